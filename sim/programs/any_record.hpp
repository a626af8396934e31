// A record as people have it: a CSV file, or the LCM event log of a run.
#pragma once

#include <string>
#include <string_view>

#include "../../hal/lcm/logged_run.hpp"

namespace saltus::program {

// What a run's log holds, its channels named as `model` names them; where that is empty or unknown, as the model the
// log itself names, or u1, y1 ... Throws LogError.
Record record_of_log(const LoggedRun& run, std::string_view model = {});

// Throws RecordError or LogError.
Record read_any_record(const std::string& file, std::string_view model = {});

}  // namespace saltus::program
