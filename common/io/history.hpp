// Time histories: CSV with a header that says what each column is, flushed row by row.
#pragma once

#include "common/io/state_archive.hpp"

#include <cstdint>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace undine
{

/// `<out>/history/<name>.csv`: lines "# name: …", "# definition: …", then "t[s],column[unit],…", then rows
/// with 17 significant digits. The file comes into being with the first row; after a restart the rows behind
/// the checkpoint are cut off.
class History
{
public:
  History(const std::string& out_dir, const std::string& name, const std::string& definition,
          const std::vector<std::string>& columns);
  /// One row. @throws Failure(output_failed)
  void write(double t, std::span<const double> values);
  void write(double t, std::initializer_list<double> values);
  /// The length of the file.
  void for_each_state(StateArchive& archive);

private:
  void open(std::int64_t length);
  struct Close
  {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string path_, header_;
  std::size_t columns_ = 0;
  std::unique_ptr<std::FILE, Close> file_;
};

} // namespace undine
