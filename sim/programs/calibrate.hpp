// saltus calibrate: how often is a diagnosis right? Declared here and called by diagnose.cpp, whose judge it is.
#pragma once

#include "program.hpp"

namespace saltus::program {
void add_calibrate(CLI::App& app);
}
