// Collective calls of a participant's ranks, nonblocking so that every wait has a limit.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/team.hpp"

#include "common/coupling/channel.hpp"
#include "common/coupling/exit_codes.hpp"
#include "common/coupling/mpi_channel.hpp"
#include "common/coupling/patience.hpp"

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

/// One turn of waiting for `who`. @throws ProtocolError(36) at the limit
void wait_for(const std::string& who, Patience& patience)
{
  if (patience.pause() == Patience::Verdict::give_up)
    throw ProtocolError(
        code::partner_silent,
        who + " of this program has kept the others waiting for " + std::to_string(patience.waited()) +
            " s\n       it may be stuck or stopped, or has not made the same collective call");
}

} // namespace

Team::Team(MPI_Comm comm, double limit) : limit_(limit)
{
  require_mpi(MPI_Comm_dup(comm, &comm_), code::internal_error, "making a communicator");
  MPI_Comm_rank(comm, &rank_);
  MPI_Comm_size(comm, &size_);
}

Team::~Team()
{
  int finalized = 0;
  MPI_Finalized(&finalized);
  if (std::uncaught_exceptions() == 0 && finalized == 0)
    MPI_Comm_free(&comm_);
}

void Team::complete(MPI_Request request) const
{
  Patience patience(limit_);
  for (int done = 0;;)
  {
    require_mpi(MPI_Test(&request, &done, MPI_STATUS_IGNORE), code::partner_silent,
                "telling all ranks of a program");
    if (done != 0)
      return;
    wait_for("rank 0", patience);
  }
}

std::vector<std::byte> Team::tell(std::vector<std::byte> bytes) const
{
  std::uint64_t size = bytes.size();
  MPI_Request request = MPI_REQUEST_NULL;
  MPI_Ibcast(&size, 1, MPI_UINT64_T, 0, comm_, &request);
  complete(request);
  bytes.resize(size);
  MPI_Ibcast(bytes.data(), count_of(size), MPI_BYTE, 0, comm_, &request);
  complete(request);
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
    complete(request);
    return {};
  }
  std::vector<std::vector<std::byte>> parts{{mine.begin(), mine.end()}};
  for (int rank = 1; rank < size_; ++rank)
  {
    Patience patience(limit_);
    int found = 0;
    MPI_Message handle = MPI_MESSAGE_NULL;
    MPI_Status status;
    while (MPI_Improbe(rank, tag, comm_, &found, &handle, &status) == MPI_SUCCESS && found == 0)
      wait_for("rank " + std::to_string(rank), patience);
    int size = 0;
    MPI_Get_count(&status, MPI_BYTE, &size);
    auto& part = parts.emplace_back(static_cast<std::size_t>(size));
    MPI_Imrecv(part.data(), size, MPI_BYTE, &handle, &request);
    for (int done = 0; done == 0;)
    {
      require_mpi(MPI_Test(&request, &done, MPI_STATUS_IGNORE), code::partner_silent,
                  "collecting from all ranks of a program");
      if (done == 0)
        wait_for("rank " + std::to_string(rank), patience);
    }
  }
  return parts;
}

} // namespace undine::link
