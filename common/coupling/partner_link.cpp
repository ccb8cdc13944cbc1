// The coupler's end of the conversation, with rank 0 of a participant and with the other owners of its rows.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/conversation.hpp"
#include "common/coupling/link.hpp"

#include <algorithm>

namespace undine::link
{
namespace
{

/// Payload of BYE_ACK.
std::monostate read_nothing(wire::Reader in)
{
  in.end();
  return {};
}

} // namespace

/// A rank of the participant that owns rows, or did.
struct PartnerLink::Path
{
  int rank;
  std::unique_ptr<Conversation> conversation; ///< null for rank 0, whose is PartnerLink's
  std::vector<std::int64_t> rows;
};

PartnerLink::PartnerLink(std::unique_ptr<Channel> channel, std::string role, PathMaker make_path)
    : conversation_(std::make_unique<Conversation>(std::move(channel), End::coupler, std::move(role))),
      make_path_(std::move(make_path))
{
}
PartnerLink::~PartnerLink() = default;
PartnerLink::PartnerLink(PartnerLink&&) noexcept = default;

void PartnerLink::send_setup(const Setup& setup) { conversation_->send(MessageType::setup, setup); }

void PartnerLink::send_surface(const SurfaceMesh& surface)
{
  conversation_->send(MessageType::surface, surface);
}

SurfaceMesh PartnerLink::receive_mesh() { return receive_surface_mesh(MessageType::mesh); }

SurfaceMesh PartnerLink::receive_surface_mesh(MessageType type)
{
  SurfaceMesh mesh = conversation_->receive(type, wire::read_surface_mesh);
  find_paths(mesh);
  mesh.owner.clear(); // nobody's concern but this link's
  return mesh;
}

/// From now on the rows are exchanged with their owners.
void PartnerLink::find_paths(const SurfaceMesh& mesh)
{
  dim_ = static_cast<std::size_t>(mesh.dim);
  if (mesh.owner.empty() && paths_.empty())
    return;
  if (!make_path_)
    conversation_->reader().reject("owner", "a list", "nothing: this coupler takes all rows from rank 0");
  if (paths_.empty())
    paths_.push_back({.rank = 0, .conversation = nullptr, .rows = {}});
  std::vector<std::int32_t> ranks = mesh.owner;
  std::sort(ranks.begin(), ranks.end());
  ranks.erase(std::unique(ranks.begin(), ranks.end()), ranks.end());
  for (const int rank : ranks)
    if (std::none_of(paths_.begin(), paths_.end(), [rank](const Path& p) { return p.rank == rank; }))
      paths_.push_back({.rank = rank,
                        .conversation = std::make_unique<Conversation>(
                            make_path_(rank), End::coupler, role() + " rank " + std::to_string(rank), rank),
                        .rows = {}});
  for (Path& path : paths_)
  {
    path.rows = mesh.rows_of(path.rank);
    if (path.conversation)
      path.conversation->follow(conversation_->progress(), mesh);
  }
}

/// talk(conversation, rows) with rank 0 and with each other rank that owns rows; all are as far as rank 0 is
/// now.
template <class Talk>
void PartnerLink::with_owners(Talk&& talk)
{
  const Progress now = conversation_->progress();
  for (Path& path : paths_)
    if (!path.conversation)
      talk(*conversation_, path.rows);
    else if (!path.rows.empty())
    {
      path.conversation->follow(now);
      talk(*path.conversation, path.rows);
    }
}

/// Rows of `mine` to their places in `all`, one row after the other.
void PartnerLink::place(std::span<const double> mine, const std::vector<std::int64_t>& rows,
                        std::span<double> all) const
{
  for (std::size_t k = 0; k < rows.size(); ++k)
    std::copy_n(mine.begin() + static_cast<std::ptrdiff_t>(k * dim_), dim_,
                all.begin() + rows[k] * static_cast<std::ptrdiff_t>(dim_));
}

/// Those rows of `all`.
std::vector<double> PartnerLink::pick(std::span<const double> all,
                                      const std::vector<std::int64_t>& rows) const
{
  std::vector<double> mine(rows.size() * dim_);
  for (std::size_t k = 0; k < rows.size(); ++k)
    std::copy_n(all.begin() + rows[k] * static_cast<std::ptrdiff_t>(dim_), dim_,
                mine.begin() + static_cast<std::ptrdiff_t>(k * dim_));
  return mine;
}

/// Numbers in a vector of all rows.
std::size_t PartnerLink::size() const
{
  std::size_t n = 0;
  for (const Path& path : paths_)
    n += path.rows.size();
  return n * dim_;
}

void PartnerLink::accept_mesh() { conversation_->send(MessageType::mesh_reply, wire::MeshReply{}); }

void PartnerLink::reject_mesh(const std::string& reason)
{
  conversation_->send(MessageType::mesh_reply, wire::MeshReply{.accepted = false, .reason = reason});
}

Report PartnerLink::receive_report() { return conversation_->receive(MessageType::ready, wire::read_report); }

SurfaceMesh PartnerLink::receive_mesh_update() { return receive_surface_mesh(MessageType::mesh_update); }

void PartnerLink::send_window(const Window& window) { conversation_->send(MessageType::window, window); }

void PartnerLink::send_checkpoint(const CheckpointOrder& order)
{
  conversation_->send(MessageType::checkpoint, order);
}

CheckpointDone PartnerLink::receive_checkpoint_done()
{
  return conversation_->receive(MessageType::checkpoint_done, wire::read_checkpoint_done);
}

/// A message of two vectors, from all owners.
template <class Vectors, class Read>
Vectors PartnerLink::collect(MessageType type, Read&& read, std::vector<double> Vectors::*one,
                             std::vector<double> Vectors::*other)
{
  if (paths_.empty())
    return conversation_->receive(type, read, conversation_->size());
  Vectors all;
  (all.*one).resize(size());
  (all.*other).resize(size());
  with_owners(
      [&](Conversation& from, const std::vector<std::int64_t>& rows)
      {
        const Vectors mine = from.receive(type, read, from.size());
        place(mine.*one, rows, all.*one);
        place(mine.*other, rows, all.*other);
      });
  return all;
}

Kinematics PartnerLink::receive_kinematics()
{
  return collect(MessageType::kinematics, wire::read_kinematics, &Kinematics::v, &Kinematics::a_free);
}

Motion PartnerLink::receive_motion()
{
  return collect(MessageType::motion, wire::read_motion, &Motion::x, &Motion::v);
}

void PartnerLink::send_activation(const Activation& activation)
{
  if (paths_.empty())
    return conversation_->send(MessageType::activation_impulse, activation);
  with_owners(
      [&](Conversation& to, const std::vector<std::int64_t>& rows)
      {
        to.send(MessageType::activation_impulse, Activation{.impulse = pick(activation.impulse, rows),
                                                            .link_force = pick(activation.link_force, rows)});
      });
}

void PartnerLink::receive_free_velocity(std::span<double> v_free)
{
  if (paths_.empty())
    return conversation_->receive_vector(MessageType::free_velocity, v_free);
  conversation_->require_size(MessageType::free_velocity, v_free.size(), size());
  with_owners(
      [&](Conversation& from, const std::vector<std::int64_t>& rows)
      {
        std::vector<double> mine(rows.size() * dim_);
        from.receive_vector(MessageType::free_velocity, mine);
        place(mine, rows, v_free);
      });
}

void PartnerLink::send_link_force(std::span<const double> f_link)
{
  if (paths_.empty())
    return conversation_->send_vector(MessageType::link_force, f_link);
  conversation_->require_size(MessageType::link_force, f_link.size(), size());
  with_owners([&](Conversation& to, const std::vector<std::int64_t>& rows)
              { to.send_vector(MessageType::link_force, pick(f_link, rows)); });
}

bool PartnerLink::stop_requested() const { return conversation_->stop_requested(); }
const std::string& PartnerLink::stop_reason() const { return conversation_->stop_reason(); }
void PartnerLink::ping()
{
  conversation_->ping();
  for (Path& path : paths_)
    if (path.conversation && !path.rows.empty())
      path.conversation->ping();
}

void PartnerLink::send_bye()
{
  conversation_->send(MessageType::bye, std::string());
  conversation_->receive(MessageType::bye_ack, read_nothing);
  end_paths();
}

void PartnerLink::end_paths() noexcept
{
  for (Path& path : paths_)
    if (path.conversation)
      path.conversation->hear_end();
}

void PartnerLink::send_failure(int code, const std::string& text) noexcept
{
  conversation_->send_failure(code, text);
  end_paths(); // the program ends as a whole
}
const std::string& PartnerLink::role() const { return conversation_->partner(); }
double PartnerLink::wait_seconds() const
{
  double sum = conversation_->wait_seconds();
  for (const Path& path : paths_)
    if (path.conversation)
      sum += path.conversation->wait_seconds();
  return sum;
}

} // namespace undine::link
