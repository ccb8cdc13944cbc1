// The two ends of the coupling protocol: SolverLink in a fluid or solid, PartnerLink in the coupler.
// SPDX-License-Identifier: BSD-3-Clause
//
// Both walk the same state machine over a Channel (MPI intercommunicator, or memory inside one process) and
// check every message: magic, type allowed in the state, sequence number, length, CRC, finite numbers.
// Errors: a violation is ProtocolError(37), a FAIL of the partner ProtocolError(40), silence beyond the
// channel's stall limit ProtocolError(36), a wrong use of the class ProtocolError(1). After an exception only
// send_failure makes sense.
//
// The conversation (C coupler, P participant):
//
//   C SETUP   P MESH   C MESH_REPLY   P READY [P MESH_UPDATE]
//   repeat    [C CHECKPOINT  P CHECKPOINT_DONE]
//             C WINDOW [P KINEMATICS  C ACTIVATION_IMPULSE]
//             (P FREE_VELOCITY  C LINK_FORCE), `steps` times on the fine side, once on the other
//             P READY [P MESH_UPDATE]
//   [C CHECKPOINT  P CHECKPOINT_DONE]   C BYE     P BYE_ACK
//
// At level A (the coupler's SETUP says scheme "staggered"):
//
//   C SETUP   P MESH   C MESH_REPLY   P MOTION  P READY [P MESH_UPDATE]
//   repeat    [C CHECKPOINT  P CHECKPOINT_DONE]
//             C WINDOW  C LINK_FORCE   P MOTION  P READY [P MESH_UPDATE]
//   [C CHECKPOINT  P CHECKPOINT_DONE]   C BYE     P BYE_ACK
//
// With scheme "contact+surface" C SURFACE precedes P MESH and P MESH_UPDATE, and a second P READY follows the
// latter; with both contact schemes every window is one step of both sides and has no KINEMATICS.
//
// At any time: P STOP_REQUEST, and PING or FAIL of both.
//
// A participant on several ranks may give the rows of its wet surface to several of them
// (SurfaceMesh::owner): KINEMATICS, ACTIVATION_IMPULSE, FREE_VELOCITY, LINK_FORCE and MOTION are then
// exchanged with every owner, the rows of each in one message; all else stays with rank 0.
#pragma once

#include "common/coupling/channel.hpp"
#include "common/coupling/messages.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <variant>
#include <vector>

namespace undine::link
{

class Conversation;

/// A solver's end. Call order: receive_setup → send_mesh → send_report, then per window: next_window →
/// [send_kinematics → receive_activation] → (send_free_velocity → receive_link_force)* → send_report.
class SolverLink
{
public:
  /// rank: of this process in the participant. On others than 0 the link exchanges the vectors of this rank's
  /// rows, and takes note of the rest: hear() what rank 0 receives, and call what rank 0 sends.
  explicit SolverLink(std::unique_ptr<Channel> channel, int rank = 0);
  ~SolverLink();
  SolverLink(SolverLink&&) noexcept;

  Setup receive_setup();
  /// Scheme "contact+surface": the partner's wet surface, before send_mesh and before each send_mesh_update.
  SurfaceMesh receive_surface();
  // On another rank than 0, what its rank 0 has received.
  void hear(const Setup&);
  void hear(const SurfaceMesh& partner);
  void hear(const Window&);
  void hear_end();
  /// Waits for the MESH_REPLY. @throws ProtocolError(4) with the coupler's reason if it rejects the mesh
  void send_mesh(const SurfaceMesh&);
  void send_report(const Report&);
  void send_mesh_update(const SurfaceMesh&); ///< directly after a report with surface_changed
  /// Nothing after BYE. Answers orders for checkpoints by what on_checkpoint was given.
  std::optional<Window> next_window();
  /// What writes the state; without it the coupler is told that this solver cannot.
  void on_checkpoint(std::function<CheckpointDone(const CheckpointOrder&)> write);
  /// For solvers that take orders one by one instead: nothing after BYE; a CheckpointOrder must be answered.
  using Order = std::variant<std::monostate, Window, CheckpointOrder>;
  Order next_order();
  void send_checkpoint_done(const CheckpointDone&);
  void send_kinematics(const Kinematics&);
  Activation receive_activation();
  void send_free_velocity(std::span<const double> v_free); ///< starts the message and returns; rows × dim
  void receive_link_force(std::span<double> f_link);       ///< waits; rows × dim
  void send_motion(const Motion&);                         ///< level A: before each report
  void send_stop_request(const std::string& reason);
  void send_failure(int code, const std::string& text) noexcept; ///< last word before the program ends
  /// "Alive": call inside long pieces of work, as often as you like (at most four per second are sent).
  void ping();
  double wait_seconds() const; ///< total time spent waiting

private:
  std::unique_ptr<Conversation> conversation_;
  std::function<CheckpointDone(const CheckpointOrder&)> write_checkpoint_;
};

/// The coupler's end towards one participant.
class PartnerLink
{
public:
  /// A channel to another rank of the participant than 0.
  using PathMaker = std::function<std::unique_ptr<Channel>(int rank)>;
  /// make_path: for participants on several ranks; without it a surface whose rows have several owners is
  /// refused (37).
  PartnerLink(std::unique_ptr<Channel> channel, std::string role, PathMaker make_path = {});
  ~PartnerLink();
  PartnerLink(PartnerLink&&) noexcept;

  void send_setup(const Setup&);
  void send_surface(const SurfaceMesh&); ///< scheme "contact+surface": of the other participant
  SurfaceMesh receive_mesh();
  void accept_mesh();
  void reject_mesh(const std::string& reason);
  Report receive_report();
  SurfaceMesh receive_mesh_update();
  void send_window(const Window&);
  void send_checkpoint(const CheckpointOrder&); ///< between two windows
  CheckpointDone receive_checkpoint_done();
  Kinematics receive_kinematics();
  void send_activation(const Activation&);
  void receive_free_velocity(std::span<double> v_free);
  void send_link_force(std::span<const double> f_link);
  Motion receive_motion(); ///< level A
  bool stop_requested() const;
  const std::string& stop_reason() const; ///< text of the last STOP_REQUEST
  void ping();                            ///< as SolverLink::ping, e.g. while factorising a large interface
  void send_bye();                        ///< and waits for BYE_ACK
  void send_failure(int code, const std::string& text) noexcept;
  const std::string& role() const;
  double wait_seconds() const;

private:
  struct Path;
  SurfaceMesh receive_surface_mesh(MessageType type);
  void find_paths(const SurfaceMesh& mesh);
  template <class Talk>
  void with_owners(Talk&& talk);
  template <class Vectors, class Read>
  Vectors collect(MessageType type, Read&& read, std::vector<double> Vectors::*one,
                  std::vector<double> Vectors::*other);
  void place(std::span<const double> mine, const std::vector<std::int64_t>& rows,
             std::span<double> all) const;
  std::vector<double> pick(std::span<const double> all, const std::vector<std::int64_t>& rows) const;
  std::size_t size() const;
  void end_paths() noexcept;

  std::unique_ptr<Conversation> conversation_;
  PathMaker make_path_;
  std::vector<Path> paths_; ///< rank 0 first; empty while all rows are its
  std::size_t dim_ = 1;
};

} // namespace undine::link
