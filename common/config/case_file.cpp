// Reads typed values from the tree of a case file and reports mistakes with line and caret.
#include "common/config/case_file.hpp"

#include "common/config/toml_tree.hpp"
#include "common/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

namespace undine
{

namespace
{

using namespace toml_tree;

const std::vector<std::string> top_level_tables = {"run",   "fluid",  "solid",      "coupling", "interface",
                                                   "probe", "output", "checkpoint", "reference"};

bool is_array_of_tables(const Node& node)
{
  return node.kind == Kind::array && !node.items.empty() &&
         std::all_of(node.items.begin(), node.items.end(),
                     [](const Node& item) { return item.kind == Kind::table; });
}

/// The value as the user wrote it, first line only.
std::string as_written(const Node& node)
{
  const Place& place = node.place;
  std::string text = place.text.substr(place.column, place.length);
  if (node.kind == Kind::array && !text.ends_with(']'))
    text += " ...";
  return text;
}

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
  for (std::size_t i = 0; i < words.size(); ++i)
  {
    const std::string& word = words[i];
    if (node->kind == Kind::array && is_index(word))
    {
      const std::size_t index = std::stoul(word);
      if (index >= node->items.size())
        fail(6, equals,
             fmt::format("the case has {} entries of '{}', numbered from 0", node->items.size(), walked));
      node = &node->items[index];
      walked += "[" + word + "]";
      continue;
    }
    const auto named = std::find_if(node->items.begin(), node->items.end(),
                                    [&word](const Node& item)
                                    {
                                      const auto name = item.members.find("name");
                                      return name != item.members.end() && name->second.text == word;
                                    });
    if (node->kind == Kind::array && named != node->items.end())
    {
      node = &*named;
      walked += "[" + word + "]";
      continue;
    }
    if (node->kind == Kind::array)
      fail(6, equals,
           fmt::format("'{}' is a list: name the entry, for example {}.0.{}", walked, walked, word));
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

std::size_t edit_distance(std::string_view a, std::string_view b)
{
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j)
    row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i)
  {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j)
    {
      const std::size_t above = row[j];
      row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row[b.size()];
}

std::string quoted_list(const std::vector<std::string>& words)
{
  std::string list;
  for (const std::string& word : words)
    list += (list.empty() ? "\"" : ", \"") + word + "\"";
  return list;
}

std::string meaning_of(const Key& key)
{
  return key.unit.empty() ? fmt::format("({})", key.meaning) : fmt::format("({}, {})", key.meaning, key.unit);
}

std::string number_text(double value) { return fmt::format("{:.12g}", value); }

/// "interface[0].patch" → "interface[].patch": all entries of a list of tables share one description.
std::string generic_path(const std::string& path)
{
  std::string generic;
  bool inside = false;
  for (const char c : path)
  {
    if (c == ']')
      inside = false;
    if (!inside)
      generic += c;
    if (c == '[')
      inside = true;
  }
  return generic;
}

struct KeyRow
{
  std::string name, type, unit, default_value, rule, meaning;
};

struct TableDescription
{
  std::string path, meaning;
  std::vector<KeyRow> rows;
};

} // namespace

class CaseDocument
{
public:
  std::string path;
  std::uint64_t hash = 0;
  Node root;
  std::vector<TableDescription> descriptions;
  std::map<std::string, std::set<std::string>> known;    ///< generic table path → names that were read
  std::map<std::string, std::vector<std::string>> names; ///< of the entries of a list, once one was chosen

  void describe_table(const std::string& table_path, std::string_view meaning)
  {
    const std::string generic = generic_path(table_path);
    for (const TableDescription& description : descriptions)
      if (description.path == generic)
        return;
    descriptions.push_back({generic, std::string(meaning), {}});
  }

  void describe_key(const std::string& table_path, const Key& key, const std::string& type,
                    const std::string& default_value, std::string rule)
  {
    const std::string generic = generic_path(table_path);
    known[generic].insert(std::string(key.name));
    for (TableDescription& description : descriptions)
    {
      if (description.path != generic)
        continue;
      for (const KeyRow& row : description.rows)
        if (row.name == key.name)
          return;
      for (const std::string prefix : {"must be ", "must lie "})
        if (rule.starts_with(prefix))
          rule.erase(0, prefix.size());
      description.rows.push_back({std::string(key.name), type, std::string(key.unit), default_value, rule,
                                  std::string(key.meaning)});
    }
  }

