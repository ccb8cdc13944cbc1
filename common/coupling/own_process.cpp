// What a process knows of itself: launcher, host, clock, stderr.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/own_process.hpp"

#include <mpi.h>

#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>

namespace undine::link
{

bool mpi_is_running()
{
  int initialized = 0;
  int finalized = 0;
  MPI_Initialized(&initialized);
  MPI_Finalized(&finalized);
  return initialized != 0 && finalized == 0;
}

std::string host_name()
{
  char name[256] = {};
  gethostname(name, sizeof name - 1);
  return name;
}

int rank_from_launcher()
{
  for (const char* name : {"OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "SLURM_PROCID"})
    if (const char* value = std::getenv(name))
      return std::atoi(value);
  return 0;
}

void sleep_for(double seconds)
{
  const timespec duration{
      .tv_sec = static_cast<time_t>(seconds),
      .tv_nsec = static_cast<long>((seconds - static_cast<double>(static_cast<time_t>(seconds))) * 1e9)};
  nanosleep(&duration, nullptr);
}

void print(const std::string& text)
{
  const char* p = text.data();
  std::size_t left = text.size();
  while (left > 0)
  {
    const ssize_t written = ::write(STDERR_FILENO, p, left);
    if (written <= 0)
      return;
    p += written;
    left -= static_cast<std::size_t>(written);
  }
}

double OwnTime::seconds()
{
  const auto now = Clock::now();
  sum_ += std::min(1.0, std::chrono::duration<double>(now - last_).count());
  last_ = now;
  return sum_;
}

} // namespace undine::link
