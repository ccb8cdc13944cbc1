// The acts of one explicit step. The remesh: remesh/remesh.cpp; what the coupler sees: fluid_interface.cpp.
#include "fluid_pfem/fluid.hpp"

#include "common/error.hpp"
#include "common/parallel/exact_sum.hpp"
#include "fluid_pfem/critical_time_step.hpp"
#include "fluid_pfem/mass_conservation.hpp"
#include "fluid_pfem/remesh/alpha_shape.hpp"
#include "fluid_pfem/remesh/distortion.hpp"
#include "fluid_pfem/simplex.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>

namespace undine::fluid
{

namespace
{

template <int dim>
std::string text(const Vec<dim>& x)
{
  return fmt::format("({:.6g})", fmt::join(x.c, ", "));
}

/// z, or 0 in the plane.
template <int dim>
double third(const Vec<dim>& x)
{
  return dim == 3 ? x[dim - 1] : 0.0;
}

} // namespace

template <int dim>
Fluid<dim>::Fluid(const FluidConfig& config, const Ranks& ranks, Cut cut)
    : config_(config), team_(config.threads, ranks, std::move(cut))
{
  const bool impedance = std::any_of(config.walls.begin(), config.walls.end(),
                                     [](const WallConfig& wall) { return wall.kind == WallKind::impedance; });
  if (!ranks.alone() && (impedance || !config.inlets.empty() || !config.outlets.empty()))
    throw InputError(fmt::format("{}: works on one rank of fluid_pfem, not on {}; start it with -n 1",
                                 impedance                ? "fluid.wall: kind = \"impedance\""
                                 : !config.inlets.empty() ? "fluid.inlet"
                                                          : "fluid.outlet",
                                 ranks.size()));
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

  nodes_.period = Period<dim>(leading<dim>(config.origin), leading<dim>(config.period));
  for (std::size_t s = 0; s < surfaces_.size() && nodes_.period.any(); ++s) // two faces per axis: no boundary
    if (config.period[s / 2] > 0.0 && ((wall_mask_ | impedance_mask_ | wet_mask_) >> s & 1))
      throw InputError(
          fmt::format("fluid.wall: '{}' is an end of a periodic direction and no wall", surfaces_[s].name));
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
  update_spacing({});
  std::iota(nodes_.id.begin(), nodes_.id.end(), global_index_t{0});
  next_id_ = static_cast<global_index_t>(n);
  nodes_.rho.assign(n, config.tait.rho0);
  if (config.initial_pressure == InitialPressure::hydrostatic)
  {
    const Vec<dim> g = leading<dim>(config.gravity);
    // Bodies do not touch each other: each has a level of its own; rows behind an inlet have the highest.
    constexpr double none = std::numeric_limits<double>::lowest();
    std::vector<double> level(2 + config.more_bodies.size(), none); // of all, of each body
    const auto own = [&](std::size_t i) -> double&
    { return level[static_cast<std::size_t>(seeds.body[i] + 1)]; };
    for (std::size_t i = 0; i < n; ++i)
      for (double* l : {&level.front(), &own(i)})
        *l = std::max(*l, -dot(g, nodes_.x[i]));
    for (std::size_t i = 0; i < n; ++i)
      nodes_.rho[i] = config.tait.hydrostatic_density(own(i) + dot(g, nodes_.x[i]));
    highest_ = level[level[1] > none ? 1 : 0]; // impedance boundaries are surfaces of the first body
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
  seeds = {}; // nobody needs them while the mesh is made
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
  collected_ = ranks().alone();
  team_.each([&](const Share& share) { kick(dt, share.node_begin, share.node_end); });
  if (!contact_.empty())
  {
    contact_.move_to(t_);
    push_off_walls(dt);
  }
}

/// v ← v + Δt/2 a.
template <int dim>
void Fluid<dim>::kick(double dt, index_t begin, index_t end)
{
  double* v = nodes_.v.front().c.data();
  const double* a = nodes_.a.front().c.data();
  for (std::ptrdiff_t k = std::ptrdiff_t{dim} * begin; k < std::ptrdiff_t{dim} * end; ++k)
    v[k] += 0.5 * dt * a[k];
}

/// Walls work on the inertia; what the kinetic energy of the particle mass gets beyond that is booked with
/// what masses that differ do, [5b] of the theory.
template <int dim>
void Fluid<dim>::push_off_walls(double dt)
{
  contact_.contact(dt, nodes_.x, nodes_.v, nodes_.inertia, nodes_.a, dt_before_,
                   [this](Vec<dim>& w, index_t n) { constrain(w, n); });
  if (exchange_energy_.empty())
    return;
  const double dt_mean = 0.5 * (dt + dt_before_);
  const Vec<dim> g = gravity();
  for (const auto& [node, dv] : contact_.corrections())
  {
    const auto n = static_cast<std::size_t>(node);
    const Vec<dim> a_free = nodes_.a[n] - (1.0 / dt_mean) * dv,
                   v_mean = nodes_.v[n] - 0.5 * dt_mean * nodes_.a[n];
    const double beyond = nodes_.M[n] - nodes_.inertia[n];
    exchange_energy_[n] +=
        dot(dv, beyond * v_mean + 0.5 * dt_mean * (beyond * a_free - (nodes_.M[n] - nodes_.m[n]) * g));
  }
}

template <int dim>
void Fluid<dim>::predict_position(double dt)
{
  fastest_.assign(static_cast<std::size_t>(team_.threads()), 0.0);
  team_.each(
      [&](const Share& share)
      {
        double* const x = nodes_.x.front().c.data();
        const double* const v = nodes_.v.front().c.data();
        Lanes fastest(0.0); // squared
        for (index_t n = share.node_begin; n < share.node_end; n += Lanes::size)
        {
          const index_t end = std::min(n + Lanes::size, share.node_end);
          for (std::ptrdiff_t k = std::ptrdiff_t{dim} * n; k < std::ptrdiff_t{dim} * end; ++k)
            x[k] += dt * v[k];
          const double* row[Lanes::size];
          for (index_t l = 0; l < Lanes::size; ++l)
            row[l] = v + std::ptrdiff_t{dim} * std::min(n + l, end - 1);
          Vec<dim, Lanes> eight;
          if constexpr (dim == 2)
            load_pairs(row, eight[0], eight[1]);
          else
            for (int l = 0; l < Lanes::size; ++l)
              for (int i = 0; i < dim; ++i)
                eight[i].set(l, row[l][i]);
          fastest = max(fastest, norm_squared(eight));
        }
        double& fastest_here = fastest_[team_.number(share)];
        for (int l = 0; l < Lanes::size; ++l)
          fastest_here = std::max(fastest_here, fastest[l]);
      });
  halo_.start(nodes_.x);
  const double speed = std::sqrt(*std::max_element(fastest_.begin(), fastest_.end()));
  const Move move{.dt = dt, .speed = speed, .of_solid = solid_.empty() ? 0.0 : solid_.speed()};
  if (ranks().alone())
    move_on(move);
  else
    moves_.push_back(move);
  if (!contact_.empty() && contact_.candidates_expired(dt * speed))
    contact_.find_candidates(nodes_.x, team_.node_begin(), team_.node_end(), config_.element_size);
  dt_before_ = dt;
}

/// @param move with the speed of the fastest node of all ranks
template <int dim>
void Fluid<dim>::move_on(const Move& move)
{
  travelled_ += move.dt * move.speed;
  if (!solid_.empty())
    travel_ += move.dt * (move.speed + 2.0 * move.of_solid);
}

/// @returns a node whose elements have turned over, or −1
template <int dim>
index_t Fluid<dim>::update_state(index_t begin, index_t end)
{
  const index_t bad =
      update_density_and_pressure<dim>(mesh_, config_.tait, config_.inertia_floor, nodes_, begin, end);
  limit_tension(begin, end);
  return bad;
}

template <int dim>
void Fluid<dim>::limit_tension(index_t begin, index_t end)
{
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
void Fluid<dim>::add_element_forces(double dt, const index_t* list, index_t begin, index_t end,
                                    const Share& share)
{
  const double power = fluid::add_element_forces<dim>(mesh_, nodes_, config_.terms, sound_speed(), gravity(),
                                                      dt, list, begin, end, share, sums_);
  if (list == nullptr)
    sums_.heat[static_cast<std::size_t>(begin / element_block)] += dt * power;
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
  if (dim == 3 || has_interface())
    halo_.finish(nodes_.x);
  if constexpr (dim == 3)
    std::fill(nodes_.V.begin() + team_.node_begin(), nodes_.V.begin() + team_.node_end(), 0.0);
  if (!has_interface())
    return;
  const Share whole{.node_begin = 0, .node_end = nodes_.size()}; // rows of others are nobody's
  const index_t layer_begin = team_.node_begin(), layer_end = std::min(n_layer_, team_.node_end()),
                e_begin = team_.element_begin();
  const auto earlier_than = [this](index_t e) // of other ranks
  {
    const auto& list = team_.earlier();
    return static_cast<index_t>(std::lower_bound(list.begin(), list.end(), e) - list.begin());
  };
  if constexpr (dim == 2)
    update_nodal_volumes(mesh_, layer_begin, layer_end, nodes_);
  else
  {
    if (const index_t count = earlier_than(e_layer_); count > 0)
      add_element_volumes(mesh_, team_.earlier().data(), 0, count, whole, nodes_);
    add_element_volumes(mesh_, nullptr, e_begin, std::min(e_layer_, team_.element_end()), whole, nodes_);
  }
  check_state(update_state(layer_begin, layer_end));
  record_nodes<dim>(nodes_, config_.terms, layer_begin, layer_end, sums_);
  layer_halo_.update(sums_.record, nodes_.m);
  if (const index_t count = earlier_than(e_wet_); count > 0)
    add_element_forces(dt, team_.earlier().data(), 0, count, whole);
  const index_t e_end = std::min(e_wet_, team_.element_end());
  for (index_t e = e_begin; e < e_end; e += element_block)
    add_element_forces(dt, nullptr, e, std::min(e + element_block, e_end), whole);
  const auto [begin, end] = wet_range();
  take_acceleration<dim>(
      nodes_, gravity(), begin, end, sums_,
      std::span(mass_rate_).subspan(static_cast<std::size_t>(begin), static_cast<std::size_t>(end - begin)));
  add_body_force(begin, end);
  for (index_t n = begin; n < end; ++n)
    constrain(nodes_.a[static_cast<std::size_t>(n)], n);
  kick(dt, begin, end);
}

template <int dim>
void Fluid<dim>::solve_free_motion_of_interior(double dt)
{
  bad_.assign(static_cast<std::size_t>(team_.threads()), -1);
  const auto state_of = [this](const Share& share)
  {
    return [this, &bad = bad_[team_.number(share)]](index_t begin, index_t end)
    {
      bad = std::max(bad, update_state(begin, end));
      record_nodes<dim>(nodes_, config_.terms, begin, end, sums_);
    };
  };
  if constexpr (dim == 2)
  {
    const auto update_blocks = [&](Turn turn)
    {
      if (turns_.empty() && turn != Turn::first) // one rank
        return;
      team_.each(
          [&](const Share& share)
          {
            const auto take = state_of(share);
            for (index_t n = std::max(share.node_begin, n_layer_), end = 0; n < share.node_end; n = end)
            {
              const index_t block = n / element_block;
              end = std::min((block + 1) * element_block, share.node_end);
              if (!turns_.empty() && turns_[static_cast<std::size_t>(block)] != turn)
                continue;
              update_nodal_volumes(mesh_, n, end, nodes_);
              take(n, end);
            }
          });
    };
    update_blocks(Turn::first);
    if (!has_interface())
      halo_.finish(nodes_.x);
    update_blocks(Turn::at_cut);
    halo_.start(sums_.record, nodes_.m);
    update_blocks(Turn::last);
    halo_.finish(sums_.record, nodes_.m);
  }
  else
  {
    team_.each(
        [&](const Share& share)
        {
          sweep(
              mesh_, share, has_interface(), e_layer_, n_layer_,
              [&](const index_t* list, index_t begin, index_t end)
              { add_element_volumes(mesh_, list, begin, end, share, nodes_); },
              state_of(share));
        });
    halo_.update(sums_.record, nodes_.m);
  }
  check_state(*std::max_element(bad_.begin(), bad_.end()));

  // Where nothing else acts on single nodes, their acceleration is used while it is in the cache.
  const bool plain = config_.body_force.empty() && constrained_.empty() && impedance_.empty() &&
                     openings_.driven_mask() == 0;
  team_.each(
      [&](const Share& share)
      {
        sweep(
            mesh_, share, has_interface(), e_wet_, n_wet_,
            [&](const index_t* list, index_t begin, index_t end)
            { add_element_forces(dt, list, begin, end, share); },
            [&](index_t begin, index_t end)
            {
              take_acceleration<dim>(
                  nodes_, gravity(), begin, end, sums_,
                  std::span(mass_rate_)
                      .subspan(static_cast<std::size_t>(begin), static_cast<std::size_t>(end - begin)));
              if (plain)
                kick(dt, begin, end);
            });
      });
  if (!plain)
  {
    const index_t begin = std::max(n_wet_, team_.node_begin()), end = team_.node_end();
    add_body_force(begin, end);
    for (const index_t n : constrained_)
      if (n >= begin && n < end)
        constrain(nodes_.a[static_cast<std::size_t>(n)], n);
    let_waves_out(dt, true);
    if (openings_.driven_mask() != 0)
    {
      for (std::size_t i = 0; i < nodes_.x.size(); ++i) // what holds a driven node does work
        if (nodes_.surface[i] & openings_.driven_mask())
          openings_energy_ -= dt * nodes_.inertia[i] * dot(nodes_.a[i], nodes_.v[i]);
      openings_.drive(nodes_, t_);
    }
    kick(dt, begin, end);
  }
  exchange_mass(dt);
  ++steps_;
  ++steps_since_remesh_;
}

template <int dim>
void Fluid<dim>::exchange_mass(double dt)
{
  const bool flux = config_.terms.residual > 0.0;
  if (!flux && config_.feedback_time <= 0.0)
    return;
  unbooked_ += dt;
  const bool book = steps_ % 5 == 0; // its energy: one step stands for five; remeshes come in fours
  const double feedback_rate = config_.feedback_time > 0.0 ? sound_speed() / config_.feedback_time : 0.0;
  team_.each(
      [&](const Share& share)
      {
        const auto count = static_cast<std::size_t>(share.node_end - share.node_begin);
        const std::span<const double> rate =
            std::span(mass_rate_).subspan(static_cast<std::size_t>(share.node_begin), flux ? count : 0);
        fluid::exchange_mass<dim>(rate, feedback_rate, dt, config_.inertia_floor * config_.tait.rho0,
                                  config_.tait, gravity(), config_.surface_tension_allowed, nodes_,
                                  share.node_begin, share.node_end, n_wet_, unbooked_ / dt,
                                  std::span(exchange_energy_)
                                      .subspan(static_cast<std::size_t>(share.node_begin), book ? count : 0));
      });
  if (book)
    unbooked_ = 0.0;
}

template <int dim>
void Fluid<dim>::solve_free_motion(double dt)
{
  solve_free_motion_of_interface(dt);
  solve_free_motion_of_interior(dt);
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
  // The element at the node that is worst: turned over the furthest, or not a number.
  const auto volume = [&](const Simplex<dim>& e)
  { return signed_volume<dim, double>(corners<dim>(nodes_.x, e, nodes_.period)); };
  Simplex<dim> e{};
  double least = std::numeric_limits<double>::max();
  for (const auto& entry : mesh_.fan(bad))
  {
    Simplex<dim> here{bad};
    std::copy(entry.opposite.begin(), entry.opposite.end(), here.begin() + 1);
    here = canonical<dim>(here);
    if (const double V = volume(here); !(V >= least))
    {
      e = here;
      least = V;
    }
  }
  Vec<dim> centre{};
  std::vector<global_index_t> ids;
  for (const auto& x : corners<dim>(nodes_.x, e, nodes_.period))
    centre += (1.0 / (dim + 1)) * x;
  for (const index_t n : e)
    ids.push_back(nodes_.id[static_cast<std::size_t>(n)]);
  const auto i = static_cast<std::size_t>(bad);
  const auto number = std::find(mesh_.elements.begin(), mesh_.elements.end(), e) - mesh_.elements.begin();
  throw NumericalError(fmt::format(
      "fluid step {}, t = {:.9g} s: element {} (nodes {}) at {} m has the volume {:.3g} m^{}, node {} "
      "{:.3g} m^{}: elements have been turned over for {} steps, remeshing did not help (velocity {} m/s, "
      "pressure {:.4g} Pa). A smaller fluid.step_safety or an earlier remesh may",
      steps_ + 1, t_, number, fmt::join(ids, " "), text(centre), least, dim, nodes_.id[i], nodes_.V[i], dim,
      turned_over_, text(nodes_.v[i]), nodes_.p[i]));
}

// ------------------------------------------------------------------------------------------------------
// between steps

template <int dim>
double Fluid<dim>::critical_time_step()
{
  if (config_.terms.mu > 0.0 || config_.terms.bulk_quadratic > 0.0)
    halo_.update(nodes_.v);
  // Where nothing but flying nodes is left no element bounds the step; walls still have to be met.
  return config_.step_safety *
         std::min(config_.element_size / sound_speed(),
                  fluid::critical_time_step<dim>(mesh_, nodes_, config_.tait, config_.terms,
                                                 config_.inertia_floor, team_, halo_, workspace_));
}

template <int dim>
std::string Fluid<dim>::worst_element()
{
  collect();
  if (mesh_.n_elements() == 0)
    return fmt::format("there is no element, {} nodes fly", nodes_.size());
  const auto quality_of = [&](const Simplex<dim>& e)
  { return quality<dim>(corners<dim>(nodes_.x, e, nodes_.period)); };
  const auto worst =
      std::min_element(mesh_.elements.begin(), mesh_.elements.end(),
                       [&](const auto& a, const auto& b) { return quality_of(a) < quality_of(b); });
  const auto corner = corners<dim>(nodes_.x, *worst, nodes_.period);
  Vec<dim> centre{}, v{};
  double p = 0.0;
  std::vector<global_index_t> ids;
  for (std::size_t a = 0; a < corner.size(); ++a)
  {
    const auto n = static_cast<std::size_t>((*worst)[a]);
    centre += (1.0 / (dim + 1)) * corner[a];
    v += (1.0 / (dim + 1)) * nodes_.v[n];
    p += nodes_.p[n] / (dim + 1);
    ids.push_back(nodes_.id[n]);
  }
  return fmt::format("the worst of {} elements is {} (nodes {}) at {} m: quality {:.3g}, volume {:.3g} m^{}, "
                     "velocity {} m/s, pressure {:.4g} Pa",
                     mesh_.n_elements(), worst - mesh_.elements.begin(), fmt::join(ids, " "), text(centre),
                     quality_of(*worst), signed_volume<dim, double>(corner), dim, text(v), p);
}

template <int dim>
bool Fluid<dim>::is_distorted()
{
  // Nodes that nobody watches could reach the solid.
  return mesh_is_bad() || (!solid_.empty() && travel_ > 0.5 * contact_reach * config_.element_size);
}

template <int dim>
bool Fluid<dim>::mesh_is_bad()
{
  if (openings_.row_due(nodes_))
    return true;
  const auto any_share = [this](auto&& found_in)
  {
    std::atomic<bool> found = false;
    team_.each(
        [&](const Share& share)
        {
          if (found_in(share))
            found = true;
        });
    return found.load();
  };
  const bool worse = any_share(
      [this](const Share& share)
      {
        return is_worse<dim>(mesh_, share.element_begin, share.element_end, nodes_.x, quality_,
                             config_.remesh.quality, nodes_.period);
      });
  if (any_rank(worse))
    return true;
  const std::int64_t due = config_.remesh.every == 0 ? 0 : steps_since_remesh_ / config_.remesh.every;
  if (due == good_for_)
    return false;
  if (!config_.remesh.only_if_moved || !solid_.empty()) // what a solid blocks is decided at remeshes only
    return true;
  halo_.update(nodes_.v);
  // A mesh is still good if its nodes have only moved together and no gap closes: a gap that has kept its
  // shape was decided at the last remesh, and round-off must not decide it again. Gaps that are not watched
  // are wider than twice the circumradius up to which they are.
  const std::span<const Simplex<dim>> gaps = ranks().alone() ? gaps_ : own_gaps_;
  const auto strained = [this](std::span<const Simplex<dim>> simplices, double limit)
  { return is_strained<dim>(simplices, nodes_.x, x_remesh_, nodes_.h, limit, nodes_.period); };
  const auto own_strained = [&](const Share& share)
  {
    return strained(std::span<const Simplex<dim>>(mesh_.elements)
                        .subspan(static_cast<std::size_t>(share.element_begin),
                                 static_cast<std::size_t>(share.element_end - share.element_begin)),
                    config_.remesh.strain);
  };
  const bool bad = travelled_ > 0.7 * watched_gap * config_.element_size || any_share(own_strained) ||
                   strained(gaps, 1.0) ||
                   std::any_of(gaps.begin(), gaps.end(),
                               [&](const Simplex<dim>& gap)
                               {
                                 return becomes_fluid<dim>(gap, nodes_, config_.remesh.shape) &&
                                        strained(std::span(&gap, 1), 0.1 * config_.remesh.strain);
                               });
  if (any_rank(bad))
    return true;
  good_for_ = due;
  return false;
}

/// Traction −(p(rest) + ρ₀c₀ v_n) n on impedance nodes, implicit in the velocity of the full step:
/// v = v_half + Δt/2 a,  (m + Δt/2 Z) a_n = F_n − p A − Z v_half,n,  Z = ρ₀ c₀ A.
template <int dim>
void Fluid<dim>::let_waves_out(double dt, bool book)
{
  const Tait& tait = config_.tait;
  for (const ImpedanceNode& node : impedance_)
  {
    const std::size_t i = node.node;
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

// ------------------------------------------------------------------------------------------------------
// what others ask for

template <int dim>
FluidEnergy Fluid<dim>::energy() const
{
  return energy_of_parts(collected_);
}

/// Kinetic, internal and potential energy.
/// @param whole every rank sums over all nodes, without asking the others
/// @param v_half velocities of which the kinetic energy is taken; empty: the mean of those before and after
/// the present half steps
template <int dim>
FluidEnergy Fluid<dim>::energy_of_state(bool whole, std::span<const Vec<dim>> v_half) const
{
  const Vec<dim> g = gravity();
  ExactSum kinetic, internal, potential;
  const auto [begin, end] = rows_to_sum(whole);
  for (std::size_t i = begin; i < end; ++i)
  {
    const Vec<dim> kick = 0.5 * dt_before_ * nodes_.a[i];
    kinetic.add(0.5 * nodes_.M[i] *
                (v_half.empty() ? dot(nodes_.v[i] - kick, nodes_.v[i] + kick) : norm_squared(v_half[i])));
    const bool opened = !config_.surface_tension_allowed && (nodes_.flag[i] & on_free_surface) &&
                        nodes_.rho[i] < config_.tait.rho0; // without a pull, hence without energy
    if (!opened)
      internal.add(nodes_.m[i] * config_.tait.internal_energy(nodes_.rho[i]));
    potential.add(-nodes_.M[i] * dot(g, nodes_.x[i]));
  }
  if (!whole)
    ranks().sum({&kinetic, &internal, &potential});
  return {.kinetic = kinetic.value(), .internal = internal.value(), .potential = potential.value()};
}

/// @param whole every rank sums over all nodes, without asking the others
template <int dim>
FluidEnergy Fluid<dim>::energy_of_parts(bool whole) const
{
  FluidEnergy e = energy_of_state(whole, {});
  ExactSum exchanged, wall_work = contact_.work(), interface_work = interface_work_;
  const auto [begin, end] = rows_to_sum(whole);
  if (whole && !ranks().alone())
    exchanged = exchange_of_all_;
  else
    for (std::size_t i = begin; i < end; ++i)
      exchanged.add(exchange_energy_[i]);
  std::vector<double> heat = sums_.heat;
  if (!whole)
  {
    ranks().sum({&exchanged, &wall_work, &interface_work});
    ranks().gather_rows(heat, blocks_of_ranks());
  }
  e.dissipated = std::accumulate(heat.begin(), heat.end(), dissipated_);
  e.exchanged = exchanged_ + exchanged.value();
  e.remesh_gain = remesh_gain_;
  e.remesh_loss = remesh_loss_;
  e.wall_work = wall_work.value();
  e.interface_work = interface_work.value();
  e.openings = openings_energy_;
  return e;
}

template <int dim>
double Fluid<dim>::interface_work() const
{
  ExactSum work = interface_work_;
  if (!collected_)
    ranks().sum({&work});
  return work.value();
}

template <int dim>
FluidMass Fluid<dim>::mass_by_state() const
{
  ExactSum meshed, flying, dynamic, volume;
  const auto [begin, end] = rows_to_sum(collected_);
  for (std::size_t i = begin; i < end; ++i)
  {
    const bool flies = nodes_.flag[i] & isolated_node;
    (flies ? flying : meshed).add(nodes_.M[i]);
    if (!flies)
    {
      dynamic.add(nodes_.m[i]);
      volume.add(nodes_.V[i]);
    }
  }
  if (!collected_)
    ranks().sum({&meshed, &flying, &dynamic, &volume});
  FluidMass mass{.meshed = meshed.value(),
                 .flying = flying.value(),
                 .dynamic = dynamic.value(),
                 .volume = volume.value()};
  mass.deleted = ledger_.deleted_mass;
  mass.inflow = inflow_;
  mass.outflow = outflow_;
  return mass;
}

template <int dim>
Vec<dim> Fluid<dim>::momentum() const
{
  require(collected_, "momentum of what was collected");
  Vec<dim> sum{};
  for (std::size_t i = 0; i < nodes_.x.size(); ++i)
    sum += nodes_.m[i] * nodes_.v[i];
  return sum;
}

template <int dim>
void Fluid<dim>::for_each_state(StateArchive& archive)
{
  if (!archive.reading())
  {
    if (archive.in_memory())
      collect();
    else if (!collected_) // each rank writes its own rows
    {
      agree();
      gather_sums();
    }
    cool();
    interface_work_.normalise();
  }
  const auto run = [](index_t begin, index_t end, std::size_t width = 1)
  {
    const auto first = static_cast<std::size_t>(begin) * width;
    return std::array{RowRun{first, first, static_cast<std::size_t>(end - begin) * width}};
  };
  const auto own = run(team_.node_begin(), team_.node_end());
  nodes_.for_each_field([&](const char* name, auto& field) { archive.rows(name, field, own); });
  archive.rows("elements", mesh_.elements, run(team_.element_begin(), team_.element_end()));
  archive("contact", contact_);
  archive("solid", solid_);
  archive("travel", travel_);
  if (!config_.body_force.empty())
  {
    sums_.body.resize(nodes_.x.size());
    archive.rows("body", sums_.body, own);
  }
  sums_.record.resize(nodes_.x.size());
  sums_.sum.resize(nodes_.x.size());
  delaunay_.forget(); // both runs then go on with a rebuild
  archive("e_layer", e_layer_);
  archive.rows("mass_rate", mass_rate_, own);
  archive.rows("exchange_energy", exchange_energy_, own);
  archive("exchanged", exchanged_);
  archive("unbooked", unbooked_);
  archive("n_wet", n_wet_);
  archive("n_layer", n_layer_);
  archive("e_wet", e_wet_);
  archive("constrained", constrained_);
  const auto [wet_begin, wet_end] = wet_range();
  archive.rows("f_link", f_link_, run(wet_begin, wet_end, dim));
  archive.rows("x_remesh", x_remesh_, own);
  archive("gaps", gaps_);
  archive("travelled", travelled_);
  archive("good_for", good_for_);
  archive("slow_axis", slow_axis_);
  if constexpr (dim == 3)
    archive("boxes", boxes_);
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
  archive("impedance", impedance_);
  archive("openings_energy", openings_energy_);
  archive("inflow", inflow_);
  archive("outflow", outflow_);
  archive("turned_over", turned_over_);
  if (!archive.reading())
    return;
  sums_.heat.assign(static_cast<std::size_t>(mesh_.n_elements() / element_block) + 1, 0.0);
  exchange_of_all_ = {};
  connect_mesh(part_of_all(std::move(mesh_.elements)));
  measure_quality();
  collected_ = ranks().alone();
  moves_.clear();
  if (ranks().rank() != 0)
    for (ExactSum* sum : sums_over_time())
      *sum = {};
  if (!contact_.empty())
    contact_.find_candidates(nodes_.x, team_.node_begin(), team_.node_end(), config_.element_size);
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
