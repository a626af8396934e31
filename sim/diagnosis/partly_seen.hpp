// A machine of which a record has some outputs only: nothing is asked of the others.
#pragma once

#include <memory>

#include "hal/record.hpp"
#include "machine.hpp"

namespace saltus::diagnosis {

// The machine without the outputs that the record lacks; null where it lacks none, has none, or has one that the
// machine does not know. What may be wrong with their sensors is no candidate. `machine` must outlive it.
std::unique_ptr<Machine> as_recorded(const Machine& machine, const Record& record);

}  // namespace saltus::diagnosis
