// A solver's end of the conversation.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/conversation.hpp"
#include "common/coupling/exit_codes.hpp"
#include "common/coupling/link.hpp"

namespace undine::link
{

SolverLink::SolverLink(std::unique_ptr<Channel> channel, int rank)
    : conversation_(std::make_unique<Conversation>(std::move(channel), End::participant, "coupler", rank))
{
}
SolverLink::~SolverLink() = default;
SolverLink::SolverLink(SolverLink&&) noexcept = default;

Setup SolverLink::receive_setup() { return conversation_->receive(MessageType::setup, wire::read_setup); }

SurfaceMesh SolverLink::receive_surface()
{
  return conversation_->receive(MessageType::surface, wire::read_surface_mesh);
}

void SolverLink::hear(const Setup& setup) { conversation_->hear(MessageType::setup, setup); }
void SolverLink::hear(const SurfaceMesh& surface) { conversation_->hear(MessageType::surface, surface); }
void SolverLink::hear(const Window& window) { conversation_->hear(MessageType::window, window); }
void SolverLink::hear_end() { conversation_->hear_end(); }

void SolverLink::send_mesh(const SurfaceMesh& mesh)
{
  conversation_->send_by_first(MessageType::mesh, mesh);
  if (conversation_->rank() > 0)
    return conversation_->hear(MessageType::mesh_reply, wire::MeshReply{}); // or rank 0 ends the program
  const wire::MeshReply reply = conversation_->receive(MessageType::mesh_reply, wire::read_mesh_reply);
  if (!reply.accepted)
    throw ProtocolError(code::bad_input_file, "the coupler rejected the wet surface: " + reply.reason);
}

void SolverLink::send_report(const Report& report)
{
  conversation_->send_by_first(MessageType::ready, report);
}

void SolverLink::send_mesh_update(const SurfaceMesh& mesh)
{
  conversation_->send_by_first(MessageType::mesh_update, mesh);
}

SolverLink::Order SolverLink::next_order()
{
  switch (conversation_->wait_for(MessageType::window))
  {
  case MessageType::bye:
    conversation_->take(MessageType::bye, wire::read_reason);
    conversation_->send(MessageType::bye_ack);
    return {};
  case MessageType::checkpoint:
    return conversation_->take(MessageType::checkpoint, wire::read_checkpoint_order);
  default:
    return conversation_->take(MessageType::window, wire::read_window);
  }
}

std::optional<Window> SolverLink::next_window()
{
  for (;;)
  {
    const Order order = next_order();
    if (const auto* checkpoint = std::get_if<CheckpointOrder>(&order))
      send_checkpoint_done(write_checkpoint_ ? write_checkpoint_(*checkpoint)
                                             : CheckpointDone{.reason = "this solver writes no checkpoints"});
    else if (const auto* window = std::get_if<Window>(&order))
      return *window;
    else
      return std::nullopt;
  }
}

void SolverLink::on_checkpoint(std::function<CheckpointDone(const CheckpointOrder&)> write)
{
  write_checkpoint_ = std::move(write);
}

void SolverLink::send_checkpoint_done(const CheckpointDone& done)
{
  conversation_->send(MessageType::checkpoint_done, done);
}

void SolverLink::send_kinematics(const Kinematics& kinematics)
{
  if (!conversation_->skips(MessageType::kinematics))
    conversation_->send(MessageType::kinematics, kinematics);
}

Activation SolverLink::receive_activation()
{
  if (conversation_->skips(MessageType::activation_impulse))
    return {};
  return conversation_->receive(MessageType::activation_impulse, wire::read_activation,
                                conversation_->size());
}

void SolverLink::send_free_velocity(std::span<const double> v_free)
{
  if (!conversation_->skips(MessageType::free_velocity))
    conversation_->send_vector(MessageType::free_velocity, v_free);
}

void SolverLink::receive_link_force(std::span<double> f_link)
{
  if (!conversation_->skips(MessageType::link_force))
    conversation_->receive_vector(MessageType::link_force, f_link);
}

void SolverLink::send_motion(const Motion& motion)
{
  if (!conversation_->skips(MessageType::motion))
    conversation_->send(MessageType::motion, motion);
}

void SolverLink::send_stop_request(const std::string& reason) { conversation_->send_stop_request(reason); }
void SolverLink::send_failure(int code, const std::string& text) noexcept
{
  conversation_->send_failure(code, text);
}
void SolverLink::ping() { conversation_->ping(); }
double SolverLink::wait_seconds() const { return conversation_->wait_seconds(); }

} // namespace undine::link
