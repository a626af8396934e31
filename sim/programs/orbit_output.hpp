// A limit cycle as a table for people and as JSON for machines.
#pragma once

#include <nlohmann/json.hpp>

#include "../orbit_report.hpp"

namespace saltus::program {

nlohmann::json orbit_json(const OrbitReport& report);
void print_orbit(const OrbitReport& report);

}  // namespace saltus::program
