// The diagnosis in ten lines a person understands.
#pragma once

#include "diagnosis.hpp"

namespace saltus::diagnosis {

std::string verdict_sentence(const Diagnosis& d);

void tell(Diagnosis& d);

// Of a record that no clock paces.
void tell_self_paced(Diagnosis& d);

}  // namespace saltus::diagnosis
