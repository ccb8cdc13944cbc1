// Rows of a list in a file, each rank its own: passed to and from their places without a detour over another
// rank.
#pragma once

#include "common/error.hpp"
#include "common/parallel/ranks.hpp"
#include "common/types.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace undine
{

/// Rows that lie one after another both in the list here and in that of all ranks.
struct RowRun
{
  std::size_t here;  ///< first of them in the list here
  std::size_t place; ///< first of them among the rows of all ranks
  std::size_t count;
};

/// Row k of the list here is number places[k] of all ranks, −1: none that is to be passed. With `width`
/// numbers in a row the runs count numbers.
std::vector<RowRun> runs_of(std::span<const index_t> places, std::size_t width = 1);

/// A file of which rows are written or read in their places, past HDF5.
class RowFile
{
public:
  enum Use
  {
    to_create, ///< empty
    to_write,  ///< one that is there
    to_read
  };
  /// @throws Failure(output_failed or bad_input_file) with the name and the reason, as all that follow
  /// @param name of the file in what is said of failures, if it differs
  RowFile(const std::string& path, Use use, const std::string& name = "");
  ~RowFile();
  RowFile(const RowFile&) = delete;
  RowFile& operator=(const RowFile&) = delete;

  /// Rows of `row_bytes` each; the list of all ranks begins at byte `begin`.
  void write(std::span<const std::byte> rows, std::size_t row_bytes, std::uint64_t begin,
             std::span<const RowRun> runs) const;
  void read(std::span<std::byte> rows, std::size_t row_bytes, std::uint64_t begin,
            std::span<const RowRun> runs) const;
  /// From here on nobody meets a full disk before byte `end` of the file (where the file system can promise
  /// that): HDF5 1.10 cannot close a file whose last blocks found no room.
  void reserve(std::uint64_t end);
  /// Return when what was written is on the disk.
  void to_disk() const;

private:
  [[noreturn]] void fail(const char* reason) const;

  std::string name_;
  Use use_;
  int file_;
  std::uint64_t reserved_ = 0;
};

/// Do `work`; what fails on one rank fails on all, in the words of the lowest. Collective.
template <class Work>
void together(const Ranks& ranks, Work&& work)
{
  if (ranks.alone())
    return work();
  std::string failure;
  try
  {
    work();
  }
  catch (const Failure& f)
  {
    failure = f.what();
  }
  std::vector<std::size_t> sizes;
  const auto texts = ranks.gather(std::vector<char>(failure.begin(), failure.end()), &sizes);
  const auto first = std::find_if(sizes.begin(), sizes.end(), [](std::size_t n) { return n > 0; });
  if (first != sizes.end())
    throw Failure(ExitCode::output_failed, std::string(texts.data(), *first));
}

} // namespace undine
