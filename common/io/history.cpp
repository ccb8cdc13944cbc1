// Time histories as CSV, flushed row by row.
#include "common/io/history.hpp"

#include "common/error.hpp"
#include "common/io/folder.hpp"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>

namespace undine
{

namespace
{

void write_text(std::FILE* file, const std::string& path, const std::string& text)
{
  if (std::fwrite(text.data(), 1, text.size(), file) != text.size() || std::fflush(file) != 0)
    throw Failure(ExitCode::output_failed,
                  fmt::format("{}: cannot be written: {}", path, std::strerror(errno)));
}

} // namespace

History::History(const std::string& out_dir, const std::string& name, const std::string& definition,
                 const std::vector<std::string>& columns)
    : path_(out_dir + "/history/" + name + ".csv"), columns_(columns.size())
{
  make_folder(out_dir + "/history");
  file_.reset(std::fopen(path_.c_str(), "wb"));
  if (!file_)
    throw Failure(ExitCode::output_failed,
                  fmt::format("{}: cannot be written: {}", path_, std::strerror(errno)));
  std::string header = fmt::format("# name: {}\n# definition: {}\nt[s]", name, definition);
  for (const std::string& column : columns)
    header += "," + column;
  write_text(file_.get(), path_, header + "\n");
}

void History::write(double t, std::span<const double> values)
{
  require(values.size() == columns_, "a row of a history has as many values as its header has columns");
  std::string row = fmt::format("{:.17g}", t);
  for (const double value : values)
    row += fmt::format(",{:.17g}", value);
  write_text(file_.get(), path_, row + "\n");
}

void History::write(double t, std::initializer_list<double> values)
{
  write(t, std::span<const double>(values.begin(), values.size()));
}

} // namespace undine
