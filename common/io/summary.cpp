// Writes summary.json: dotted keys become nested objects.
#include "common/io/summary.hpp"

#include "common/error.hpp"
#include "common/io/folder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>

namespace undine
{

namespace
{

std::string json_string(std::string_view text)
{
  std::string out = "\"";
  for (const char c : text)
    if (c == '"' || c == '\\')
      out += std::string("\\") + c;
    else if (c == '\n')
      out += "\\n";
    else if (static_cast<unsigned char>(c) < 0x20)
      out += fmt::format("\\u{:04x}", static_cast<unsigned>(c));
    else
      out += c;
  return out + "\"";
}

/// The shortest text that reads back the same.
std::string json_number(double value) { return std::isfinite(value) ? fmt::format("{}", value) : "null"; }

using Entry = std::pair<std::string, std::string>;

/// `entries` all begin with the same `skip` characters; write what follows as one object.
std::string object(const std::vector<Entry>& entries, std::size_t skip, int level)
{
  const std::string indent(static_cast<std::size_t>(2 * level), ' ');
  std::vector<std::string> names; // in the order of their first use
  for (const Entry& entry : entries)
  {
    const std::string name = entry.first.substr(skip, entry.first.find('.', skip) - skip);
    if (std::find(names.begin(), names.end(), name) == names.end())
      names.push_back(name);
  }
  std::string out;
  for (const std::string& name : names)
  {
    std::vector<Entry> members;
    for (const Entry& entry : entries)
      if (entry.first.substr(skip, entry.first.find('.', skip) - skip) == name)
        members.push_back(entry);
    const bool is_value = members[0].first.size() == skip + name.size();
    for (const Entry& entry : members)
      require((entry.first.size() == skip + name.size()) == is_value,
              "a summary key is both a value and a table");
    out += fmt::format("{}{}  {}: {}", out.empty() ? "" : ",\n", indent, json_string(name),
                       is_value ? members[0].second : object(members, skip + name.size() + 1, level + 1));
  }
  return "{\n" + out + "\n" + indent + "}";
}

} // namespace

void Summary::set_json(const std::string& key, std::string json)
{
  for (auto& [known, value] : entries_)
    if (known == key)
    {
      value = std::move(json);
      return;
    }
  entries_.emplace_back(key, std::move(json));
}

void Summary::set(const std::string& key, double value) { set_json(key, json_number(value)); }

void Summary::set(const std::string& key, const std::vector<double>& list)
{
  std::string all;
  for (const double value : list)
    all += (all.empty() ? "" : ", ") + json_number(value);
  set_json(key, "[" + all + "]");
}

void Summary::set(const std::string& key, long long value) { set_json(key, fmt::format("{}", value)); }

void Summary::set(const std::string& key, const std::string& value) { set_json(key, json_string(value)); }

void Summary::set(const std::string& key, bool value) { set_json(key, value ? "true" : "false"); }

std::string Summary::json() const { return entries_.empty() ? "{}\n" : object(entries_, 0, 0) + "\n"; }

void Summary::write(const std::string& path) const { replace_file(path, json()); }

} // namespace undine
