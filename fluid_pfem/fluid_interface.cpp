// The fluid's side of an interface: its wet surface, link forces, activation.
#include "fluid_pfem/fluid.hpp"

#include "common/error.hpp"

#include <algorithm>

namespace undine::fluid
{

template <int dim>
void Fluid<dim>::push(std::span<const double> f_link, double dt)
{
  require(f_link.size() == static_cast<std::size_t>(n_wet_) * dim, "the link force fits the wet surface");
  const double dt_mean = 0.5 * (dt + dt_before_); // from one half step to the next
  bool pushed = false;
  for (index_t n = 0; n < n_wet_here(); ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    Vec<dim> J;
    for (int k = 0; k < dim; ++k)
      J[k] = dt * f_link[i * dim + static_cast<std::size_t>(k)];
    if (J == Vec<dim>{})
      continue;
    pushed = true;
    Vec<dim> dv = (1.0 / nodes_.inertia[i]) * J;
    constrain(dv, n);
    // Mean of the velocities in the half steps before and after: exactly the change of kinetic energy between
    // them.
    interface_work_ += dot(J, nodes_.v[i] + 0.5 * (dv - dt_mean * nodes_.a[i]));
    nodes_.v[i] += dv;
    nodes_.a[i] += (1.0 / dt_mean) * dv;
  }
  if (pushed && !contact_.empty())
    push_off_walls(dt); // a node between the solid and a wall
}

template <int dim>
void Fluid<dim>::correct_with_link(std::span<const double> f_link, double dt)
{
  require(f_link.size() == static_cast<std::size_t>(n_wet_) * dim, "the link force fits the wet surface");
  for (index_t n = 0; n < n_wet_here(); ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    Vec<dim> link, f_mean;
    for (int k = 0; k < dim; ++k)
    {
      link[k] = f_link[i * dim + static_cast<std::size_t>(k)] / nodes_.inertia[i];
      f_mean[k] = 0.5 * (f_link[i * dim + static_cast<std::size_t>(k)] +
                         f_link_[i * dim + static_cast<std::size_t>(k)]);
    }
    constrain(link, n);
    // Work over the step: Δt ½(f⁰ + f¹)·½(v⁰ + v¹) with v⁰ + v¹ = 2 v_half + Δt/2 (a¹ − a⁰); the mean is
    // v_half up to that telescoping part, and v_half = v_free − Δt/2 a_free.
    const Vec<dim> v_half = nodes_.v[i] - 0.5 * dt * nodes_.a[i];
    interface_work_ += dt * dot(f_mean, v_half);
    nodes_.a[i] += link;
    nodes_.v[i] += 0.5 * dt * link;
  }
  std::copy(f_link.begin(), f_link.end(), f_link_.begin());
}

template <int dim>
void Fluid<dim>::meet_solid(const link::SurfaceMesh& solid)
{
  const bool first = solid_.empty();
  solid_.show(solid, t_);
  if (first)
    triangulate();
}

template <int dim>
link::SurfaceMesh Fluid<dim>::wet_surface() const
{
  link::SurfaceMesh s;
  s.dim = dim;
  s.epoch = surface_epoch_;
  for (const auto& [interface, surface] : config_.interfaces)
    s.interfaces.push_back(interface);
  for (index_t n = 0; n < n_wet_; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    s.node_id.push_back(nodes_.id[i]);
    s.x.insert(s.x.end(), nodes_.x[i].c.begin(), nodes_.x[i].c.end());
    for (int row = 0; row < dim; ++row)
    {
      Vec<dim> e{};
      e[row] = 1.0 / nodes_.inertia[i];
      constrain(e, n); // a projection: symmetric, so rows are columns
      s.inverse_mass.insert(s.inverse_mass.end(), e.c.begin(), e.c.end());
    }
  }
  if (!solid_.empty()) // any of these faces may come to lie on the solid
    for (const auto& facet : mesh_.boundary)
      if (std::all_of(facet.begin(), facet.end(), [&](index_t n) { return n < n_wet_; }))
      {
        s.face_nodes.insert(s.face_nodes.end(), facet.begin(), facet.end());
        s.face_offset.push_back(static_cast<std::int32_t>(s.face_nodes.size()));
        s.face_interface.push_back(0);
      }
  for (const auto& facet : mesh_.boundary)
  {
    SurfaceMask common = wet_mask_;
    for (const index_t n : facet)
      common &= nodes_.surface[static_cast<std::size_t>(n)];
    if (common == 0)
      continue;
    for (std::size_t k = 0; k < config_.interfaces.size(); ++k)
      if (config_.interfaces[k].second != InterfaceConfig::whole_boundary &&
          common & surface_bit(config_.interfaces[k].second, "interface"))
      {
        s.face_nodes.insert(s.face_nodes.end(), facet.begin(), facet.end());
        s.face_offset.push_back(static_cast<std::int32_t>(s.face_nodes.size()));
        s.face_interface.push_back(static_cast<std::int32_t>(k));
        break;
      }
  }
  return s;
}

template <int dim>
std::span<const double> Fluid<dim>::interface_velocity() const
{
  return {nodes_.v.front().c.data(), static_cast<std::size_t>(n_wet_) * dim};
}

template <int dim>
link::Kinematics Fluid<dim>::kinematics() const
{
  link::Kinematics k;
  for (std::size_t i = 0; i < static_cast<std::size_t>(n_wet_); ++i)
  {
    Vec<dim> link{};
    for (int c = 0; c < dim; ++c)
      link[c] = f_link_[i * dim + static_cast<std::size_t>(c)] / nodes_.inertia[i];
    constrain(link, static_cast<index_t>(i));
    const Vec<dim> a_free = nodes_.a[i] - link;
    k.v.insert(k.v.end(), nodes_.v[i].c.begin(), nodes_.v[i].c.end());
    k.a_free.insert(k.a_free.end(), a_free.c.begin(), a_free.c.end());
  }
  return k;
}

template <int dim>
void Fluid<dim>::apply_activation(const link::Activation& activation)
{
  collected_ = ranks().alone();
  if (!has_interface())
    return;
  const link::Kinematics now = kinematics();
  for (std::size_t i = 0; i < static_cast<std::size_t>(n_wet_); ++i)
  {
    Vec<dim> dv, da;
    for (int c = 0; c < dim; ++c)
    {
      const auto k = i * dim + static_cast<std::size_t>(c);
      dv[c] = activation.impulse[k] / nodes_.inertia[i];
      da[c] = activation.link_force[k] / nodes_.inertia[i];
    }
    constrain(dv, static_cast<index_t>(i));
    constrain(da, static_cast<index_t>(i));
    for (int c = 0; c < dim; ++c)
    {
      const auto k = i * dim + static_cast<std::size_t>(c);
      interface_work_ += activation.impulse[k] * (now.v[k] + 0.5 * dv[c]);
      nodes_.v[i][c] += dv[c];
      nodes_.a[i][c] = now.a_free[k] + da[c];
    }
  }
  f_link_ = activation.link_force;
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
