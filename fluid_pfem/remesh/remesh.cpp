// New connectivity at a synchronised time.
#include "common/error.hpp"
#include "common/parallel/in_parts.hpp"
#include "common/parallel/untouched_rows.hpp"
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/remesh/alpha_shape.hpp"
#include "fluid_pfem/remesh/beside_solid.hpp"
#include "fluid_pfem/remesh/refine_coarsen.hpp"
#include "fluid_pfem/simplex.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace undine::fluid
{

namespace
{

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
  quality_ = UntouchedRows<float>();
  mass_rate_ = UntouchedRows<double>();
  exchange_energy_ = UntouchedRows<double>(); // booked
  mesh_.fans = UnwrittenRows<FanEntry<dim>>();
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
  auto& old_x = x_remesh_;
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
       .known = known.among(),
       .threads = team_.threads()});
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
                        config_.element_size, config_.remesh.shape, ranks(), team_.threads());
  drop_fragments(choice);
  ranks().sum({&choice.created, &choice.dropped});
  pieces = std::vector<std::array<int, 3>>();
  // The number that each old node has come to bear; a node that was merged is where the other one is.
  std::vector<index_t> number(old_x.size());
  std::iota(number.begin(), number.end(), 0);
  const auto new_number_of = [](index_t n, const std::vector<index_t>& new_number)
  { return n < 0 || new_number.empty() ? n : new_number[static_cast<std::size_t>(n)]; };
  const auto follow = [&](const std::vector<index_t>& new_number)
  {
    for (index_t& n : number)
      n = new_number_of(n, new_number);
  };
  for (const auto& [kept, gone] : spacing.merges)
    number[static_cast<std::size_t>(gone)] = kept;
  follow(spacing.new_number);
  const std::vector<index_t> moved_before = moved_nodes(old, number, spacing); // before numbers change again
  std::vector<index_t> held; // nodes whose rows this rank has
  for (std::size_t n = 0; n < mine.size(); ++n)
    if (mine[n])
      held.push_back(static_cast<index_t>(n));
  const auto renumber_held = [&](const std::vector<index_t>& new_number)
  {
    for (index_t& n : held)
      n = new_number_of(n, new_number);
  };
  const std::vector<index_t>* known_rows = mine.empty() ? nullptr : &held;
  const auto deleted = delete_isolated_nodes(choice.elements, known_rows);
  renumber_held(deleted);
  const auto ordered = order_nodes(choice.elements, known_rows);
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
  std::vector<char> moved(nodes_.x.size(), 0);
  for (index_t n : moved_before)
    if ((n = new_number_of(n, deleted)) >= 0 && (n = new_number_of(n, ordered)) >= 0)
      moved[static_cast<std::size_t>(n)] = 1;
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
  constrain_velocities();

  ++ledger_.remeshes;
  ledger_.merged += spacing.merged;
  ledger_.split += spacing.split;
  ledger_.created += choice.created.value();
  ledger_.dropped += choice.dropped.value();
  const double jump = energy_of_state(ranks().alone(), v_half_).total() - before;
  (jump > 0.0 ? remesh_gain_ : remesh_loss_) += jump;
  keep_own_rows();
}

/// The same elements, but other nodes are near the solid. Collective.
template <int dim>
void Fluid<dim>::renew_order()
{
  agree();
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
  keep_own_rows();
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
  choose_slow_axis(nullptr);
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
  const bool moves = !nodes_.v.empty();
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
  nodes_.for_each_field_of_owners(
      [this](const char*, auto& field)
      {
        if (!field.empty())
          return;
        field.resize(nodes_.x.size());
        if (!ranks().alone())
          give_back(field, 0, field.size()); // zeros as they are
      });
  elements = sorted_elements<dim>(std::move(elements));
  connect_mesh(elements);
  finish_mesh();
  const auto first = team_.nodes_of_ranks();
  if (moves)
    ranks().gather_rows(nodes_.v, first);
  ranks().gather_rows(nodes_.flag, first);
  std::copy(nodes_.m.begin() + team_.node_begin(), nodes_.m.begin() + team_.node_end(),
            nodes_.M.begin() + team_.node_begin());
  // What the scene leaves empty is a gap, also where the rules of a remesh would make it fluid.
  ShapeChoice<dim> choice =
      choose_fluid<dim>(nodes_, wall_pieces(), std::move(delaunay), nodes_.x, own_elements(),
                        config_.element_size, config_.remesh.shape, ranks());
  std::erase_if(choice.elements, [&elements](const Simplex<dim>& e)
                { return std::binary_search(elements.begin(), elements.end(), canonical<dim>(e)); });
  choice.gaps.insert(choice.gaps.end(), choice.elements.begin(), choice.elements.end());
  gaps_ = sorted_elements<dim>(ranks().gather(choice.gaps));
  find_ghosts(); // now with the gaps
  keep_places();
  keep_own_rows();
}

/// All nodes on walls and solid, in order; each rank looks at its own. Collective.
template <int dim>
std::vector<typename Fluid<dim>::OnPieces> Fluid<dim>::nodes_on_walls() const
{
  std::vector<OnPieces> found;
  const auto rows = rows_to_sum(ranks().alone());
  const auto look_at = [this](std::size_t n, std::vector<OnPieces>& list)
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
      list.push_back(here);
  };
  if (!contact_.empty() || !solid_.empty())
    found = list_in_parts<OnPieces>(team_.threads(), rows[1] - rows[0], 0,
                                    [&](std::vector<OnPieces>& list, std::size_t begin, std::size_t end)
                                    {
                                      for (std::size_t n = rows[0] + begin; n < rows[0] + end; ++n)
                                        look_at(n, list);
                                    });
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

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
