// saltus identify for a record that no clock paces.
#pragma once

#include "hal/record.hpp"
#include "identify.hpp"

namespace saltus::program {

void identify_rhythm(const IdentifyOptions& o, const Record& record);

}  // namespace saltus::program
