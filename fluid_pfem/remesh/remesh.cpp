// New connectivity at a synchronised time.
#include "common/error.hpp"
#include "common/parallel/exact_sum.hpp"
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/mass_conservation.hpp"
#include "fluid_pfem/remesh/alpha_shape.hpp"
#include "fluid_pfem/remesh/beside_solid.hpp"
#include "fluid_pfem/remesh/refine_coarsen.hpp"
#include "fluid_pfem/simplex.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <unordered_map>
#include <utility>

namespace undine::fluid
{

namespace
{

/// Numbers that look random, each another (finaliser of splitmix64).
std::uint64_t mixed(std::uint64_t z)
{
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

/// The corners in the order of their numbers, so that what is computed of them depends on the set only.
template <int dim>
std::array<Vec<dim>, dim + 1> sorted_corners(const FluidNodes<dim>& nodes, Simplex<dim> e)
{
  std::sort(e.begin(), e.end());
  return corners<dim>(nodes.x, e, nodes.period);
}

/// Of the corners [m].
template <int dim>
double least_spacing(const FluidNodes<dim>& nodes, const Simplex<dim>& e)
{
  double least = nodes.h[static_cast<std::size_t>(e[0])];
  for (const index_t n : e)
    least = std::min(least, nodes.h[static_cast<std::size_t>(n)]);
  return least;
}

} // namespace

/// So far around a node the others decide which of its simplices are looked at, whatever their corners want
/// for a spacing [m].
template <int dim>
double Fluid<dim>::halo_width() const
{
  return 2.0 * largest_radius(config_.remesh.shape) * coarsest_;
}

/// Delaunay simplices, as far as walls and solid leave room for them: all, or those of which a node of `mine`
/// has the lowest number, up to the circumradius that matters. Collective.
template <int dim>
std::vector<Simplex<dim>> Fluid<dim>::triangulation(std::span<const char> mine, const KnownNodes& known)
{
  std::vector<Simplex<dim>> simplices;
  if (nodes_.period.any())
  {
    double extent = 0.0;
    for (std::size_t n = 0; n < mine.size(); ++n)
      for (int i = 0; i < dim && mine[n]; ++i)
        extent = std::max(extent, std::abs(nodes_.x[n][i]));
    simplices = periodic_delaunay<dim>(
        nodes_.x, nodes_.period,
        {.mine = mine, .reach = halo_width(), .among = known.among(), .extent = ranks().max(extent)});
    for (auto& e : simplices)
      e = canonical<dim>(e);
  }
  else
  {
    delaunay_.update(nodes_.x, mine, halo_width(), known.among());
    simplices = delaunay_.simplices(mine);
  }
  constexpr double around_corner = 0.1; // of the spacing: what an element may cut off a wall's corner
  if (contact_.has_convex())
    std::erase_if(simplices,
                  [&](const Simplex<dim>& e)
                  {
                    const auto outer = std::count_if(
                        e.begin(), e.end(),
                        [&](index_t n) { return nodes_.flag[static_cast<std::size_t>(n)] & on_boundary; });
                    return outer >= 2 && contact_.blocks(sorted_corners<dim>(nodes_, e),
                                                         around_corner * least_spacing(nodes_, e));
                  });
  if (!solid_.empty())
    leave_room_for_solid(mine, simplices);
  return simplices;
}

/// Elements that the solid blocks go, and holes beside it are filled from their rims. A rim may be long: of
/// what is blocked and small enough to have been fluid all ranks know all, and do the same. Collective.
/// @param simplices those of which a node of `mine` has the lowest number; empty: all
template <int dim>
void Fluid<dim>::leave_room_for_solid(std::span<const char> mine, std::vector<Simplex<dim>>& simplices)
{
  struct Blocked
  {
    Simplex<dim> nodes;
    std::array<Vec<dim>, dim + 1> x;
    std::array<double, dim + 1> h;
  };
  std::vector<Blocked> blocked;
  std::erase_if(simplices,
                [&](const Simplex<dim>& e)
                {
                  const auto corner = sorted_corners<dim>(nodes_, e);
                  if (!solid_.blocks(corner, least_spacing(nodes_, e)))
                    return false;
                  if (dim == 2 && circumradius<dim>(corner) <= 0.5 * halo_width())
                  {
                    Blocked& b = blocked.emplace_back(Blocked{.nodes = e, .x = {}, .h = {}});
                    for (std::size_t a = 0; a <= dim; ++a)
                    {
                      b.x[a] = nodes_.x[static_cast<std::size_t>(e[a])];
                      b.h[a] = nodes_.h[static_cast<std::size_t>(e[a])];
                    }
                  }
                  return true;
                });
  std::vector<Simplex<dim>> erased;
  for (const Blocked& b : ranks().gather(blocked))
  {
    erased.push_back(b.nodes);
    for (std::size_t a = 0; a <= dim && !ranks().alone(); ++a)
    {
      nodes_.x[static_cast<std::size_t>(b.nodes[a])] = b.x[a];
      nodes_.h[static_cast<std::size_t>(b.nodes[a])] = b.h[a];
    }
  }
  for (const auto& filled : fill_beside<dim>(solid_, nodes_.x, nodes_.h, erased, config_.remesh.shape.keep))
    if (const auto e = canonical<dim>(filled); mine.empty() || mine[static_cast<std::size_t>(e[0])])
      simplices.push_back(e);
}

/// 1 for nodes of this rank; a new node is its first parent's. Empty on one rank.
template <int dim>
std::vector<char> Fluid<dim>::part_of_rank(const SpacingReport& spacing) const
{
  std::vector<char> mine;
  if (ranks().alone())
    return mine;
  const auto n_before = static_cast<std::size_t>(team_.nodes_of_ranks().back());
  mine.assign(n_before, 0);
  std::fill(mine.begin() + team_.node_begin(), mine.begin() + team_.node_end(), 1);
  for (const auto& split : spacing.splits)
    mine.push_back(mine[static_cast<std::size_t>(split[0])]);
  for (std::size_t n = 0; n < spacing.new_number.size(); ++n)
    if (spacing.new_number[n] >= 0)
      mine[static_cast<std::size_t>(spacing.new_number[n])] = mine[n];
  mine.resize(nodes_.x.size());
  return mine;
}

/// One rank's part of simplices that all ranks have.
template <int dim>
std::vector<Simplex<dim>> Fluid<dim>::part_of_all(std::vector<Simplex<dim>> simplices) const
{
  const auto [begin, end] = rows_of_rank(simplices.size(), ranks());
  simplices.erase(simplices.begin() + static_cast<std::ptrdiff_t>(end), simplices.end());
  simplices.erase(simplices.begin(), simplices.begin() + static_cast<std::ptrdiff_t>(begin));
  return simplices;
}

namespace
{

/// Simplices in new numbers; those that lost a node are dropped. No new numbers: nothing changes.
template <std::size_t corners>
void renumber(std::vector<std::array<index_t, corners>>& simplices, const std::vector<index_t>& new_number)
{
  if (new_number.empty())
    return;
  for (auto& s : simplices)
    for (index_t& n : s)
      n = new_number[static_cast<std::size_t>(n)];
  std::erase_if(simplices, [](const auto& s) { return *std::min_element(s.begin(), s.end()) < 0; });
}

} // namespace

template <int dim>
void Fluid<dim>::remesh()
{
  const Ranks::Clock clock(ranks(), &Ranks::Cost::remesh);
  const bool bad = mesh_is_bad();
  if (bad) // the exchange of mass of the last step is part of the density that stays
  {
    check_state(update_state(team_.node_begin(), team_.node_end()));
    collected_ = ranks().alone();
  }
  cool();
  if (!bad)
    return renew_order();
  check_places();
  if (nodes_.period.any())
    for (auto& x : nodes_.x)
      x = nodes_.period.wrapped(x);
  if (!openings_.empty())
    pass_openings();
  KnownNodes known = look_around();
  find_half_step_velocity();
  const double before = energy_of_state(ranks().alone(), v_half_).total();
  update_spacing(known);
  // What is found anew with the mesh makes room: a remesh is when most memory is needed.
  workspace_ = {};
  quality_ = std::vector<float>();
  mass_rate_ = std::vector<double>();
  exchange_energy_ = std::vector<double>(); // booked
  mesh_.fans = std::vector<FanEntry<dim>>();
  sums_.record = UntouchedRows<NodeRecord<dim>>();
  sums_.sum = UntouchedRows<FourNumbers>();
  const auto [old_begin, old_end] = rows_to_sum(ranks().alone());
  const auto own_rows = [](const auto& field, std::size_t begin, std::size_t end)
  {
    return std::vector(field.begin() + static_cast<std::ptrdiff_t>(begin),
                       field.begin() + static_cast<std::ptrdiff_t>(end));
  };
  Particles<dim> old{.begin = static_cast<index_t>(old_begin),
                     .M = own_rows(nodes_.M, old_begin, old_end),
                     .x = own_rows(nodes_.x, old_begin, old_end),
                     .v = own_rows(v_half_, old_begin, old_end)};
  std::vector<Vec<dim>>& old_x = x_remesh_;
  old_x.resize(nodes_.x.size());
  const auto keep_place = [&](index_t n)
  { old_x[static_cast<std::size_t>(n)] = nodes_.x[static_cast<std::size_t>(n)]; };
  known.each(nodes_.size(), keep_place);
  for (const auto& ghosts : halo_.received())
    if (!known.all)
      std::for_each(ghosts.begin(), ghosts.end(), keep_place);
  if (!solid_.empty())
    cling_to_solid();
  auto pieces = wall_pieces();
  for (std::size_t n = 0; n < pieces.size(); ++n) // walls may have been reached since the last remesh
  {
    const bool wall = pieces[n][0] >= 0 || (nodes_.surface[n] & wall_mask_);
    nodes_.flag[n] = static_cast<std::uint8_t>((nodes_.flag[n] & ~on_wall) | (wall ? on_wall : 0));
  }
  // A node in the middle of an edge along a curved side, or past a corner, lies inside the solid: so deep it
  // is put on its surface, deeper it is not made.
  const SpacingReport spacing = refine_and_coarsen<dim>(
      nodes_, mesh_, pieces, solid_.empty() ? n_wet_ : 0, // nodes beside a solid come and go
      config_.remesh.spacing, next_id_,
      [&](const Vec<dim>& x, double h) { return solid_.depth(x, h) > brought_out * h; },
      {.ranks = ranks(),
       .elements = own_elements(),
       .node_begin = team_.node_begin(),
       .node_end = team_.node_end(),
       .known = known.among()});
  for (const auto& [kept, gone] : spacing.merges)
    delaunay_.merge(kept, gone);
  for (const auto& [i, j, added] : spacing.splits)
    delaunay_.split(i, j, added);
  if (!spacing.new_number.empty())
    delaunay_.renumber(spacing.new_number);
  follow_changes(spacing, known);
  if (contact_.has_convex())
    known.each(nodes_.size(), [this](index_t n)
               { contact_.settle(std::span(nodes_.x).subspan(static_cast<std::size_t>(n), 1)); });
  if (!solid_.empty())
    known.each(nodes_.size(),
               [this](index_t n)
               {
                 const auto i = static_cast<std::size_t>(n);
                 nodes_.x[i] = solid_.outside(nodes_.x[i], 0.02 * nodes_.h[i], brought_out * nodes_.h[i]);
               });
  const std::vector<char> mine = part_of_rank(spacing);
  ShapeChoice<dim> choice =
      choose_fluid<dim>(nodes_, pieces, triangulation(mine, known), old_x,
                        ranks().alone() ? std::span<const Simplex<dim>>(mesh_.elements) : own_elements(),
                        config_.element_size, config_.remesh.shape, ranks());
  drop_fragments(choice);
  ranks().sum({&choice.created, &choice.dropped});
  pieces = std::vector<std::array<int, 3>>();
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
  std::vector<index_t> held; // nodes whose rows this rank has
  for (std::size_t n = 0; n < mine.size(); ++n)
    if (mine[n])
      held.push_back(static_cast<index_t>(n));
  const auto renumber_held = [&held](const std::vector<index_t>& new_number)
  {
    for (index_t& n : held)
      n = n < 0 || new_number.empty() ? n : new_number[static_cast<std::size_t>(n)];
  };
  const auto deleted = delete_isolated_nodes(choice.elements, mine);
  renumber_held(deleted);
  const auto ordered = order_nodes(choice.elements, mine.empty() ? nullptr : &held);
  renumber_held(ordered);
  follow(deleted);
  follow(ordered);
  gaps_ = ranks().gather(choice.gaps);
  renumber(gaps_, deleted);
  renumber(gaps_, ordered);
  gaps_ = sorted_elements<dim>(std::move(gaps_));
  std::vector<Simplex<dim>> old_elements;
  if (ranks().alone())
    old_elements = std::move(mesh_.elements);
  else
    old_elements.assign(own_elements().begin(), own_elements().end());
  std::vector<char> moved = moved_nodes(old, number, spacing);
  connect_mesh(std::move(choice.elements));
  pass_rows(held, moved);
  const std::vector<Simplex<dim>> changed = changed_elements(std::move(old_elements), moved, number);
  // At the full step, nodes pressed against a wall carry half a kick into it that is not theirs to give.
  find_half_step_velocity();
  std::vector<double> V_before(nodes_.V.begin() + team_.node_begin(), nodes_.V.begin() + team_.node_end());
  finish_mesh();
  hand_over_mass(changed, old, number, V_before, v_half_);
  old = {}; // here a remesh needs most memory
  number = std::vector<index_t>();
  V_before = std::vector<double>();
  smooth_mass_defect(v_half_);
  for (const index_t n : constrained_)
    constrain(nodes_.v[static_cast<std::size_t>(n)], n);

  ++ledger_.remeshes;
  ledger_.merged += spacing.merged;
  ledger_.split += spacing.split;
  ledger_.created += choice.created.value();
  ledger_.dropped += choice.dropped.value();
  const double jump = energy_of_state(ranks().alone(), v_half_).total() - before;
  (jump > 0.0 ? remesh_gain_ : remesh_loss_) += jump;
  collected_ = ranks().alone();
}

/// The same elements, but other nodes are near the solid. Collective.
template <int dim>
void Fluid<dim>::renew_order()
{
  rows_are_due() ? gather_state() : agree();
  std::vector<Simplex<dim>> elements(own_elements().begin(), own_elements().end());
  std::vector<index_t> held(static_cast<std::size_t>(team_.node_end() - team_.node_begin()));
  std::iota(held.begin(), held.end(), team_.node_begin());
  const std::vector<index_t> new_number = order_nodes(elements, &held);
  renumber(gaps_, new_number);
  for (index_t& n : held)
    n = new_number.empty() ? n : new_number[static_cast<std::size_t>(n)];
  connect_mesh(std::move(elements));
  std::vector<char> moved(nodes_.x.size(), 0);
  pass_rows(held, moved);
  finish_mesh();
  collected_ = ranks().alone();
}

/// What is nowhere cannot be triangulated. @throws NumericalError
template <int dim>
void Fluid<dim>::check_places() const
{
  const auto [begin, end] = rows_to_sum(ranks().alone());
  for (std::size_t n = begin; n < end; ++n)
    if (!std::isfinite(norm_squared(nodes_.x[n])))
      throw NumericalError(fmt::format(
          "fluid step {}, t = {:.9g} s: node {} is at ({:.4g}) m, mass {:.3g} kg, velocity ({:.4g}) m/s, "
          "pressure {:.4g} Pa: no place for a mesh. A smaller fluid.step_safety may help",
          steps_, t_, nodes_.id[n], fmt::join(nodes_.x[n].c, ", "), nodes_.m[n],
          fmt::join(nodes_.v[n].c, ", "), nodes_.p[n]));
}

/// Of the nodes of this rank.
template <int dim>
void Fluid<dim>::find_half_step_velocity()
{
  v_half_.resize(nodes_.x.size());
  const auto [begin, end] = rows_to_sum(ranks().alone());
  for (std::size_t n = begin; n < end; ++n)
    v_half_[n] = nodes_.v[n] - 0.5 * dt_before_ * nodes_.a[n];
}

/// Collective.
template <int dim>
void Fluid<dim>::update_spacing(const KnownNodes& known)
{
  if (known.all)
    nodes_.h.assign(nodes_.x.size(), config_.element_size);
  coarsest_ = config_.element_size;
  if (size_.uniform())
    return;
  coarsest_ = 0.0;
  known.each(nodes_.size(),
             [this](index_t n)
             {
               const auto i = static_cast<std::size_t>(n);
               nodes_.h[i] = size_(nodes_.x[i], contact_);
               coarsest_ = std::max(coarsest_, nodes_.h[i]);
             });
  coarsest_ = ranks().max(coarsest_);
}

/// The nodes around which this rank makes the first triangulation: a slice across the longest axis. Empty on
/// one rank.
template <int dim>
std::vector<char> Fluid<dim>::slice_of_rank()
{
  std::vector<char> mine;
  if (ranks().alone())
    return mine;
  choose_slow_axis();
  std::vector<index_t> along(nodes_.x.size());
  std::iota(along.begin(), along.end(), 0);
  std::sort(along.begin(), along.end(),
            [this](index_t a, index_t b)
            {
              const double x = nodes_.x[static_cast<std::size_t>(a)][slow_axis_],
                           y = nodes_.x[static_cast<std::size_t>(b)][slow_axis_];
              return x != y ? x < y : a < b;
            });
  mine.assign(along.size(), 0);
  const auto [begin, end] = rows_of_rank(along.size(), ranks());
  for (std::size_t k = begin; k < end; ++k)
    mine[static_cast<std::size_t>(along[k])] = 1;
  return mine;
}

template <int dim>
void Fluid<dim>::triangulate()
{
  collect(); // where a solid is met there was a mesh before
  cool();
  std::vector<Simplex<dim>> delaunay = triangulation(slice_of_rank(), {}); // of this rank
  auto elements = alpha_shape<dim>(nodes_.x, nodes_.h, config_.remesh.alpha, delaunay, nodes_.period);
  if (inside_)
    std::erase_if(elements,
                  [&](const Simplex<dim>& e)
                  {
                    Vec<dim> centroid{};
                    for (const auto& x : corners<dim>(nodes_.x, e, nodes_.period))
                      centroid += (1.0 / (dim + 1)) * x;
                    return !inside_(nodes_.period.wrapped(centroid));
                  });
  renumber(delaunay, order_nodes(elements, nullptr));
  elements = sorted_elements<dim>(std::move(elements));
  connect_mesh(elements);
  finish_mesh();
  collected_ = ranks().alone();
  collect();
  nodes_.M = nodes_.m;
  // What the scene leaves empty is a gap, also where the rules of a remesh would make it fluid.
  ShapeChoice<dim> choice =
      choose_fluid<dim>(nodes_, wall_pieces(), std::move(delaunay), nodes_.x, own_elements(),
                        config_.element_size, config_.remesh.shape, ranks());
  std::erase_if(choice.elements, [&elements](const Simplex<dim>& e)
                { return std::binary_search(elements.begin(), elements.end(), canonical<dim>(e)); });
  choice.gaps.insert(choice.gaps.end(), choice.elements.begin(), choice.elements.end());
  gaps_ = sorted_elements<dim>(ranks().gather(choice.gaps));
  find_ghosts(); // now with the gaps
  x_remesh_ = nodes_.x;
  collected_ = ranks().alone();
}

/// All nodes on walls and solid, in order; each rank looks at its own. Collective.
template <int dim>
std::vector<typename Fluid<dim>::OnPieces> Fluid<dim>::nodes_on_walls() const
{
  std::vector<OnPieces> found;
  const auto [begin, end] = rows_to_sum(ranks().alone());
  if (!contact_.empty() || !solid_.empty())
    for (std::size_t n = begin; n < end; ++n)
    {
      OnPieces here{.node = static_cast<index_t>(n), .pieces = {-1, -1, -1}};
      if (!contact_.empty())
        here.pieces = contact_.pieces_at(nodes_.x[n], on_wall_within * nodes_.h[n]);
      if (!solid_.empty())
        for (const int side : solid_.sides_at(nodes_.x[n], on_wall_within * nodes_.h[n]))
          if (const auto free = std::find(here.pieces.begin(), here.pieces.end(), -1);
              side >= 0 && free != here.pieces.end())
            *free = side;
      if (here.pieces[0] >= 0)
        found.push_back(here);
    }
  return ranks().gather(found);
}

/// What walls and solid all nodes are on. Collective.
template <int dim>
std::vector<std::array<int, 3>> Fluid<dim>::wall_pieces() const
{
  std::vector<std::array<int, 3>> pieces(nodes_.x.size(), {-1, -1, -1});
  for (const OnPieces& here : nodes_on_walls())
    pieces[static_cast<std::size_t>(here.node)] = here.pieces;
  return pieces;
}

/// Elements sorted and shared out; each rank finds the fans of its nodes. Collective.
/// @param elements of this rank: those of all ranks make up the mesh
template <int dim>
void Fluid<dim>::connect_mesh(std::vector<Simplex<dim>> elements)
{
  share_elements(sorted_elements<dim>(std::move(elements)));
  find_fans<dim>(mesh_, team_.node_begin(), team_.node_end(), team_.earlier(), team_.element_begin(),
                 team_.element_end());
  if (!ranks().alone())
    mesh_.boundary = ranks().gather(mesh_.boundary);
  find_ghosts();
  reach_is_found_ = false;
}

/// All that follows from positions, densities and connectivity, for the nodes of each rank. Collective.
template <int dim>
void Fluid<dim>::finish_mesh()
{
  const index_t n_nodes = nodes_.size(), begin = team_.node_begin(), end = team_.node_end();
  const std::vector<std::uint8_t> was(nodes_.flag.begin() + begin, nodes_.flag.begin() + end);
  flag_nodes();
  // A node that opened at the free surface had no pull; when the fluid closes around it, it begins with none.
  if (!config_.surface_tension_allowed)
    for (std::size_t k = 0; k < was.size(); ++k)
      if (const std::size_t i = static_cast<std::size_t>(begin) + k;
          (was[k] & on_free_surface) && !(nodes_.flag[i] & on_free_surface))
        nodes_.rho[i] = std::max(nodes_.rho[i], config_.tait.rho0);
  constrained_.clear();
  for (index_t n = 0; n < n_nodes; ++n)
    if (nodes_.surface[static_cast<std::size_t>(n)] & wall_mask_)
      constrained_.push_back(n);
  for (const index_t n : constrained_)
    constrain(nodes_.v[static_cast<std::size_t>(n)], n);

  const auto each_element = [this](auto&& add)
  {
    team_.each(
        [&](const Share& share)
        {
          sweep(
              mesh_, share, false, 0, 0,
              [&](const index_t* list, index_t first, index_t last) { add(list, first, last, share); },
              [](index_t, index_t) {});
        });
  };
  if constexpr (dim == 2)
    team_.each([this](const Share& share)
               { update_nodal_volumes(mesh_, share.node_begin, share.node_end, nodes_); });
  else
  {
    std::fill(nodes_.V.begin() + begin, nodes_.V.begin() + end, 0.0);
    each_element([&](const index_t* list, index_t first, index_t last, const Share& share)
                 { add_element_volumes(mesh_, list, first, last, share, nodes_); });
  }

  // ρ and p are the state; masses follow the new volumes. An isolated node keeps its mass and flies.
  for (index_t n = begin; n < end; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    if (mesh_.isolated(n))
      nodes_.rho[i] = config_.tait.rho0;
    if (mesh_.isolated(n))
      nodes_.m[i] = nodes_.M[i] > 0.0 ? nodes_.M[i] : least_inertia(i);
    else // the inverse of update_density_and_pressure, completed nodes included
      nodes_.m[i] =
          nodes_.rho[i] * nodes_.V[i] + (nodes_.rho[i] - config_.tait.rho0) *
                                            std::max(0.0, least_inertia(i) / config_.tait.rho0 - nodes_.V[i]);
    nodes_.p[i] = config_.tait.pressure(nodes_.rho[i]);
    // What flies is moved by gravity alone: no element can accelerate it.
    nodes_.inertia[i] = mesh_.isolated(n) ? nodes_.m[i] : std::max(nodes_.m[i], least_inertia(i));
  }
  limit_tension(begin, end);
  mass_rate_.resize(static_cast<std::size_t>(n_nodes));
  std::fill(mass_rate_.begin() + begin, mass_rate_.begin() + end, 0.0);
  exchange_energy_.resize(static_cast<std::size_t>(n_nodes)); // all booked: zeros
  sums_.reset(n_nodes, begin, end);
  sums_.heat.assign(static_cast<std::size_t>(mesh_.n_elements() / element_block) + 1, 0.0);
  // Viscous terms need the velocity of the half step: at the full one, nodes pressed against a wall carry
  // half a kick into it.
  const std::vector<Vec<dim>> v(nodes_.v.begin() + begin, nodes_.v.begin() + end);
  // Of half a kick into a wall nothing will be left, but the residual of momentum sees the difference between
  // it and that of the new mesh.
  const auto each_pressed = [&](auto&& visit) // visit(node, part of its acceleration into walls)
  {
    for (index_t n = contact_.empty() ? end : std::max(n_wet_, begin); n < end; ++n)
      if (const auto i = static_cast<std::size_t>(n); nodes_.flag[i] & on_wall)
        visit(i, contact_.into_walls(nodes_.x[i], on_wall_within * nodes_.h[i], nodes_.a[i]));
  };
  std::vector<Vec<dim>> pressed;
  each_pressed([&](std::size_t, const Vec<dim>& a) { pressed.push_back(a); });
  for (auto i = static_cast<std::size_t>(begin); i < static_cast<std::size_t>(end); ++i)
    nodes_.v[i] -= 0.5 * dt_before_ * nodes_.a[i];
  record_nodes<dim>(nodes_, config_.terms, begin, end, sums_);
  halo_.update(sums_.record, nodes_.m);
  each_element([&](const index_t* list, index_t first, index_t last, const Share& share)
               { add_element_forces(present_step(dt_before_), list, first, last, share); });
  std::fill(sums_.heat.begin(), sums_.heat.end(), 0.0); // no time has passed
  accelerate(present_step(dt_before_), begin, end);
  add_body_force(begin, end);
  constrain_accelerations(begin, end);
  find_impedance();
  let_waves_out(dt_before_, false);
  std::copy(v.begin(), v.end(), nodes_.v.begin() + begin);
  each_pressed([&, k = std::size_t{0}](std::size_t i, const Vec<dim>& a) mutable
               { nodes_.v[i] += (0.5 * dt_before_) * (a - pressed[k++]); });
  openings_.drive(nodes_, t_);

  f_link_.assign(static_cast<std::size_t>(n_wet_) * dim, 0.0);
  steps_since_remesh_ = 0;
  travelled_ = 0.0;
  good_for_ = 0;
  turned_over_ = turned_over_agreed_ = 0;
  agreed_at_ = steps_;
  x_remesh_.resize(static_cast<std::size_t>(n_nodes));
  std::copy(nodes_.x.begin() + begin, nodes_.x.begin() + end, x_remesh_.begin() + begin);
  for (const auto& ghosts : halo_.received())
    for (const index_t n : ghosts)
      x_remesh_[static_cast<std::size_t>(n)] = nodes_.x[static_cast<std::size_t>(n)];
  measure_quality();
  if (!contact_.empty())
    contact_.find_candidates(nodes_.x, begin, end, config_.element_size);
  ++surface_epoch_;
}

template <int dim>
void Fluid<dim>::measure_quality()
{
  quality_.resize(mesh_.elements.size());
  for (auto e = static_cast<std::size_t>(team_.element_begin());
       e < static_cast<std::size_t>(team_.element_end()); ++e)
    quality_[e] = static_cast<float>(quality<dim>(corners<dim>(x_remesh_, mesh_.elements[e], nodes_.period)));
}

/// Boundary, free surface, wall, isolated: from the boundary facets and the walls. Each rank flags its nodes.
/// Collective.
template <int dim>
void Fluid<dim>::flag_nodes()
{
  const std::vector<OnPieces> on_walls = nodes_on_walls();
  const auto from = [&](index_t n)
  {
    return std::lower_bound(on_walls.begin(), on_walls.end(), n,
                            [](const OnPieces& here, index_t k) { return here.node < k; });
  };
  const auto pieces_of = [&](index_t n)
  {
    const auto it = from(n);
    return it != on_walls.end() && it->node == n ? it->pieces : std::array<int, 3>{-1, -1, -1};
  };
  auto next = from(team_.node_begin());
  for (index_t n = team_.node_begin(); n < team_.node_end(); ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    const bool on_piece = next != on_walls.end() && next->node == n;
    next += on_piece;
    const bool wall = on_piece || (nodes_.surface[i] & wall_mask_);
    const bool alone = mesh_.isolated(n);
    nodes_.flag[i] =
        static_cast<std::uint8_t>((wall ? on_wall : 0) | (alone ? isolated_node | on_boundary : 0));
    nodes_.alone[i] = alone ? static_cast<std::uint8_t>(std::min(nodes_.alone[i] + 1, 255)) : 0;
  }
  for (const auto& facet : mesh_.boundary)
  {
    if (std::none_of(facet.begin(), facet.end(), [this](index_t n) { return team_.owns(n); }))
      continue;
    SurfaceMask surface = wall_mask_ | wet_mask_ | impedance_mask_ | openings_.driven_mask();
    std::array<int, 3> shared = pieces_of(facet[0]);
    for (const index_t n : facet)
    {
      surface &= nodes_.surface[static_cast<std::size_t>(n)];
      const auto p = pieces_of(n);
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
  halo_.update(nodes_.flag);
}

/// One or two elements that hang together with no others are spray: as fluid they would be a spring between
/// few nodes that snaps. Their nodes fly. Elements decide by what is at their nodes: where three meet in a
/// node, or one meets two others, the group is large enough, and the neighbours of such elements belong to
/// it. Each rank decides on the elements it has chosen. Where three of these meet, three meet; of the few
/// others all ranks know all. Collective.
template <int dim>
void Fluid<dim>::drop_fragments(ShapeChoice<dim>& choice) const
{
  const auto n_nodes = nodes_.x.size();
  std::vector<std::uint8_t> count(n_nodes, 0); // of elements; three stand for many
  for (const auto& e : choice.elements)
    for (const index_t n : e)
      if (auto& c = count[static_cast<std::size_t>(n)]; c < 3)
        ++c;
  const auto crowded = [&](const Simplex<dim>& e)
  {
    return std::any_of(e.begin(), e.end(), [&](index_t n) { return count[static_cast<std::size_t>(n)] > 2; });
  };
  std::vector<Simplex<dim>> few; // that may not be crowded
  std::copy_if(choice.elements.begin(), choice.elements.end(), std::back_inserter(few),
               [&](const Simplex<dim>& e) { return !crowded(e); });
  few = ranks().gather(few);
  if (few.empty())
    return;
  std::vector<char> large(n_nodes, 0); // a node of an element that hangs together with enough others
  for (const auto& e : choice.elements)
    if (crowded(e))
      for (const index_t n : e)
        large[static_cast<std::size_t>(n)] = 1;
  if (!ranks().alone()) // of the nodes of the few, what all ranks have there
  {
    std::vector<index_t> nodes;
    for (const auto& e : few)
      nodes.insert(nodes.end(), e.begin(), e.end());
    std::sort(nodes.begin(), nodes.end());
    nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
    std::vector<std::int64_t> there;
    for (const index_t n : nodes)
      there.insert(there.end(), {count[static_cast<std::size_t>(n)], large[static_cast<std::size_t>(n)]});
    ranks().sum(there);
    for (std::size_t k = 0; k < nodes.size(); ++k)
    {
      count[static_cast<std::size_t>(nodes[k])] =
          static_cast<std::uint8_t>(std::min<std::int64_t>(there[2 * k], 3));
      large[static_cast<std::size_t>(nodes[k])] = there[2 * k + 1] > 0;
    }
  }
  const auto name = [&](const Simplex<dim>& e)
  {
    std::uint64_t sum = 0; // of mixed identifiers: no order
    for (const index_t n : e)
      sum += mixed(static_cast<std::uint64_t>(nodes_.id[static_cast<std::size_t>(n)]));
    return mixed(sum);
  };
  std::unordered_map<std::size_t, std::uint64_t> names; // of the elements at a node, combined
  for (const auto& e : few)
    if (!crowded(e))
      for (const index_t n : e)
        names[static_cast<std::size_t>(n)] ^= name(e);
  const auto is_large = [&](const Simplex<dim>& e)
  {
    if (crowded(e))
      return true;
    std::uint64_t other = 0;
    for (const index_t n : e)
      if (count[static_cast<std::size_t>(n)] == 2)
      {
        const std::uint64_t here = names[static_cast<std::size_t>(n)] ^ name(e);
        if (here == 0 || (other != 0 && here != other)) // 0: the other one is crowded
          return true;
        other = here;
      }
    return false;
  };
  for (const auto& e : few)
    if (is_large(e))
      for (const index_t n : e)
        large[static_cast<std::size_t>(n)] = 1;
  const SurfaceMask kept = wet_mask_ | openings_.driven_mask();
  std::erase_if(choice.elements,
                [&](const Simplex<dim>& e)
                {
                  const bool stays = std::any_of(e.begin(), e.end(),
                                                 [&](index_t n)
                                                 {
                                                   const auto i = static_cast<std::size_t>(n);
                                                   return large[i] || (nodes_.surface[i] & kept) != 0;
                                                 });
                  if (!stays)
                    choice.dropped.add(
                        std::abs(signed_volume<dim, double>(corners<dim>(nodes_.x, e, nodes_.period))));
                  return !stays;
                });
}

/// Collective.
/// @param elements of this rank
/// @param mine nodes whose rows this rank has; empty: all
/// @returns the new number of each node, empty if numbers stay
template <int dim>
std::vector<index_t> Fluid<dim>::delete_isolated_nodes(std::vector<Simplex<dim>>& elements,
                                                       std::span<const char> mine)
{
  if (config_.remesh.delete_isolated_after == 0)
    return {};
  const auto long_alone = [this](std::size_t n)
  { return nodes_.alone[n] >= config_.remesh.delete_isolated_after; };
  std::vector<char> used(nodes_.x.size(), 0);
  std::vector<index_t> again;
  for (const auto& e : elements)
    for (const index_t n : e)
      if (long_alone(static_cast<std::size_t>(n)))
        again.push_back(n);
  for (const index_t n : ranks().gather(again))
    used[static_cast<std::size_t>(n)] = 1;
  struct Lost
  {
    index_t node;
    double M;
  };
  std::vector<Lost> lost;
  for (std::size_t n = 0; n < used.size(); ++n)
    if ((mine.empty() || mine[n]) && long_alone(n) && !used[n])
      lost.push_back({static_cast<index_t>(n), nodes_.M[n]});
  lost = ranks().gather(lost);
  if (lost.empty())
    return {};
  std::sort(lost.begin(), lost.end(), [](const Lost& a, const Lost& b) { return a.node < b.node; });
  std::vector<char>& gone = used;
  std::fill(gone.begin(), gone.end(), 0);
  for (const Lost& node : lost)
  {
    gone[static_cast<std::size_t>(node.node)] = 1;
    ++ledger_.deleted_nodes;
    ledger_.deleted_mass += node.M;
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
/// remesh that follows finds the fluid where it is. All ranks get all rows and do the same. Collective.
template <int dim>
void Fluid<dim>::pass_openings()
{
  collect();
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
  exchange_energy_.assign(nodes_.x.size(), 0.0); // all booked
  openings_energy_ += energy().total() - before;
  update_nodal_volumes<dim>(mesh_, nodes_);
  if (ranks().alone())
    return;
  mesh_.elements = sorted_elements<dim>(std::move(mesh_.elements)); // parts of the new numbers
  team_.share_out(nodes_.size(), mesh_);
}

/// Areas at impedance nodes, of which all ranks know all. Collective.
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
    nodes_.period.join(x);
    // volume_gradient of the facet is inward: V∇N = −area/dim
    for (const index_t n : facet)
      if (common != 0)
        area[static_cast<std::size_t>(n)] -= volume_gradient<dim, double>(x);
  }
  const auto [begin, end] = rows_to_sum(ranks().alone());
  for (std::size_t n = begin; n < end; ++n)
    if (norm_squared(area[n]) > 0.0)
      impedance_.push_back({n, area[n]});
  impedance_ = ranks().gather(impedance_);
}

namespace
{

/// Rows from the one of number `sorted` on, taken in the order of `tail`, come to lie before the rows
/// `place`, which do not descend.
template <class T>
void merge_tail(std::vector<T>& field, std::ptrdiff_t sorted, const std::vector<index_t>& tail,
                const std::vector<index_t>& place)
{
  std::vector<T> added;
  for (const index_t n : tail)
    added.push_back(field[static_cast<std::size_t>(n)]);
  auto end = field.begin() + sorted; // of what has still to move
  for (auto k = static_cast<std::ptrdiff_t>(tail.size()); k-- > 0;)
  {
    const auto from = field.begin() + place[static_cast<std::size_t>(k)];
    std::move_backward(from, end, end + k + 1);
    end = from;
    end[k] = added[static_cast<std::size_t>(k)];
  }
}

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

/// Nodes of a box of the order, at most. In the plane a step goes along rows: in boxes of 4096 it takes 1.15
/// times as long, in boxes of 64 1.9 times.
template <int dim>
constexpr std::size_t in_a_box = dim == 2 ? 16384 : 16;

/// The axis along which the fluid extends furthest; another one than now only if it is clearly longer. Rows
/// across it are short, and so are the cuts between ranks.
template <int dim>
void Fluid<dim>::choose_slow_axis()
{
  Vec<dim> mean{}, square{};
  const double part = 1.0 / static_cast<double>(nodes_.x.size());
  for (const auto& x : nodes_.x)
    mean += part * x;
  for (const auto& x : nodes_.x)
    for (int i = 0; i < dim; ++i)
      square[i] += (x[i] - mean[i]) * (x[i] - mean[i]);
  for (int i = 0; i < dim; ++i)
    if (square[i] > 1.5 * square[slow_axis_])
      slow_axis_ = i;
}

/// Rows of two spacings, the longest axis slowest: short to look up, and in the plane up to eight ranks with
/// cuts as short as any. Or boxes, whose ranges stay compact (docs/benchmarks/scaling.md): in space of few
/// nodes, in the plane of many, in rows.
template <int dim>
std::int64_t Fluid<dim>::row_of(const Vec<dim>& x) const
{
  std::int64_t row = in_boxes() ? boxes_.box_of(x) : 0;
  if (dim == 3 && in_boxes())
    return row;
  for (int k = 0; k < dim; ++k)
  {
    const int i = (slow_axis_ + dim - k) % dim;
    constexpr double most = 1 << 19; // 20 bits per axis
    const double place = std::floor(x[i] / (2.0 * config_.element_size));
    row = (row << 20) + static_cast<std::int64_t>(std::clamp(place, -most, most - 1.0));
  }
  return row;
}

/// Wet nodes first, then their neighbours, then the rest; inside each group by row_of, then by identifier.
/// Rows are those of a node's birth or of the last time that all were renewed: neighbours in space should be
/// neighbours in memory, but need not be every time. The order is
/// one of the nodes, whoever holds them, and with it the order in which elements are summed. Collective.
/// @param elements of this rank
/// @param held numbers of nodes whose rows are right here: those of all ranks are all nodes; −1: deleted;
/// null: all
/// @returns the new number of each node, empty if numbers stay
template <int dim>
std::vector<index_t> Fluid<dim>::order_nodes(std::vector<Simplex<dim>>& elements,
                                             const std::vector<index_t>* held)
{
  const auto n_nodes = static_cast<std::size_t>(nodes_.size());
  const bool renew = rows_are_due();
  if (renew)
  {
    choose_slow_axis();
    if (in_boxes())
      boxes_.build(nodes_.x, in_a_box<dim>);
  }
  const std::vector<char> group = wet_groups(elements, held);
  index_t sorted = nodes_.size(); // those before it are in order, unless all rows are new or groups may be
  while (sorted > 0 && nodes_.row[static_cast<std::size_t>(sorted - 1)] == no_row)
    --sorted;
  const bool tail_only = !renew && group.empty();
  for (auto n = static_cast<std::size_t>(tail_only ? sorted : 0); n < n_nodes; ++n)
    if (renew || nodes_.row[n] == no_row)
      nodes_.row[n] = row_of(nodes_.x[n]);

  const auto before = [&](index_t a, index_t b)
  {
    const auto n = static_cast<std::size_t>(a), m = static_cast<std::size_t>(b);
    if (!group.empty() && group[n] != group[m])
      return group[n] < group[m];
    return nodes_.row[n] != nodes_.row[m] ? nodes_.row[n] < nodes_.row[m] : nodes_.id[n] < nodes_.id[m];
  };
  if (!tail_only)
  {
    sorted = 1;
    while (sorted < nodes_.size() && !before(sorted, sorted - 1))
      ++sorted;
  }
  if (sorted >= nodes_.size())
    return {};
  std::vector<index_t> new_of_old(n_nodes);
  const auto take_numbers = [&]
  {
    delaunay_.renumber(new_of_old);
    for (auto& e : elements)
      for (index_t& n : e)
        n = new_of_old[static_cast<std::size_t>(n)];
    return new_of_old;
  };
  if (tail_only)
  {
    std::vector<index_t> tail(n_nodes - static_cast<std::size_t>(sorted)),
        all(static_cast<std::size_t>(sorted)), place;
    std::iota(tail.begin(), tail.end(), sorted);
    std::sort(tail.begin(), tail.end(), before);
    std::iota(all.begin(), all.end(), 0);
    for (const index_t n : tail)
      place.push_back(
          static_cast<index_t>(std::upper_bound(all.begin(), all.end(), n, before) - all.begin()));
    for (std::size_t k = 0, n = 0; n < all.size() || k < tail.size();)
      if (k < tail.size() && static_cast<std::size_t>(place[k]) == n)
      {
        new_of_old[static_cast<std::size_t>(tail[k])] = static_cast<index_t>(n + k);
        ++k;
      }
      else
      {
        new_of_old[n] = static_cast<index_t>(n + k);
        ++n;
      }
    nodes_.for_each_field([&](const char*, auto& field) { merge_tail(field, sorted, tail, place); });
    return take_numbers();
  }
  std::vector<index_t> old_of_new(n_nodes);
  std::iota(old_of_new.begin(), old_of_new.end(), 0);
  std::sort(old_of_new.begin() + sorted, old_of_new.end(), before);
  std::inplace_merge(old_of_new.begin(), old_of_new.begin() + sorted, old_of_new.end(), before);
  for (std::size_t n = 0; n < n_nodes; ++n)
    new_of_old[static_cast<std::size_t>(old_of_new[n])] = static_cast<index_t>(n);
  nodes_.for_each_field([&](const char*, auto& field) { permute(field, old_of_new); });
  return take_numbers();
}

/// 0 for wet nodes, 1 for their neighbours, 2 for the rest; empty where there can be no wet ones. Collective.
/// @param elements, held as of order_nodes
template <int dim>
std::vector<char> Fluid<dim>::wet_groups(const std::vector<Simplex<dim>>& elements,
                                         const std::vector<index_t>* held)
{
  n_wet_ = n_layer_ = 0;
  travel_ = 0.0;
  if (wet_mask_ == 0 && solid_.empty())
    return {};
  const auto n_nodes = nodes_.x.size();
  std::vector<char> group(n_nodes, 2);
  // Nodes that an element of some rank finds, each once from every rank.
  const auto put = [&](char found, auto&& finds)
  {
    std::vector<index_t> nodes;
    for (const auto& e : elements)
      for (const index_t n : e)
        if (char& g = group[static_cast<std::size_t>(n)]; g > found && finds(e, n))
        {
          g = found;
          nodes.push_back(n);
        }
    for (const index_t n : ranks().gather(nodes))
      group[static_cast<std::size_t>(n)] = std::min(group[static_cast<std::size_t>(n)], found);
  };
  put(0, [&](const Simplex<dim>&, index_t n)
      { return (nodes_.surface[static_cast<std::size_t>(n)] & wet_mask_) != 0; });
  std::vector<index_t> near;
  const auto look_at = [&](index_t n)
  {
    if (n >= 0 && solid_.is_near(nodes_.x[static_cast<std::size_t>(n)], contact_reach * config_.element_size))
      near.push_back(n);
  };
  if (held)
    std::for_each(held->begin(), held->end(), look_at);
  else
    for (index_t n = 0; n < nodes_.size(); ++n)
      look_at(n);
  for (const index_t n : held ? ranks().gather(near) : near)
    group[static_cast<std::size_t>(n)] = 0;
  put(1,
      [&](const Simplex<dim>& e, index_t)
      {
        return std::any_of(e.begin(), e.end(),
                           [&](index_t n) { return group[static_cast<std::size_t>(n)] == 0; });
      });
  for (const char g : group)
  {
    n_wet_ += g == 0;
    n_layer_ += g <= 1;
  }
  return group;
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
