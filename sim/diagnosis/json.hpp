// A diagnosis for machines to read.
#pragma once

#include <nlohmann/json.hpp>

#include "diagnosis.hpp"

namespace saltus::diagnosis {

nlohmann::json to_json(const Diagnosis& d);

}  // namespace saltus::diagnosis
