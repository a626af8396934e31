// The diagnosis in ten lines a person understands.
#pragma once

#include "diagnosis.hpp"

namespace saltus::diagnosis {

void tell(Diagnosis& d);

}  // namespace saltus::diagnosis
