// Collective calls of a participant's ranks, nonblocking so that every wait has a limit.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/team.hpp"

#include "common/coupling/channel.hpp"
#include "common/coupling/exit_codes.hpp"
#include "common/coupling/mpi_channel.hpp"
#include "common/coupling/patience.hpp"

#include <algorithm>
#include <cstdint>
#include <exception>
#include <limits>
#include <string>

namespace undine::link
{
namespace
{

int count_of(std::uint64_t bytes)
{
  if (bytes > static_cast<std::uint64_t>(std::numeric_limits<int>::max()))
    throw ProtocolError(code::internal_error, "more than 2 GiB of wet surface cannot be collected");
  return static_cast<int>(bytes);
}

/// One turn of waiting for a rank; negative: it is not known for which. @throws ProtocolError(36) at the
/// limit
void wait_for(int rank, Patience& patience)
{
  if (patience.pause() == Patience::Verdict::give_up)
    throw ProtocolError(
        code::partner_silent,
        (rank < 0 ? std::string("a rank") : "rank " + std::to_string(rank)) +
            " of this program has kept the others waiting for " + std::to_string(patience.waited()) +
            " s\n       it may be stuck or stopped, or has not made the same collective call");
}

} // namespace

Team::Team(MPI_Comm comm, double limit) : comm_(comm), limit_(limit)
{
  MPI_Comm_rank(comm, &rank_);
  MPI_Comm_size(comm, &size_);
  collect({}); // a rank that is stopped by now is named; MPI_Comm_dup would wait for it for ever
  require_mpi(MPI_Comm_dup(comm, &comm_), code::internal_error, "making a communicator");
}

Team::~Team()
{
  int finalized = 0;
  MPI_Finalized(&finalized);
  if (std::uncaught_exceptions() == 0 && finalized == 0)
    MPI_Comm_free(&comm_);
}

void Team::complete(MPI_Request request, int awaited) const
{
  Patience patience(limit_);
  for (int done = 0;;)
  {
    require_mpi(MPI_Test(&request, &done, MPI_STATUS_IGNORE), code::partner_silent,
                "a message to or from another rank of a program");
    if (done != 0)
      return;
    wait_for(awaited, patience);
  }
}

std::vector<std::byte> Team::tell(std::vector<std::byte> bytes) const
{
  const int awaited = rank_ > 0 ? 0 : size_ == 2 ? 1 : -1;
  std::uint64_t size = bytes.size();
  MPI_Request request = MPI_REQUEST_NULL;
  MPI_Ibcast(&size, 1, MPI_UINT64_T, 0, comm_, &request);
  complete(request, awaited);
  bytes.resize(size);
  MPI_Ibcast(bytes.data(), count_of(size), MPI_BYTE, 0, comm_, &request);
  complete(request, awaited);
  return bytes;
}

std::vector<std::vector<std::byte>> Team::collect(std::span<const std::byte> mine) const
{
  constexpr int tag = 5;
  const int count = count_of(mine.size());
  MPI_Request request = MPI_REQUEST_NULL;
  if (rank_ > 0)
  {
    MPI_Isend(mine.data(), count, MPI_BYTE, 0, tag, comm_, &request);
    complete(request, 0);
    return {};
  }
  std::vector<std::vector<std::byte>> parts{{mine.begin(), mine.end()}};
  for (int rank = 1; rank < size_; ++rank)
    parts.push_back(receive(rank, tag));
  return parts;
}

std::vector<std::byte> Team::receive(int rank, int tag) const
{
  Patience patience(limit_);
  int found = 0;
  MPI_Message handle = MPI_MESSAGE_NULL;
  MPI_Request request = MPI_REQUEST_NULL;
  MPI_Status status;
  while (MPI_Improbe(rank, tag, comm_, &found, &handle, &status) == MPI_SUCCESS && found == 0)
    wait_for(rank, patience);
  int size = 0;
  MPI_Get_count(&status, MPI_BYTE, &size);
  std::vector<std::byte> bytes(static_cast<std::size_t>(size));
  MPI_Imrecv(bytes.data(), size, MPI_BYTE, &handle, &request);
  complete(request, rank);
  return bytes;
}

std::vector<std::byte> Team::hand_out(std::vector<std::vector<std::byte>> of_ranks) const
{
  constexpr int tag = 7;
  if (rank_ > 0)
    return receive(0, tag);
  std::vector<MPI_Request> requests(of_ranks.size(), MPI_REQUEST_NULL);
  for (std::size_t r = 1; r < of_ranks.size(); ++r)
    MPI_Isend(of_ranks[r].data(), count_of(of_ranks[r].size()), MPI_BYTE, static_cast<int>(r), tag, comm_,
              &requests[r]);
  for (std::size_t r = 1; r < of_ranks.size(); ++r)
    complete(requests[r], static_cast<int>(r));
  return std::move(of_ranks[0]);
}

void Team::share(double* all, const Stretches& stretches) const
{
  constexpr int tag = 6;
  const auto me = static_cast<std::size_t>(rank_);
  std::vector<MPI_Request> requests;
  std::vector<int> partner;
  const auto move = [&](auto start, const std::array<std::size_t, 2>& owned,
                        const std::array<std::size_t, 2>& wanted, int rank)
  {
    const std::size_t begin = std::max(owned[0], wanted[0]), end = std::min(owned[1], wanted[1]);
    if (begin >= end)
      return;
    partner.push_back(rank);
    start(all + begin, count_of(end - begin), MPI_DOUBLE, rank, tag, comm_, &requests.emplace_back());
  };
  for (int r = 0; r < size_; ++r)
    if (r != rank_)
      move(MPI_Irecv, stretches.own[static_cast<std::size_t>(r)], stretches.wanted[me], r);
  for (int r = 0; r < size_; ++r)
    if (r != rank_)
      move(MPI_Isend, stretches.own[me], stretches.wanted[static_cast<std::size_t>(r)], r);
  for (std::size_t k = 0; k < requests.size(); ++k)
  {
    Patience patience(limit_);
    for (int done = 0;;)
    {
      require_mpi(MPI_Test(&requests[k], &done, MPI_STATUS_IGNORE), code::partner_silent,
                  "sharing among the ranks of a program");
      if (done != 0)
        break;
      wait_for(partner[k], patience);
    }
  }
}

} // namespace undine::link
