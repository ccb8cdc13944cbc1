// Overrides: TOML values or bare words, for a key that goes through tables and entries of lists.
#include "common/config/overrides.hpp"

#include "common/config/toml_path.hpp"
#include "common/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>

namespace undine
{
namespace
{

using namespace toml_tree;

void move_to_command_line(Node& node, const std::string& line, std::size_t shift)
{
  node.place.line = 0;
  node.place.column = std::min(line.size(), node.place.column + shift);
  node.place.length = std::max<std::size_t>(1, std::min(node.place.length, line.size() - node.place.column));
  node.place.text = line;
  node.from_override = true;
  for (Node& item : node.items)
    move_to_command_line(item, line, shift);
  for (auto& [key, member] : node.members)
  {
    move_to_command_line(member, line, shift);
    member.key_place = place_of_key(key, member.place);
  }
}

/// VALUE of an override: a TOML value, or else a text without quotes.
Node parse_override_value(const std::string& value, const std::string& line, std::size_t column)
{
  static const std::string prefix = "value = ";
  try
  {
    Node parsed = parse(prefix + value + "\n", "--set");
    if (parsed.members.size() == 1)
    {
      Node node = std::move(parsed.members.at("value"));
      move_to_command_line(node, line,
                           column - prefix.size()); // wraps around where column < 8; the sum is right
      return node;
    }
  }
  catch (const SyntaxError&)
  {
    // Not TOML: a bare word is a text. Something that begins like a list, a table or a quoted text is a
    // mistake.
    if (std::string_view("[{\"'").find(value.front()) != std::string_view::npos)
      throw InputError(diagnostic("", {.line = 0, .column = column, .length = value.size(), .text = line},
                                  "the value is not complete: check brackets and quotes"));
  }
  Node node;
  node.kind = Kind::text;
  node.text = value;
  node.place = {.line = 0, .column = column, .length = value.size(), .text = line};
  node.from_override = true;
  return node;
}

constexpr std::size_t no_such_name = ~std::size_t{0};

/// The entry of a list that a word of the key means: by its number, which may be too large, or by its name.
std::size_t index_of(const Node& list, const std::string& word)
{
  if (is_index(word))
    return std::stoul(word);
  for (std::size_t k = 0; k < list.items.size(); ++k)
    if (const Node* name = member_of(list.items[k], "name"); name != nullptr && name->text == word)
      return k;
  return no_such_name;
}

} // namespace

void apply_override(Node& root, const std::string& path, const std::string& entry)
{
  const std::string line = "--set " + entry;
  const auto fail = [&](std::size_t column, std::size_t length, const std::string& text) {
    throw InputError(diagnostic(path, {.line = 0, .column = column, .length = length, .text = line}, text));
  };

  const std::size_t equals = entry.find('=');
  if (equals == std::string::npos)
    fail(6, entry.size(), "an override reads table.key=value");
  const std::size_t first = entry.find_first_not_of(" \t", equals + 1);
  if (first == std::string::npos)
    fail(6, entry.size(), "the value is missing: an override reads table.key=value");
  const std::string value = entry.substr(first, entry.find_last_not_of(" \t") - first + 1);
  const std::vector<std::string> words = split_key(entry.substr(0, equals));
  if (std::any_of(words.begin(), words.end(), [](const std::string& word) { return word.empty(); }))
    fail(6, std::max<std::size_t>(1, equals), "an override reads table.key=value");
  if (words.size() > toml_tree::max_depth)
    fail(6, equals, fmt::format("a key of more than {} words", toml_tree::max_depth));

  const Place key_place{.line = 0, .column = 6, .length = equals, .text = line};
  Node* node = &root;
  std::string walked;
  for (const std::string& word : words)
  {
    if (node->kind == Kind::array)
    {
      const std::size_t count = node->items.size();
      const std::size_t index = index_of(*node, word);
      if (index == no_such_name)
        fail(6, equals,
             fmt::format("'{}' is a list: name the entry, for example {}.0.{}", walked, walked, word));
      if (index >= count)
        fail(6, equals, fmt::format("the case has {} entries of '{}', numbered from 0", count, walked));
      node = &node->items[index];
      walked += "[" + word + "]";
      continue;
    }
    if (node->kind != Kind::table)
      fail(6, equals, fmt::format("'{}' is a value, not a table", walked));
    const bool is_new = !node->members.contains(word);
    node = &node->members[word];
    walked += (walked.empty() ? "" : ".") + word;
    if (is_new)
    {
      node->kind = Kind::table;
      node->place = node->key_place = key_place;
      node->from_override = true;
    }
  }
  *node = parse_override_value(value, line, 6 + first);
  node->key_place = key_place;
}

} // namespace undine