  [[noreturn]] void fail_at(const Place& place, const std::string& text) const
  {
    throw InputError(diagnostic(path, place, text));
  }

  std::vector<std::string> known_names(const std::string& table_path) const
  {
    const auto found = known.find(generic_path(table_path));
    if (found == known.end())
      return {};
    return {found->second.begin(), found->second.end()};
  }

  [[noreturn]] void fail_unknown(const std::string& table_path, const std::string& name, const Node& node,
                                 const std::vector<std::string>& candidates) const
  {
    const std::string full = table_path.empty() ? name : table_path + "." + name;
    const bool is_table = node.kind == Kind::table || is_array_of_tables(node);
    std::string text = fmt::format("unknown {} '{}'", is_table ? "table" : "key", full);
    if (const std::string near = nearest_word(name, candidates); !near.empty())
      text += fmt::format(": did you mean '{}'?", near);
    else if (!candidates.empty())
      text += fmt::format(": known here are {}", fmt::join(candidates, ", "));
    fail_at(node.key_place, text);
  }

  void reject_unknown(const Node& table, const std::string& table_path) const
  {
    const std::vector<std::string> names = known_names(table_path);
    for (const Node* member : in_order(table))
    {
      const std::string& name = member_name(table, member);
      if (std::find(names.begin(), names.end(), name) == names.end())
        fail_unknown(table_path, name, *member, names);
      reject_unknown_below(*member, table_path.empty() ? name : table_path + "." + name);
    }
  }

  void reject_unknown_below(const Node& node, const std::string& node_path) const
  {
    if (node.kind == Kind::table)
      reject_unknown(node, node_path);
    else if (is_array_of_tables(node))
      for (std::size_t i = 0; i < node.items.size(); ++i)
        reject_unknown(node.items[i], fmt::format("{}[{}]", node_path, i));
  }

  /// Members in the order of the file, overrides last, so that the first mistake is reported first.
  static std::vector<const Node*> in_order(const Node& table)
  {
    std::vector<const Node*> members;
    for (const auto& [name, member] : table.members)
      members.push_back(&member);
    std::stable_sort(members.begin(), members.end(),
                     [](const Node* a, const Node* b)
                     {
                       const auto rank = [](const Node* n)
                       { return n->key_place.line == 0 ? ~std::size_t{0} : n->key_place.line; };
                       return rank(a) < rank(b);
                     });
    return members;
  }

  static const std::string& member_name(const Node& table, const Node* member)
  {
    return std::find_if(table.members.begin(), table.members.end(),
                        [member](const auto& entry) { return &entry.second == member; })
        ->first;
  }
};

namespace
{

const Node* as_node(const void* pointer) { return static_cast<const Node*>(pointer); }

/// One read of one key: finds the value, marks the key as known, and words the errors.
struct Reading
{
  CaseDocument& document;
  const Node* table;
  const std::string& table_path;
  const Key& key;
  std::string full; ///< "fluid.density"

  Reading(CaseDocument& d, const void* t, const std::string& p, const Key& k)
      : document(d), table(as_node(t)), table_path(p), key(k), full(p + "." + std::string(k.name))
  {
  }

  const Node* value() const
  {
    if (table == nullptr)
      return nullptr;
    const auto found = table->members.find(std::string(key.name));
    return found == table->members.end() ? nullptr : &found->second;
  }

  const Node& required_value() const
  {
    if (const Node* node = value())
      return *node;
    const std::string what = fmt::format("missing key '{}' {}", full, meaning_of(key));
    if (table == nullptr)
      throw InputError(fmt::format("{}: {}: the case has no table [{}]", document.path, what, table_path));
    // A required key that is misspelt is better reported where it stands.
    const std::vector<std::string> names = document.known_names(table_path);
    for (const auto& [name, member] : table->members)
      if (std::find(names.begin(), names.end(), name) == names.end() &&
          nearest_word(name, {std::string(key.name)}) == key.name)
        document.fail_unknown(table_path, name, member, {std::string(key.name)});
    document.fail_at(table->place, what);
  }

  [[noreturn]] void fail(const Node& node, const std::string& rule) const { fail(node, full, rule); }
  [[noreturn]] void fail(const Node& node, const std::string& name, const std::string& rule) const
  {
    document.fail_at(node.place,
                     fmt::format("{} = {}: {} {}", name, as_written(node), rule, meaning_of(key)));
  }

