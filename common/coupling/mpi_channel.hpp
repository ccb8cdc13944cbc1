// A conversation over an MPI intercommunicator with one rank of the other program.
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
  /// The other end of a channel: a rank at the other side of a communicator.
  struct Path
  {
    MPI_Comm comm;
    int rank;
    bool operator==(const Path&) const = default;
  };
  void open(const Path& path) { paths_.push_back(path); }
  void close(const Path& path) { std::erase(paths_, path); }
  /// Sends a heartbeat over all open paths but `except`, at most one per `period` seconds.
  void beat(const Path& except, double period);

private:
  std::vector<MPI_Comm> comms_;
  std::vector<Path> paths_;
  std::chrono::steady_clock::time_point last_beat_{};
};

/// Sends are copied into buffers of the channel and complete later; receive() spins shortly, yields, then
/// sleeps.
class MpiChannel final : public Channel
{
public:
  /// @param comm     intercommunicator of `owner`; errors must be returned, not fatal
  /// @param rank     of the other program
  /// @param stall_seconds  ≤ 0 waits for ever
  MpiChannel(std::shared_ptr<Intercommunicators> owner, MPI_Comm comm, int rank, double stall_seconds);
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
  Intercommunicators::Path path_;
  double stall_;
  std::vector<std::unique_ptr<Outgoing>> outgoing_;
};

} // namespace undine::link
