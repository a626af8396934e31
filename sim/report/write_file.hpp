// Files that a program leaves behind: whole or not at all.
#pragma once

#include <string>

namespace saltus {

// Writes beside the target and renames, so that no half-written file is ever seen; through a symbolic link, which stays
// one; straight into what cannot be replaced, such as /dev/stdout. Throws std::runtime_error, naming the path.
void write_file(const std::string& path, const std::string& text);

// Throws the same error now, before long work, where it can be told already: the folder is missing or closed.
void check_writable(const std::string& path);

}  // namespace saltus