  double number_of(const Node& node, const std::string& name, const Rule& rule) const
  {
    if (node.kind != Kind::integer && node.kind != Kind::number)
      fail(node, name, "must be a number");
    if (!std::isfinite(node.number))
      fail(node, name, "must be finite");
    if (!rule.holds(node.number))
      fail(node, name, rule.text);
    return node.number;
  }

  std::int64_t integer_of(const Node& node, const Rule& rule) const
  {
    if (node.kind != Kind::integer)
      fail(node, "must be an integer");
    if (!rule.holds(node.number))
      fail(node, rule.text);
    return node.integer;
  }

  std::string text_of(const Node& node, const std::string& name) const
  {
    if (node.kind == Kind::text)
      return node.text;
    if (node.from_override && (node.kind == Kind::integer || node.kind == Kind::number ||
                               node.kind == Kind::boolean || node.kind == Kind::other))
      return as_written(node); // --set run.name=7: the shell has eaten the quotes
    fail(node, name, "must be a text in quotes");
  }

  std::string choice_of(const Node& node, const std::vector<std::string>& choices) const
  {
    const std::string word = text_of(node, full);
    if (std::find(choices.begin(), choices.end(), word) != choices.end())
      return word;
    std::string rule = "must be one of " + quoted_list(choices);
    if (const std::string near = nearest_word(word, choices); !near.empty())
      rule += fmt::format("; did you mean \"{}\"?", near);
    fail(node, rule);
  }

  const Node& list_of(const Node& node, const char* of_what) const
  {
    if (node.kind != Kind::array)
      fail(node, fmt::format("must be a list of {}", of_what));
    return node;
  }

  std::vector<double> numbers_of(const Node& node, std::size_t size, const Rule& rule) const
  {
    list_of(node, "numbers");
    if (size > 0 && node.items.size() != size)
      fail(node, fmt::format("must have {} entries, not {}", size, node.items.size()));
    std::vector<double> values;
    for (std::size_t i = 0; i < node.items.size(); ++i)
      values.push_back(number_of(node.items[i], fmt::format("{}[{}]", full, i), rule));
    return values;
  }

  void describe(const std::string& type, const std::string& default_value, const std::string& rule) const
  {
    document.describe_key(table_path, key, type, default_value, rule);
  }
};

const std::string required_key = "required";
const std::string no_default = "none";

std::string list_type(std::size_t size)
{
  return size > 0 ? fmt::format("{} numbers", size) : std::string("numbers");
}

std::string list_text(const std::vector<double>& values)
{
  std::string text;
  for (const double value : values)
    text += (text.empty() ? "" : ", ") + number_text(value);
  return "[" + text + "]";
}

} // namespace

// Rules
// ---------------------------------------------------------------------------------------------------------

Rule any_number()
{
  return {[](double) { return true; }, "must be a number"};
}
Rule positive()
{
  return {[](double x) { return x > 0.0; }, "must be positive"};
}
Rule non_negative()
{
  return {[](double x) { return x >= 0.0; }, "must not be negative"};
}
Rule at_least(double lower)
{
  return {[lower](double x) { return x >= lower; }, "must be at least " + number_text(lower)};
}
Rule between(double lower, double upper)
{
  return {[lower, upper](double x) { return x >= lower && x <= upper; },
          fmt::format("must lie in [{}, {}]", number_text(lower), number_text(upper))};
}
Rule strictly_between(double lower, double upper)
{
  return {[lower, upper](double x) { return x > lower && x < upper; },
          fmt::format("must lie in ({}, {})", number_text(lower), number_text(upper))};
}

// CaseTable
// -----------------------------------------------------------------------------------------------------

CaseTable::CaseTable(std::shared_ptr<CaseDocument> document, const void* node, std::string path)
    : document_(std::move(document)), node_(node), path_(std::move(path))
{
}

bool CaseTable::present() const { return node_ != nullptr; }

bool CaseTable::has(std::string_view name) const
{
  return node_ != nullptr && as_node(node_)->members.contains(std::string(name));
}

const std::string& CaseTable::path() const { return path_; }

double CaseTable::number(const Key& key, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("number", required_key, rule.text);
  return reading.number_of(reading.required_value(), reading.full, rule);
}

double CaseTable::number(const Key& key, double default_value, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("number", number_text(default_value), rule.text);
  const Node* node = reading.value();
  return node ? reading.number_of(*node, reading.full, rule) : default_value;
}

std::optional<double> CaseTable::optional_number(const Key& key, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("number", no_default, rule.text);
  const Node* node = reading.value();
  return node ? std::optional(reading.number_of(*node, reading.full, rule)) : std::nullopt;
}

std::int64_t CaseTable::integer(const Key& key, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("integer", required_key, rule.text);
  return reading.integer_of(reading.required_value(), rule);
}

std::int64_t CaseTable::integer(const Key& key, std::int64_t default_value, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("integer", fmt::format("{}", default_value), rule.text);
  const Node* node = reading.value();
  return node ? reading.integer_of(*node, rule) : default_value;
}

std::optional<std::int64_t> CaseTable::optional_integer(const Key& key, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("integer", no_default, rule.text);
  const Node* node = reading.value();
  return node ? std::optional(reading.integer_of(*node, rule)) : std::nullopt;
}

bool CaseTable::boolean(const Key& key, bool default_value) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("boolean", default_value ? "true" : "false", "");
  const Node* node = reading.value();
  if (node == nullptr)
    return default_value;
  if (node->kind != Kind::boolean)
    reading.fail(*node, "must be true or false");
  return node->boolean;
}

