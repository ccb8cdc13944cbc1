// A conversation over an MPI intercommunicator, rank 0 to rank 0.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "common/coupling/channel.hpp"

#include <mpi.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace undine::link
{

/// @throws ProtocolError(exit_code) with MPI's text unless `result` is MPI_SUCCESS; `doing`: "waiting for a
/// hello"
void require_mpi(int result, int exit_code, const char* doing);

/// The intercommunicators of one process. Freed when neither the World nor a channel needs them any more.
///
/// While the coupler waits for one partner, the others wait for the coupler; beat() tells them that it lives,
/// so that only the truly silent program is accused and long work of one partner does not let the others give
/// up.
class Intercommunicators
{
public:
  Intercommunicators() = default;
  ~Intercommunicators();
  Intercommunicators(const Intercommunicators&) = delete;
  Intercommunicators& operator=(const Intercommunicators&) = delete;

  void add(MPI_Comm comm) { comms_.push_back(comm); }
  /// Sends a heartbeat over all but `except`, at most one per `period` seconds.
  void beat(MPI_Comm except, double period);

private:
  std::vector<MPI_Comm> comms_;
  std::chrono::steady_clock::time_point last_beat_{};
};

/// Sends are copied into buffers of the channel and complete later; receive() spins shortly, yields, then
/// sleeps.
class MpiChannel final : public Channel
{
public:
  /// @param comm     intercommunicator of `owner`; errors must be returned, not fatal
  /// @param stall_seconds  ≤ 0 waits for ever
  MpiChannel(std::shared_ptr<Intercommunicators> owner, MPI_Comm comm, double stall_seconds);
  /// Waits up to a second for sends in progress; buffers of unfinished ones are left to MPI.
  ~MpiChannel() override;

  /// Lets every conversation in progress of this process say why it ends; true if there was one. Call from
  /// the thread that uses MPI.
  static bool say_farewells(const std::string& reason);

  void send(std::span<const std::byte> message) override;
  void receive(std::vector<std::byte>& message) override;

private:
  struct Outgoing
  {
    std::vector<std::byte> bytes;
    MPI_Request request = MPI_REQUEST_NULL;
  };

  bool progress_sends();

  std::shared_ptr<Intercommunicators> owner_;
  MPI_Comm comm_;
  double stall_;
  std::vector<std::unique_ptr<Outgoing>> outgoing_;
};

} // namespace undine::link
