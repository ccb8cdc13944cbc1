// The acts of one explicit step, and the remesh.
#include "fluid_pfem/fluid.hpp"

#include "common/error.hpp"
#include "fluid_pfem/critical_time_step.hpp"
#include "fluid_pfem/mass_conservation.hpp"
#include "fluid_pfem/remesh/alpha_shape.hpp"
#include "fluid_pfem/remesh/refine_coarsen.hpp"
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

template <int dim>
std::array<Vec<dim>, dim + 1> corners(const FluidNodes<dim>& nodes, const Simplex<dim>& e)
{
  std::array<Vec<dim>, dim + 1> x;
  for (std::size_t a = 0; a < x.size(); ++a)
    x[a] = nodes.x[static_cast<std::size_t>(e[a])];
  return x;
}

/// Nodes this near to a solid are watched for contact with it, in units of the spacing.
constexpr double contact_reach = 2.0;

/// z, or 0 in the plane.
template <int dim>
double third(const Vec<dim>& x)
{
  return dim == 3 ? x[dim - 1] : 0.0;
}

} // namespace

template <int dim>
Fluid<dim>::Fluid(const FluidConfig& config) : config_(config)
{
  surfaces_ = body_surfaces<dim>(config);
  wall_kind_.assign(surfaces_.size(), WallKind::slip);
  for (const WallConfig& wall : config.walls)
  {
    const SurfaceMask bit = surface_bit(wall.on, "fluid.wall.on");
    (wall.kind == WallKind::impedance ? impedance_mask_ : wall_mask_) |= bit;
    wall_kind_[static_cast<std::size_t>(std::countr_zero(bit))] = wall.kind;
  }
  for (const auto& [interface, surface] : config.interfaces)
    if (surface != InterfaceConfig::whole_boundary)
      wet_mask_ |= surface_bit(surface, "interface '" + interface + "': fluid");
  if ((wall_mask_ | impedance_mask_) & wet_mask_)
    throw InputError("fluid.wall: a surface of an [[interface]] cannot be a rigid wall as well");

  contact_ = Walls<dim>(config.contact_walls, config.element_size, 0.0);
  size_ = SizeField<dim>(config.element_size, config.coarsest, config.spacing, surfaces_, contact_);
  openings_ = Openings<dim>(config.inlets, config.outlets, config.element_size);
  auto [seeds, inside] = seed_scene<dim>(config, size_, contact_);
  openings_.first_rows(seeds.x, seeds.surface, seeds.body);
  if (!config.inlets.empty())
    inside = [in_body = inside, openings = openings_](const Vec<dim>& x)
    { return (in_body && in_body(x)) || openings.behind_inlet(x); };
  const std::size_t n = seeds.x.size();
  nodes_.for_each_field([n](const char*, auto& field) { field.resize(n); });
  nodes_.x = std::move(seeds.x);
  nodes_.surface = std::move(seeds.surface);
  update_spacing();
  std::iota(nodes_.id.begin(), nodes_.id.end(), global_index_t{0});
  next_id_ = static_cast<global_index_t>(n);
  nodes_.rho.assign(n, config.tait.rho0);
  if (config.initial_pressure == InitialPressure::hydrostatic)
  {
    const Vec<dim> g = leading<dim>(config.gravity);
    highest_ = -1e300;
    for (const auto& x : nodes_.x)
      highest_ = std::max(highest_, -dot(g, x));
    for (std::size_t i = 0; i < n; ++i)
      nodes_.rho[i] = config.tait.hydrostatic_density(highest_ + dot(g, nodes_.x[i]));
  }
  for (std::size_t i = 0; i < n; ++i)
  {
    if (seeds.body[i] < 0)
      continue;
    const auto b = static_cast<std::size_t>(seeds.body[i]);
    const auto& v0 = (b == 0 ? config : config.more_bodies[b - 1]).initial_velocity;
    for (std::size_t k = 0; k < v0.size(); ++k)
      nodes_.v[i].c[k] = v0[k](nodes_.x[i][0], nodes_.x[i][1], third(nodes_.x[i]), 0.0);
  }
  openings_.drive(nodes_, 0.0);
  inside_ = std::move(inside);
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
  predict_velocity(dt);
  predict_position(dt);
}

template <int dim>
void Fluid<dim>::predict_velocity(double dt)
{
  t_ += dt;
  const index_t n_nodes = nodes_.size();
  for (index_t n = 0; n < n_nodes; ++n)
    nodes_.v[static_cast<std::size_t>(n)] += 0.5 * dt * nodes_.a[static_cast<std::size_t>(n)];
  if (!contact_.empty())
  {
    contact_.move_to(t_);
    wall_work_ += push_off_walls(dt);
  }
}

template <int dim>
double Fluid<dim>::push_off_walls(double dt)
{
  return contact_.contact(dt, nodes_.x, nodes_.v, nodes_.inertia, nodes_.a,
                          dt_before_ > 0.0 ? dt_before_ : dt);
}

template <int dim>
void Fluid<dim>::push(std::span<const double> f_link, double dt)
{
  require(f_link.size() == static_cast<std::size_t>(n_wet_) * dim, "the link force fits the wet surface");
  const double dt_mean = 0.5 * (dt + (dt_before_ > 0.0 ? dt_before_ : dt)); // from one half step to the next
  bool pushed = false;
  for (index_t n = 0; n < n_wet_; ++n)
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
    wall_work_ += push_off_walls(dt); // a node between the solid and a wall
}

