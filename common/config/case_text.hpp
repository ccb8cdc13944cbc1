// The text of a case as a tree of values that know where they are written.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace undine
{

/// Where something is written: a line of the file, or an override of the command line (line 0).
struct Place
{
  std::size_t line = 0;
  std::size_t column = 0; ///< byte offset in `text`, from 0
  std::size_t length = 1; ///< bytes
  std::string text;       ///< the source line
};

enum class Kind
{
  boolean,
  integer,
  number,
  text,
  array,
  table,
  other // dates and times: TOML has them, a case does not use them
};

struct Node
{
  Kind kind = Kind::other;
  bool boolean = false;
  std::int64_t integer = 0;
  double number = 0.0;
  std::string text;
  std::vector<Node> items;
  std::map<std::string, Node> members;
  Place place;     ///< of the value
  Place key_place; ///< of the key, or of the header of a table
  bool from_override = false;
};

/// The tree of a TOML text. @throws InputError with line and caret where it is none; `path` names it there
Node parse_case_text(const std::string& text, const std::string& path);

/// Put the value of `entry`, "table.key=VALUE", into the tree; VALUE is a TOML value, or else a text without
/// quotes. Entries of lists are named by number or by their `name`. @throws InputError with a caret
void apply_override(Node& root, const std::string& path, const std::string& entry);

bool is_array_of_tables(const Node& node);

/// The value as the user wrote it, first line only.
std::string as_written(const Node& node);

/// "path:line:column: text", the source line, and a caret under the place.
std::string diagnostic(const std::string& path, const Place& place, const std::string& text);

/// Words of "table[0].key" or "table.0.key".
std::vector<std::string> split_key(const std::string& key);

/// A word of digits only, five at most.
bool is_index(const std::string& word);

} // namespace undine
