// toml11 parses; the tree and its places are ours.
#include "common/config/toml_tree.hpp"

#include <fmt/format.h>
#include <toml.hpp>

#include <algorithm>
#include <sstream>

namespace undine::toml_tree
{

namespace
{

std::string strip_carriage_return(std::string line)
{
  if (!line.empty() && line.back() == '\r')
    line.pop_back();
  return line;
}

Place place_of(const toml::value& value)
{
  const toml::source_location where = value.location();
  Place place{.line = where.line(),
              .column = where.column() - 1,
              .length = std::max<std::size_t>(1, where.region()),
              .text = strip_carriage_return(where.line_str())};
  place.column = std::min(place.column, place.text.size());
  place.length = std::min(place.length, std::max<std::size_t>(1, place.text.size() - place.column));
  return place;
}

Node convert(const toml::value& value)
{
  Node node;
  node.place = place_of(value);
  node.key_place = node.place;
  switch (value.type())
  {
  case toml::value_t::boolean:
    node.kind = Kind::boolean;
    node.boolean = value.as_boolean();
    break;
  case toml::value_t::integer:
    node.kind = Kind::integer;
    node.integer = value.as_integer();
    node.number = static_cast<double>(node.integer);
    break;
  case toml::value_t::floating:
    node.kind = Kind::number;
    node.number = value.as_floating();
    break;
  case toml::value_t::string:
    node.kind = Kind::text;
    node.text = value.as_string().str;
    break;
  case toml::value_t::array:
    node.kind = Kind::array;
    for (const toml::value& item : value.as_array())
      node.items.push_back(convert(item));
    break;
  case toml::value_t::table:
    node.kind = Kind::table;
    for (const auto& [key, member] : value.as_table())
    {
      Node& child = node.members[key] = convert(member);
      child.key_place = place_of_key(key, child.place);
    }
    break;
  default:
    break;
  }
  return node;
}

std::size_t count_characters(std::string_view utf8)
{
  return static_cast<std::size_t>(
      std::count_if(utf8.begin(), utf8.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

} // namespace

Place place_of_key(const std::string& key, const Place& value)
{
  const std::size_t found = value.text.rfind(key, value.column);
  if (found == std::string::npos)
    return value;
  return {.line = value.line, .column = found, .length = key.size(), .text = value.text};
}

std::string diagnostic(const std::string& path, const Place& place, const std::string& text)
{
  const std::string_view line = place.text;
  const std::string_view before = line.substr(0, place.column);
  const std::string_view marked = line.substr(before.size(), place.length);
  std::string blanks; // tabs stay tabs, so that the caret stands below its place on every terminal
  for (const char c : before)
    if ((c & 0xC0) != 0x80)
      blanks += c == '\t' ? '\t' : ' ';
  const std::size_t width = std::max<std::size_t>(1, count_characters(marked));
  const std::string where = place.line == 0
                                ? std::string("command line")
                                : fmt::format("{}:{}:{}", path, place.line, count_characters(before) + 1);
  return fmt::format("{}: {}\n  {}\n  {}^{}", where, text, line, blanks, std::string(width - 1, '~'));
}

namespace
{

/// toml11 says where a text breaks the grammar in its message only; take line, source and caret from the last
/// snippet.
std::string syntax_diagnostic(const std::string& path, const std::string& message)
{
  std::vector<std::string> lines;
  std::istringstream stream(message);
  for (std::string line; std::getline(stream, line);)
    lines.push_back(line);

  std::string summary = lines.empty() ? message : lines[0];
  if (const std::string prefix = "[error] "; summary.starts_with(prefix))
    summary.erase(0, prefix.size());
  if (summary.starts_with("toml::"))
    if (const std::size_t colon = summary.find(": "); colon != std::string::npos)
      summary.erase(0, colon + 2);

  Place place;
  std::string comment;
  std::size_t first_line = 0;
  for (std::size_t i = 0; i + 1 < lines.size(); ++i)
  {
    const std::size_t bar = lines[i].find(" | ");
    const std::size_t number = lines[i].find_first_not_of(' ');
    if (bar == std::string::npos || number >= bar ||
        lines[i].find_first_not_of("0123456789", number) != bar || lines[i + 1].size() < bar + 3)
      continue;
    place.line = std::stoul(lines[i].substr(number, bar - number));
    place.text = strip_carriage_return(lines[i].substr(bar + 3));
    const std::string marks = lines[i + 1].substr(bar + 3);
    place.column = std::min(marks.find_first_of("^~"), place.text.size());
    place.length =
        std::max<std::size_t>(1, static_cast<std::size_t>(std::count(marks.begin(), marks.end(), '~')));
    const std::size_t end = marks.find_first_not_of("^~- ");
    comment = end == std::string::npos ? "" : marks.substr(end);
    if (first_line == 0)
      first_line = place.line;
  }

  const std::size_t open = summary.find("(\""), close = summary.find("\")");
  if (summary.find("already exists") != std::string::npos && open != std::string::npos && close > open)
    summary = fmt::format("'{}' is written twice (first on line {}): keep one",
                          summary.substr(open + 2, close - open - 2), first_line);
  else
    summary =
        "not valid TOML: " + summary + (comment.empty() || comment == "here" ? "" : " (" + comment + ")");
  if (place.line == 0)
    return path + ": " + summary;
  return diagnostic(path, place, summary);
}

/// Bytes of the UTF-8 character that begins `text`; 0 if it begins with none (RFC 3629).
std::size_t utf8_length(std::string_view text)
{
  const auto byte = [&text](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  const std::size_t length = lead < 0x80   ? 1
                             : lead < 0xC2 ? 0
                             : lead < 0xE0 ? 2
                             : lead < 0xF0 ? 3
                             : lead < 0xF5 ? 4
                                           : 0;
  if (length > text.size())
    return 0;
  for (std::size_t i = 1; i < length; ++i)
    if ((byte(i) & 0xC0) != 0x80)
      return 0;
  const bool too_long = (lead == 0xE0 && byte(1) < 0xA0) || (lead == 0xF0 && byte(1) < 0x90);
  const bool out_of_range = (lead == 0xED && byte(1) >= 0xA0) || (lead == 0xF4 && byte(1) >= 0x90);
  return too_long || out_of_range ? 0 : length;
}

/// toml11 3.7.1 reads out of bounds where a text is not UTF-8 (a file saved as Latin-1): refuse it before.
void require_utf8(const std::string& text, const std::string& path)
{
  std::size_t line = 1, line_begin = 0;
  for (std::size_t i = 0; i < text.size();)
  {
    const std::size_t length = utf8_length(std::string_view(text).substr(i));
    if (length == 0)
      throw InputError(
          fmt::format("{}:{}:{}: not valid UTF-8: save the file in this encoding", path, line,
                      count_characters(std::string_view(text).substr(line_begin, i - line_begin)) + 1));
    if (text[i] == '\n')
    {
      ++line;
      line_begin = i + 1;
    }
    i += length;
  }
}

/// toml11 goes down a level of the stack for every bracket and our tree for every word of a key: refuse what
/// nobody writes, before.
void require_shallow(const std::string& text, const std::string& path)
{
  std::size_t line = 1, line_begin = 0, brackets = 0, dots = 0;
  std::string_view quote; // of the text in which we are
  for (std::size_t i = 0; i < text.size(); ++i)
  {
    const std::string_view rest = std::string_view(text).substr(i);
    if (rest[0] == '\n')
    {
      ++line;
      line_begin = i + 1;
      dots = 0;
      if (quote.size() == 1)
        quote = {}; // not closed: toml11 says so
    }
    else if (!quote.empty())
    {
      if (rest[0] == '\\' && quote[0] == '"' && rest.size() > 1 && rest[1] != '\n')
        ++i;
      else if (rest.starts_with(quote))
      {
        i += quote.size() - 1;
        for (int own = 0; own < 2 && quote.size() == 3 && i + 1 < text.size() && text[i + 1] == quote[0];
             ++own)
          ++i; // up to two quotes may stand before the closing three
        quote = {};
      }
    }
    else if (rest[0] == '#')
      i = std::min(text.find('\n', i), text.size()) - 1;
    else if (rest[0] == '"' || rest[0] == '\'')
    {
      const bool several_lines = rest.starts_with(R"(""")") || rest.starts_with("'''");
      quote = rest.substr(0, several_lines ? 3 : 1);
      i += quote.size() - 1;
    }
    else
    {
      brackets += rest[0] == '[' || rest[0] == '{';
      brackets -= (rest[0] == ']' || rest[0] == '}') && brackets > 0;
      dots = std::string_view("=,[{").find(rest[0]) != std::string_view::npos ? 0 : dots + (rest[0] == '.');
      if (brackets > max_depth || dots >= max_depth)
        throw InputError(fmt::format(
            "{}:{}:{}: more than {} levels: {}", path, line,
            count_characters(std::string_view(text).substr(line_begin, i - line_begin)) + 1, max_depth,
            dots >= max_depth ? "a case has keys of few words" : "is a bracket not closed?"));
    }
  }
}

} // namespace

Node parse(const std::string& text, const std::string& path)
{
  require_utf8(text, path);
  require_shallow(text, path);
  std::istringstream stream(text);
  try
  {
    return convert(toml::parse(stream, path));
  }
  catch (const toml::exception& error)
  {
    throw SyntaxError(syntax_diagnostic(path, error.what()));
  }
  catch (const std::exception& error)
  {
    throw SyntaxError(path + ": not valid TOML: " + error.what());
  }
}

} // namespace undine::toml_tree
