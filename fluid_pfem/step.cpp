// The acts of one explicit step, each on a range of nodes or elements. Several steps at once:
// several_steps.cpp.
#include "fluid_pfem/eight.hpp"
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/mass_conservation.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <span>
#include <utility>

namespace undine::fluid
{

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
  if (contact_.empty())
    return;
  contact_.move_to(t_);
  push_off_walls(dt);
}

/// What all nodes have in common in a step of length `dt` that ends at the present time.
template <int dim>
Step<dim> Fluid<dim>::present_step(double dt) const
{
  return {.dt = dt, .dt_before = dt_before_, .g = gravity()};
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

template <int dim>
void Fluid<dim>::push_off_walls(double dt)
{
  const Step<dim> step = present_step(dt);
  const auto [first, last] = contact_.own_blocks();
  for (index_t block = first; block < last; ++block)
    push_off_walls(step, block, contact_.reaction());
}

/// Walls work on the inertia; what the kinetic energy of the particle mass gets beyond that is booked with
/// what masses that differ do, [5b] of the theory.
template <int dim>
void Fluid<dim>::push_off_walls(const Step<dim>& step, index_t block, typename Walls<dim>::Reaction& reaction)
{
  reaction.corrections.clear();
  contact_.contact(
      block, step.number, step.dt, nodes_.x, nodes_.v, nodes_.inertia, nodes_.a, step.dt_before,
      [this](Vec<dim>& w, index_t n) { constrain(w, n); }, reaction);
  const double dt_mean = 0.5 * (step.dt + step.dt_before);
  const Vec<dim>& g = step.g;
  for (const auto& [node, dv] : reaction.corrections)
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
  team_.each([&](const Share& share)
             { fastest_[team_.number(share)] = move_nodes<false>(dt, share.node_begin, share.node_end); });
  halo_.start(nodes_.x);
  const double speed = std::sqrt(*std::max_element(fastest_.begin(), fastest_.end()));
  const Move move{.dt = dt, .speed = speed, .of_solid = solid_.empty() ? 0.0 : solid_.speed()};
  if (ranks().alone())
    move_on(move);
  else
    moves_.push_back(move);
  const auto [first, last] = contact_.own_blocks();
  for (index_t block = first; block < last; ++block)
    contact_.has_moved(block, 0, dt * speed, nodes_.x);
  dt_before_ = dt;
}

/// x ← x + Δt v, after v ← v + Δt/2 a where `kicks`.
/// @returns squared speed of the fastest of the nodes [m²/s²]
template <int dim>
template <bool kicks>
double Fluid<dim>::move_nodes(double dt, index_t begin, index_t end)
{
  double* const x = nodes_.x.front().c.data();
  double* const v = nodes_.v.front().c.data();
  const double* const a = nodes_.a.front().c.data();
  Lanes fastest(0.0);
  index_t n = begin;
  for (; n + Lanes::size <= end; n += Lanes::size)
  {
    std::array<Lanes, dim> now; // numbers as they lie in memory
    for (std::size_t part = 0; part < dim; ++part)
    {
      const std::ptrdiff_t k = std::ptrdiff_t{dim} * n + static_cast<std::ptrdiff_t>(part) * Lanes::size;
      now[part] = load_lanes(v + k, Lanes::size);
      if constexpr (kicks)
      {
        now[part] += Lanes(0.5 * dt) * load_lanes(a + k, Lanes::size);
        store_lanes(now[part], v + k, Lanes::size);
      }
      store_lanes(load_lanes(x + k, Lanes::size) + Lanes(dt) * now[part], x + k, Lanes::size);
    }
    fastest = max(fastest, norm_squared(columns_of<dim>(now)));
  }
  double fastest_of_all = 0.0;
  for (int l = 0; l < Lanes::size; ++l)
    fastest_of_all = std::max(fastest_of_all, fastest[l]);
  for (; n < end; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    if constexpr (kicks)
      nodes_.v[i] += 0.5 * dt * nodes_.a[i];
    nodes_.x[i] += dt * nodes_.v[i];
    fastest_of_all = std::max(fastest_of_all, norm_squared(nodes_.v[i]));
  }
  return fastest_of_all;
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
void Fluid<dim>::add_element_forces(const Step<dim>& step, const index_t* list, index_t begin, index_t end,
                                    const Share& share, ShapeLook* look)
{
  const double power = fluid::add_element_forces<dim>(mesh_, nodes_, config_.terms, sound_speed(), step.g,
                                                      step.dt, list, begin, end, share, sums_, look);
  if (list == nullptr)
    sums_.heat[static_cast<std::size_t>(begin / element_block)] += step.dt * power;
}

/// a = F/inertia + g of nodes [begin, end), and the mass flux into them.
template <int dim>
void Fluid<dim>::accelerate(const Step<dim>& step, index_t begin, index_t end)
{
  take_acceleration<dim>(
      nodes_, step.g, begin, end, sums_,
      std::span(mass_rate_).subspan(static_cast<std::size_t>(begin), static_cast<std::size_t>(end - begin)));
}

/// Accelerations of nodes [begin, end) as the walls of the box allow.
template <int dim>
void Fluid<dim>::constrain_accelerations(index_t begin, index_t end)
{
  for (auto n = std::lower_bound(constrained_.begin(), constrained_.end(), begin);
       n != constrained_.end() && *n < end; ++n)
    constrain(nodes_.a[static_cast<std::size_t>(*n)], *n);
}

/// Of the nodes of this rank, as the walls of the box allow.
template <int dim>
void Fluid<dim>::constrain_velocities()
{
  for (const index_t n : constrained_)
    if (team_.owns(n))
      constrain(nodes_.v[static_cast<std::size_t>(n)], n);
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
  const Step<dim> step = present_step(dt);
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
    add_element_forces(step, team_.earlier().data(), 0, count, whole);
  const index_t e_end = std::min(e_wet_, team_.element_end());
  for (index_t e = e_begin; e < e_end; e += element_block)
    add_element_forces(step, nullptr, e, std::min(e + element_block, e_end), whole);
  const auto [begin, end] = wet_range();
  accelerate(step, begin, end);
  add_body_force(begin, end);
  constrain_accelerations(begin, end);
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
  const bool local = forces_are_local();
  const Step<dim> step = present_step(dt);
  team_.each(
      [&](const Share& share)
      {
        sweep(
            mesh_, share, has_interface(), e_wet_, n_wet_,
            [&](const index_t* list, index_t begin, index_t end)
            { add_element_forces(step, list, begin, end, share); },
            [&](index_t begin, index_t end)
            {
              accelerate(step, begin, end);
              if (!local)
                return;
              constrain_accelerations(begin, end);
              kick(dt, begin, end);
            });
      });
  if (!local)
  {
    const index_t begin = std::max(n_wet_, team_.node_begin()), end = team_.node_end();
    add_body_force(begin, end);
    constrain_accelerations(begin, end);
    let_waves_out(dt, true);
    if (openings_.driven_mask() != 0)
    {
      const auto [first, last] = rows_to_sum(ranks().alone());
      for (std::size_t i = first; i < last; ++i) // what holds a driven node does work
        if (nodes_.surface[i] & openings_.driven_mask())
          book_opening(1, -(dt * nodes_.inertia[i]), dot(nodes_.a[i], nodes_.v[i]));
      openings_.drive(nodes_, t_);
    }
    kick(dt, begin, end);
  }
  const double booked = time_to_book(dt);
  team_.each([&](const Share& share) { exchange_mass(step, booked, share.node_begin, share.node_end); });
  ++steps_;
  ++steps_since_remesh_;
}

/// Nothing acts on nodes but elements, weight and walls.
template <int dim>
bool Fluid<dim>::forces_are_local() const
{
  return config_.body_force.empty() && impedance_.empty() && openings_.driven_mask() == 0;
}

/// The energy that exchange of mass gives is booked in every fifth step, which stands for five; remeshes come
/// in fours.
/// @returns time for which the present step of length `dt` stands [s]; 0: it is not booked
template <int dim>
double Fluid<dim>::time_to_book(double dt)
{
  unbooked_ += dt;
  return steps_ % 5 == 0 ? std::exchange(unbooked_, 0.0) : 0.0;
}

/// @param booked time for which the energy of this exchange is booked [s]; 0: it is not
template <int dim>
void Fluid<dim>::exchange_mass(const Step<dim>& step, double booked, index_t begin, index_t end)
{
  const bool flux = config_.terms.residual > 0.0;
  if (!flux && config_.feedback_time <= 0.0)
    return;
  const double feedback_rate = config_.feedback_time > 0.0 ? sound_speed() / config_.feedback_time : 0.0;
  const auto of = [&](UntouchedRows<double>& field, bool wanted)
  {
    return std::span(field).subspan(static_cast<std::size_t>(begin),
                                    wanted ? static_cast<std::size_t>(end - begin) : 0);
  };
  fluid::exchange_mass<dim>(of(mass_rate_, flux), feedback_rate, step.dt,
                            config_.inertia_floor * config_.tait.rho0, config_.tait, step.g,
                            config_.surface_tension_allowed, nodes_, begin, end, n_wet_, booked / step.dt,
                            of(exchange_energy_, booked > 0.0));
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

/// Traction −(p(rest) + ρ₀c₀ v_n) n on impedance nodes, implicit in the velocity of the full step:
/// v = v_half + Δt/2 a,  (m + Δt/2 Z) a_n = F_n − p A − Z v_half,n,  Z = ρ₀ c₀ A.
template <int dim>
void Fluid<dim>::let_waves_out(double dt, bool book)
{
  const Tait& tait = config_.tait;
  for (const ImpedanceNode& node : impedance_)
  {
    const std::size_t i = node.node;
    if (!team_.owns(static_cast<index_t>(i)))
      continue;
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
      book_opening(0, dt * m * da, v_n);
  }
}

/// Work of a node at an opening, the product of two factors [J]: of one rank at once, of several when they
/// agree, in the order that one rank would have.
/// @param kind 0 impedance, 1 driven: those of a step come one after the other
template <int dim>
void Fluid<dim>::book_opening(int kind, double factor, double other)
{
  if (ranks().alone())
    openings_energy_ = std::fma(factor, other, openings_energy_); // as openings_energy() adds
  else
    opening_works_.push_back({2 * steps_ + kind, factor, other});
}

template double Fluid<2>::move_nodes<true>(double, index_t, index_t);
template double Fluid<2>::move_nodes<false>(double, index_t, index_t);
template double Fluid<3>::move_nodes<true>(double, index_t, index_t);
template double Fluid<3>::move_nodes<false>(double, index_t, index_t);
template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
