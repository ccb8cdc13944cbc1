// A TOML text as a plain tree that keeps the place of every value; the only user of toml11, whose templates
// are slow to compile.
#pragma once

#include "common/error.hpp"

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace undine::toml_tree
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

/// The text breaks the grammar of TOML.
class SyntaxError : public InputError
{
public:
  using InputError::InputError;
};

/// Levels of a case: brackets in each other, and words of a dotted key.
inline constexpr std::size_t max_depth = 32;

/// The root table of `text`; `path` names it in messages. Throws SyntaxError with line, source and caret, and
/// InputError where the text is not UTF-8 or deeper than `max_depth`.
Node parse(const std::string& text, const std::string& path);

/// Place of the key in front of its value: toml11 keeps none, so it is the last word of that name there.
Place place_of_key(const std::string& key, const Place& value);

/// "path:line:column: text", the source line, and a caret under the place.
std::string diagnostic(const std::string& path, const Place& place, const std::string& text);

} // namespace undine::toml_tree
