// The fluid's part among several ranks: ghosts, what all agree on, and the whole state.
#include "common/parallel/untouched_rows.hpp"
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/remesh/beside_solid.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

namespace undine::fluid
{

/// Elements are numbered in their order over all ranks and cut into shares. A rank puts those of its share
/// and those that touch its nodes in their places among all; what is in other places is nobody's. Collective.
/// @param sorted of this rank: those of all ranks make up the mesh
template <int dim>
void Fluid<dim>::share_elements(std::vector<Simplex<dim>> sorted)
{
  if (ranks().alone())
  {
    mesh_.elements = std::move(sorted);
    e_wet_ = first_element_from<dim>(mesh_.elements, n_wet_);
    e_layer_ = first_element_from<dim>(mesh_.elements, n_layer_);
    team_.share_out(nodes_.size(), mesh_);
    return;
  }
  sorted = sorted_over_ranks<dim>(std::move(sorted), ranks());
  const auto count = static_cast<index_t>(sorted.size()), me = static_cast<index_t>(ranks().rank());
  const std::vector<index_t> counts = ranks().gather(std::vector{count});
  const index_t begin = std::accumulate(counts.begin(), counts.begin() + me, 0),
                total = std::accumulate(counts.begin(), counts.end(), 0);
  std::vector<std::int64_t> sums{first_element_from<dim>(sorted, n_wet_),
                                 first_element_from<dim>(sorted, n_layer_)};
  ranks().sum(sums);
  e_wet_ = static_cast<index_t>(sums[0]);
  e_layer_ = static_cast<index_t>(sums[1]);
  const std::vector<index_t> first_element = team_.cut_elements(total);
  sums.assign(first_element.size(), 0);
  for (std::size_t k = 0; k < sums.size(); ++k)
    if (const index_t e = first_element[k] - begin; e >= 0 && e < count)
      sums[k] = sorted[static_cast<std::size_t>(e)][0];
  ranks().sum(sums);
  std::vector<index_t> first_node(sums.begin(), sums.end());
  for (std::size_t k = 0; k < sums.size(); ++k)
    if (first_element[k] == total)
      first_node[k] = nodes_.size();
  first_node.front() = 0;
  team_.share_out(first_element, first_node);

  struct Numbered
  {
    index_t number;
    Simplex<dim> nodes;
  };
  std::vector<std::vector<Numbered>> to(counts.size());
  std::vector<index_t> earlier;
  mesh_.elements.resize(static_cast<std::size_t>(total));
  const auto put = [&](const Numbered& e)
  {
    mesh_.elements[static_cast<std::size_t>(e.number)] = e.nodes;
    if (e.number < team_.element_begin())
      earlier.push_back(e.number);
  };
  for (index_t k = 0; k < count; ++k)
  {
    const Numbered e{begin + k, sorted[static_cast<std::size_t>(k)]};
    if (e.number >= team_.element_begin() && e.number < team_.element_end() &&
        std::all_of(e.nodes.begin(), e.nodes.end(), [this](index_t n) { return team_.owns(n); }))
    {
      put(e);
      continue;
    }
    std::array<int, dim + 2> of; // its rank and those of its nodes
    of[0] = owner(team_.elements_of_ranks(), e.number);
    for (std::size_t a = 0; a <= dim; ++a)
      of[a + 1] = owner(team_.nodes_of_ranks(), e.nodes[a]);
    std::sort(of.begin(), of.end());
    const auto end = std::unique(of.begin(), of.end());
    std::for_each(of.begin(), end,
                  [&](int r) { r == me ? put(e) : to[static_cast<std::size_t>(r)].push_back(e); });
  }
  for (const auto& part : ranks().exchange(std::move(to)))
    std::for_each(part.begin(), part.end(), put);
  std::sort(earlier.begin(), earlier.end());
  team_.find_shared(mesh_, std::move(earlier));
}

template <int dim>
std::span<const Simplex<dim>> Fluid<dim>::own_elements() const
{
  if (ranks().alone())
    return mesh_.elements;
  return std::span(mesh_.elements)
      .subspan(static_cast<std::size_t>(team_.element_begin()),
               static_cast<std::size_t>(team_.element_end() - team_.element_begin()));
}

/// Ghosts are the nodes of other ranks in what this rank computes: elements that it owns, or that touch its
/// nodes, and gaps that it watches. Each rank makes its lists alone, from the elements that it owns or that
/// touch its nodes: these come before its own.
template <int dim>
void Fluid<dim>::find_ghosts()
{
  if (ranks().alone())
    return;
  const int me = ranks().rank();
  const auto size = static_cast<std::size_t>(ranks().size());
  std::vector<std::vector<index_t>> send(size), receive(size);
  const auto need = [&](int rank, index_t n)
  {
    const int of = owner(team_.nodes_of_ranks(), n);
    if (of != rank && rank == me)
      receive[static_cast<std::size_t>(of)].push_back(n);
    if (of == me && rank != me)
      send[static_cast<std::size_t>(rank)].push_back(n);
  };
  std::vector<index_t> near = team_.earlier();
  for (index_t e = team_.element_begin(); e < team_.element_end(); ++e)
    near.push_back(e);
  for (const index_t e : near)
  {
    const auto& nodes = mesh_.elements[static_cast<std::size_t>(e)];
    const auto mine = std::count_if(nodes.begin(), nodes.end(), [this](index_t n) { return team_.owns(n); });
    const bool computed = e >= team_.element_begin() && e < team_.element_end();
    if (mine == (computed ? dim + 1 : 0))
      continue;
    for (const index_t n : nodes)
    {
      need(owner(team_.elements_of_ranks(), e), n);
      for (const index_t other : nodes)
        need(owner(team_.nodes_of_ranks(), other), n);
    }
  }
  own_gaps_.clear();
  for (const auto& gap : gaps_)
  {
    const int watcher = owner(team_.nodes_of_ranks(), gap[0]);
    if (watcher == me)
      own_gaps_.push_back(gap);
    for (const index_t n : gap)
      need(watcher, n);
  }
  for (auto* lists : {&send, &receive})
    for (auto& list : *lists)
    {
      std::sort(list.begin(), list.end());
      list.erase(std::unique(list.begin(), list.end()), list.end());
    }
  // A node beside a ghost is a ghost itself, on the ghost's rank.
  turns_.assign(static_cast<std::size_t>(nodes_.size() / element_block) + 1, Turn::first);
  std::fill(turns_.begin() + (team_.node_begin() + team_.node_end()) / 2 / element_block, turns_.end(),
            Turn::last);
  for (const auto& list : send)
    for (const index_t n : list)
      turns_[static_cast<std::size_t>(n / element_block)] = Turn::at_cut;
  // What the ranks that have nodes of the interface pass to each other before the rest is computed.
  auto layer_send = send, layer_receive = receive;
  for (auto* lists : {&layer_send, &layer_receive})
    for (std::size_t r = 0; r < size; ++r)
    {
      const bool both = has_interface() && team_.nodes_of_ranks()[r] < n_layer_;
      std::erase_if((*lists)[r], [&](index_t n) { return !both || n >= n_layer_; });
    }
  halo_ = Halo(ranks(), std::move(send), std::move(receive));
  layer_halo_ = Halo(ranks(), std::move(layer_send), std::move(layer_receive));
}

/// First wet node of every rank, and their number.
template <int dim>
std::vector<index_t> Fluid<dim>::wet_of_ranks() const
{
  std::vector<index_t> first;
  for (const index_t n : team_.nodes_of_ranks())
    first.push_back(std::min(n, n_wet_));
  return first;
}

/// Energy that openings brought, with what the ranks have not agreed on yet [J]. Collective.
template <int dim>
double Fluid<dim>::openings_energy() const
{
  double sum = openings_energy_;
  if (ranks().alone() || (impedance_mask_ == 0 && openings_.driven_mask() == 0))
    return sum;
  std::vector<OpeningWork> works = ranks().gather(opening_works_); // of a step in the order of the nodes
  std::stable_sort(works.begin(), works.end(),
                   [](const OpeningWork& a, const OpeningWork& b) { return a.turn < b.turn; });
  for (const OpeningWork& work : works)
    sum = std::fma(work.factor, work.other, sum);
  return sum;
}

/// Some rank says yes. The ranks also agree on how fast nodes have moved, how long some were turned over, and
/// the work at openings.
template <int dim>
bool Fluid<dim>::any_rank(bool yes)
{
  if (ranks().alone())
    return yes;
  std::vector<double> values{yes ? 1.0 : 0.0, static_cast<double>(turned_over_)};
  for (const Move& move : moves_)
    values.push_back(move.speed);
  ranks().max(values);
  for (std::size_t k = 0; k < moves_.size(); ++k)
  {
    moves_[k].speed = values[k + 2];
    move_on(moves_[k]);
  }
  moves_.clear();
  turned_over_agreed_ = static_cast<int>(values[1]);
  agreed_at_ = steps_;
  openings_energy_ = openings_energy();
  opening_works_.clear();
  return values[0] > 0.0;
}

/// On how far nodes may have moved, and how long some were turned over. Collective.
template <int dim>
void Fluid<dim>::agree()
{
  any_rank(false);
  turned_over_ = ranks().alone() ? turned_over_ : turned_over_agreed_;
}

/// Positions, velocities and flags of nodes of other ranks come here, as far as they lie within reach of what
/// this rank decides in a remesh, with room for what the remesh moves, across the ends of a period too.
/// Collective.
/// @returns the nodes whose rows are right here: for the others nothing but what all ranks know
template <int dim>
KnownNodes Fluid<dim>::look_around()
{
  if (ranks().alone() || collected_)
    return {};
  agree();
  const auto begin = static_cast<std::size_t>(team_.node_begin()),
             end = static_cast<std::size_t>(team_.node_end());
  KnownNodes known{.all = false, .list = std::vector<index_t>(end - begin)};
  std::iota(known.list.begin(), known.list.end(), team_.node_begin());
  update_spacing(known);
  double settled = 0.0; // largest distance that a node is taken out of walls
  if (contact_.has_convex())
  {
    std::vector<Vec<dim>> x(nodes_.x.begin() + team_.node_begin(), nodes_.x.begin() + team_.node_end());
    contact_.settle(x);
    for (std::size_t k = 0; k < x.size(); ++k)
      settled = std::max(settled, norm(x[k] - nodes_.x[begin + k]));
    settled = ranks().max(settled);
  }
  if (!solid_.empty()) // a node that clings to a corner, and then is taken out of the solid
    settled += (config_.remesh.spacing.merge + brought_out) * coarsest_;
  const double reach = LocalDelaunay<dim>::spare * halo_width() + 2.0 * (coarsest_ + settled);

  // Cells of half the reach: what is within reach of a node lies at most two cells off.
  const double size = 0.5 * reach * (1.0 + 1e-9);
  using Cell = std::array<std::int64_t, dim>;
  struct Run // of consecutive nodes in one cell
  {
    Cell cell;
    std::size_t begin, end;
  };
  const auto cell_of = [size](const Vec<dim>& x)
  {
    Cell cell;
    for (std::size_t i = 0; i < dim; ++i)
      cell[i] = static_cast<std::int64_t>(std::floor(x.c[i] / size));
    return cell;
  };
  std::vector<Run> runs;
  for (std::size_t n = begin; n < end; ++n)
  {
    const Cell cell = cell_of(nodes_.x[n]);
    if (runs.empty() || runs.back().cell != cell)
      runs.push_back({cell, n, n});
    runs.back().end = n + 1;
  }
  std::vector<Cell> own;
  for (const Run& run : runs)
    own.push_back(run.cell);
  const auto sort = [](std::vector<Cell>& list)
  {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  };
  sort(own);
  std::vector<Cell> around = own; // also of images within reach of the period's cell
  const auto shifts = nodes_.period.shifts();
  for (std::size_t k = 1; k < shifts.size(); ++k)
    for (std::size_t n = begin; n < end; ++n)
    {
      const Vec<dim> image = nodes_.x[n] + shifts[k], inside = image - nodes_.period.origin();
      bool near = true;
      for (int i = 0; i < dim; ++i)
        if (const double length = nodes_.period.length()[i]; length > 0.0)
          near = near && inside[i] > -2.0 * reach && inside[i] < length + 2.0 * reach;
      if (const Cell cell = cell_of(image); near && (around.empty() || around.back() != cell))
        around.push_back(cell);
    }
  sort(around);
  std::vector<std::size_t> counts;
  const std::vector<Cell> cells = ranks().gather(around, &counts);
  Cell lower{}, upper{}; // of the own cells
  for (std::size_t i = 0; i < dim && !own.empty(); ++i)
  {
    const auto less = [i](const Cell& a, const Cell& b) { return a[i] < b[i]; };
    lower[i] = (*std::min_element(own.begin(), own.end(), less))[i];
    upper[i] = (*std::max_element(own.begin(), own.end(), less))[i];
  }
  struct Row
  {
    index_t node;
    std::uint8_t flag, alone;
    Vec<dim> x, v;
  };
  std::vector<std::vector<Row>> to(counts.size());
  auto from = cells.begin();
  for (std::size_t r = 0; r < counts.size(); ++r)
  {
    const auto last = from + static_cast<std::ptrdiff_t>(counts[r]);
    std::vector<char> wanted(own.size(), 0);
    for (auto it = from; it != last && r != static_cast<std::size_t>(ranks().rank()); ++it)
    {
      bool far = own.empty();
      for (std::size_t i = 0; i < dim; ++i)
        far = far || (*it)[i] < lower[i] - 2 || (*it)[i] > upper[i] + 2;
      constexpr int around = dim == 2 ? 25 : 125;
      for (int k = 0; k < around && !far; ++k)
      {
        Cell near = *it;
        for (int i = 0, rest = k; i < dim; ++i, rest /= 5)
          near[static_cast<std::size_t>(i)] += rest % 5 - 2;
        if (const auto found = std::lower_bound(own.begin(), own.end(), near);
            found != own.end() && *found == near)
          wanted[static_cast<std::size_t>(found - own.begin())] = 1;
      }
    }
    from = last;
    if (std::any_of(wanted.begin(), wanted.end(), [](char w) { return w != 0; }))
      for (const Run& run : runs)
        if (wanted[static_cast<std::size_t>(std::lower_bound(own.begin(), own.end(), run.cell) -
                                            own.begin())])
          for (std::size_t n = run.begin; n < run.end; ++n)
            to[r].push_back(
                {static_cast<index_t>(n), nodes_.flag[n], nodes_.alone[n], nodes_.x[n], nodes_.v[n]});
  }
  const auto rows = ranks().exchange(std::move(to)); // rank by rank, in order
  std::vector<index_t> list;
  for (std::size_t r = 0; r < rows.size(); ++r)
  {
    if (r == static_cast<std::size_t>(ranks().rank()))
      list.insert(list.end(), known.list.begin(), known.list.end());
    for (const Row& row : rows[r])
    {
      const auto n = static_cast<std::size_t>(row.node);
      nodes_.flag[n] = row.flag;
      nodes_.alone[n] = row.alone;
      nodes_.x[n] = row.x;
      nodes_.v[n] = row.v;
      list.push_back(row.node);
    }
  }
  known.list = std::move(list);
  return known;
}

/// Nodes take the places of sharp corners of the solid, on all ranks alike. Collective.
template <int dim>
void Fluid<dim>::cling_to_solid()
{
  const double merge = config_.remesh.spacing.merge;
  if (ranks().alone())
    return cling_to_corners<dim>(solid_, mesh_.boundary, merge, nodes_);
  // A node that comes to one corner may come near the next: rows of all facets of twice that reach.
  const auto corners = solid_.convex_corners();
  const auto is_near = [&](index_t n)
  {
    return team_.owns(n) && std::any_of(corners.begin(), corners.end(),
                                        [&](const auto& corner) {
                                          return norm(nodes_.x[static_cast<std::size_t>(n)] - corner.x) <=
                                                 2.01 * merge * coarsest_;
                                        });
  };
  std::vector<index_t> numbers;
  for (std::size_t f = 0; f < mesh_.boundary.size() && !corners.empty(); ++f)
    if (std::any_of(mesh_.boundary[f].begin(), mesh_.boundary[f].end(), is_near))
      numbers.push_back(static_cast<index_t>(f));
  numbers = ranks().gather(numbers);
  std::sort(numbers.begin(), numbers.end());
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
  std::vector<Facet<dim>> facets;
  std::vector<index_t> ends;
  for (const index_t f : numbers)
  {
    facets.push_back(mesh_.boundary[static_cast<std::size_t>(f)]);
    ends.insert(ends.end(), facets.back().begin(), facets.back().end());
  }
  struct Row
  {
    index_t node;
    Vec<dim> x, v;
    double h, p, rho;
  };
  std::vector<Row> rows;
  for (const index_t n : ends)
    if (const auto i = static_cast<std::size_t>(n); team_.owns(n))
      rows.push_back({n, nodes_.x[i], nodes_.v[i], nodes_.h[i], nodes_.p[i], nodes_.rho[i]});
  for (const Row& row : ranks().gather(rows))
  {
    const auto i = static_cast<std::size_t>(row.node);
    std::tie(nodes_.x[i], nodes_.v[i], nodes_.h[i], nodes_.p[i], nodes_.rho[i]) =
        std::tie(row.x, row.v, row.h, row.p, row.rho);
  }
  cling_to_corners<dim>(solid_, facets, merge, nodes_);
}

/// Numbers of known nodes after merges and splits: all that took part are known, and what was made of them.
template <int dim>
void Fluid<dim>::follow_changes(const SpacingReport& spacing, KnownNodes& known) const
{
  if (known.all)
    return;
  auto& list = known.list;
  list.insert(list.end(), spacing.involved.begin(), spacing.involved.end());
  for (const auto& split : spacing.splits)
    list.push_back(split[2]);
  if (!spacing.new_number.empty())
  {
    for (index_t& n : list)
      n = spacing.new_number[static_cast<std::size_t>(n)];
    std::erase(list, -1);
  }
  const auto added = std::is_sorted_until(list.begin(), list.end());
  std::sort(added, list.end());
  std::inplace_merge(list.begin(), added, list.end());
  list.erase(std::unique(list.begin(), list.end()), list.end());
}

/// Rows of nodes that are now another rank's go there, those of ghosts come here. Collective.
/// @param held numbers of the nodes whose rows are right here: those of all ranks are all nodes
/// @param moved goes with the rows
template <int dim>
void Fluid<dim>::pass_rows(std::span<const index_t> held, std::vector<char>& moved)
{
  if (ranks().alone())
    return;
  struct Row
  {
    index_t node;
    std::uint8_t flag, alone;
    char moved;
    Vec<dim> x, v, a;
    double M, rho, V, h;
  };
  std::vector<std::vector<Row>> to(static_cast<std::size_t>(ranks().size()));
  for (const index_t n : held)
    if (const auto i = static_cast<std::size_t>(n); n >= 0 && !team_.owns(n))
      to[static_cast<std::size_t>(owner(team_.nodes_of_ranks(), n))].push_back(
          {n, nodes_.flag[i], nodes_.alone[i], moved[i], nodes_.x[i], nodes_.v[i], nodes_.a[i], nodes_.M[i],
           nodes_.rho[i], nodes_.V[i], nodes_.h[i]});
  for (const auto& rows : ranks().exchange(std::move(to)))
    for (const Row& row : rows)
    {
      const auto i = static_cast<std::size_t>(row.node);
      std::tie(nodes_.flag[i], nodes_.alone[i], moved[i], nodes_.x[i], nodes_.v[i], nodes_.a[i], nodes_.M[i],
               nodes_.rho[i], nodes_.V[i], nodes_.h[i]) =
          std::tie(row.flag, row.alone, row.moved, row.x, row.v, row.a, row.M, row.rho, row.V, row.h);
    }
  halo_.update(nodes_.x, nodes_.h, moved);
}

/// The rows of all nodes that a remesh could go on with. Collective.
template <int dim>
void Fluid<dim>::gather_state()
{
  if (collected_)
    return;
  const auto first = team_.nodes_of_ranks();
  const auto rows = [&](auto&... fields) { (ranks().gather_rows(fields, first), ...); };
  rows(nodes_.x, nodes_.v, nodes_.a, nodes_.m, nodes_.M, nodes_.inertia, nodes_.rho, nodes_.p, nodes_.V,
       nodes_.flag, nodes_.alone);
  if (!size_.uniform())
    rows(nodes_.h);
  agree();
}

/// Rows of nodes and elements that this rank does not compute with take no memory until the next collect().
template <int dim>
void Fluid<dim>::keep_own_rows()
{
  collected_ = ranks().alone();
  if (collected_)
    return;
  std::vector<index_t> numbers; // rank by rank, hence in order
  for (std::size_t r = 0; r < halo_.received().size(); ++r)
  {
    const auto& ghosts = halo_.received()[r];
    numbers.insert(numbers.end(), ghosts.begin(), ghosts.end());
    for (index_t n = team_.node_begin(); n < team_.node_end() && static_cast<int>(r) == ranks().rank(); ++n)
      numbers.push_back(n);
  }
  const auto nodes = ranges_of(numbers);
  nodes_.for_each_field_of_owners([&nodes](const char*, auto& field) { give_back_others(field, nodes); });
  give_back_others(x_remesh_, nodes);
  give_back_others(v_half_, nodes);
  give_back_others(mass_rate_, nodes);
  give_back_others(exchange_energy_, nodes);
  auto elements = ranges_of(before_elements_here());
  elements.push_back({elements_here_.begin, elements_here_.end});
  give_back_others(mesh_.elements, elements);
  give_back_others(quality_, elements);
}

/// Rank 0 has all of the sums over time. Collective.
template <int dim>
void Fluid<dim>::gather_sums()
{
  std::vector<ExactSum*> sums = sums_over_time();
  ranks().sum(sums);
  for (ExactSum* sum : sums)
    ranks().rank() == 0 ? sum->normalise() : static_cast<void>(*sum = {});
}

template <int dim>
void Fluid<dim>::collect()
{
  if (collected_)
    return;
  gather_state();
  gather_sums();
  const auto first = team_.nodes_of_ranks();
  ranks().gather_rows(mesh_.elements, team_.elements_of_ranks());
  if (!config_.body_force.empty())
  {
    sums_.body.resize(nodes_.x.size());
    ranks().gather_rows(sums_.body, first);
  }
  ranks().gather_rows(sums_.heat, blocks_of_ranks());
  exchange_of_all_ = {};
  for (index_t n = team_.node_begin(); n < team_.node_end(); ++n)
    exchange_of_all_.add(exchange_energy_[static_cast<std::size_t>(n)]);
  ranks().sum({&exchange_of_all_});
  collected_ = true;
}

/// Of each rank its part; of what was collected rank 0 has all.
template <int dim>
std::vector<ExactSum*> Fluid<dim>::sums_over_time()
{
  std::vector<ExactSum*> sums = contact_.sums();
  sums.push_back(&interface_work_);
  return sums;
}

/// What became heat, and what moved mass brought, since the last remesh is booked. Collective.
template <int dim>
void Fluid<dim>::cool()
{
  if (exchange_energy_.empty()) // no step yet
    return;
  ranks().gather_rows(sums_.heat, blocks_of_ranks());
  dissipated_ = std::accumulate(sums_.heat.begin(), sums_.heat.end(), dissipated_);
  std::fill(sums_.heat.begin(), sums_.heat.end(), 0.0);
  ExactSum exchanged;
  for (auto n = static_cast<std::size_t>(team_.node_begin()); n < static_cast<std::size_t>(team_.node_end());
       ++n)
  {
    exchanged.add(exchange_energy_[n]);
    exchange_energy_[n] = 0.0;
  }
  ranks().sum({&exchanged});
  exchanged_ += exchanged.value();
  exchange_of_all_ = {};
}

template <int dim>
std::array<std::size_t, 2> Fluid<dim>::rows_to_sum(bool whole) const
{
  return whole ? std::array{std::size_t{0}, nodes_.x.size()}
               : std::array{static_cast<std::size_t>(team_.node_begin()),
                            static_cast<std::size_t>(team_.node_end())};
}

/// First block of elements of every rank, and their number.
template <int dim>
std::vector<index_t> Fluid<dim>::blocks_of_ranks() const
{
  std::vector<index_t> first;
  for (const index_t e : team_.elements_of_ranks())
    first.push_back((e + element_block - 1) / element_block);
  return first;
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
