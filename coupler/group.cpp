// Joining and splitting of what the participants of one side say.
#include "coupler/group.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <initializer_list>
#include <utility>

namespace undine::coupler
{

namespace
{

void append(auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); }

/// What each member says by `receive`, its `parts` one after the other.
template <class Message>
Message receive_from(std::span<link::PartnerLink* const> members, Message (link::PartnerLink::*receive)(),
                     std::initializer_list<std::vector<double> Message::*> parts)
{
  Message all = (members[0]->*receive)();
  for (link::PartnerLink* member : members.subspan(1))
  {
    const Message one = (member->*receive)();
    for (const auto part : parts)
      append(all.*part, one.*part);
  }
  return all;
}

} // namespace

link::SurfaceMesh join(std::span<const link::SurfaceMesh> surfaces)
{
  if (surfaces.size() == 1)
    return surfaces[0];
  link::SurfaceMesh all;
  std::int64_t first_id = 0;
  for (const link::SurfaceMesh& one : surfaces)
  {
    all.dim = one.dim;
    all.epoch += one.epoch;
    const auto first_node = static_cast<std::int32_t>(all.n_nodes());
    std::vector<std::int32_t> interface;
    for (const std::string& name : one.interfaces)
    {
      const auto known = std::find(all.interfaces.begin(), all.interfaces.end(), name);
      interface.push_back(static_cast<std::int32_t>(known - all.interfaces.begin()));
      if (known == all.interfaces.end())
        all.interfaces.push_back(name);
    }
    std::int64_t next_id = first_id;
    for (const std::int64_t id : one.node_id)
    {
      all.node_id.push_back(first_id + id);
      next_id = std::max(next_id, first_id + id + 1);
    }
    first_id = next_id;
    append(all.x, one.x);
    append(all.inverse_mass, one.inverse_mass);
    const std::int32_t first_entry = all.face_offset.back();
    for (std::size_t f = 1; f < one.face_offset.size(); ++f)
      all.face_offset.push_back(first_entry + one.face_offset[f]);
    for (const std::int32_t node : one.face_nodes)
      all.face_nodes.push_back(first_node + node);
    for (const std::int32_t i : one.face_interface)
      all.face_interface.push_back(interface[static_cast<std::size_t>(i)]);
    for (const std::int32_t node : one.coupled_nodes)
      all.coupled_nodes.push_back(first_node + node);
    append(all.coupled_inverse_mass, one.coupled_inverse_mass);
  }
  return all;
}

link::Report join(std::span<const link::Report> reports)
{
  link::Report all = reports[0];
  for (const link::Report& one : reports.subspan(1))
  {
    all.stable_dt = std::min(all.stable_dt, one.stable_dt);
    all.kinetic_energy += one.kinetic_energy;
    all.internal_energy += one.internal_energy;
    all.external_work += one.external_work;
    all.dissipated_energy += one.dissipated_energy;
    all.interface_work += one.interface_work;
    all.mass += one.mass;
    all.compute_seconds = std::max(all.compute_seconds, one.compute_seconds);
    all.wait_seconds = std::min(all.wait_seconds, one.wait_seconds);
    all.steps = std::max(all.steps, one.steps);
    all.surface_changed = all.surface_changed || one.surface_changed;
  }
  return all;
}

Group::Group(std::vector<link::PartnerLink*> members) : members_(std::move(members))
{
  require(!members_.empty(), "a side of the interface has a participant");
}

std::size_t Group::size(std::size_t member) const { return surface_[member].x.size(); }

link::SurfaceMesh Group::receive_mesh()
{
  surface_.clear();
  for (link::PartnerLink* p : members_)
    surface_.push_back(p->receive_mesh());
  return join(surface_);
}

link::Report Group::receive_report()
{
  std::vector<link::Report> reports;
  changed_.clear();
  for (link::PartnerLink* p : members_)
  {
    reports.push_back(p->receive_report());
    changed_.push_back(reports.back().surface_changed);
  }
  return join(reports);
}

link::SurfaceMesh Group::receive_mesh_update(std::span<const double> x)
{
  std::size_t begin = 0;
  for (std::size_t k = 0; k < members_.size(); ++k)
  {
    const std::size_t n = size(k);
    if (changed_[k])
      surface_[k] = members_[k]->receive_mesh_update();
    else
    {
      require(begin + n <= x.size(), "positions of the joined surface");
      const auto own = x.subspan(begin, n);
      surface_[k].x.assign(own.begin(), own.end());
    }
    begin += n;
  }
  return join(surface_);
}

void Group::send_window(const link::Window& window)
{
  for (link::PartnerLink* p : members_)
    p->send_window(window);
}

link::Kinematics Group::receive_kinematics()
{
  return receive_from(members(), &link::PartnerLink::receive_kinematics,
                      {&link::Kinematics::v, &link::Kinematics::a_free});
}

void Group::send_activation(const link::Activation& activation)
{
  std::ptrdiff_t begin = 0;
  for (std::size_t k = 0; k < members_.size(); ++k)
  {
    const auto end = begin + static_cast<std::ptrdiff_t>(size(k));
    const auto part = [begin, end](const std::vector<double>& all)
    { return std::vector<double>(all.begin() + begin, all.begin() + end); };
    members_[k]->send_activation(
        {.impulse = part(activation.impulse), .link_force = part(activation.link_force)});
    begin = end;
  }
}

void Group::receive_free_velocity(std::span<double> v_free)
{
  std::size_t begin = 0;
  for (std::size_t k = 0; k < members_.size(); begin += size(k), ++k)
    members_[k]->receive_free_velocity(v_free.subspan(begin, size(k)));
}

void Group::send_link_force(std::span<const double> f_link)
{
  std::size_t begin = 0;
  for (std::size_t k = 0; k < members_.size(); begin += size(k), ++k)
    members_[k]->send_link_force(f_link.subspan(begin, size(k)));
}

link::Motion Group::receive_motion()
{
  return receive_from(members(), &link::PartnerLink::receive_motion, {&link::Motion::x, &link::Motion::v});
}

bool Group::stop_requested() const
{
  return std::any_of(members_.begin(), members_.end(),
                     [](const link::PartnerLink* p) { return p->stop_requested(); });
}

double Group::wait_seconds() const
{
  double sum = 0.0;
  for (const link::PartnerLink* p : members_)
    sum += p->wait_seconds();
  return sum;
}

} // namespace undine::coupler
