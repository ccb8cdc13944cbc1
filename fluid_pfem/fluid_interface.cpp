// The fluid's side of an interface: its wet surface, link forces, activation.
#include "fluid_pfem/fluid.hpp"

#include "common/error.hpp"

#include <algorithm>

namespace undine::fluid
{

namespace
{

/// Row k of a vector of the interface.
template <int dim>
Vec<dim> vec(std::span<const double> rows, index_t k)
{
  Vec<dim> v;
  for (int c = 0; c < dim; ++c)
    v[c] = rows[static_cast<std::size_t>(k) * dim + static_cast<std::size_t>(c)];
  return v;
}

} // namespace

template <int dim>
void Fluid<dim>::push(std::span<const double> f_link, double dt)
{
  const auto [begin, end] = wet_range();
  require(f_link.size() == static_cast<std::size_t>(end - begin) * dim, "the link force fits the wet nodes");
  const double dt_mean = 0.5 * (dt + dt_before_); // from one half step to the next
  bool pushed = false;
  for (index_t n = begin; n < end; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    const Vec<dim> J = dt * vec<dim>(f_link, n - begin);
    if (J == Vec<dim>{})
      continue;
    pushed = true;
    Vec<dim> dv = (1.0 / nodes_.inertia[i]) * J;
    constrain(dv, n);
    // Mean of the velocities in the half steps before and after: exactly the change of kinetic energy between
    // them.
    interface_work_.add(dot(J, nodes_.v[i] + 0.5 * (dv - dt_mean * nodes_.a[i])));
    nodes_.v[i] += dv;
    nodes_.a[i] += (1.0 / dt_mean) * dv;
  }
  if (pushed && !contact_.empty())
    push_off_walls(dt); // a node between the solid and a wall
}

template <int dim>
void Fluid<dim>::correct_with_link(std::span<const double> f_link, double dt)
{
  const auto [begin, end] = wet_range();
  require(f_link.size() == static_cast<std::size_t>(end - begin) * dim, "the link force fits the wet nodes");
  for (index_t n = begin; n < end; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    const Vec<dim> f = vec<dim>(f_link, n - begin), f_mean = 0.5 * (f + vec<dim>(f_link_, n));
    Vec<dim> link;
    for (int k = 0; k < dim; ++k)
      link[k] = f[k] / nodes_.inertia[i];
    constrain(link, n);
    // Work over the step: Δt ½(f⁰ + f¹)·½(v⁰ + v¹) with v⁰ + v¹ = 2 v_half + Δt/2 (a¹ − a⁰); the mean is
    // v_half up to that telescoping part, and v_half = v_free − Δt/2 a_free.
    const Vec<dim> v_half = nodes_.v[i] - 0.5 * dt * nodes_.a[i];
    interface_work_.add(dt * dot(f_mean, v_half));
    nodes_.a[i] += link;
    nodes_.v[i] += 0.5 * dt * link;
  }
  std::copy(f_link.begin(), f_link.end(), f_link_.begin() + std::ptrdiff_t{dim} * begin);
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
  std::vector<Vec<dim>> x(nodes_.x.begin(), nodes_.x.begin() + n_wet_);
  std::vector<double> inertia(nodes_.inertia.begin(), nodes_.inertia.begin() + n_wet_);
  const std::vector<index_t> first = wet_of_ranks();
  ranks().gather_rows(x, first);
  ranks().gather_rows(inertia, first);
  for (std::size_t r = 0; r + 1 < first.size() && !ranks().alone(); ++r)
    s.owner.resize(static_cast<std::size_t>(first[r + 1]), static_cast<std::int32_t>(r));
  for (index_t n = 0; n < n_wet_; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    s.node_id.push_back(nodes_.id[i]);
    s.x.insert(s.x.end(), x[i].c.begin(), x[i].c.end());
    for (int row = 0; row < dim; ++row)
    {
      Vec<dim> e{};
      e[row] = 1.0 / inertia[i];
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
  const auto [begin, end] = wet_range();
  return {nodes_.v.front().c.data() + std::ptrdiff_t{dim} * begin,
          static_cast<std::size_t>(end - begin) * dim};
}

template <int dim>
link::Kinematics Fluid<dim>::kinematics() const
{
  link::Kinematics k;
  const auto [begin, end] = wet_range();
  for (index_t n = begin; n < end; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    Vec<dim> link = vec<dim>(f_link_, n);
    for (int c = 0; c < dim; ++c)
      link[c] /= nodes_.inertia[i];
    constrain(link, n);
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
  const link::Kinematics now = kinematics();
  const auto [begin, end] = wet_range();
  for (index_t n = begin; n < end; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    Vec<dim> dv = vec<dim>(activation.impulse, n - begin), da = vec<dim>(activation.link_force, n - begin);
    for (int c = 0; c < dim; ++c)
    {
      dv[c] /= nodes_.inertia[i];
      da[c] /= nodes_.inertia[i];
    }
    constrain(dv, n);
    constrain(da, n);
    interface_work_.add(dot(vec<dim>(activation.impulse, n - begin), vec<dim>(now.v, n - begin) + 0.5 * dv));
    nodes_.v[i] += dv;
    nodes_.a[i] = vec<dim>(now.a_free, n - begin) + da;
  }
  std::copy(activation.link_force.begin(), activation.link_force.end(),
            f_link_.begin() + std::ptrdiff_t{dim} * begin);
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
