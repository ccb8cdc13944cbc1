// The parsed case and what its readers know of its keys: for messages, unknown keys and docs/case-file.md.
#pragma once

#include "common/config/case_file.hpp"
#include "common/config/toml_tree.hpp"

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace undine
{

// What stands for a default where there is none.
inline const std::string required_key = "required";
inline const std::string no_default = "none";

/// Shared by a CaseFile and its tables. Entries of a list of tables, "interface[0]", share the descriptions
/// of "interface[]".
class CaseDocument
{
public:
  using Node = toml_tree::Node;
  using Member = std::pair<const std::string, Node>;

  std::string path;
  std::uint64_t hash = 0;
  Node root;
  std::map<std::string, std::vector<std::string>> names; ///< of the entries of a list, once one was chosen

  void describe_table(const std::string& table_path, std::string_view meaning);
  void describe_key(const std::string& table_path, const Key& key, const std::string& type,
                    const std::string& default_value, std::string rule);
  /// The table has a member of that name.
  void know(const std::string& table_path, std::string_view name);
  std::vector<std::string> known_names(const std::string& table_path) const;
  /// Rows of all keys described so far, a Markdown table per table of the case.
  std::string documentation() const;

  [[noreturn]] void fail_at(const toml_tree::Place& place, const std::string& text) const;
  [[noreturn]] void fail_unknown(const std::string& table_path, const std::string& name, const Node& node,
                                 const std::vector<std::string>& candidates) const;
  /// A member that nobody has described, in a table, in the entries of a list of tables, and below.
  void reject_unknown_below(const Node& node, const std::string& node_path) const;
  /// Members in the order of the file, overrides last, so that the first mistake is reported first.
  static std::vector<const Member*> in_order(const Node& table);

  /// `file` relative to the folder of the case, unless absolute.
  std::string resolve(const std::string& file) const;
  /// The value that a message begins with, or whose file, or nullptr: see CaseFile::with_place.
  const Node* find_mentioned(std::string_view text) const;

private:
  struct KeyRow
  {
    std::string name, type, unit, default_value, rule, meaning;
  };
  struct TableDescription
  {
    std::string path, meaning;
    std::vector<KeyRow> rows;
  };

  void reject_unknown(const Node& table, const std::string& table_path) const;

  std::vector<TableDescription> descriptions_;
  std::map<std::string, std::set<std::string>> known_; ///< generic table path → names of members
};

/// Path of a member of a table; the root's is "".
std::string path_of(const std::string& table_path, std::string_view name);

} // namespace undine
