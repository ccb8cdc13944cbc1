// What the solid tells the coupler of its wet surface, and how it takes link forces and impulses.
#include "solid_fe/solid.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace undine::solid
{

template <int dim>
std::span<const double> Solid<dim>::rows_of_all(std::span<const double> mine, std::vector<double>& room) const
{
  if (ranks().alone())
    return mine;
  room.resize(f_link_.size() * dim);
  auto from = mine.begin();
  share_.for_own(0, f_link_.size(),
                 [&](std::size_t n)
                 {
                   std::copy_n(from, dim, room.begin() + static_cast<std::ptrdiff_t>(n * dim));
                   from += dim;
                 });
  assert(from == mine.end());
  return room;
}

template <int dim>
void Solid<dim>::push(std::span<const double> f_of_rank, double dt)
{
  std::vector<double> room;
  const auto f_link = rows_of_all(f_of_rank, room);
  assert(f_link.size() == f_link_.size() * dim);
  const double dt_mean = 0.5 * (dt + dt_before_); // from one half step to the next
  if constexpr (dim == 2)
    if (beam_)
    {
      if (!moves_beam())
        return;
      const auto row = [&](std::size_t n) { return Vec<2>{{f_link[2 * n], f_link[2 * n + 1]}}; };
      for (std::size_t n = 0; n < f_link_.size(); ++n)
      {
        interface_work_[n] += 0.5 * dt * dot(row(n), nodes_.v[n] - dt_mean * nodes_.a[n]);
        beam_->add_face_impulse(place_[n].second, place_[n].first, dt * row(n));
      }
      show_beam(false);
      for (std::size_t n = 0; n < f_link_.size(); ++n)
        interface_work_[n] += 0.5 * dt * dot(row(n), nodes_.v[n]);
      for (auto& driven : driven_fibres_)
        for (const index_t end : fibre_[driven.fibre])
          if (const auto n = static_cast<std::size_t>(end); n < f_link_.size())
            external_work_[n] -= dt * row(n)[driven.component] * driven.v_step;
      return;
    }
  share_.for_own(0, f_link_.size(),
                 [&](std::size_t n)
                 {
                   for (int i = 0; i < dim; ++i)
                   {
                     const double f = f_link[n * dim + static_cast<std::size_t>(i)];
                     const double dv = dt * nodes_.inverse_mass[n][i] * f, v = nodes_.v[n][i];
                     // Mean of the velocities in the half steps before and after: exactly the change of
                     // kinetic energy between them.
                     if (nodes_.inverse_mass[n][i] > 0.0)
                       interface_work_[n] += dt * f * (v + 0.5 * (dv - dt_mean * nodes_.a[n][i]));
                     nodes_.v[n][i] = v + dv;
                   }
                 });
  for (auto& driven : driven_)
    if (driven.node < f_link_.size() && share_.owns(driven.node))
    {
      const double f = f_link[driven.node * dim + static_cast<std::size_t>(driven.component)];
      interface_work_[driven.node] += dt * f * driven.v_step;
      external_work_[driven.node] -= dt * f * driven.v_step;
    }
}

template <int dim>
void Solid<dim>::correct_with_link(std::span<const double> f_of_rank, double dt)
{
  std::vector<double> room;
  const auto f_link = rows_of_all(f_of_rank, room);
  assert(f_link.size() == f_link_.size() * dim);
  const double half = 0.5 * dt;
  share_.for_own(0, f_link_.size(),
                 [&](std::size_t n)
                 {
                   Vec<dim> f;
                   for (int i = 0; i < dim; ++i)
                   {
                     f[i] = f_link[n * dim + static_cast<std::size_t>(i)];
                     if (beam_)
                       continue;
                     const double a_link = nodes_.inverse_mass[n][i] * f[i];
                     nodes_.a[n][i] += a_link;
                     nodes_.v[n][i] += half * a_link;
                   }
                   link_beam(n, f, dt);
                   interface_work_[n] += 0.5 * dot(f_link_[n] + f, step_of_wet_[n]);
                   f_link_[n] = f;
                 });
  if (beam_)
  {
    if (!moves_beam())
      return;
    show_beam(false);
  }
  for (auto& driven : driven_fibres_)
    for (const index_t end : fibre_[driven.fibre])
      if (const auto n = static_cast<std::size_t>(end); n < f_link_.size())
      {
        external_work_[n] -= 0.5 * f_link_[n][driven.component] * dt * driven.v_step;
        driven.reaction -= f_link_[n][driven.component];
      }
  for (auto& driven : driven_) // what the link pushes into a driven component, its support takes up
    if (driven.node < f_link_.size() && share_.owns(driven.node))
    {
      const double f = f_link_[driven.node][driven.component];
      external_work_[driven.node] -= 0.5 * f * dt * driven.v_step;
      driven.reaction -= f;
    }
}

template <int dim>
void Solid<dim>::apply_activation(const link::Activation& activation)
{
  if constexpr (dim == 2)
    if (beam_)
    {
      if (!moves_beam())
        return;
      const auto row = [](const std::vector<double>& all, std::size_t n) {
        return Vec<2>{{all[2 * n], all[2 * n + 1]}};
      };
      const double kinetic = beam_->kinetic_energy(); // its change is Σ impulse · (v⁻ + v⁺)/2
      for (std::size_t n = 0; n < f_link_.size(); ++n)
        beam_->add_face_impulse(place_[n].second, place_[n].first, row(activation.impulse, n));
      if (!f_link_.empty())
        interface_work_[0] += beam_->kinetic_energy() - kinetic;
      beam_->drop_face_forces();
      for (std::size_t n = 0; n < f_link_.size(); ++n)
      {
        f_link_[n] = row(activation.link_force, n);
        link_beam(n, f_link_[n], 0.0);
      }
      show_beam(false);
      for (auto& driven : driven_fibres_)
      {
        driven.reaction = -beam_->force(driven.fibre)[driven.component];
        for (const index_t end : fibre_[driven.fibre])
          if (const auto n = static_cast<std::size_t>(end); n < f_link_.size())
            driven.reaction -= f_link_[n][driven.component];
      }
      return;
    }
  std::size_t k = 0; // component in the activation
  share_.for_own(0, f_link_.size(),
                 [&](std::size_t n)
                 {
                   for (int i = 0; i < dim; ++i, ++k)
                   {
                     const double impulse = activation.impulse[k], v_before = nodes_.v[n][i];
                     nodes_.v[n][i] += nodes_.inverse_mass[n][i] * impulse;
                     if (nodes_.inverse_mass[n][i] > 0.0)
                       interface_work_[n] += impulse * 0.5 * (v_before + nodes_.v[n][i]);
                     f_link_[n][i] = activation.link_force[k];
                     nodes_.a[n][i] = a_free_wet_[n][i] + nodes_.inverse_mass[n][i] * f_link_[n][i];
                   }
                 });
  assert(k == activation.impulse.size() && k == activation.link_force.size());
  for (auto& driven : driven_)
    if (driven.node < f_link_.size() && share_.owns(driven.node))
      driven.reaction = driven_force(driven) - f_link_[driven.node][driven.component];
}

template <int dim>
link::SurfaceMesh Solid<dim>::wet_surface()
{
  if (!ranks().alone() && !beam_)
  {
    const auto owner = std::span(share_.owner()).first(f_link_.size());
    std::vector<Vec<dim>> u(nodes_.u.begin(), nodes_.u.begin() + static_cast<std::ptrdiff_t>(owner.size()));
    share_.collect(u, owner);
    std::copy(u.begin(), u.end(), nodes_.u.begin());
  }
  auto message = surface_message(reference_, wet_, nodes_);
  if (!ranks().alone() && !beam_)
    message.owner.assign(share_.owner().begin(),
                         share_.owner().begin() + static_cast<std::ptrdiff_t>(f_link_.size()));
  message.epoch = surface_epoch_++;
  if constexpr (dim == 2)
    if (beam_)
    {
      theta_sent_ = beam_->theta();
      for (std::size_t n = 0; n < f_link_.size(); ++n)
      {
        const auto& [k, face] = place_[n];
        const auto own = beam_->face_inverse_mass(face, face, k);
        std::copy(own.c.begin(), own.c.end(),
                  message.inverse_mass.begin() + static_cast<std::ptrdiff_t>(4 * n));
      }
      for (std::size_t k = 0; k < fibre_.size(); ++k)
        if (fibre_[k][0] < reference_.n_wet && fibre_[k][1] < reference_.n_wet)
        {
          message.coupled_nodes.insert(message.coupled_nodes.end(), fibre_[k].begin(), fibre_[k].end());
          const auto block = beam_->face_inverse_mass(BeamFace::left, BeamFace::right, k);
          message.coupled_inverse_mass.insert(message.coupled_inverse_mass.end(), block.c.begin(),
                                              block.c.end());
        }
    }
  return message;
}

template <int dim>
bool Solid<dim>::wet_surface_has_changed() const
{
  for (std::size_t k = 0; k < theta_sent_.size(); ++k)
    if (std::abs(beam_->theta()[k] - theta_sent_[k]) > 1e-3 &&
        (fibre_[k][0] < reference_.n_wet || fibre_[k][1] < reference_.n_wet))
      return true;
  return false;
}

template <int dim>
std::span<const double> Solid<dim>::interface_velocity() const
{
  static_assert(sizeof(Vec<dim>) == dim * sizeof(double));
  if (!ranks().alone())
  {
    wet_rows_.clear();
    share_.for_own(0, f_link_.size(),
                   [this](std::size_t n)
                   { wet_rows_.insert(wet_rows_.end(), nodes_.v[n].c.begin(), nodes_.v[n].c.end()); });
    return wet_rows_;
  }
  return {reinterpret_cast<const double*>(nodes_.v.data()), static_cast<std::size_t>(reference_.n_wet) * dim};
}

template <int dim>
link::Kinematics Solid<dim>::kinematics() const
{
  link::Kinematics kinematics;
  const auto v = interface_velocity();
  kinematics.v.assign(v.begin(), v.end());
  share_.for_own(0, a_free_wet_.size(),
                 [&](std::size_t n)
                 {
                   const auto& a = a_free_wet_[n].c;
                   kinematics.a_free.insert(kinematics.a_free.end(), a.begin(), a.end());
                 });
  return kinematics;
}

template class Solid<2>;
template class Solid<3>;

} // namespace undine::solid
