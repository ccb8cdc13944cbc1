// The acts of one explicit step, and the remesh.
#include "fluid_pfem/fluid.hpp"

#include "common/error.hpp"
#include "fluid_pfem/critical_time_step.hpp"
#include "fluid_pfem/mass_conservation.hpp"
#include "fluid_pfem/remesh/alpha_shape.hpp"
#include "fluid_pfem/remesh/delaunay.hpp"
#include "fluid_pfem/simplex.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <tuple>

namespace undine::fluid
{

namespace
{

template <int dim>
Vec<dim> leading(const std::array<double, 3>& a)
{
  Vec<dim> v;
  for (int i = 0; i < dim; ++i)
    v[i] = a[static_cast<std::size_t>(i)];
  return v;
}

template <int dim>
std::string text(const Vec<dim>& x)
{
  return fmt::format("({:.6g})", fmt::join(x.c, ", "));
}

/// Shape of a simplex in (0, 1]: dim · inradius / circumradius.
template <int dim>
double quality(const std::array<Vec<dim>, dim + 1>& x)
{
  double surface = 0.0;
  for (const auto& g : volume_gradients<dim, double>(x))
    surface += dim * norm(g);
  return dim * (dim * signed_volume<dim, double>(x) / surface) / circumradius<dim>(x);
}

} // namespace

template <int dim>
Fluid<dim>::Fluid(const FluidConfig& config) : config_(config)
{
  const Vec<dim> origin = leading<dim>(config.origin), size = leading<dim>(config.size);
  surfaces_ = box_surfaces<dim>(origin, size);
  wall_kind_.assign(surfaces_.size(), WallKind::slip);
  for (const WallConfig& wall : config.walls)
  {
    const SurfaceMask bit = surface_bit(wall.on, "fluid.wall.on");
    wall_mask_ |= bit;
    wall_kind_[static_cast<std::size_t>(std::countr_zero(bit))] = wall.kind;
  }
  for (const auto& [interface, surface] : config.interfaces)
    wet_mask_ |= surface_bit(surface, "interface '" + interface + "': fluid");
  if (wall_mask_ & wet_mask_)
    throw InputError("fluid.wall: a surface of an [[interface]] cannot be a rigid wall as well");

  Seeds<dim> seeds = seed_box<dim>(origin, size, config.element_size, config.seeding);
  const std::size_t n = seeds.x.size();
  nodes_.x = std::move(seeds.x);
  nodes_.surface = std::move(seeds.surface);
  nodes_.v.resize(n);
  nodes_.a.resize(n);
  nodes_.m.resize(n);
  nodes_.p.resize(n);
  nodes_.V.resize(n);
  nodes_.h.assign(n, config.element_size);
  nodes_.id.resize(n);
  std::iota(nodes_.id.begin(), nodes_.id.end(), global_index_t{0});
  nodes_.rho.assign(n, config.tait.rho0);
  if (config.initial_pressure == InitialPressure::hydrostatic)
  {
    const Vec<dim> g = leading<dim>(config.gravity);
    double highest = -1e300; // of the potential g·x, where p = p₀
    for (const auto& x : nodes_.x)
      highest = std::max(highest, -dot(g, x));
    for (std::size_t i = 0; i < n; ++i)
      nodes_.rho[i] = config.tait.hydrostatic_density(highest + dot(g, nodes_.x[i]));
  }
  triangulate();
}

template <int dim>
SurfaceMask Fluid<dim>::surface_bit(const std::string& name, const std::string& what) const
{
  std::vector<std::string> known;
  for (std::size_t s = 0; s < surfaces_.size(); ++s)
  {
    if (surfaces_[s].name == name)
      return SurfaceMask{1} << s;
    known.push_back(surfaces_[s].name);
  }
  const std::string nearest = nearest_word(name, known);
  throw InputError(fmt::format("{} = '{}': the fluid has no such surface. Surfaces there: {}.{}", what, name,
                               fmt::join(known, " "),
                               nearest.empty() ? "" : " Did you mean '" + nearest + "'?"));
}

// ----------------------------------------------------------------------------------------------------------
// one step

template <int dim>
void Fluid<dim>::predict(double dt)
{
  const index_t n_nodes = nodes_.size();
  for (index_t n = 0; n < n_nodes; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    nodes_.v[i] += 0.5 * dt * nodes_.a[i];
    nodes_.x[i] += dt * nodes_.v[i];
  }
  if (!config_.viscosity.none())
  {
    update_element_stress<dim>(mesh_, nodes_, config_.viscosity, config_.tait.sound_speed(config_.tait.rho0),
                               stress_);
    dissipated_ += dt * stress_.dissipation;
  }
}

template <int dim>
void Fluid<dim>::update_state(index_t begin, index_t end)
{
  update_nodal_volumes<dim>(mesh_, nodes_, begin, end);
  check_state(update_density_and_pressure<dim>(mesh_, config_.tait, nodes_, begin, end));
}

template <int dim>
void Fluid<dim>::solve_free_motion_of_interface(double dt)
{
  update_state(0, n_layer_);
  update_acceleration<dim>(mesh_, nodes_, stress_, body_force(), 0, n_wet_);
  for (index_t n = 0; n < n_wet_; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    constrain(nodes_.a[i], n);
    nodes_.v[i] += 0.5 * dt * nodes_.a[i];
  }
}

template <int dim>
void Fluid<dim>::solve_free_motion_of_interior(double dt)
{
  const index_t n_nodes = nodes_.size();
  update_state(n_layer_, n_nodes);
  update_acceleration<dim>(mesh_, nodes_, stress_, body_force(), n_wet_, n_nodes);
  for (const index_t n : constrained_)
    if (n >= n_wet_)
      constrain(nodes_.a[static_cast<std::size_t>(n)], n);
  for (index_t n = n_wet_; n < n_nodes; ++n)
    nodes_.v[static_cast<std::size_t>(n)] += 0.5 * dt * nodes_.a[static_cast<std::size_t>(n)];
  ++steps_;
  ++steps_since_remesh_;
}

template <int dim>
void Fluid<dim>::solve_free_motion(double dt)
{
  solve_free_motion_of_interface(dt);
  solve_free_motion_of_interior(dt);
}

template <int dim>
void Fluid<dim>::correct_with_link(std::span<const double> f_link, double dt)
{
  require(f_link.size() == static_cast<std::size_t>(n_wet_) * dim, "the link force fits the wet surface");
  for (index_t n = 0; n < n_wet_; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    Vec<dim> link, f_mean;
    for (int k = 0; k < dim; ++k)
    {
      link[k] = f_link[i * dim + static_cast<std::size_t>(k)] / nodes_.m[i];
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
void Fluid<dim>::constrain(Vec<dim>& w, index_t n) const
{
  SurfaceMask walls = nodes_.surface[static_cast<std::size_t>(n)] & wall_mask_;
  for (; walls != 0; walls &= walls - 1)
  {
    const auto s = static_cast<std::size_t>(std::countr_zero(walls));
    if (wall_kind_[s] == WallKind::no_slip)
      w = Vec<dim>{};
    else
      w -= dot(w, surfaces_[s].normal) * surfaces_[s].normal;
  }
}

template <int dim>
Vec<dim> Fluid<dim>::body_force() const
{
  return leading<dim>(config_.gravity);
}

template <int dim>
void Fluid<dim>::check_state(index_t bad) const
{
  if (bad < 0)
    return;
  const auto i = static_cast<std::size_t>(bad);
  throw NumericalError(
      fmt::format("fluid step {}: the volume of node {} at {} m is {:.3g}: its elements have turned over "
                  "(velocity {} m/s). A smaller fluid.step_safety or an earlier remesh may help",
                  steps_ + 1, nodes_.id[i], text(nodes_.x[i]), nodes_.V[i], text(nodes_.v[i])));
}

// ------------------------------------------------------------------------------------------------------
// between steps

template <int dim>
double Fluid<dim>::critical_time_step() const
{
  return config_.step_safety * fluid::critical_time_step<dim>(mesh_, nodes_, config_.tait, config_.viscosity);
}

template <int dim>
double Fluid<dim>::smallest_quality() const
{
  double worst = 1.0;
  for (const auto& e : mesh_.elements)
  {
    std::array<Vec<dim>, dim + 1> x;
    for (std::size_t a = 0; a < x.size(); ++a)
      x[a] = nodes_.x[static_cast<std::size_t>(e[a])];
    worst = std::min(worst, quality<dim>(x));
  }
  return worst;
}

template <int dim>
bool Fluid<dim>::is_distorted() const
{
  if (config_.remesh_every > 0 && steps_since_remesh_ >= config_.remesh_every)
    return true;
  return smallest_quality() < std::min(config_.remesh_quality, 0.6 * quality_at_remesh_);
}

template <int dim>
void Fluid<dim>::remesh()
{
  const double before = energy().total();
  triangulate();
  remeshing_energy_ += energy().total() - before;
  ++remeshes_;
}

template <int dim>
void Fluid<dim>::triangulate()
{
  mesh_ =
      connect<dim>(nodes_.size(), alpha_shape<dim>(nodes_.x, nodes_.h, config_.alpha, delaunay(nodes_.x)));
  order_nodes();

  const index_t n_nodes = nodes_.size();
  constrained_.clear();
  for (index_t n = 0; n < n_nodes; ++n)
    if (nodes_.surface[static_cast<std::size_t>(n)] & wall_mask_)
      constrained_.push_back(n);
  for (const index_t n : constrained_)
    constrain(nodes_.v[static_cast<std::size_t>(n)], n);

  // ρ and p are the state; masses follow the new volumes. An isolated node keeps its mass and flies.
  update_nodal_volumes<dim>(mesh_, nodes_, 0, n_nodes);
  for (index_t n = 0; n < n_nodes; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    if (mesh_.isolated(n))
    {
      nodes_.rho[i] = config_.tait.rho0;
      if (nodes_.m[i] == 0.0)
        nodes_.m[i] = config_.tait.rho0 * std::pow(nodes_.h[i], dim);
    }
    else
      nodes_.m[i] = nodes_.rho[i] * nodes_.V[i];
    nodes_.p[i] = config_.tait.pressure(nodes_.rho[i]);
  }
  if (!config_.viscosity.none())
    update_element_stress<dim>(mesh_, nodes_, config_.viscosity, config_.tait.sound_speed(config_.tait.rho0),
                               stress_);
  update_acceleration<dim>(mesh_, nodes_, stress_, body_force(), 0, n_nodes);
  for (const index_t n : constrained_)
    constrain(nodes_.a[static_cast<std::size_t>(n)], n);
  f_link_.assign(static_cast<std::size_t>(n_wet_) * dim, 0.0);
  steps_since_remesh_ = 0;
  quality_at_remesh_ = smallest_quality();
  ++surface_epoch_;
}

namespace
{

template <class T>
void permute(std::vector<T>& field, const std::vector<index_t>& old_of_new)
{
  std::vector<T> result;
  result.reserve(field.size());
  for (const index_t n : old_of_new)
    result.push_back(field[static_cast<std::size_t>(n)]);
  field = std::move(result);
}

} // namespace

/// Wet nodes first, then their neighbours, then the rest; inside each group along the box diagonal's sweep
/// (by rows of one spacing).
template <int dim>
void Fluid<dim>::order_nodes()
{
  const auto n_nodes = static_cast<std::size_t>(nodes_.size());
  std::vector<int> group(n_nodes, 2);
  n_wet_ = n_layer_ = 0;
  for (std::size_t n = 0; n < n_nodes; ++n)
    if ((nodes_.surface[n] & wet_mask_) && !mesh_.isolated(static_cast<index_t>(n)))
      group[n] = 0;
  for (const auto& e : mesh_.elements)
    if (std::any_of(e.begin(), e.end(), [&](index_t n) { return group[static_cast<std::size_t>(n)] == 0; }))
      for (const index_t n : e)
        group[static_cast<std::size_t>(n)] = std::min(group[static_cast<std::size_t>(n)], 1);
  for (const int g : group)
  {
    n_wet_ += g == 0;
    n_layer_ += g <= 1;
  }

  std::vector<index_t> old_of_new(n_nodes);
  std::iota(old_of_new.begin(), old_of_new.end(), 0);
  const auto row = [&](index_t n)
  {
    std::array<long, dim> cell{};
    for (int i = 0; i < dim; ++i) // the last axis runs slowest
      cell[static_cast<std::size_t>(dim - 1 - i)] =
          std::lround(std::floor(nodes_.x[static_cast<std::size_t>(n)][i] / (2.0 * config_.element_size)));
    return cell;
  };
  std::sort(old_of_new.begin(), old_of_new.end(),
            [&](index_t a, index_t b)
            {
              const auto key = [&](index_t n) {
                return std::tuple(group[static_cast<std::size_t>(n)], row(n),
                                  nodes_.id[static_cast<std::size_t>(n)]);
              };
              return key(a) < key(b);
            });
  std::vector<index_t> new_of_old(n_nodes);
  for (std::size_t n = 0; n < n_nodes; ++n)
    new_of_old[static_cast<std::size_t>(old_of_new[n])] = static_cast<index_t>(n);

  nodes_.for_each_field([&](const char*, auto& field) { permute(field, old_of_new); });
  std::vector<Simplex<dim>> elements = std::move(mesh_.elements);
  for (auto& e : elements)
    for (index_t& n : e)
      n = new_of_old[static_cast<std::size_t>(n)];
  mesh_ = connect<dim>(nodes_.size(), std::move(elements));
}

// ------------------------------------------------------------------------------------------------ what
// others ask for

template <int dim>
FluidEnergy Fluid<dim>::energy() const
{
  FluidEnergy e;
  const Vec<dim> g = body_force();
  for (std::size_t i = 0; i < nodes_.x.size(); ++i)
  {
    e.kinetic += 0.5 * nodes_.m[i] * norm_squared(nodes_.v[i]);
    e.internal += nodes_.m[i] * config_.tait.internal_energy(nodes_.rho[i]);
    e.potential -= nodes_.m[i] * dot(g, nodes_.x[i]);
  }
  e.dissipated = dissipated_;
  e.remeshing = remeshing_energy_;
  e.interface_work = interface_work_;
  return e;
}

template <int dim>
double Fluid<dim>::mass() const
{
  return std::accumulate(nodes_.m.begin(), nodes_.m.end(), 0.0);
}

template <int dim>
Vec<dim> Fluid<dim>::momentum() const
{
  Vec<dim> sum{};
  for (std::size_t i = 0; i < nodes_.x.size(); ++i)
    sum += nodes_.m[i] * nodes_.v[i];
  return sum;
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
      e[row] = 1.0 / nodes_.m[i];
      constrain(e, n); // a projection: symmetric, so rows are columns
      s.inverse_mass.insert(s.inverse_mass.end(), e.c.begin(), e.c.end());
    }
  }
  for (const auto& facet : mesh_.boundary)
  {
    SurfaceMask common = wet_mask_;
    for (const index_t n : facet)
      common &= nodes_.surface[static_cast<std::size_t>(n)];
    if (common == 0)
      continue;
    for (std::size_t k = 0; k < config_.interfaces.size(); ++k)
      if (common & surface_bit(config_.interfaces[k].second, "interface"))
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
      link[c] = f_link_[i * dim + static_cast<std::size_t>(c)] / nodes_.m[i];
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
  const link::Kinematics now = kinematics();
  for (std::size_t i = 0; i < static_cast<std::size_t>(n_wet_); ++i)
  {
    Vec<dim> dv, da;
    for (int c = 0; c < dim; ++c)
    {
      const auto k = i * dim + static_cast<std::size_t>(c);
      dv[c] = activation.impulse[k] / nodes_.m[i];
      da[c] = activation.link_force[k] / nodes_.m[i];
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

template <int dim>
void Fluid<dim>::set_velocity(const std::vector<Vec<dim>>& v)
{
  require(v.size() == nodes_.v.size(), "one velocity per node");
  nodes_.v = v;
  for (const index_t n : constrained_)
    constrain(nodes_.v[static_cast<std::size_t>(n)], n);
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
