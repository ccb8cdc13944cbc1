// What of a case a message speaks of: a mistake that shows late, such as a surface that the mesh has not,
// gets its place so.
#include "common/config/case_document.hpp"
#include "common/config/toml_path.hpp"

#include <algorithm>
#include <optional>

namespace undine
{
namespace
{

using namespace toml_tree;

/// The quoted word at the beginning of `text`, or nothing.
std::optional<std::string_view> quoted_word(std::string_view text)
{
  if (text.empty() || (text[0] != '"' && text[0] != '\''))
    return std::nullopt;
  const std::size_t end = text.find(text[0], 1);
  return end == std::string_view::npos ? std::nullopt : std::optional(text.substr(1, end - 1));
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

/// The key that a message begins with, or nullptr.
const Node* find_key(const Node& root, std::string_view text)
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
const Node* find_file(const Node& node, std::string_view text, const CaseDocument& document)
{
  if (node.kind == Kind::text && !node.text.empty() && text.starts_with(document.resolve(node.text) + ":"))
    return &node;
  for (const Node& item : node.items)
    if (const Node* found = find_file(item, text, document))
      return found;
  for (const auto& [name, member] : node.members)
    if (const Node* found = find_file(member, text, document))
      return found;
  return nullptr;
}

} // namespace

const Node* CaseDocument::find_mentioned(std::string_view text) const
{
  const Node* key = find_key(root, text);
  return key != nullptr ? key : find_file(root, text, *this);
}

} // namespace undine
