// summary.json: what a run was, cost and conserved, written by each program as a part and merged by
// scripts/run.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace undine
{

/// A flat-to-nested JSON writer: keys "fluid.steps" become {"fluid": {"steps": …}}.
class Summary
{
public:
  void set(const std::string& key, double value);
  void set(const std::string& key, long long value);
  void set(const std::string& key, const std::string& value);
  void set(const std::string& key, bool value);
  /// Write to `path` through a temporary file and rename. NaN and infinities become null.
  void write(const std::string& path) const;

private:
  std::vector<std::pair<std::string, std::string>> entries_; ///< key and JSON text of the value
};

} // namespace undine
