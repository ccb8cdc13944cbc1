// States of a conversation and the steps between them.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/progress.hpp"

#include <algorithm>
#include <array>

namespace undine::link
{
namespace
{

/// What may come in a state, and from whom.
struct Turn
{
  End speaker;
  std::array<MessageType, 3> types; ///< the first again in the places that are not needed
};

constexpr Turn only(End speaker, MessageType type) { return {speaker, {type, type, type}}; }

constexpr Turn turn(State state)
{
  switch (state)
  {
  case State::setup:
    return only(End::coupler, MessageType::setup);
  case State::surface:
    return only(End::coupler, MessageType::surface);
  case State::mesh:
    return only(End::participant, MessageType::mesh);
  case State::mesh_reply:
    return only(End::coupler, MessageType::mesh_reply);
  case State::report:
    return only(End::participant, MessageType::ready);
  case State::mesh_update:
    return only(End::participant, MessageType::mesh_update);
  case State::window_or_bye:
    return {End::coupler, {MessageType::window, MessageType::bye, MessageType::checkpoint}};
  case State::checkpoint_done:
    return only(End::participant, MessageType::checkpoint_done);
  case State::kinematics:
    return only(End::participant, MessageType::kinematics);
  case State::activation:
    return only(End::coupler, MessageType::activation_impulse);
  case State::free_velocity:
    return only(End::participant, MessageType::free_velocity);
  case State::link_force:
    return only(End::coupler, MessageType::link_force);
  case State::motion:
    return only(End::participant, MessageType::motion);
  case State::bye_ack:
  case State::closed:
    break;
  }
  return only(End::participant, MessageType::bye_ack);
}

} // namespace

End Progress::speaker() const { return turn(state_).speaker; }

bool Progress::allows(MessageType type) const
{
  const auto types = turn(state_).types;
  return !is_closed() && std::find(types.begin(), types.end(), type) != types.end();
}

std::string Progress::expected() const
{
  if (is_closed())
    return "nothing, the conversation is over";
  const Turn now = turn(state_);
  std::string text = name_of(now.types[0]);
  for (const MessageType other : {now.types[1], now.types[2]})
    if (other != now.types[0])
      text += std::string(" or ") + name_of(other);
  return text + (now.speaker == End::coupler ? " of the coupler (" : " of the participant (") + place() + ")";
}

std::string Progress::place() const
{
  if (window_.index < 0)
    return "before the first window";
  std::string text = "window " + std::to_string(window_.index);
  if (state_ == State::free_velocity || state_ == State::link_force)
    text += ", exchange " + std::to_string(exchange_ + 1) + " of " + std::to_string(exchanges_);
  return text;
}

double Progress::time() const
{
  if (takes_forces_)
    return state_ == State::link_force ? window_.t_begin : window_.t_end;
  if (state_ == State::free_velocity || state_ == State::link_force)
    return exchange_ + 1 == exchanges_ ? window_.t_end
                                       : window_.t_begin + static_cast<double>(exchange_ + 1) * window_.dt();
  return state_ == State::kinematics || state_ == State::activation ? window_.t_begin : window_.t_end;
}

void Progress::learn(const Setup& setup)
{
  setup_dim_ = setup.dim;
  takes_forces_ = setup.scheme == staggered_scheme;
  sees_surface_ = setup.scheme == contact_surface_scheme;
  window_.t_begin = window_.t_end = setup.t_begin;
}

void Progress::learn(const SurfaceMesh& mesh)
{
  dim_ = mesh.dim;
  epoch_ = mesh.epoch;
}

void Progress::learn(const wire::MeshReply& reply) { mesh_accepted_ = reply.accepted; }

void Progress::learn(const Report& report) { surface_changed_ = report.surface_changed; }

void Progress::learn(const Window& window)
{
  window_ = window;
  exchanges_ = window.fine && !window.flight ? window.steps : 1;
  exchange_ = 0;
}

void Progress::advance(MessageType type)
{
  switch (type)
  {
  case MessageType::setup:
    state_ = sees_surface_ ? State::surface : State::mesh;
    break;
  case MessageType::surface:
    state_ = has_mesh_ ? State::mesh_update : State::mesh;
    break;
  case MessageType::mesh:
    has_mesh_ = true;
    state_ = State::mesh_reply;
    break;
  case MessageType::mesh_reply:
    state_ = !mesh_accepted_ ? State::closed : takes_forces_ ? State::motion : State::report;
    break;
  case MessageType::ready:
    state_ = !surface_changed_ ? State::window_or_bye : sees_surface_ ? State::surface : State::mesh_update;
    break;
  case MessageType::mesh_update: // beside the partner's surface; energies and stable step follow from it
    state_ = sees_surface_ ? State::report : State::window_or_bye;
    break;
  case MessageType::window:
    state_ = takes_forces_ ? State::link_force : window_.activate ? State::kinematics : State::free_velocity;
    break;
  case MessageType::checkpoint:
    state_ = State::checkpoint_done;
    break;
  case MessageType::checkpoint_done:
    state_ = State::window_or_bye;
    break;
  case MessageType::kinematics:
    state_ = State::activation;
    break;
  case MessageType::activation_impulse:
    state_ = State::free_velocity;
    break;
  case MessageType::free_velocity:
    state_ = window_.flight ? State::report : State::link_force;
    break;
  case MessageType::link_force:
    ++exchange_;
    state_ = takes_forces_ ? State::motion : exchange_ < exchanges_ ? State::free_velocity : State::report;
    break;
  case MessageType::motion:
    state_ = State::report;
    break;
  case MessageType::bye:
    state_ = State::bye_ack;
    break;
  case MessageType::bye_ack:
    state_ = State::closed;
    break;
  default:
    break; // PING, STOP_REQUEST: no influence
  }
}

} // namespace undine::link
