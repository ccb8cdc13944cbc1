// Time histories: CSV with a header that says what each column is, flushed row by row.
#pragma once

#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace undine
{

/// `<out>/history/<name>.csv`: lines "# name: …", "# definition: …", then "t[s],column[unit],…", then rows
/// with 17 significant digits.
class History
{
public:
  History(const std::string& out_dir, const std::string& name, const std::string& definition,
          const std::vector<std::string>& columns);
  /// One row. @throws Failure(output_failed)
  void write(double t, std::span<const double> values);
  void write(double t, std::initializer_list<double> values);

private:
  struct Close
  {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string path_;
  std::size_t columns_ = 0;
  std::unique_ptr<std::FILE, Close> file_;
};

} // namespace undine
