// From MPI_COMM_WORLD to roles: HELLO with a deadline before any collective call.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "common/coupling/channel.hpp"
#include "common/coupling/handshake.hpp"

#include <mpi.h>

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace undine::link
{

inline constexpr std::uint16_t protocol_major = 1;
inline constexpr std::uint16_t protocol_minor = 0;

struct Identity
{
  std::string role;            ///< "coupler", "fluid", "solid" (or a solid's own name once there are several)
  std::string solver;          ///< program and version, for people
  int dim = 0;                 ///< 0: did not read the case
  std::uint64_t case_hash = 0; ///< 0: did not read the case
  std::vector<std::string> partners; ///< roles that must be present, e.g. {"fluid", "solid"} for the coupler
  std::uint64_t capabilities =
      capability::link; ///< bits of namespace capability; of a coupler only `distributed` has a meaning
};

struct Deadlines
{
  double hello = 60.0;  ///< every rank must have spoken [s]
  double stall = 300.0; ///< a partner may be silent for that long [s]; warning at half time; 0 = off
};

/// The world after the hand-shake. Owns the communicators; never throws from its destructor.
class World
{
public:
  /// Collective over all ranks of MPI_COMM_WORLD, without a collective MPI call before every rank has spoken.
  /// Every rank throws the same error, that of world rank 0, and should then call abort_world().
  /// @throws ProtocolError 32 no hello (names ranks), 33 version, 34 different case, 35 roles do not fit
  static World connect(const Identity&, const Deadlines&);
  World(World&&) noexcept;
  ~World();

  MPI_Comm comm() const; ///< the ranks of this role; use it instead of MPI_COMM_WORLD
  bool coupled() const;  ///< false: this program runs alone
  /// Channel to `role` on rank 0 of this role; nullptr on the other ranks.
  std::unique_ptr<Channel> channel(const std::string& role) const;
  /// Channel of this process to rank `rank` of `role`, for the rows of wet nodes; from rank 0 of the coupler
  /// or to it. @throws ProtocolError(37) if `role` has no such rank
  std::unique_ptr<Channel> path(const std::string& role, int rank) const;
  std::string solver_of(const std::string& role) const;
  std::uint64_t capabilities_of(const std::string& role) const;

private:
  struct State;
  explicit World(std::unique_ptr<State>);
  std::unique_ptr<State> state_;
};

} // namespace undine::link
