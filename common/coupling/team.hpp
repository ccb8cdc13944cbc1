// The ranks of one program among themselves: what rank 0 says, what it collects.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mpi.h>

#include <cstddef>
#include <span>
#include <vector>

namespace undine::link
{

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

private:
  void complete(MPI_Request request) const;

  MPI_Comm comm_;
  double limit_;
  int rank_ = 0, size_ = 1;
};

} // namespace undine::link
