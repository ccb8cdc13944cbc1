// How far a conversation is: which message may come next, from which end, and what decides that.
// SPDX-License-Identifier: BSD-3-Clause
//
// No bytes and no channel here: a value that both ends derive from the same messages. The order of messages
// is written out in link.hpp.
#pragma once

#include "common/coupling/messages.hpp"
#include "common/coupling/wire.hpp"

#include <cstdint>
#include <string>

namespace undine::link
{

enum class End
{
  coupler,
  participant
};

/// Named after what comes next.
enum class State
{
  setup,
  surface,
  mesh,
  mesh_reply,
  report,
  mesh_update,
  window_or_bye,
  checkpoint_done,
  kinematics,
  activation,
  free_velocity,
  link_force,
  motion,
  bye_ack,
  closed
};

/// What both ends derive from the messages between the coupler and rank 0 of a participant.
class Progress
{
public:
  bool is_closed() const { return state_ == State::closed; }
  End speaker() const; ///< of what comes next
  /// The type may come next. PING, FAIL and a participant's STOP_REQUEST may at any time, and are not asked
  /// for.
  bool allows(MessageType type) const;
  /// "READY of the participant (window 3)", for errors.
  std::string expected() const;

  /// Time that a message of this state belongs to [s]: step counts times dt, never a sum.
  double time() const;
  const Window& window() const { return window_; } ///< in progress; index −1 before the first
  int setup_dim() const { return setup_dim_; }
  int dim() const { return dim_; }               ///< of the MESH, 1 before it
  std::uint32_t epoch() const { return epoch_; } ///< of the surface sent last

  // What the next state depends on in the content of a message.
  void learn(const Setup&);
  void learn(const SurfaceMesh&); ///< of MESH and MESH_UPDATE
  void learn(const wire::MeshReply&);
  void learn(const Report&);
  void learn(const Window&);
  template <class Content>
  void learn(const Content&) ///< of all others nothing
  {
  }

  /// To the state after a message whose content has been learnt.
  void advance(MessageType type);
  void close() { state_ = State::closed; }

private:
  std::string place() const;

  State state_ = State::setup;
  int setup_dim_ = 0;
  bool takes_forces_ = false; ///< level A
  bool sees_surface_ = false; ///< the partner's surface precedes its own
  bool has_mesh_ = false;     ///< MESH has been exchanged
  int dim_ = 1;
  std::uint32_t epoch_ = 0;
  bool mesh_accepted_ = false;
  bool surface_changed_ = false;
  Window window_{.index = -1};
  std::int64_t exchange_ = 0;
  std::int64_t exchanges_ = 0;
};

} // namespace undine::link
