// The page about a diagnosis: one HTML file with its pictures inside, nothing fetched from anywhere.
#pragma once

#include <string>

#include "../diagnosis/diagnosis.hpp"

namespace saltus {

// Writes DIR/index.html, making DIR where there is none; returns its path. Throws std::runtime_error naming the file.
std::string write_diagnosis_page(const diagnosis::Diagnosis& d, const std::string& folder);

}  // namespace saltus
