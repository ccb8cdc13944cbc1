// The ranks of one program among themselves: what rank 0 says, what it collects.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mpi.h>

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace undine::link
{

/// An array of numbers that is shared out: on each rank r it is complete from own[r][0] to before own[r][1],
/// and may be needed from wanted[r][0] to before wanted[r][1]. The same on all ranks.
struct Stretches
{
  std::vector<std::array<std::size_t, 2>> own, wanted;
};

/// Collective calls that wait with a limit and share their core.
class Team
{
public:
  /// Collective. @param comm   stays the caller's, who may use it for other things meanwhile
  /// @param limit  rank 0 may keep the others waiting, or they it, for that long [s]; ≤ 0: for ever
  Team(MPI_Comm comm, double limit);
  ~Team();
  Team(const Team&) = delete;
  Team& operator=(const Team&) = delete;

  int rank() const { return rank_; }
  int size() const { return size_; }
  /// Bytes of rank 0 on all. Others wait for rank 0 without using their core. @throws ProtocolError(36) at
  /// the limit
  std::vector<std::byte> tell(std::vector<std::byte> bytes) const;
  /// Bytes of all ranks on rank 0, by rank; on others nothing. @throws ProtocolError(36) at the limit
  std::vector<std::vector<std::byte>> collect(std::span<const std::byte> mine) const;
  /// Bytes of rank 0 for each rank, by rank; each gets its own. Others than 0 give nothing.
  /// @throws ProtocolError(36) at the limit
  std::vector<std::byte> hand_out(std::vector<std::vector<std::byte>> of_ranks) const;

  /// Each rank gets what it wants of `all` from those that own it. Microseconds where all are in the call.
  /// @throws ProtocolError(36) at the limit
  void share(double* all, const Stretches& stretches) const;

private:
  std::vector<std::byte> receive(int rank, int tag) const;
  void complete(MPI_Request request, int awaited) const; ///< awaited: the other rank, or -1

  MPI_Comm comm_;
  double limit_;
  int rank_ = 0, size_ = 1;
};

} // namespace undine::link
