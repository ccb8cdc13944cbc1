// Nodes of a TOML tree by name and by path.
#pragma once

#include "common/config/toml_tree.hpp"

#include <string>
#include <string_view>
#include <vector>

namespace undine::toml_tree
{

bool is_array_of_tables(const Node& node);

/// The value as the user wrote it, first line only.
std::string as_written(const Node& node);

/// nullptr if the table has no such member.
const Node* member_of(const Node& table, std::string_view name);

/// Words of a key: "interface[0].patch" and "interface.0.patch" are interface, 0, patch.
std::vector<std::string> split_key(const std::string& key);

/// The word is the number of an entry.
bool is_index(const std::string& word);

} // namespace undine::toml_tree