template <int dim>
void Fluid<dim>::predict_position(double dt)
{
  const index_t n_nodes = nodes_.size();
  double fastest = 0.0; // squared
  if (!contact_.empty() || !solid_.empty())
    for (index_t n = 0; n < n_nodes; ++n)
      fastest = std::max(fastest, norm_squared(nodes_.v[static_cast<std::size_t>(n)]));
  for (index_t n = 0; n < n_nodes; ++n)
    nodes_.x[static_cast<std::size_t>(n)] += dt * nodes_.v[static_cast<std::size_t>(n)];
  if (!contact_.empty() && contact_.candidates_expired(dt * std::sqrt(fastest)))
    contact_.find_candidates(nodes_.x, config_.element_size);
  if (!solid_.empty())
    travel_ += dt * (std::sqrt(fastest) + 2.0 * solid_.speed());
  dt_before_ = dt;
}

template <int dim>
void Fluid<dim>::update_state(index_t begin, index_t end)
{
  check_state(
      update_density_and_pressure<dim>(mesh_, config_.tait, config_.inertia_floor, nodes_, begin, end));
  if (config_.least_pressure > -1e299)
    for (index_t n = begin; n < end; ++n)
      nodes_.p[static_cast<std::size_t>(n)] =
          std::max(nodes_.p[static_cast<std::size_t>(n)], config_.least_pressure);
  if (!config_.surface_tension_allowed)
    for (index_t n = begin; n < end; ++n)
      if (nodes_.flag[static_cast<std::size_t>(n)] & on_free_surface)
        nodes_.p[static_cast<std::size_t>(n)] = std::max(nodes_.p[static_cast<std::size_t>(n)], 0.0);
}

template <int dim>
void Fluid<dim>::add_element_forces(double dt, index_t begin, index_t end)
{
  fluid::add_element_forces<dim>(mesh_, nodes_, config_.terms, sound_speed(), gravity(), dt, begin, end,
                                 sums_);
}

template <int dim>
void Fluid<dim>::add_body_force(index_t begin, index_t end)
{
  if (config_.body_force.empty())
    return;
  sums_.body.resize(nodes_.x.size());
  for (index_t n = begin; n < end; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    for (int k = 0; k < dim; ++k)
      sums_.body[i][k] = config_.body_force[static_cast<std::size_t>(k)](nodes_.x[i][0], nodes_.x[i][1],
                                                                         third(nodes_.x[i]), t_);
    nodes_.a[i] += (nodes_.m[i] / nodes_.inertia[i]) * sums_.body[i];
  }
}

template <int dim>
void Fluid<dim>::solve_free_motion_of_interface(double dt)
{
  std::fill(nodes_.V.begin(), nodes_.V.end(), 0.0);
  add_element_volumes<dim>(mesh_, 0, e_layer_, nodes_);
  if (n_wet_ == 0)
    return;
  update_state(0, n_layer_);
  record_nodes<dim>(nodes_, config_.terms, 0, n_layer_, sums_);
  add_element_forces(dt, 0, e_wet_);
  take_acceleration<dim>(nodes_, gravity(), 0, n_wet_, sums_, mass_rate_);
  add_body_force(0, n_wet_);
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
  add_element_volumes<dim>(mesh_, e_layer_, mesh_.n_elements(), nodes_);
  update_state(n_layer_, n_nodes);
  record_nodes<dim>(nodes_, config_.terms, n_layer_, n_nodes, sums_);
  add_element_forces(dt, e_wet_, mesh_.n_elements());
  dissipated_ += dt * sums_.dissipation;
  take_acceleration<dim>(nodes_, gravity(), n_wet_, n_nodes, sums_, mass_rate_);
  add_body_force(n_wet_, n_nodes);
  for (const index_t n : constrained_)
    if (n >= n_wet_)
      constrain(nodes_.a[static_cast<std::size_t>(n)], n);
  let_waves_out(dt, true);
  if (openings_.driven_mask() != 0)
  {
    for (std::size_t i = 0; i < nodes_.x.size(); ++i) // what holds a driven node does work
      if (nodes_.surface[i] & openings_.driven_mask())
        openings_energy_ -= dt * nodes_.inertia[i] * dot(nodes_.a[i], nodes_.v[i]);
    openings_.drive(nodes_, t_);
  }
  for (index_t n = n_wet_; n < n_nodes; ++n)
    nodes_.v[static_cast<std::size_t>(n)] += 0.5 * dt * nodes_.a[static_cast<std::size_t>(n)];
  exchange_mass(dt);
  ++steps_;
  ++steps_since_remesh_;
}

