// The clocks of the benchmarks.
#pragma once

#include <ctime>

namespace undine::test
{

/// [s] of a clock of POSIX.
inline double seconds_of(clockid_t clock)
{
  timespec t{};
  clock_gettime(clock, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Processor time of all threads of this process [s].
inline double cpu_seconds() { return seconds_of(CLOCK_PROCESS_CPUTIME_ID); }

/// Time on the wall, from any origin [s].
inline double wall_seconds() { return seconds_of(CLOCK_MONOTONIC); }

} // namespace undine::test