std::string CaseTable::text(const Key& key) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("text", required_key, "");
  return reading.text_of(reading.required_value(), reading.full);
}

std::string CaseTable::text(const Key& key, std::string_view default_value) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("text", fmt::format("\"{}\"", default_value), "");
  const Node* node = reading.value();
  return node ? reading.text_of(*node, reading.full) : std::string(default_value);
}

std::optional<std::string> CaseTable::optional_text(const Key& key) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("text", no_default, "");
  const Node* node = reading.value();
  return node ? std::optional(reading.text_of(*node, reading.full)) : std::nullopt;
}

std::string CaseTable::choice(const Key& key, const std::vector<std::string>& choices) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("text", required_key, "one of " + quoted_list(choices));
  return reading.choice_of(reading.required_value(), choices);
}

std::string CaseTable::choice(const Key& key, std::string_view default_value,
                              const std::vector<std::string>& choices) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("text", fmt::format("\"{}\"", default_value), "one of " + quoted_list(choices));
  const Node* node = reading.value();
  return node ? reading.choice_of(*node, choices) : std::string(default_value);
}

std::vector<double> CaseTable::numbers(const Key& key, std::size_t size, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe(list_type(size), required_key, rule.text);
  return reading.numbers_of(reading.required_value(), size, rule);
}

std::vector<double> CaseTable::numbers(const Key& key, std::size_t size,
                                       const std::vector<double>& default_value, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe(list_type(size), list_text(default_value), rule.text);
  const Node* node = reading.value();
  return node ? reading.numbers_of(*node, size, rule) : default_value;
}

std::vector<std::string> CaseTable::texts(const Key& key, const std::vector<std::string>& default_value) const
{
  const Reading reading(*document_, node_, path_, key);
  reading.describe("texts", "[" + quoted_list(default_value) + "]", "");
  const Node* node = reading.value();
  if (node == nullptr)
    return default_value;
  std::vector<std::string> values;
  for (const Node& item : reading.list_of(*node, "texts").items)
    values.push_back(reading.text_of(item, fmt::format("{}[{}]", reading.full, values.size())));
  return values;
}

bool CaseTable::is_text(std::string_view name) const
{
  return has(name) && as_node(node_)->members.at(std::string(name)).kind == Kind::text;
}

namespace
{

const Node* find_table(const CaseDocument& document, const Node* parent, const std::string& name,
                       const std::string& full)
{
  if (parent == nullptr)
    return nullptr;
  const auto found = parent->members.find(name);
  if (found == parent->members.end())
    return nullptr;
  const Node& node = found->second;
  if (is_array_of_tables(node))
    document.fail_at(node.place, fmt::format("'{}' is one table: write [{}]", full, full));
  if (node.kind != Kind::table)
    document.fail_at(node.place,
                     fmt::format("{} = {}: must be a table: write [{}]", full, as_written(node), full));
  return &node;
}

std::vector<const Node*> find_tables(const CaseDocument& document, const Node* parent,
                                     const std::string& name, const std::string& full)
{
  if (parent == nullptr)
    return {};
  const auto found = parent->members.find(name);
  if (found == parent->members.end())
    return {};
  const Node& node = found->second;
  if (!is_array_of_tables(node))
    document.fail_at(node.place, fmt::format("'{}' is a list of tables: write [[{}]]", full, full));
  std::vector<const Node*> tables;
  for (const Node& item : node.items)
    tables.push_back(&item);
  return tables;
}

} // namespace