/// m and M follow the stabilising flux; m also follows M, so that what remeshing did to the density field
/// heals.
template <int dim>
void Fluid<dim>::exchange_mass(double dt)
{
  const bool flux = config_.terms.residual > 0.0, feedback = config_.feedback_time > 0.0;
  if (!flux && !feedback)
    return;
  const double c_per_T = feedback ? sound_speed() / config_.feedback_time : 0.0;
  const index_t n_nodes = nodes_.size();
  for (index_t n = 0; n < n_nodes; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    const double exchanged = flux ? dt * mass_rate_[i] : 0.0;
    const double defect = std::clamp(nodes_.M[i] - nodes_.m[i], -0.2 * nodes_.m[i], 0.2 * nodes_.m[i]);
    nodes_.m[i] += exchanged + (nodes_.flag[i] & isolated_node ? 0.0 : dt * c_per_T / nodes_.h[i] * defect);
    nodes_.M[i] += exchanged;
    if (n >= n_wet_) // the coupler was told the mass of the wet ones
      nodes_.inertia[i] =
          nodes_.flag[i] & isolated_node ? nodes_.m[i] : std::max(nodes_.m[i], least_inertia(i));
  }
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
Vec<dim> Fluid<dim>::gravity() const
{
  const double ramp =
      config_.gravity_ramp > t_ ? 0.5 * (1.0 - std::cos(std::acos(-1.0) * t_ / config_.gravity_ramp)) : 1.0;
  return ramp * leading<dim>(config_.gravity);
}

/// Least mass in Newton's law of node i.
template <int dim>
double Fluid<dim>::least_inertia(std::size_t i) const
{
  return config_.inertia_floor * config_.tait.rho0 * regular_volume<dim>(nodes_.h[i]);
}

template <int dim>
void Fluid<dim>::check_state(index_t bad)
{
  // Elements of spray may turn over between two looks at the mesh: their node keeps its pressure, and the
  // next look finds them and remeshes. What is not over by then is a blow-up.
  constexpr int looks_away = 10; // steps
  if (bad < 0 || ++turned_over_ <= looks_away)
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
  // Where nothing but flying nodes is left no element bounds the step; walls still have to be met.
  return config_.step_safety *
         std::min(config_.element_size / sound_speed(),
                  fluid::critical_time_step<dim>(mesh_, nodes_, config_.tait, config_.terms,
                                                 config_.inertia_floor, workspace_));
}

template <int dim>
bool Fluid<dim>::is_distorted() const
{
  // Nodes that nobody watches could reach the solid.
  return mesh_is_bad() || (!solid_.empty() && travel_ > 0.5 * contact_reach * config_.element_size);
}

template <int dim>
bool Fluid<dim>::mesh_is_bad() const
{
  if (openings_.row_due(nodes_))
    return true;
  for (std::size_t e = 0; e < mesh_.elements.size(); ++e)
  {
    const double q = quality<dim>(corners(nodes_, mesh_.elements[e]));
    if (!(q >= std::min(config_.remesh.quality, 0.6 * static_cast<double>(quality_[e]))))
      return true;
  }
  if (config_.remesh.every == 0 || steps_since_remesh_ < config_.remesh.every)
    return false;
  if (!config_.remesh.only_if_moved)
    return true;
  // A mesh is still good if its nodes have only moved together.
  Vec<dim> mean{};
  for (std::size_t n = 0; n < x_remesh_.size(); ++n)
    mean += (1.0 / static_cast<double>(x_remesh_.size())) * (nodes_.x[n] - x_remesh_[n]);
  for (std::size_t n = 0; n < x_remesh_.size(); ++n)
    if (norm(nodes_.x[n] - x_remesh_[n] - mean) > 0.05 * nodes_.h[n])
      return true;
  return false;
}

template <int dim>
void Fluid<dim>::meet_solid(const link::SurfaceMesh& solid)
{
  const bool first = solid_.empty();
  solid_.show(solid, t_);
  if (first)
    triangulate();
}

/// Delaunay simplices of all nodes that the solid leaves room for.
template <int dim>
std::vector<Simplex<dim>> Fluid<dim>::triangulation()
{
  delaunay_.update(nodes_.x);
  std::vector<Simplex<dim>> simplices = delaunay_.simplices();
  constexpr double around_corner = 0.1; // of the spacing: what an element may cut off a wall's corner
  if (contact_.has_convex())
    std::erase_if(simplices,
                  [&](const Simplex<dim>& e)
                  {
                    const auto outer = std::count_if(
                        e.begin(), e.end(),
                        [&](index_t n) { return nodes_.flag[static_cast<std::size_t>(n)] & on_boundary; });
                    return outer >= 2 &&
                           contact_.blocks(corners(nodes_, e),
                                           around_corner * nodes_.h[static_cast<std::size_t>(e[0])]);
                  });
  if (!solid_.empty())
    std::erase_if(simplices, [&](const Simplex<dim>& e)
                  { return solid_.blocks(corners(nodes_, e), nodes_.h[static_cast<std::size_t>(e[0])]); });
  return simplices;
}

template <int dim>
void Fluid<dim>::remesh()
{
  if (!mesh_is_bad()) // the same elements, but other nodes are near the solid
  {
    auto elements = std::move(mesh_.elements);
    order_if_due(elements);
    finish_mesh(std::move(elements));
    return;
  }
  update_state(0, nodes_.size()); // the exchange of mass of the last step is part of the density that stays
  pass_openings();
  const double before = energy().total();
  if (!openings_.empty())
    update_nodal_volumes<dim>(mesh_, nodes_);
  update_spacing();
  const std::vector<Vec<dim>> old_x = nodes_.x;
  auto pieces = wall_pieces();
  for (std::size_t n = 0; n < pieces.size(); ++n) // walls may have been reached since the last remesh
  {
    const bool wall = pieces[n][0] >= 0 || (nodes_.surface[n] & wall_mask_);
    nodes_.flag[n] = static_cast<std::uint8_t>((nodes_.flag[n] & ~on_wall) | (wall ? on_wall : 0));
  }
  const SpacingReport spacing = refine_and_coarsen<dim>(
      nodes_, mesh_, pieces, solid_.empty() ? n_wet_ : 0, // nodes beside a solid come and go
      config_.remesh.spacing, next_id_);
  for (const auto& [kept, gone] : spacing.merges)
    delaunay_.merge(kept, gone);
  for (const auto& [i, j, added] : spacing.splits)
    delaunay_.split(i, j, added);
  if (!spacing.new_number.empty())
    delaunay_.renumber(spacing.new_number);
  contact_.settle(nodes_.x);
  if (!solid_.empty()) // a new node in the middle of a curved side lies inside it
    for (std::size_t n = 0; n < nodes_.x.size(); ++n)
      nodes_.x[n] = solid_.outside(nodes_.x[n], 0.02 * nodes_.h[n], 0.3 * nodes_.h[n]);
  ShapeChoice<dim> choice = choose_fluid<dim>(nodes_, pieces, triangulation(), old_x, mesh_.elements,
                                              config_.element_size, config_.remesh.shape);
  drop_fragments(choice);
  // The number that each old node has come to bear; a node that was merged is where the other one is.
  std::vector<index_t> number(old_x.size());
  std::iota(number.begin(), number.end(), 0);
  const auto follow = [&number](const std::vector<index_t>& new_number)
  {
    for (index_t& n : number)
      n = n < 0 || new_number.empty() ? n : new_number[static_cast<std::size_t>(n)];
  };
  for (const auto& [kept, gone] : spacing.merges)
    number[static_cast<std::size_t>(gone)] = kept;
  follow(spacing.new_number);
  follow(delete_isolated_nodes(choice.elements));
  follow(order_if_due(choice.elements));
  const std::vector<double> V_before = nodes_.V;
  // At the full step, nodes pressed against a wall carry half a kick into it that is not theirs to give.
  std::vector<Vec<dim>> v_half = nodes_.v;
  for (std::size_t n = 0; n < v_half.size(); ++n)
    v_half[n] -= 0.5 * dt_before_ * nodes_.a[n];
  std::vector<Simplex<dim>> old_elements = mesh_.elements;
  finish_mesh(std::move(choice.elements));
  if (config_.feedback_time > 0.0)
    hand_over_mass(changed_elements(std::move(old_elements), old_x, number), V_before, v_half);

  ++ledger_.remeshes;
  ledger_.merged += spacing.merged;
  ledger_.split += spacing.split;
  ledger_.created += choice.created;
  ledger_.dropped += choice.dropped;
  const double jump = energy().total() - before;
  (jump > 0.0 ? remesh_gain_ : remesh_loss_) += jump;
}

template <int dim>
void Fluid<dim>::update_spacing()
{
  nodes_.h.assign(nodes_.x.size(), config_.element_size);
  if (size_.uniform())
    return;
  for (std::size_t n = 0; n < nodes_.x.size(); ++n)
    nodes_.h[n] = size_(nodes_.x[n], contact_);
}

template <int dim>
void Fluid<dim>::triangulate()
{
  auto elements = alpha_shape<dim>(nodes_.x, nodes_.h, config_.remesh.alpha, triangulation());
  if (inside_)
    std::erase_if(elements,
                  [&](const Simplex<dim>& e)
                  {
                    Vec<dim> centroid{};
                    for (const auto& x : corners(nodes_, e))
                      centroid += (1.0 / (dim + 1)) * x;
                    return !inside_(centroid);
                  });
  order_if_due(elements);
  finish_mesh(std::move(elements));
  nodes_.M = nodes_.m;
}

template <int dim>
std::vector<std::array<int, 3>> Fluid<dim>::wall_pieces() const
{
  std::vector<std::array<int, 3>> pieces(nodes_.x.size(), {-1, -1, -1});
  constexpr double tolerance = 0.02; // of the spacing
  if (!contact_.empty())
    for (std::size_t n = 0; n < nodes_.x.size(); ++n)
      pieces[n] = contact_.pieces_at(nodes_.x[n], tolerance * nodes_.h[n]);
  if (!solid_.empty())
    for (std::size_t n = 0; n < nodes_.x.size(); ++n)
      for (const int side : solid_.sides_at(nodes_.x[n], tolerance * nodes_.h[n]))
        if (const auto free = std::find(pieces[n].begin(), pieces[n].end(), -1);
            side >= 0 && free != pieces[n].end())
          *free = side;
  return pieces;
}

/// All that follows from positions, densities and connectivity.
template <int dim>
void Fluid<dim>::finish_mesh(std::vector<Simplex<dim>> elements)
{
  mesh_ = connect<dim>(nodes_.size(), std::move(elements));
  flag_nodes();
  const index_t n_nodes = nodes_.size();
  constrained_.clear();
  for (index_t n = 0; n < n_nodes; ++n)
    if (nodes_.surface[static_cast<std::size_t>(n)] & wall_mask_)
      constrained_.push_back(n);
  for (const index_t n : constrained_)
    constrain(nodes_.v[static_cast<std::size_t>(n)], n);

  // ρ and p are the state; masses follow the new volumes. An isolated node keeps its mass and flies.
  update_nodal_volumes<dim>(mesh_, nodes_);
  for (index_t n = 0; n < n_nodes; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    if (mesh_.isolated(n))
    {
      nodes_.rho[i] = config_.tait.rho0;
      nodes_.m[i] = nodes_.M[i] > 0.0 ? nodes_.M[i] : least_inertia(i);
    }
    else // the inverse of update_density_and_pressure, completed nodes included
      nodes_.m[i] =
          nodes_.rho[i] * nodes_.V[i] + (nodes_.rho[i] - config_.tait.rho0) *
                                            std::max(0.0, least_inertia(i) / config_.tait.rho0 - nodes_.V[i]);
    nodes_.p[i] = config_.tait.pressure(nodes_.rho[i]);
    // What flies is moved by gravity alone: no element can accelerate it.
    nodes_.inertia[i] = mesh_.isolated(n) ? nodes_.m[i] : std::max(nodes_.m[i], least_inertia(i));
  }
  mass_rate_.assign(static_cast<std::size_t>(n_nodes), 0.0);
  sums_.reset(n_nodes);
  // Elements are sorted by their smallest node.
  const auto elements_below = [this](index_t n)
  {
    return static_cast<index_t>(std::partition_point(mesh_.elements.begin(), mesh_.elements.end(),
                                                     [n](const Simplex<dim>& e) { return e[0] < n; }) -
                                mesh_.elements.begin());
  };
  e_wet_ = elements_below(n_wet_);
  e_layer_ = elements_below(n_layer_);
  // Viscous terms need the velocity of the half step: at the full one, nodes pressed against a wall carry
  // half a kick into it.
  const std::vector<Vec<dim>> v = nodes_.v;
  for (std::size_t i = 0; i < v.size(); ++i)
    nodes_.v[i] -= 0.5 * dt_before_ * nodes_.a[i];
  record_nodes<dim>(nodes_, config_.terms, 0, n_nodes, sums_);
  add_element_forces(dt_before_, 0, mesh_.n_elements());
  take_acceleration<dim>(nodes_, gravity(), 0, n_nodes, sums_, mass_rate_);
  add_body_force(0, n_nodes);
  for (const index_t n : constrained_)
    constrain(nodes_.a[static_cast<std::size_t>(n)], n);
  find_impedance();
  let_waves_out(dt_before_, false);
  nodes_.v = v;
  openings_.drive(nodes_, t_);

  f_link_.assign(static_cast<std::size_t>(n_wet_) * dim, 0.0);
  steps_since_remesh_ = 0;
  turned_over_ = 0;
  x_remesh_ = nodes_.x;
  quality_.resize(mesh_.elements.size());
  for (std::size_t e = 0; e < mesh_.elements.size(); ++e)
    quality_[e] = static_cast<float>(quality<dim>(corners(nodes_, mesh_.elements[e])));
  if (!contact_.empty())
    contact_.find_candidates(nodes_.x, config_.element_size);
  ++surface_epoch_;
}

/// Boundary, free surface, wall, isolated: from the boundary facets and the walls.
template <int dim>
void Fluid<dim>::flag_nodes()
{
  const auto pieces = wall_pieces();
  const index_t n_nodes = nodes_.size();
  for (index_t n = 0; n < n_nodes; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    const bool wall = pieces[i][0] >= 0 || (nodes_.surface[i] & wall_mask_);
    const bool alone = mesh_.isolated(n);
    nodes_.flag[i] =
        static_cast<std::uint8_t>((wall ? on_wall : 0) | (alone ? isolated_node | on_boundary : 0));
    nodes_.alone[i] = alone ? static_cast<std::uint8_t>(std::min(nodes_.alone[i] + 1, 255)) : 0;
  }
  for (const auto& facet : mesh_.boundary)
  {
    SurfaceMask surface = wall_mask_ | wet_mask_ | impedance_mask_ | openings_.driven_mask();
    std::array<int, 3> shared = pieces[static_cast<std::size_t>(facet[0])];
    for (const index_t n : facet)
    {
      surface &= nodes_.surface[static_cast<std::size_t>(n)];
      const auto& p = pieces[static_cast<std::size_t>(n)];
      for (int& piece : shared)
        if (std::find(p.begin(), p.end(), piece) == p.end())
          piece = -1;
    }
    const bool bound =
        surface != 0 || std::any_of(shared.begin(), shared.end(), [](int piece) { return piece >= 0; });
    for (const index_t n : facet)
      nodes_.flag[static_cast<std::size_t>(n)] |=
          static_cast<std::uint8_t>(bound ? on_boundary : on_boundary | on_free_surface);
  }
}

/// One or two elements that hang together with no others are spray: as fluid they would be a spring between
/// few nodes that snaps. Their nodes fly.
template <int dim>
void Fluid<dim>::drop_fragments(ShapeChoice<dim>& choice) const
{
  constexpr int fewest = 3; // elements
  std::vector<index_t> root(nodes_.x.size());
  std::iota(root.begin(), root.end(), 0);
  const auto find = [&](index_t n)
  {
    while (root[static_cast<std::size_t>(n)] != n)
      n = root[static_cast<std::size_t>(n)] =
          root[static_cast<std::size_t>(root[static_cast<std::size_t>(n)])];
    return n;
  };
  for (const auto& e : choice.elements)
    for (const index_t n : e)
      root[static_cast<std::size_t>(find(n))] = find(e[0]);
  std::vector<int> count(nodes_.x.size(), 0);
  for (const auto& e : choice.elements)
    ++count[static_cast<std::size_t>(find(e[0]))];
  std::erase_if(choice.elements,
                [&](const Simplex<dim>& e)
                {
                  const bool wet = std::any_of(e.begin(), e.end(),
                                               [&](index_t n) {
                                                 return (nodes_.surface[static_cast<std::size_t>(n)] &
                                                         (wet_mask_ | openings_.driven_mask())) != 0;
                                               });
                  if (wet || count[static_cast<std::size_t>(find(e[0]))] >= fewest)
                    return false;
                  choice.dropped += std::abs(signed_volume<dim, double>(corners(nodes_, e)));
                  return true;
                });
}

/// @returns the new number of each node, empty if numbers stay
template <int dim>
std::vector<index_t> Fluid<dim>::delete_isolated_nodes(std::vector<Simplex<dim>>& elements)
{
  if (config_.remesh.delete_isolated_after == 0)
    return {};
  std::vector<char> used(nodes_.x.size(), 0);
  for (const auto& e : elements)
    for (const index_t n : e)
      used[static_cast<std::size_t>(n)] = 1;
  std::vector<char> gone(nodes_.x.size(), 0);
  for (std::size_t n = 0; n < gone.size(); ++n)
    if (!used[n] && nodes_.alone[n] >= config_.remesh.delete_isolated_after)
    {
      gone[n] = 1;
      ++ledger_.deleted_nodes;
      ledger_.deleted_mass += nodes_.M[n];
    }
  return erase_nodes(gone, elements);
}

/// @returns the new number of each node, empty if numbers stay
template <int dim>
std::vector<index_t> Fluid<dim>::erase_nodes(const std::vector<char>& gone,
                                             std::vector<Simplex<dim>>& elements)
{
  std::vector<index_t> new_number(nodes_.x.size(), -1);
  index_t kept = 0;
  for (std::size_t n = 0; n < new_number.size(); ++n)
    if (!gone[n])
      new_number[n] = kept++;
    else
      delaunay_.remove(static_cast<index_t>(n));
  if (kept == nodes_.size())
    return {};
  delaunay_.renumber(new_number);
  nodes_.for_each_field(
      [&](const char*, auto& field)
      {
        for (std::size_t n = 0; n < new_number.size(); ++n)
          if (new_number[n] >= 0)
            field[static_cast<std::size_t>(new_number[n])] = field[n];
        field.resize(static_cast<std::size_t>(kept));
      });
  for (auto& e : elements)
    for (index_t& n : e)
      n = new_number[static_cast<std::size_t>(n)];
  return new_number;
}

/// Nodes come in and go out; the advected mesh of the last remesh gets and loses their elements, so that the
/// remesh that follows finds the fluid where it is.
template <int dim>
void Fluid<dim>::pass_openings()
{
  if (openings_.empty())
    return;
  const double before = energy().total();
  const index_t n_before = nodes_.size();
  inflow_ += openings_.let_in(nodes_, mesh_.elements, next_id_, config_.tait.rho0);
  openings_.drive(nodes_, t_);
  std::vector<char> gone;
  outflow_ += openings_.let_out(nodes_, mesh_.elements, gone);
  if (!gone.empty() || nodes_.size() != n_before)
    delaunay_.forget();
  if (!gone.empty())
  {
    erase_nodes(gone, mesh_.elements);
    mesh_.boundary.clear(); // of a mesh that is no more; the edges of splits are then taken as inner ones
  }
  openings_energy_ += energy().total() - before;
}

template <int dim>
void Fluid<dim>::find_impedance()
{
  impedance_.clear();
  if (impedance_mask_ == 0)
    return;
  std::vector<Vec<dim>> area(nodes_.x.size());
  for (const auto& facet : mesh_.boundary)
  {
    SurfaceMask common = impedance_mask_;
    std::array<Vec<dim>, dim> x;
    for (std::size_t k = 0; k < dim; ++k)
    {
      common &= nodes_.surface[static_cast<std::size_t>(facet[k])];
      x[k] = nodes_.x[static_cast<std::size_t>(facet[k])];
    }
    // volume_gradient of the facet is inward: V∇N = −area/dim
    for (const index_t n : facet)
      if (common != 0)
        area[static_cast<std::size_t>(n)] -= volume_gradient<dim, double>(x);
  }
  for (index_t n = 0; n < nodes_.size(); ++n)
    if (norm_squared(area[static_cast<std::size_t>(n)]) > 0.0)
      impedance_.push_back({n, area[static_cast<std::size_t>(n)]});
}

/// Traction −(p(rest) + ρ₀c₀ v_n) n on impedance nodes, implicit in the velocity of the full step:
/// v = v_half + Δt/2 a,  (m + Δt/2 Z) a_n = F_n − p A − Z v_half,n,  Z = ρ₀ c₀ A.
template <int dim>
void Fluid<dim>::let_waves_out(double dt, bool book)
{
  const Tait& tait = config_.tait;
  for (const ImpedanceNode& node : impedance_)
  {
    const auto i = static_cast<std::size_t>(node.node);
    const double A = norm(node.area), Z = tait.rho0 * sound_speed() * A, m = nodes_.inertia[i];
    const Vec<dim> n = node.area * (1.0 / A);
    const double depth = std::max(0.0, highest_ + dot(leading<dim>(config_.gravity), nodes_.x[i]));
    const double p = config_.initial_pressure == InitialPressure::hydrostatic
                         ? tait.pressure(tait.hydrostatic_density(depth))
                         : tait.p0;
    const double v_n = dot(nodes_.v[i], n), a_n = dot(nodes_.a[i], n);
    const double da = (m * a_n - p * A - Z * v_n) / (m + 0.5 * dt * Z) - a_n;
    nodes_.a[i] += da * n;
    if (book)
      openings_energy_ += dt * m * da * v_n;
  }
}

/// Elements that the old or the new mesh has alone, or that have been deformed by the remesh.
/// @param number present number of each old node, −1: deleted
template <int dim>
std::vector<Simplex<dim>> Fluid<dim>::changed_elements(std::vector<Simplex<dim>> old,
                                                       std::span<const Vec<dim>> old_x,
                                                       std::span<const index_t> number) const
{
  std::vector<char> moved(nodes_.x.size(), 0);
  for (std::size_t n = 0; n < number.size(); ++n)
    if (number[n] >= 0 && nodes_.x[static_cast<std::size_t>(number[n])] != old_x[n])
      moved[static_cast<std::size_t>(number[n])] = 1;
  bool same_numbers = openings_.empty(); // elements of an inlet are in no order
  for (std::size_t n = 0; n < number.size(); ++n)
    same_numbers = same_numbers && number[n] == static_cast<index_t>(n);
  if (!same_numbers)
  {
    for (auto& e : old)
      for (index_t& n : e)
        n = number[static_cast<std::size_t>(n)];
    old = sorted_elements<dim>(nodes_.size(), std::move(old));
  }
  std::vector<Simplex<dim>> changed;
  const auto& now = mesh_.elements;
  for (std::size_t o = 0, k = 0; o < old.size() || k < now.size();)
    if (k == now.size() || (o < old.size() && old[o] < now[k]))
      changed.push_back(old[o++]);
    else if (o == old.size() || now[k] < old[o])
      changed.push_back(now[k++]);
    else
    {
      if (std::any_of(now[k].begin(), now[k].end(),
                      [&](index_t n) { return moved[static_cast<std::size_t>(n)]; }))
        changed.push_back(now[k]);
      ++o;
      ++k;
    }
  return changed;
}

/// New connectivity hands volume from node to node; particle mass goes with it, so that a remesh of quiet
/// fluid leaves no defect M − m. Nodes that share changed elements form a patch; what its losers lose goes to
/// its gainers. Only volume that the patch as a whole gained or lost is a defect: that was created or dropped
/// by decision. A node that flies or flew keeps its mass. Nodes keep their velocities, which conserves
/// momentum of a linear field, unless the kinetic energy of the patch would grow: then gainers take over as
/// much of the losers' velocity as keeps it.
/// @param changed elements of the old or the new mesh that the other does not have, in the present numbers
/// @param V_before of each node before the remesh [m^dim]
/// @param v_half velocity of the half step, whose energy it is [m/s]
template <int dim>
void Fluid<dim>::hand_over_mass(const std::vector<Simplex<dim>>& changed, std::span<const double> V_before,
                                std::span<Vec<dim>> v_half)
{
  const auto n_nodes = static_cast<std::size_t>(nodes_.size());
  std::vector<index_t> leader(n_nodes, -1); // of the patch; −1: nothing has changed at the node
  const auto leader_of = [&](index_t n)
  {
    for (index_t up; (up = leader[static_cast<std::size_t>(n)]) != n; n = up)
      leader[static_cast<std::size_t>(n)] = leader[static_cast<std::size_t>(up)];
    return n;
  };
  for (const auto& e : changed)
  {
    index_t first = -1;
    for (const index_t n : e)
      if (n >= 0)
      {
        if (leader[static_cast<std::size_t>(n)] < 0)
          leader[static_cast<std::size_t>(n)] = n;
        const index_t root = leader_of(n);
        if (first >= 0) // the smaller number leads, so that the order does not matter
          leader[static_cast<std::size_t>(std::max(first, root))] = std::min(first, root);
        first = first < 0 ? root : std::min(first, root);
      }
  }

  struct Patch
  {
    double gain = 0.0, loss = 0.0, mass = 0.0; ///< volumes; mass that changes hands
    Vec<dim> momentum{};                       ///< of that mass
    double energy = 0.0;                       ///< kinetic, that the patch gains if velocities stay …
    double linear = 0.0, square = 0.0; ///< … plus θ linear + θ² square if gainers take a part θ of the way
  };
  std::vector<Patch> patches(n_nodes); // at its leader
  const auto patch_of = [&](std::size_t n) -> Patch&
  { return patches[static_cast<std::size_t>(leader_of(static_cast<index_t>(n)))]; };
  const auto gain_of = [&](std::size_t n)
  {
    const bool flies = V_before[n] == 0.0 || (nodes_.flag[n] & isolated_node);
    return leader[n] < 0 || flies ? 0.0 : nodes_.V[n] - V_before[n];
  };
  for (std::size_t n = 0; n < n_nodes; ++n)
    if (const double gain = gain_of(n); gain != 0.0)
      (gain > 0.0 ? patch_of(n).gain : patch_of(n).loss) += std::abs(gain);
  for (std::size_t n = 0; n < n_nodes; ++n)
    if (const double gain = gain_of(n); gain < 0.0)
    {
      Patch& p = patch_of(n);
      const double given = nodes_.rho[n] * -gain * std::min(1.0, p.gain / p.loss);
      nodes_.M[n] -= given;
      p.mass += given;
      p.momentum += given * v_half[n];
      p.energy -= 0.5 * given * norm_squared(v_half[n]);
    }
  // Change of velocity of a gainer that takes all the way: its new mass has the mean velocity of both.
  const auto full_change = [&](std::size_t n, const Patch& p, double taken)
  {
    const bool free =
        static_cast<index_t>(n) >= n_wet_ && nodes_.M[n] > taken; // the coupler knows v of wet nodes
    return free ? (taken / nodes_.M[n]) * ((1.0 / p.mass) * p.momentum - v_half[n]) : Vec<dim>{};
  };
  for (std::size_t n = 0; n < n_nodes; ++n)
    if (const double gain = gain_of(n); gain > 0.0)
      if (Patch& p = patch_of(n); p.mass > 0.0)
      {
        const double taken = p.mass * gain / p.gain;
        nodes_.M[n] += taken;
        const Vec<dim> dv = full_change(n, p, taken);
        p.energy += 0.5 * taken * norm_squared(v_half[n]);
        p.linear += nodes_.M[n] * dot(v_half[n], dv);
        p.square += 0.5 * nodes_.M[n] * norm_squared(dv);
      }
  for (std::size_t n = 0; n < n_nodes; ++n)
    if (const double gain = gain_of(n); gain > 0.0)
      if (const Patch& p = patch_of(n); p.mass > 0.0 && p.energy > 0.0 && p.square > 0.0)
      {
        const double discriminant = p.linear * p.linear - 4.0 * p.square * p.energy;
        const double theta = p.linear < 0.0 && discriminant > 0.0
                                 ? std::min(1.0, 2.0 * p.energy / (std::sqrt(discriminant) - p.linear))
                                 : 1.0;
        const Vec<dim> dv = theta * full_change(n, p, p.mass * gain / p.gain);
        nodes_.v[n] += dv;
        v_half[n] += dv;
      }
  smooth_mass_defect(v_half);
  for (const index_t n : constrained_)
    constrain(nodes_.v[static_cast<std::size_t>(n)], n);
}

/// Spread M − m over neighbours, conserving ΣM, without a gain of kinetic energy: the feedback then acts on
/// the smooth part and makes no noise.
template <int dim>
void Fluid<dim>::smooth_mass_defect(std::span<Vec<dim>> v_half)
{
  constexpr int sweeps = 5;
  constexpr double share = 0.08;
  for (int sweep = 0; sweep < sweeps; ++sweep)
    for (const auto& e : mesh_.elements)
      for (std::size_t a = 0; a <= dim; ++a)
        for (std::size_t b = a + 1; b <= dim; ++b)
        {
          const auto i = static_cast<std::size_t>(e[a]), j = static_cast<std::size_t>(e[b]);
          const double wanted = share * ((nodes_.M[i] - nodes_.m[i]) - (nodes_.M[j] - nodes_.m[j]));
          // A small node must not be emptied.
          const double flux =
              std::clamp(wanted, -0.1 * std::max(nodes_.M[j], 0.0), 0.1 * std::max(nodes_.M[i], 0.0));
          nodes_.M[i] -= flux;
          nodes_.M[j] += flux;
          const std::size_t from = flux > 0.0 ? i : j, to = flux > 0.0 ? j : i;
          const double rise = norm_squared(v_half[to]) - norm_squared(v_half[from]);
          if (rise <= 0.0 || static_cast<index_t>(to) < n_wet_ || !(nodes_.M[to] > std::abs(flux)))
            continue;
          // The receiver slows down by a part of the way to the mean velocity that pays for the rise, to
          // first order in the flux.
          const Vec<dim> way = v_half[from] - v_half[to];
          const double pays = -2.0 * dot(v_half[to], way);
          const Vec<dim> dv = (std::min(1.0, rise / pays) * std::abs(flux) / nodes_.M[to]) * way;
          v_half[to] += dv;
          nodes_.v[to] += dv;
        }
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
/// @returns the new number of each node
template <int dim>
std::vector<index_t> Fluid<dim>::order_nodes(std::vector<Simplex<dim>>& elements)
{
  const auto n_nodes = static_cast<std::size_t>(nodes_.size());
  std::vector<char> used(n_nodes, 0);
  for (const auto& e : elements)
    for (const index_t n : e)
      used[static_cast<std::size_t>(n)] = 1;
  std::vector<int> group(n_nodes, 2);
  n_wet_ = n_layer_ = 0;
  for (std::size_t n = 0; n < n_nodes; ++n)
    if (((nodes_.surface[n] & wet_mask_) && used[n]) ||
        solid_.is_near(nodes_.x[n], contact_reach * config_.element_size))
      group[n] = 0;
  travel_ = 0.0;
  for (const auto& e : elements)
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
  delaunay_.renumber(new_of_old);
  for (auto& e : elements)
    for (index_t& n : e)
      n = new_of_old[static_cast<std::size_t>(n)];
  return new_of_old;
}

/// Neighbours in space should be neighbours in memory; a few new nodes at the end do not matter, wet nodes
/// must come first.
template <int dim>
std::vector<index_t> Fluid<dim>::order_if_due(std::vector<Simplex<dim>>& elements)
{
  constexpr std::int64_t order_every = 25;
  if (wet_mask_ != 0 || !solid_.empty() || ledger_.remeshes % order_every == 0)
    return order_nodes(elements);
  n_layer_ = 0;
  return {};
}

// ------------------------------------------------------------------------------------------------ what
// others ask for

template <int dim>
FluidEnergy Fluid<dim>::energy() const
{
  FluidEnergy e;
  const Vec<dim> g = gravity();
  for (std::size_t i = 0; i < nodes_.x.size(); ++i)
  {
    e.kinetic += 0.5 * nodes_.M[i] * norm_squared(nodes_.v[i]);
    e.internal += nodes_.m[i] * config_.tait.internal_energy(nodes_.rho[i]);
    e.potential -= nodes_.M[i] * dot(g, nodes_.x[i]);
  }
  e.dissipated = dissipated_;
  e.remesh_gain = remesh_gain_;
  e.remesh_loss = remesh_loss_;
  e.wall_work = wall_work_;
  e.interface_work = interface_work_;
  e.openings = openings_energy_;
  return e;
}

template <int dim>
FluidMass Fluid<dim>::mass_by_state() const
{
  FluidMass mass;
  for (std::size_t i = 0; i < nodes_.x.size(); ++i)
  {
    const bool flies = nodes_.flag[i] & isolated_node;
    (flies ? mass.flying : mass.meshed) += nodes_.M[i];
    if (!flies)
    {
      mass.dynamic += nodes_.m[i];
      mass.volume += nodes_.V[i];
    }
  }
  mass.deleted = ledger_.deleted_mass;
  mass.inflow = inflow_;
  mass.outflow = outflow_;
  return mass;
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

template <int dim>
void Fluid<dim>::for_each_state(StateArchive& archive)
{
  nodes_.for_each_field([&archive](const char* name, auto& field) { archive(name, field); });
  archive("elements", mesh_.elements);
  if (archive.reading())
    mesh_ = connect<dim>(nodes_.size(), std::move(mesh_.elements));
  archive("contact", contact_);
  archive("solid", solid_);
  archive("travel", travel_);
  archive("terms", sums_);
  sums_.record.resize(nodes_.x.size());
  sums_.sum.resize(nodes_.x.size());
  delaunay_.forget(); // both runs then go on with a rebuild
  archive("e_layer", e_layer_);
  archive("mass_rate", mass_rate_);
  archive("n_wet", n_wet_);
  archive("n_layer", n_layer_);
  archive("e_wet", e_wet_);
  archive("constrained", constrained_);
  archive("f_link", f_link_);
  archive("quality", quality_);
  archive("x_remesh", x_remesh_);
  archive("next_id", next_id_);
  archive("t", t_);
  archive("dt_before", dt_before_);
  archive("steps", steps_);
  archive("steps_since_remesh", steps_since_remesh_);
  archive("surface_epoch", surface_epoch_);
  archive("ledger", ledger_);
  archive("dissipated", dissipated_);
  archive("remesh_gain", remesh_gain_);
  archive("remesh_loss", remesh_loss_);
  archive("interface_work", interface_work_);
  archive("wall_work", wall_work_);
  archive("impedance", impedance_);
  archive("openings_energy", openings_energy_);
  archive("inflow", inflow_);
  archive("outflow", outflow_);
  archive("turned_over", turned_over_);
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
