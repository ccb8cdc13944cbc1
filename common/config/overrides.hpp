// What --set changes in the tree of a case.
#pragma once

#include "common/config/toml_tree.hpp"

#include <string>

namespace undine
{

/// Sets what `entry`, "table.key=VALUE", says; tables that are not there are made. `path` is that of the
/// case, for messages. @throws InputError
void apply_override(toml_tree::Node& root, const std::string& path, const std::string& entry);

} // namespace undine