CaseTable CaseTable::table(std::string_view name, std::string_view meaning) const
{
  const std::string full = path_ + "." + std::string(name);
  document_->known[generic_path(path_)].insert(std::string(name));
  document_->describe_table(full, meaning);
  return CaseTable(document_, find_table(*document_, as_node(node_), std::string(name), full), full);
}

std::vector<CaseTable> CaseTable::tables(std::string_view name, std::string_view meaning) const
{
  const std::string full = path_ + "." + std::string(name);
  document_->known[generic_path(path_)].insert(std::string(name));
  document_->describe_table(full + "[]", meaning);
  std::vector<CaseTable> entries;
  for (const Node* node : find_tables(*document_, as_node(node_), std::string(name), full))
    entries.push_back(CaseTable(document_, node, fmt::format("{}[{}]", full, entries.size())));
  return entries;
}

void CaseTable::fail(std::string_view name, const std::string& text) const
{
  const std::string full = name.empty() ? path_ : path_ + "." + std::string(name);
  if (node_ == nullptr)
    throw InputError(
        fmt::format("{}: {}: {} (the case has no table [{}])", document_->path, full, text, path_));
  const Node& table = *as_node(node_);
  const auto found = table.members.find(std::string(name));
  if (found == table.members.end())
    document_->fail_at(table.place, fmt::format("{}: {}", full, text));
  document_->fail_at(found->second.place, fmt::format("{} = {}: {}", full, as_written(found->second), text));
}

// CaseFile
// ------------------------------------------------------------------------------------------------------

namespace
{

/// The quoted word at the beginning of `text`, or nothing.
std::optional<std::string_view> quoted_word(std::string_view text)
{
  if (text.empty() || (text[0] != '"' && text[0] != '\''))
    return std::nullopt;
  const std::size_t end = text.find(text[0], 1);
  return end == std::string_view::npos ? std::nullopt : std::optional(text.substr(1, end - 1));
}

const Node* member_of(const Node& table, std::string_view name)
{
  const auto found = table.members.find(std::string(name));
  return found == table.members.end() ? nullptr : &found->second;
}

/// `interface "wet": solid = ...`: the key of that entry, or the entry itself if the next word is none of its
/// keys.
const Node* find_in_named_entry(const Node& root, std::string_view list_name, std::string_view rest)
{
  const Node* list = member_of(root, list_name);
  const auto name = quoted_word(rest);
  if (list == nullptr || !name)
    return nullptr;
  for (const Node& entry : list->items)
    if (const Node* own = member_of(entry, "name"); own != nullptr && own->text == *name)
    {
      rest.remove_prefix(std::min(rest.size(), name->size() + 4)); // two quotes, colon, blank
      const Node* member = member_of(entry, rest.substr(0, rest.find_first_of(" :")));
      return member == nullptr ? &entry : member;
    }
  return nullptr;
}

/// What of the case a message begins with, or nullptr. See CaseFile::with_place.
const Node* find_mentioned(const Node& root, std::string_view text)
{
  const std::size_t end = text.find_first_of(" :");
  if (end == std::string_view::npos)
    return nullptr;
  const std::string path(text.substr(0, end));
  if (text[end] == ' ' && (path == "interface" || path == "probe"))
    return find_in_named_entry(root, path, text.substr(end + 1));

  const std::size_t equals = text.find("= ", end);
  const auto value = equals == end + 1 ? quoted_word(text.substr(equals + 2)) : std::nullopt;
  std::vector<const Node*> front{&root}; // without a number, "fluid.wall.on" may be any entry of the list
  for (const std::string& word : split_key(path))
  {
    std::vector<const Node*> next;
    for (const Node* node : front)
      if (is_index(word))
      {
        if (const std::size_t index = std::stoul(word); index < node->items.size())
          next.push_back(&node->items[index]);
      }
      else if (const Node* member = member_of(*node, word))
        next.push_back(member);
      else
        for (const Node& item : node->items)
          if (const Node* of_item = member_of(item, word))
            next.push_back(of_item);
    front = std::move(next);
  }
  for (const Node* node : front)
    if (!value || node->text == *value)
      return node;
  return nullptr;
}

/// The value that names the file a message begins with, as in "cases/gate/gate.msh: cannot be read", or
/// nullptr.
const Node* find_mentioned_file(const Node& node, std::string_view text, const CaseFile& file)
{
  if (node.kind == Kind::text && !node.text.empty() && text.starts_with(file.resolve(node.text) + ":"))
    return &node;
  for (const Node& item : node.items)
    if (const Node* found = find_mentioned_file(item, text, file))
      return found;
  for (const auto& [name, member] : node.members)
    if (const Node* found = find_mentioned_file(member, text, file))
      return found;
  return nullptr;
}

} // namespace

