// Time histories as CSV, flushed row by row.
#include "common/io/history.hpp"

#include "common/error.hpp"
#include "common/io/folder.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

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
    : path_(out_dir + "/history/" + name + ".csv"),
      header_(fmt::format("# name: {}\n# definition: {}\nt[s]", name, definition)), columns_(columns.size())
{
  make_folder(out_dir + "/history");
  for (const std::string& column : columns)
    header_ += "," + column;
  header_ += "\n";
}

/// Keep the first `length` bytes of the file; 0, or a shorter file: start afresh.
void History::open(std::int64_t length)
{
  std::error_code none;
  const auto present = std::filesystem::file_size(path_, none);
  const bool goes_on = length > 0 && !none && present >= static_cast<std::uintmax_t>(length);
  file_.reset(std::fopen(path_.c_str(), goes_on ? "r+b" : "wb"));
  if (!file_ ||
      (goes_on && (ftruncate(fileno(file_.get()), length) != 0 || std::fseek(file_.get(), 0, SEEK_END) != 0)))
    throw Failure(ExitCode::output_failed,
                  fmt::format("{}: cannot be written: {}", path_, std::strerror(errno)));
  if (!goes_on)
    write_text(file_.get(), path_, header_);
}

void History::for_each_state(StateArchive& archive)
{
  std::int64_t length = file_ ? std::ftell(file_.get()) : 0;
  archive("length", length);
  if (archive.reading())
    open(length);
}

void History::write(double t, std::span<const double> values)
{
  require(values.size() == columns_, "a row of a history has as many values as its header has columns");
  if (!file_)
    open(0);
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
