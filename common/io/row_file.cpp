// Rows of a list in a file, by pread and pwrite.
#include "common/io/row_file.hpp"

#include <fmt/format.h>

#include <bit>
#include <cerrno>
#include <cstring>

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

namespace undine
{

static_assert(std::endian::native == std::endian::little, "numbers go into the file as they lie in memory");

std::vector<RowRun> runs_of(std::span<const index_t> places, std::size_t width)
{
  std::vector<RowRun> runs;
  for (std::size_t k = 0; k < places.size(); ++k)
  {
    if (places[k] < 0)
      continue;
    const RowRun row{k * width, static_cast<std::size_t>(places[k]) * width, width};
    if (!runs.empty() && runs.back().here + runs.back().count == row.here &&
        runs.back().place + runs.back().count == row.place)
      runs.back().count += width;
    else
      runs.push_back(row);
  }
  return runs;
}

RowFile::RowFile(const std::string& path, Use use, const std::string& name)
    : name_(name.empty() ? path : name), use_(use),
      file_(::open(path.c_str(),
                   O_CLOEXEC | (use == to_read     ? O_RDONLY
                                : use == to_create ? O_WRONLY | O_CREAT | O_TRUNC
                                                   : O_WRONLY),
                   0666))
{
  if (file_ < 0)
    fail(std::strerror(errno));
}

RowFile::~RowFile() { ::close(file_); }

void RowFile::fail(const char* reason) const
{
  throw Failure(use_ == to_read ? ExitCode::bad_input_file : ExitCode::output_failed,
                fmt::format("{}: cannot be {}: {}", name_, use_ == to_read ? "read" : "written", reason));
}

void RowFile::write(std::span<const std::byte> rows, std::size_t row_bytes, std::uint64_t begin,
                    std::span<const RowRun> runs) const
{
  for (const RowRun& run : runs)
  {
    auto rest = rows.subspan(run.here * row_bytes, run.count * row_bytes);
    for (auto at = static_cast<off_t>(begin + run.place * row_bytes); !rest.empty();)
    {
      const ssize_t written = ::pwrite(file_, rest.data(), rest.size(), at);
      if (written < 0 && errno != EINTR)
        fail(std::strerror(errno));
      rest = rest.subspan(static_cast<std::size_t>(std::max<ssize_t>(written, 0)));
      at += std::max<ssize_t>(written, 0);
    }
  }
}

void RowFile::read(std::span<std::byte> rows, std::size_t row_bytes, std::uint64_t begin,
                   std::span<const RowRun> runs) const
{
  for (const RowRun& run : runs)
  {
    auto rest = rows.subspan(run.here * row_bytes, run.count * row_bytes);
    for (auto at = static_cast<off_t>(begin + run.place * row_bytes); !rest.empty();)
    {
      const ssize_t n = ::pread(file_, rest.data(), rest.size(), at);
      if (n == 0)
        fail("it ends too early");
      if (n < 0 && errno != EINTR)
        fail(std::strerror(errno));
      rest = rest.subspan(static_cast<std::size_t>(std::max<ssize_t>(n, 0)));
      at += std::max<ssize_t>(n, 0);
    }
  }
}

void RowFile::reserve(std::uint64_t end)
{
  if (end <= reserved_)
    return;
  rlimit limit{};
  if (::getrlimit(RLIMIT_FSIZE, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY && end > limit.rlim_cur)
    fail(std::strerror(EFBIG));
  int failed = 0;
  do
    failed = ::fallocate(file_, FALLOC_FL_KEEP_SIZE, static_cast<off_t>(reserved_),
                         static_cast<off_t>(end - reserved_));
  while (failed && errno == EINTR);
  if (failed && errno != EOPNOTSUPP)
    fail(std::strerror(errno));
  reserved_ = end;
}

void RowFile::to_disk() const
{
  if (::fsync(file_) != 0)
    fail(std::strerror(errno));
}

} // namespace undine