CaseFile CaseFile::read(const std::string& path, const std::vector<std::string>& overrides)
{
  if (!std::filesystem::is_regular_file(path))
    throw InputError(path + ": there is no such case file", ExitCode::bad_input_file);
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  if (!file)
    throw InputError(path + ": the case file cannot be read", ExitCode::bad_input_file);
  return parse(text.str(), path, overrides);
}

CaseFile CaseFile::parse(const std::string& text, const std::string& path,
                         const std::vector<std::string>& overrides)
{
  auto document = std::make_shared<CaseDocument>();
  document->path = path;
  document->root = toml_tree::parse(text, path);
  for (const std::string& entry : overrides)
    apply_override(document->root, path, entry);

  // FNV-1a, 64 bits (Fowler, Noll, Vo); a zero byte parts the text and each override.
  std::uint64_t hash = 14695981039346656037ull;
  const auto add = [&hash](std::string_view bytes)
  {
    for (const char c : bytes)
      hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211ull;
    hash *= 1099511628211ull;
  };
  add(text);
  for (const std::string& entry : overrides)
    add(entry);
  document->hash = hash == 0 ? 1 : hash;

  if (const auto schema = document->root.members.find("schema"); schema != document->root.members.end())
    if (schema->second.kind != Kind::integer || schema->second.integer != 1)
      document->fail_at(schema->second.place,
                        fmt::format("schema = {}: must be 1 (this program reads schema 1 of the case file)",
                                    as_written(schema->second)));
  return CaseFile(std::move(document));
}

CaseTable CaseFile::table(std::string_view name, std::string_view meaning) const
{
  const std::string full(name);
  document_->describe_table(full, meaning);
  return CaseTable(document_, find_table(*document_, &document_->root, full, full), full);
}

std::vector<CaseTable> CaseFile::tables(std::string_view name, std::string_view meaning) const
{
  const std::string full(name);
  document_->describe_table(full + "[]", meaning);
  std::vector<CaseTable> entries;
  for (const Node* node : find_tables(*document_, &document_->root, full, full))
    entries.push_back(CaseTable(document_, node, fmt::format("{}[{}]", full, entries.size())));
  return entries;
}

bool CaseFile::has_table(std::string_view name) const
{
  const auto found = document_->root.members.find(std::string(name));
  return found != document_->root.members.end() &&
         (found->second.kind == Kind::table || is_array_of_tables(found->second));
}

std::vector<std::string> CaseFile::names_of(std::string_view table) const
{
  const std::string list(table);
  if (const auto chosen = document_->names.find(list); chosen != document_->names.end())
    return chosen->second;
  const Node* node = member_of(document_->root, table);
  if (node == nullptr || !is_array_of_tables(*node))
    return {list};
  // The coupler says in HELLO, in 127 bytes with commas between, which roles it waits for: "fluid" and these.
  constexpr std::size_t room = 127 - std::string_view("fluid").size();
  std::size_t said = 0;
  std::vector<std::string> names;
  for (const Node& entry : node->items)
  {
    const Node* own = member_of(entry, "name");
    if (own == nullptr && node->items.size() == 1)
      return {list};
    const std::string name = fmt::format("{}[{}].name", list, names.size());
    if (own == nullptr)
      document_->fail_at(entry.key_place,
                         fmt::format("missing key '{}': one of several [[{}]] needs one", name, list));
    const std::string bad =
        own->kind != Kind::text || own->text.empty() || own->text.size() > 31 ||
                own->text.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRST"
                                            "UVWXYZ0123456789_-") != std::string::npos
            ? "must be a word of at most 31 letters, digits, '_' and '-'"
        : std::find(names.begin(), names.end(), own->text) != names.end() ? "another entry has this name"
                                                                          : "";
    if (!bad.empty())
      document_->fail_at(own->place, fmt::format("{} = {}: {}", name, as_written(*own), bad));
    said += 1 + own->text.size();
    if (said > room)
      document_->fail_at(
          own->place,
          fmt::format("{} = {}: the names of all [[{}]] and a byte for each must fit into {} bytes, "
                      "with this one they take {}: write shorter names",
                      name, as_written(*own), list, room, said));
    names.push_back(own->text);
  }
  return names;
}

