// summary.json: what a run was, cost and conserved, written by each program as a part and merged by
// scripts/run.
#pragma once

#include <concepts>
#include <string>
#include <utility>
#include <vector>

namespace undine
{

/// A flat-to-nested JSON writer: keys "fluid.steps" become {"fluid": {"steps": …}}, in the order of their
/// first use. Setting a key again replaces its value. A key cannot be both a value and a table
/// (InternalError).
class Summary
{
public:
  void set(const std::string& key, double value);
  void set(const std::string& key, long long value);
  void set(const std::string& key, const std::string& value);
  void set(const std::string& key, const char* value) { set(key, std::string(value)); } // would prefer bool
  void set(const std::string& key, bool value);
  void set(const std::string& key, const std::vector<double>& list);
  template <std::integral Integer>
  void set(const std::string& key, Integer value)
  {
    set(key, static_cast<long long>(value));
  }
  /// The JSON text, two spaces per level.
  std::string json() const;
  /// Write to `path` through a temporary file and rename. NaN and infinities become null.
  /// @throws Failure(output_failed) with path and reason
  void write(const std::string& path) const;

private:
  void set_json(const std::string& key, std::string json);
  std::vector<std::pair<std::string, std::string>> entries_; ///< key and JSON text of the value
};

} // namespace undine
