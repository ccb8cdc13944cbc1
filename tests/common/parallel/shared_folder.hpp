// All ranks of mpirun, one folder of theirs, as long as a test lives, and a file that one rank cannot write.
#pragma once

#include "common/parallel/mpi_ranks.hpp"
#include "tests/common/io/temporary_folder.hpp"

#include <csignal>
#include <optional>
#include <string>
#include <vector>

#include <sys/resource.h>

namespace undine
{

inline Ranks all_ranks() { return ranks_of(MPI_COMM_WORLD, 60.0); }

/// Rank 0 makes and removes it.
struct SharedFolder
{
  std::optional<TemporaryFolder> made;
  std::string path;
  explicit SharedFolder(const Ranks& ranks)
  {
    if (ranks.rank() == 0)
      made.emplace();
    const std::string mine = made ? made->path : "";
    const auto all = ranks.of_first(std::vector<char>(mine.begin(), mine.end()));
    path.assign(all.begin(), all.end());
  }
};

/// While it lives, files of this process do not grow beyond so many bytes: a quota, where a disk would be
/// full.
class SmallDisk
{
public:
  explicit SmallDisk(bool small, rlim_t bytes = 4096)
  {
    getrlimit(RLIMIT_FSIZE, &old_);
    rlimit limit = old_;
    if (small)
      limit.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~SmallDisk()
  {
    setrlimit(RLIMIT_FSIZE, &old_);
    std::signal(SIGXFSZ, handler_);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

private:
  rlimit old_{};
  void (*handler_)(int) = std::signal(SIGXFSZ, SIG_IGN);
};

} // namespace undine