std::string CaseFile::choose(std::string_view table, const std::string& name) const
{
  const std::vector<std::string> names = names_of(table);
  const auto found =
      name.empty() && names.size() == 1 ? names.begin() : std::find(names.begin(), names.end(), name);
  if (found == names.end())
    throw InputError(
        name.empty() ? fmt::format("command line: the case has several [[{}]]: say which with --name ({})",
                                   table, fmt::join(names, ", "))
                     : fmt::format("command line: --name {}: the case has no {} of this name; it has {}",
                                   name, table, fmt::join(names, ", ")));
  document_->names[std::string(table)] = names;
  const auto list = document_->root.members.find(std::string(table));
  if (list != document_->root.members.end() && is_array_of_tables(list->second))
  {
    Node entry = std::move(list->second.items[static_cast<std::size_t>(found - names.begin())]);
    list->second = std::move(entry);
  }
  return *found;
}

void CaseFile::reject_unknown_keys(const std::vector<std::string>& read_here) const
{
  const Node& root = document_->root;
  for (const Node* member : CaseDocument::in_order(root))
  {
    const std::string& name = CaseDocument::member_name(root, member);
    if (name == "schema")
      continue;
    if (std::find(top_level_tables.begin(), top_level_tables.end(), name) == top_level_tables.end())
      document_->fail_unknown("", name, *member, top_level_tables);
    if (std::find(read_here.begin(), read_here.end(), name) != read_here.end())
      document_->reject_unknown_below(*member, name);
  }
}

std::uint64_t CaseFile::hash() const { return document_->hash; }

const std::string& CaseFile::path() const { return document_->path; }

std::string CaseFile::resolve(const std::string& file) const
{
  const std::filesystem::path given(file);
  if (given.is_absolute())
    return file;
  return (std::filesystem::path(document_->path).parent_path() / given).lexically_normal().string();
}

std::string CaseFile::with_place(const std::string& text) const
{
  const Node* node = find_mentioned(document_->root, text);
  if (node == nullptr)
    node = find_mentioned_file(document_->root, text, *this);
  return node == nullptr ? text : diagnostic(document_->path, node->place, text);
}

std::string CaseFile::documentation() const
{
  const auto cell = [](const std::string& text)
  {
    std::string escaped;
    for (const char c : text)
      escaped += c == '|' ? std::string("\\|") : std::string(1, c);
    return escaped;
  };
  const auto code = [](const std::string& text)
  { return text == required_key || text == no_default ? text : "`" + text + "`"; };
  std::string out;
  for (const TableDescription& table : document_->descriptions)
  {
    const bool is_list = table.path.ends_with("[]");
    const std::string name = is_list ? table.path.substr(0, table.path.size() - 2) : table.path;
    out += fmt::format("## `{}{}{}`\n\n", is_list ? "[[" : "[", name, is_list ? "]]" : "]");
    if (!table.meaning.empty())
      out += cell(table.meaning) + "\n\n";
    if (table.rows.empty())
      continue;
    out += "| key | type | unit | default | rule | meaning |\n| --- | --- | --- | --- | --- | --- |\n";
    for (const KeyRow& row : table.rows)
      out += fmt::format("| `{}` | {} | {} | {} | {} | {} |\n", row.name, row.type, cell(row.unit),
                         cell(code(row.default_value)), cell(row.rule), cell(row.meaning));
    out += "\n";
  }
  return out;
}

std::string nearest_word(std::string_view word, const std::vector<std::string>& known)
{
  const std::size_t limit = std::max<std::size_t>(2, word.size() / 3);
  std::string nearest;
  std::size_t smallest = limit + 1;
  for (const std::string& candidate : known)
    // A distance as long as the word itself would call any short word near.
    if (const std::size_t distance = edit_distance(word, candidate);
        distance < smallest && distance < std::max(word.size(), candidate.size()))
    {
      smallest = distance;
      nearest = candidate;
    }
  return nearest;
}

} // namespace undine
