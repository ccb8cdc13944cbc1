// Typed values of a table: each read describes its key, checks the value and words the mistake.
#include "common/config/case_document.hpp"
#include "common/config/nearest_word.hpp"
#include "common/config/toml_path.hpp"
#include "common/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace undine
{

using namespace toml_tree;

namespace
{

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

/// One read of one key: describes the key, finds the value, and words the errors.
struct Reading
{
  CaseDocument& document;
  const Node* table;
  const std::string& table_path;
  const Key& key;
  std::string full; ///< "fluid.density"

  Reading(CaseDocument& d, const Node* t, const std::string& p, const Key& k, const std::string& type,
          const std::string& default_value, const std::string& rule)
      : document(d), table(t), table_path(p), key(k), full(path_of(p, k.name))
  {
    document.describe_key(table_path, key, type, default_value, rule);
  }

  const Node* value() const { return table == nullptr ? nullptr : member_of(*table, key.name); }

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
};

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

const Node* find_table(const CaseDocument& document, const Node* parent, std::string_view name,
                       const std::string& full)
{
  const Node* node = parent == nullptr ? nullptr : member_of(*parent, name);
  if (node == nullptr)
    return nullptr;
  if (is_array_of_tables(*node))
    document.fail_at(node->place, fmt::format("'{}' is one table: write [{}]", full, full));
  if (node->kind != Kind::table)
    document.fail_at(node->place,
                     fmt::format("{} = {}: must be a table: write [{}]", full, as_written(*node), full));
  return node;
}

std::vector<const Node*> find_tables(const CaseDocument& document, const Node* parent, std::string_view name,
                                     const std::string& full)
{
  const Node* node = parent == nullptr ? nullptr : member_of(*parent, name);
  if (node == nullptr)
    return {};
  if (!is_array_of_tables(*node))
    document.fail_at(node->place, fmt::format("'{}' is a list of tables: write [[{}]]", full, full));
  std::vector<const Node*> tables;
  for (const Node& item : node->items)
    tables.push_back(&item);
  return tables;
}

} // namespace

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

CaseTable::CaseTable(std::shared_ptr<CaseDocument> document, const toml_tree::Node* node, std::string path)
    : document_(std::move(document)), node_(node), path_(std::move(path))
{
}

bool CaseTable::present() const { return node_ != nullptr; }

bool CaseTable::has(std::string_view name) const
{
  return node_ != nullptr && member_of(*node_, name) != nullptr;
}

const std::string& CaseTable::path() const { return path_; }

double CaseTable::number(const Key& key, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key, "number", required_key, rule.text);
  return reading.number_of(reading.required_value(), reading.full, rule);
}

double CaseTable::number(const Key& key, double default_value, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key, "number", number_text(default_value), rule.text);
  const Node* node = reading.value();
  return node ? reading.number_of(*node, reading.full, rule) : default_value;
}

std::optional<double> CaseTable::optional_number(const Key& key, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key, "number", no_default, rule.text);
  const Node* node = reading.value();
  return node ? std::optional(reading.number_of(*node, reading.full, rule)) : std::nullopt;
}

std::int64_t CaseTable::integer(const Key& key, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key, "integer", required_key, rule.text);
  return reading.integer_of(reading.required_value(), rule);
}

std::int64_t CaseTable::integer(const Key& key, std::int64_t default_value, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key, "integer", fmt::format("{}", default_value),
                        rule.text);
  const Node* node = reading.value();
  return node ? reading.integer_of(*node, rule) : default_value;
}

std::optional<std::int64_t> CaseTable::optional_integer(const Key& key, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key, "integer", no_default, rule.text);
  const Node* node = reading.value();
  return node ? std::optional(reading.integer_of(*node, rule)) : std::nullopt;
}

bool CaseTable::boolean(const Key& key, bool default_value) const
{
  const Reading reading(*document_, node_, path_, key, "boolean", default_value ? "true" : "false", "");
  const Node* node = reading.value();
  if (node == nullptr)
    return default_value;
  if (node->kind != Kind::boolean)
    reading.fail(*node, "must be true or false");
  return node->boolean;
}

std::string CaseTable::text(const Key& key) const
{
  const Reading reading(*document_, node_, path_, key, "text", required_key, "");
  return reading.text_of(reading.required_value(), reading.full);
}

std::string CaseTable::text(const Key& key, std::string_view default_value) const
{
  const Reading reading(*document_, node_, path_, key, "text", fmt::format("\"{}\"", default_value), "");
  const Node* node = reading.value();
  return node ? reading.text_of(*node, reading.full) : std::string(default_value);
}

std::optional<std::string> CaseTable::optional_text(const Key& key) const
{
  const Reading reading(*document_, node_, path_, key, "text", no_default, "");
  const Node* node = reading.value();
  return node ? std::optional(reading.text_of(*node, reading.full)) : std::nullopt;
}

std::string CaseTable::choice(const Key& key, const std::vector<std::string>& choices) const
{
  const Reading reading(*document_, node_, path_, key, "text", required_key,
                        "one of " + quoted_list(choices));
  return reading.choice_of(reading.required_value(), choices);
}

std::string CaseTable::choice(const Key& key, std::string_view default_value,
                              const std::vector<std::string>& choices) const
{
  const Reading reading(*document_, node_, path_, key, "text", fmt::format("\"{}\"", default_value),
                        "one of " + quoted_list(choices));
  const Node* node = reading.value();
  return node ? reading.choice_of(*node, choices) : std::string(default_value);
}

std::vector<double> CaseTable::numbers(const Key& key, std::size_t size, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key, list_type(size), required_key, rule.text);
  return reading.numbers_of(reading.required_value(), size, rule);
}

std::vector<double> CaseTable::numbers(const Key& key, std::size_t size,
                                       const std::vector<double>& default_value, const Rule& rule) const
{
  const Reading reading(*document_, node_, path_, key, list_type(size), list_text(default_value), rule.text);
  const Node* node = reading.value();
  return node ? reading.numbers_of(*node, size, rule) : default_value;
}

std::vector<std::string> CaseTable::texts(const Key& key, const std::vector<std::string>& default_value) const
{
  const Reading reading(*document_, node_, path_, key, "texts", "[" + quoted_list(default_value) + "]", "");
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
  return has(name) && member_of(*node_, name)->kind == Kind::text;
}

CaseTable CaseTable::table(std::string_view name, std::string_view meaning) const
{
  const std::string full = path_of(path_, name);
  document_->know(path_, name);
  document_->describe_table(full, meaning);
  return CaseTable(document_, find_table(*document_, node_, name, full), full);
}

std::vector<CaseTable> CaseTable::tables(std::string_view name, std::string_view meaning) const
{
  const std::string full = path_of(path_, name);
  document_->know(path_, name);
  document_->describe_table(full + "[]", meaning);
  std::vector<CaseTable> entries;
  for (const Node* node : find_tables(*document_, node_, name, full))
    entries.push_back(CaseTable(document_, node, fmt::format("{}[{}]", full, entries.size())));
  return entries;
}

void CaseTable::fail(std::string_view name, const std::string& text) const
{
  const std::string full = name.empty() ? path_ : path_of(path_, name);
  if (node_ == nullptr)
    throw InputError(
        fmt::format("{}: {}: {} (the case has no table [{}])", document_->path, full, text, path_));
  const Node* node = member_of(*node_, name);
  if (node == nullptr)
    document_->fail_at(node_->place, fmt::format("{}: {}", full, text));
  document_->fail_at(node->place, fmt::format("{} = {}: {}", full, as_written(*node), text));
}

} // namespace undine
