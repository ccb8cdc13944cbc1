// Names and paths in a TOML tree.
#include "common/config/toml_path.hpp"

#include <algorithm>

namespace undine::toml_tree
{

bool is_array_of_tables(const Node& node)
{
  return node.kind == Kind::array && !node.items.empty() &&
         std::all_of(node.items.begin(), node.items.end(),
                     [](const Node& item) { return item.kind == Kind::table; });
}

std::string as_written(const Node& node)
{
  const Place& place = node.place;
  std::string text = place.text.substr(place.column, place.length);
  if (node.kind == Kind::array && !text.ends_with(']'))
    text += " ...";
  return text;
}

const Node* member_of(const Node& table, std::string_view name)
{
  const auto found = table.members.find(std::string(name));
  return found == table.members.end() ? nullptr : &found->second;
}

std::vector<std::string> split_key(const std::string& key)
{
  std::vector<std::string> words(1);
  for (const char c : key)
    if (c == '.' || c == '[')
      words.emplace_back();
    else if (c != ']' && c != ' ')
      words.back() += c;
  return words;
}

bool is_index(const std::string& word)
{
  return !word.empty() && word.size() < 6 && word.find_first_not_of("0123456789") == std::string::npos;
}

} // namespace undine::toml_tree
