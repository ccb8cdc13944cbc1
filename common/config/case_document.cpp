// Keys as they are described, unknown ones, and the page that lists them.
#include "common/config/case_document.hpp"

#include "common/config/nearest_word.hpp"
#include "common/config/toml_path.hpp"
#include "common/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>

namespace undine
{

using namespace toml_tree;

namespace
{

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

} // namespace

std::string path_of(const std::string& table_path, std::string_view name)
{
  return table_path.empty() ? std::string(name) : table_path + "." + std::string(name);
}

void CaseDocument::describe_table(const std::string& table_path, std::string_view meaning)
{
  const std::string generic = generic_path(table_path);
  for (const TableDescription& description : descriptions_)
    if (description.path == generic)
      return;
  descriptions_.push_back({generic, std::string(meaning), {}});
}

void CaseDocument::describe_key(const std::string& table_path, const Key& key, const std::string& type,
                                const std::string& default_value, std::string rule)
{
  const std::string generic = generic_path(table_path);
  know(table_path, key.name);
  for (TableDescription& description : descriptions_)
  {
    if (description.path != generic)
      continue;
    for (const KeyRow& row : description.rows)
      if (row.name == key.name)
        return;
    for (const std::string prefix : {"must be ", "must lie "})
      if (rule.starts_with(prefix))
        rule.erase(0, prefix.size());
    description.rows.push_back(
        {std::string(key.name), type, std::string(key.unit), default_value, rule, std::string(key.meaning)});
  }
}

void CaseDocument::fail_at(const Place& place, const std::string& text) const
{
  throw InputError(diagnostic(path, place, text));
}

void CaseDocument::know(const std::string& table_path, std::string_view name)
{
  known_[generic_path(table_path)].insert(std::string(name));
}

std::vector<std::string> CaseDocument::known_names(const std::string& table_path) const
{
  const auto found = known_.find(generic_path(table_path));
  if (found == known_.end())
    return {};
  return {found->second.begin(), found->second.end()};
}

void CaseDocument::fail_unknown(const std::string& table_path, const std::string& name, const Node& node,
                                const std::vector<std::string>& candidates) const
{
  const std::string full = path_of(table_path, name);
  const bool is_table = node.kind == Kind::table || is_array_of_tables(node);
  std::string text = fmt::format("unknown {} '{}'", is_table ? "table" : "key", full);
  if (const std::string near = nearest_word(name, candidates); !near.empty())
    text += fmt::format(": did you mean '{}'?", near);
  else if (!candidates.empty())
    text += fmt::format(": known here are {}", fmt::join(candidates, ", "));
  fail_at(node.key_place, text);
}

void CaseDocument::reject_unknown(const Node& table, const std::string& table_path) const
{
  const std::vector<std::string> names = known_names(table_path);
  for (const Member* member : in_order(table))
  {
    const auto& [name, node] = *member;
    if (std::find(names.begin(), names.end(), name) == names.end())
      fail_unknown(table_path, name, node, names);
    reject_unknown_below(node, path_of(table_path, name));
  }
}

void CaseDocument::reject_unknown_below(const Node& node, const std::string& node_path) const
{
  if (node.kind == Kind::table)
    reject_unknown(node, node_path);
  else if (is_array_of_tables(node))
    for (std::size_t i = 0; i < node.items.size(); ++i)
      reject_unknown(node.items[i], fmt::format("{}[{}]", node_path, i));
}

std::vector<const CaseDocument::Member*> CaseDocument::in_order(const Node& table)
{
  std::vector<const Member*> members;
  for (const Member& member : table.members)
    members.push_back(&member);
  const auto line = [](const Member* m)
  { return m->second.key_place.line == 0 ? ~std::size_t{0} : m->second.key_place.line; };
  std::stable_sort(members.begin(), members.end(),
                   [&line](const Member* a, const Member* b) { return line(a) < line(b); });
  return members;
}

std::string CaseDocument::documentation() const
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
  for (const TableDescription& table : descriptions_)
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

std::string CaseDocument::resolve(const std::string& file) const
{
  const std::filesystem::path given(file);
  if (given.is_absolute())
    return file;
  return (std::filesystem::path(path).parent_path() / given).lexically_normal().string();
}

} // namespace undine
