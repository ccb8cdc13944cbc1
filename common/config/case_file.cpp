// Reads a case file: text, overrides, hash, names of the entries of lists.
#include "common/config/case_file.hpp"

#include "common/config/case_document.hpp"
#include "common/config/overrides.hpp"
#include "common/config/toml_path.hpp"
#include "common/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace undine
{

using namespace toml_tree;

namespace
{

const std::vector<std::string> top_level_tables = {"run",   "fluid",  "solid",      "coupling", "interface",
                                                   "probe", "output", "checkpoint", "reference"};

/// The coupler says in HELLO, in 127 bytes with commas between, which roles it waits for: "fluid" and the
/// names of a list.
constexpr std::size_t room_of_names = 127 - std::string_view("fluid").size();

bool is_name(const Node& node)
{
  return node.kind == Kind::text && !node.text.empty() && node.text.size() <= 31 &&
         node.text.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRST"
                                     "UVWXYZ0123456789_-") == std::string::npos;
}

/// FNV-1a, 64 bits (Fowler, Noll, Vo); a zero byte parts the text and each override.
std::uint64_t hash_of(const std::string& text, const std::vector<std::string>& overrides)
{
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
  return hash == 0 ? 1 : hash;
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

  document->hash = hash_of(text, overrides);

  if (const Node* schema = member_of(document->root, "schema");
      schema != nullptr && (schema->kind != Kind::integer || schema->integer != 1))
    document->fail_at(schema->place,
                      fmt::format("schema = {}: must be 1 (this program reads schema 1 of the case file)",
                                  as_written(*schema)));
  return CaseFile(std::move(document));
}

CaseTable CaseFile::root() const { return CaseTable(document_, &document_->root, ""); }

CaseTable CaseFile::table(std::string_view name, std::string_view meaning) const
{
  return root().table(name, meaning);
}

std::vector<CaseTable> CaseFile::tables(std::string_view name, std::string_view meaning) const
{
  return root().tables(name, meaning);
}

bool CaseFile::has_table(std::string_view name) const
{
  const Node* node = member_of(document_->root, name);
  return node != nullptr && (node->kind == Kind::table || is_array_of_tables(*node));
}

std::vector<std::string> CaseFile::names_of(std::string_view table) const
{
  const std::string list(table);
  if (const auto chosen = document_->names.find(list); chosen != document_->names.end())
    return chosen->second;
  const Node* node = member_of(document_->root, table);
  if (node == nullptr || !is_array_of_tables(*node))
    return {list};
  std::size_t said = 0;
  std::vector<std::string> names;
  for (const Node& entry : node->items)
  {
    const Node* own = member_of(entry, "name");
    if (own == nullptr && node->items.size() == 1)
      return {list};
    const std::string key = fmt::format("{}[{}].name", list, names.size());
    if (own == nullptr)
      document_->fail_at(entry.key_place,
                         fmt::format("missing key '{}': one of several [[{}]] needs one", key, list));
    said += 1 + own->text.size();
    std::string bad;
    if (!is_name(*own))
      bad = "must be a word of at most 31 letters, digits, '_' and '-'";
    else if (std::find(names.begin(), names.end(), own->text) != names.end())
      bad = "another entry has this name";
    else if (said > room_of_names)
      bad = fmt::format("the names of all [[{}]] and a byte for each must fit into {} bytes, with this one "
                        "they take {}: write shorter names",
                        list, room_of_names, said);
    if (!bad.empty())
      document_->fail_at(own->place, fmt::format("{} = {}: {}", key, as_written(*own), bad));
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
  for (const CaseDocument::Member* member : CaseDocument::in_order(root))
  {
    const auto& [name, node] = *member;
    if (name == "schema")
      continue;
    if (std::find(top_level_tables.begin(), top_level_tables.end(), name) == top_level_tables.end())
      document_->fail_unknown("", name, node, top_level_tables);
    if (std::find(read_here.begin(), read_here.end(), name) != read_here.end())
      document_->reject_unknown_below(node, name);
  }
}

std::uint64_t CaseFile::hash() const { return document_->hash; }

const std::string& CaseFile::path() const { return document_->path; }

std::string CaseFile::resolve(const std::string& file) const { return document_->resolve(file); }

std::string CaseFile::with_place(const std::string& text) const
{
  const Node* node = document_->find_mentioned(text);
  return node == nullptr ? text : diagnostic(document_->path, node->place, text);
}

std::string CaseFile::documentation() const { return document_->documentation(); }

} // namespace undine
