// A conversation over an MPI intercommunicator: nonblocking sends, a receive loop that shares its core.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/mpi_channel.hpp"

#include "common/coupling/exit_codes.hpp"
#include "common/coupling/patience.hpp"

#include <sched.h>
#include <sys/prctl.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <limits>

namespace undine::link
{
namespace
{

using Clock = std::chrono::steady_clock;

constexpr int message_tag = 1;
constexpr int heartbeat_tag = 2;

void require_success(int result, const char* doing) { require_mpi(result, code::partner_silent, doing); }

bool mpi_is_usable()
{
  int initialized = 0;
  int finalized = 0;
  MPI_Initialized(&initialized);
  MPI_Finalized(&finalized);
  return initialized != 0 && finalized == 0;
}

/// All channels of this process, for say_farewells().
std::vector<MpiChannel*>& channels()
{
  static std::vector<MpiChannel*> list;
  return list;
}

} // namespace

void require_mpi(int result, int exit_code, const char* doing)
{
  if (result == MPI_SUCCESS)
    return;
  char text[MPI_MAX_ERROR_STRING];
  int length = 0;
  MPI_Error_string(result, text, &length);
  throw ProtocolError(exit_code, std::string("MPI failed while ") + doing + ": " +
                                     std::string(text, std::size_t(length)));
}

Intercommunicators::~Intercommunicators()
{
  // While an exception unwinds the program is about to abort, and the partner will not help to free.
  if (std::uncaught_exceptions() > 0 || !mpi_is_usable())
    return;
  for (MPI_Comm& comm : comms_)
    MPI_Comm_free(&comm);
}

void Intercommunicators::beat(const Path& except, double period)
{
  if (paths_.size() < 2)
    return;
  const auto now = Clock::now();
  if (std::chrono::duration<double>(now - last_beat_).count() < period)
    return;
  last_beat_ = now;
  for (const Path& path : paths_)
    if (path != except)
    {
      MPI_Request request = MPI_REQUEST_NULL;
      require_success(MPI_Isend(nullptr, 0, MPI_BYTE, path.rank, heartbeat_tag, path.comm, &request),
                      "sending a heartbeat");
      MPI_Request_free(&request); // no buffer, nothing to wait for
    }
}

MpiChannel::MpiChannel(std::shared_ptr<Intercommunicators> owner, MPI_Comm comm, int rank,
                       double stall_seconds)
    : owner_(std::move(owner)), path_{comm, rank}, stall_(stall_seconds)
{
  owner_->open(path_);
  // The kernel rounds sleeps up by 50 µs unless told otherwise; the back-off wants 20 µs.
  prctl(PR_SET_TIMERSLACK, 1000UL, 0UL, 0UL, 0UL);
  channels().push_back(this);
}

MpiChannel::~MpiChannel()
{
  std::erase(channels(), this);
  owner_->close(path_);
  if (mpi_is_usable())
  {
    const auto limit = Clock::now() + std::chrono::seconds(1);
    while (!progress_sends() && Clock::now() < limit)
      sched_yield();
  }
  for (auto& slot : outgoing_)
    if (slot->request != MPI_REQUEST_NULL)
      static_cast<void>(slot.release()); // MPI may still read it
}

bool MpiChannel::say_farewells(const std::string& reason)
{
  bool said = false;
  for (MpiChannel* channel : channels())
    said = channel->say_farewell(reason) || said;
  return said;
}

/// Completes what can be completed; true if no send is in progress.
bool MpiChannel::progress_sends()
{
  bool idle = true;
  for (auto& slot : outgoing_)
    if (slot->request != MPI_REQUEST_NULL)
    {
      int done = 0;
      if (MPI_Test(&slot->request, &done, MPI_STATUS_IGNORE) != MPI_SUCCESS)
        slot->request = MPI_REQUEST_NULL; // the partner is gone; receive() will say so
      else if (done == 0)
        idle = false;
    }
  return idle;
}

void MpiChannel::send(std::span<const std::byte> message)
{
  if (message.size() > static_cast<std::size_t>(std::numeric_limits<int>::max()))
    throw ProtocolError(code::internal_error, "a message of " + std::to_string(message.size()) +
                                                  " bytes cannot be sent; the limit is 2 GiB");
  progress_sends();
  auto slot = std::find_if(outgoing_.begin(), outgoing_.end(),
                           [](const auto& s) { return s->request == MPI_REQUEST_NULL; });
  if (slot == outgoing_.end())
    slot = outgoing_.insert(outgoing_.end(), std::make_unique<Outgoing>());
  Outgoing& out = **slot;
  out.bytes.assign(message.begin(), message.end());
  require_success(MPI_Isend(out.bytes.data(), static_cast<int>(out.bytes.size()), MPI_BYTE, path_.rank,
                            message_tag, path_.comm, &out.request),
                  "sending");
}

void MpiChannel::receive(std::vector<std::byte>& message)
{
  Patience patience(stall_);
  const auto pause = [this, &patience]
  {
    switch (patience.pause())
    {
    case Patience::Verdict::give_up:
      throw ProtocolError(code::partner_silent, waiting_text(patience.waited()));
    case Patience::Verdict::warn:
      std::fprintf(stderr, "warning: %s\n", waiting_text(patience.waited()).c_str());
      break;
    case Patience::Verdict::wait:
      break;
    }
    if (stall_ > 0.0 && patience.long_wait())
      owner_->beat(path_, std::min(5.0, 0.2 * stall_));
  };

  for (;;)
  {
    int found = 0;
    MPI_Message handle = MPI_MESSAGE_NULL;
    MPI_Status status;
    require_success(MPI_Improbe(path_.rank, MPI_ANY_TAG, path_.comm, &found, &handle, &status),
                    "waiting for a message");
    if (found == 0)
    {
      progress_sends();
      pause();
      continue;
    }
    int size = 0;
    MPI_Get_count(&status, MPI_BYTE, &size);
    message.resize(static_cast<std::size_t>(size));
    MPI_Request request = MPI_REQUEST_NULL;
    require_success(MPI_Imrecv(message.data(), size, MPI_BYTE, &handle, &request), "receiving");
    patience.restart();
    for (int done = 0;;)
    {
      require_success(MPI_Test(&request, &done, MPI_STATUS_IGNORE), "receiving");
      if (done != 0)
        break;
      pause(); // a large message may still be on its way
    }
    if (status.MPI_TAG == heartbeat_tag)
      continue;
    return;
  }
}

} // namespace undine::link
