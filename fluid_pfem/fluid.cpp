// The fluid as others see it: made from its configuration, its bounds, its ledgers, its state. The acts of a
// step: step.cpp; the remesh: remesh/remesh.cpp; what the coupler sees: fluid_interface.cpp.
#include "fluid_pfem/fluid.hpp"

#include "common/config/nearest_word.hpp"
#include "common/error.hpp"
#include "common/parallel/exact_sum.hpp"
#include "common/parallel/in_parts.hpp"
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

} // namespace

template <int dim>
Fluid<dim>::Fluid(const FluidConfig& config, const Ranks& ranks, Cut cut)
    : config_(config), team_(config.threads, ranks, std::move(cut))
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
  nodes_.for_each_field_of_all([n](const char*, auto& field) { field.resize(n); });
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
    if (!v0.empty())
      nodes_.v.resize(n);
    for (std::size_t k = 0; k < v0.size(); ++k)
      nodes_.v[i].c[k] = v0[k](nodes_.x[i][0], nodes_.x[i][1], third(nodes_.x[i]), 0.0);
  }
  if (!openings_.empty())
  {
    nodes_.v.resize(n);
    nodes_.a.resize(n);
    openings_.drive(nodes_, 0.0);
  }
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

/// Least mass in Newton's law of node i.
template <int dim>
double Fluid<dim>::least_inertia(std::size_t i) const
{
  return config_.inertia_floor * config_.tait.rho0 * regular_volume<dim>(nodes_.h[i]);
}

template <int dim>
void Fluid<dim>::check_state(index_t bad)
{
  if (bad < 0 || ++turned_over_ <= may_be_turned_over)
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

/// A row has moved so far that the next one must follow. Collective.
template <int dim>
bool Fluid<dim>::row_is_due() const
{
  if (openings_.driven_mask() == 0)
    return false;
  const auto [begin, end] = rows_to_sum(ranks().alone());
  std::vector<double> behind = openings_.behind(nodes_, begin, end);
  ranks().max(behind);
  return openings_.row_due(behind);
}

template <int dim>
bool Fluid<dim>::mesh_is_bad()
{
  if (row_is_due())
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
  const bool worse = good_at_ != steps_ &&
                     any_share(
                         [this](const Share& share)
                         {
                           return is_worse<dim>(mesh_, share.element_begin, share.element_end, nodes_.x,
                                                quality_, config_.remesh.quality, nodes_.period);
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
  struct Sums
  {
    ExactSum kinetic, internal, potential;
  };
  std::vector<Sums> parts(static_cast<std::size_t>(team_.threads()));
  const auto rows = rows_to_sum(whole);
  in_parts(team_.threads(), rows[1] - rows[0],
           [&](int part, std::size_t begin, std::size_t end)
           {
             Sums sums;
             for (std::size_t i = rows[0] + begin; i < rows[0] + end; ++i)
             {
               const Vec<dim> kick = 0.5 * dt_before_ * nodes_.a[i];
               sums.kinetic.add(
                   0.5 * nodes_.M[i] *
                   (v_half.empty() ? dot(nodes_.v[i] - kick, nodes_.v[i] + kick) : norm_squared(v_half[i])));
               const bool opened = !config_.surface_tension_allowed && (nodes_.flag[i] & on_free_surface) &&
                                   nodes_.rho[i] < config_.tait.rho0; // without a pull, hence without energy
               if (!opened)
                 sums.internal.add(nodes_.m[i] * config_.tait.internal_energy(nodes_.rho[i]));
               sums.potential.add(-nodes_.M[i] * dot(g, nodes_.x[i]));
             }
             parts[static_cast<std::size_t>(part)] = sums;
           });
  auto& [kinetic, internal, potential] = parts.front();
  for (std::size_t part = 1; part < parts.size(); ++part)
  {
    kinetic += parts[part].kinetic;
    internal += parts[part].internal;
    potential += parts[part].potential;
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
  e.openings = whole ? openings_energy_ : openings_energy();
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
  sums_.make_room(nodes_.size());
  sums_.clear(team_.node_begin(), team_.node_end());
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
  if (in_boxes())
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
  turned_over_agreed_ = turned_over_;
  agreed_at_ = steps_;
  sums_.heat.assign(static_cast<std::size_t>(mesh_.n_elements() / element_block) + 1, 0.0);
  exchange_of_all_ = {};
  connect_mesh(part_of_all(std::move(mesh_.elements)));
  measure_quality();
  keep_own_rows();
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
