// What a process knows of itself while it starts and while it fails.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <string>

namespace undine::link
{

bool mpi_is_running(); ///< between MPI_Init and MPI_Finalize
std::string host_name();
int rank_from_launcher(); ///< in the world, as the launcher tells it before MPI_Init
void sleep_for(double seconds);
/// On stderr, by one write, so that the lines of several programs do not mix.
void print(const std::string& text);

/// Time that this process has had. One that was stopped (SIGSTOP; mpirun wakes it to end it) must not wake up
/// past a limit and speak: from one look to the next at most a second counts.
class OwnTime
{
public:
  double seconds();

private:
  using Clock = std::chrono::steady_clock;
  double sum_ = 0.0;
  Clock::time_point last_ = Clock::now();
};

} // namespace undine::link
