// What saltus identify says of a model that was run beside the record of a machine that paces itself.
#pragma once

#include <nlohmann/json.hpp>

#include "../diagnosis/section_runs.hpp"

namespace saltus::program {

nlohmann::json json_of(const diagnosis::RhythmBeside& beside, const Rhythm& rhythm);
void print(const diagnosis::RhythmBeside& beside, const Rhythm& rhythm);

}  // namespace saltus::program
