// Several steps of the plane fluid in one sweep over the nodes: memory is read and written once for all.
//
// Nodes are numbered row by row and elements sorted by their lowest node, so that what acts on a node has
// numbers near its own. As soon as the nodes around it have completed a step, a node may begin the next one:
// step k + 1 follows step k through the numbers, some rows behind. In each step
//   a node moves       when its forces of the step before are complete;
//   knows its state    when its neighbours have moved;
//   gets its forces    from element after element, when the corners know their state;
// and nobody reads what a step behind overwrites: the forces of a node are complete only when all elements
// around it are done, hence when all its neighbours know their state. Sums have the order of single steps.
//
// On several ranks each gets the nodes around its own, as many neighbours of neighbours as the steps need,
// and makes the first steps of those itself: two layers fewer with each step. Ranks then meet once in a
// sweep.
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/mass_conservation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace undine::fluid
{

namespace
{

constexpr int most_steps = 8, ///< of one sweep
    most_steps_of_ranks = 4;  ///< if there are several
constexpr double worth = 0.1; ///< so many nodes of others, over its own, may a rank take into a sweep

/// The next multiple of `unit`, but n at most.
index_t round_up(index_t k, index_t unit, index_t n) { return std::min((k + unit - 1) / unit * unit, n); }

} // namespace

/// A step of the sweep, and how far it has come.
template <int dim>
struct Fluid<dim>::InFlight
{
  Step<dim> step;
  double booked = 0.0;      ///< as in exchange_mass
  Range moves, knows, gets; ///< nodes that move in it, find their state, get their forces
  Taken taken;              ///< elements
  index_t moved = 0, known = 0,
          complete = 0; ///< first node that has not moved, has no state, waits for forces
  index_t element = 0;  ///< next one
  bool done = false;
  double fastest = 0.0; ///< squared speed of the fastest node of this rank [m²/s²]
  index_t bad = -1;     ///< a node of this rank whose elements have turned over, or −1
  Share inner, at_edge; ///< who gets forces: where all corners do, and where not
  typename Walls<dim>::Reaction* of_others = nullptr; ///< of walls on nodes of other ranks
};

template <int dim>
void Fluid<dim>::advance(double dt, std::int64_t steps)
{
  while (steps > 0)
  {
    const int together = in_one_sweep(steps);
    if (together > 1)
      skew(dt, together);
    else
    {
      predict(dt);
      solve_free_motion(dt);
    }
    steps -= together;
  }
}

template <int dim>
int Fluid<dim>::in_one_sweep(std::int64_t steps)
{
  if (steps < 2 || dim != 2 || team_.threads() != 1 || n_wet_ != 0 || !solid_.empty() || !forces_are_local())
    return 1;
  find_reach();
  const int together = static_cast<int>(std::min<std::int64_t>(steps, sweep_steps_));
  return far_from_blow_up(together) ? together : 1;
}

/// No node can be found to be turned over for too long: whoever reads that wants to see its step.
template <int dim>
bool Fluid<dim>::far_from_blow_up(int steps) const
{
  const std::int64_t most =
      ranks().alone() ? turned_over_ : turned_over_agreed_ + steps_ - agreed_at_; // the same on all ranks
  return most + steps <= may_be_turned_over;
}

/// Of this mesh, if it is not found yet. Collective.
template <int dim>
void Fluid<dim>::find_reach()
{
  if (reach_is_found_)
    return;
  reach_is_found_ = true;
  sweep_steps_ = most_steps;
  elements_here_ = {0, mesh_.n_elements()};
  around_.assign(1, {0, nodes_.size()});
  taken_.assign(1, {.elements = elements_here_, .inner = elements_here_});
  if (!ranks().alone())
    find_surroundings();
  if (sweep_steps_ > 1)
    find_reach_of_blocks();
}

/// What this rank needs of others for a sweep. Collective.
template <int dim>
void Fluid<dim>::find_surroundings()
{
  const auto first = team_.nodes_of_ranks();
  const int me = ranks().rank();
  const Range own{team_.node_begin(), team_.node_end()};
  index_t widest = 0; // difference of numbers in an element
  for (const auto& e : own_elements())
    widest = std::max(widest, *std::max_element(e.begin(), e.end()) - e[0]);
  widest = static_cast<index_t>(ranks().max(static_cast<double>(widest)));
  constexpr index_t layers = 2 * most_steps_of_ranks;
  const auto near = [&](int r) -> Range // rank r, for sure
  {
    return {std::max(first[static_cast<std::size_t>(r)] - layers * widest, 0),
            std::min(first[static_cast<std::size_t>(r) + 1] + layers * widest, nodes_.size())};
  };
  const bool small = own.end - own.begin <= layers * widest; // what is near may be more than the whole
  sweep_steps_ = 1;
  if (ranks().max(small ? 1.0 : 0.0) > 0.0)
    return;

  struct Numbered
  {
    index_t number;
    Simplex<dim> nodes;
  };
  const auto elements_from = [&](index_t n, Range among) // the first whose lowest node is n or a later one
  {
    return among.begin +
           first_element_from<dim>(std::span(mesh_.elements)
                                       .subspan(static_cast<std::size_t>(among.begin),
                                                static_cast<std::size_t>(among.end - among.begin)),
                                   n);
  };
  const Range mine{team_.element_begin(), team_.element_end()};
  std::vector<std::vector<Numbered>> to(static_cast<std::size_t>(ranks().size()));
  for (int r = 0; r < ranks().size(); ++r)
    if (r != me)
    {
      const Range nodes = near(r);
      const index_t end = elements_from(nodes.end, mine);
      for (index_t e = elements_from(nodes.begin, mine); e < end; ++e)
        to[static_cast<std::size_t>(r)].push_back({e, mesh_.elements[static_cast<std::size_t>(e)]});
    }
  elements_here_ = mine;
  for (const auto& part : ranks().exchange(to))
    for (const Numbered& e : part)
    {
      mesh_.elements[static_cast<std::size_t>(e.number)] = e.nodes;
      elements_here_ = {std::min(elements_here_.begin, e.number), std::max(elements_here_.end, e.number + 1)};
    }

  around_.assign(1, own);
  for (index_t k = 0; k < layers; ++k)
  {
    Range wider = around_.back();
    for (index_t e = elements_from(wider.begin - widest, elements_here_),
                 end = elements_from(wider.begin, elements_here_);
         e < end; ++e)
    {
      const auto& nodes = mesh_.elements[static_cast<std::size_t>(e)];
      if (*std::max_element(nodes.begin(), nodes.end()) >= around_.back().begin)
      {
        wider.begin = nodes[0]; // sorted: the lowest
        break;
      }
    }
    for (index_t e = elements_from(around_.back().end - widest, elements_here_),
                 end = std::max(elements_from(around_.back().end, elements_here_), mine.end);
         e < end; ++e)
    {
      const auto& nodes = mesh_.elements[static_cast<std::size_t>(e)];
      wider.end = std::max(wider.end, *std::max_element(nodes.begin(), nodes.end()) + 1);
    }
    around_.push_back(wider);
  }
  taken_.clear();
  for (std::size_t k = 0; k < layers; k += 2)
    taken_.push_back({.elements = {elements_from(around_[k + 1].begin, elements_here_),
                                   std::max(elements_from(around_[k].end, elements_here_), mine.end)},
                      .inner = {elements_from(around_[k].begin, elements_here_),
                                elements_from(around_[k].end - widest, elements_here_)}});
  sweep_steps_ = most_steps_of_ranks;
  const auto others = [&](int steps) // among what so many steps need
  {
    const Range& all = around_[static_cast<std::size_t>(2 * steps)];
    return (all.end - all.begin) - (own.end - own.begin);
  };
  while (sweep_steps_ > 1 && others(sweep_steps_) > worth * static_cast<double>(own.end - own.begin))
    --sweep_steps_;
  sweep_steps_ = most_steps_of_ranks - static_cast<int>(ranks().max(most_steps_of_ranks - sweep_steps_));
  if (sweep_steps_ < 2)
    return;
  const Range widest_range = around_[static_cast<std::size_t>(2 * sweep_steps_)];

  auto boundary = std::move(mesh_.boundary); // of all ranks
  const Range known = near(me);
  find_fans<dim>(mesh_, known.begin, known.end, {}, elements_here_.begin, elements_here_.end);
  mesh_.boundary = std::move(boundary);

  const std::vector<Range> wanted = ranks().gather(std::vector{widest_range});
  const auto common = [&](const Range& nodes, int of)
  {
    std::vector<index_t> list;
    for (index_t n = std::max(nodes.begin, first[static_cast<std::size_t>(of)]);
         n < std::min(nodes.end, first[static_cast<std::size_t>(of) + 1]); ++n)
      list.push_back(n);
    return list;
  };
  std::vector<std::vector<index_t>> send(wanted.size()), receive(wanted.size());
  for (int r = 0; r < ranks().size(); ++r)
    if (r != me)
    {
      send[static_cast<std::size_t>(r)] = common(wanted[static_cast<std::size_t>(r)], me);
      receive[static_cast<std::size_t>(r)] = common(widest_range, r);
    }
  far_halo_ = Halo(ranks(), std::move(send), std::move(receive));
  far_halo_.update(nodes_.h, nodes_.flag);
  for (const auto& list : far_halo_.received())
    for (const index_t n : list)
      sums_.sum[static_cast<std::size_t>(n)] = FourNumbers{};
}

/// How far each block of elements reaches.
template <int dim>
void Fluid<dim>::find_reach_of_blocks()
{
  const Range nodes{mesh_.first_with_fan, mesh_.end_with_fan()};
  index_t known = nodes.begin, moved = nodes.begin, group = 0;
  reach_.assign(static_cast<std::size_t>(elements_here_.end / element_block) + 1, {});
  for (index_t begin = elements_here_.begin; begin <= elements_here_.end;)
  {
    const index_t block = begin / element_block,
                  end = std::min((block + 1) * element_block, elements_here_.end);
    for (index_t e = begin; e < end; ++e)
      for (const index_t n : mesh_.elements[static_cast<std::size_t>(e)])
        known = std::max(known, n + 1);
    const index_t complete = end < elements_here_.end ? mesh_.elements[static_cast<std::size_t>(end)][0] /
                                                            Lanes::size * Lanes::size
                                                      : nodes.end;
    known = round_up(std::max(known, complete), Lanes::size, nodes.end);
    moved = std::max(moved, known);
    for (; nodes.begin + group * Lanes::size < known; ++group)
    {
      const auto& rings = mesh_.rings;
      for (index_t r = rings.begin[static_cast<std::size_t>(group)];
           r < rings.begin[static_cast<std::size_t>(group) + 1]; ++r)
        for (const index_t twice : rings.row[static_cast<std::size_t>(r)])
          moved = std::max(moved, twice / 2 + 1);
    }
    moved = round_up(moved, Walls<dim>::block_size, nodes.end);
    reach_[static_cast<std::size_t>(block)] = {.moved = moved, .known = known, .complete = complete};
    if (end == elements_here_.end)
      break;
    begin = end;
  }
}

template <int dim>
void Fluid<dim>::skew(double dt, int steps)
{
  collected_ = ranks().alone();
  far_halo_.update(nodes_.x, nodes_.v, nodes_.a, nodes_.m, nodes_.M, nodes_.inertia, nodes_.rho, nodes_.p);
  const auto around = [&](int layers) -> const Range&
  { return around_[std::min(static_cast<std::size_t>(layers), around_.size() - 1)]; };
  typename Walls<dim>::Reaction of_others;
  if (!contact_.empty() && !ranks().alone())
  {
    of_others = contact_.no_reaction();
    contact_.surround(nodes_.x, around(2 * steps).begin, around(2 * steps).end);
  }
  std::array<InFlight, most_steps> flight;
  std::array<double, most_steps> times;
  const auto end = flight.begin() + steps;
  for (auto f = flight.begin(); f < end; ++f)
  {
    const auto number = static_cast<std::size_t>(f - flight.begin());
    t_ += dt;
    times[number] = t_;
    f->step = present_step(dt);
    f->step.number = number;
    f->booked = time_to_book(dt);
    dt_before_ = dt;
    ++steps_;
    ++steps_since_remesh_;
    const int left = static_cast<int>(end - f) - 1; // steps after it
    f->gets = around(2 * left);
    f->knows = around(2 * left + 1);
    f->moves = around(2 * left + 2);
    f->taken = taken_[std::min(static_cast<std::size_t>(left), taken_.size() - 1)];
    f->complete = f->gets.begin;
    f->known = f->knows.begin;
    f->moved = f->moves.begin;
    f->element = f->taken.elements.begin;
    f->inner = {.node_begin = f->gets.begin, .node_end = f->gets.end};
    f->at_edge = f->inner;
    f->at_edge.mixed.assign(ranks().alone() ? 0 : reach_.size(), 1);
    f->of_others = &of_others;
  }

  if (!contact_.empty())
    contact_.move_to(std::span(times).first(static_cast<std::size_t>(steps)));

  while (!(end - 1)->done)
  {
    take_block(flight.front(), nodes_.size());
    for (auto f = flight.begin() + 1; f < end; ++f)
      while (take_block(*f, (f - 1)->complete))
        ;
  }

  halo_.update(nodes_.x); // of gaps that it watches
  for (auto f = flight.begin(); f < end; ++f)
  {
    check_state(f->bad);
    const Move move{.dt = dt, .speed = std::sqrt(f->fastest), .of_solid = 0.0};
    if (ranks().alone())
      move_on(move);
    else
      moves_.push_back(move);
  }
}

/// The next block of elements of a step, and all that it takes before and brings about.
/// @param may_move nodes below have completed the step before
/// @returns false if it cannot be done yet, or there is none
template <int dim>
bool Fluid<dim>::take_block(InFlight& f, index_t may_move)
{
  if (f.done)
    return false;
  const index_t e = f.element, block = e / element_block,
                e_end = std::min((block + 1) * element_block, f.taken.elements.end);
  Reach to = reach_[static_cast<std::size_t>(block)];
  if (e_end == f.taken.elements.end) // the last
    to = {.moved = f.moves.end, .known = f.knows.end, .complete = f.gets.end};
  to.moved = std::min(contact_.empty() ? to.moved : contact_.end_of_block(to.moved), f.moves.end);
  if (to.moved > may_move)
    return false;
  move(f, to.moved);
  find_state(f, std::min(to.known, f.knows.end));
  if (e < e_end)
    add_element_forces(f.step, nullptr, e, e_end,
                       e >= f.taken.inner.begin && e_end <= f.taken.inner.end ? f.inner : f.at_edge);
  if (const index_t complete = std::min(to.complete, f.gets.end); f.complete < complete)
  {
    accelerate(f.step, f.complete, complete);
    constrain_accelerations(f.complete, complete);
    kick(f.step.dt, f.complete, complete);
    exchange_mass(f.step, f.booked, f.complete, complete);
    f.complete = complete;
  }
  f.element = e_end;
  f.done = e_end == f.taken.elements.end;
  return true;
}

/// act(begin, end, own) for the nodes [begin, end): those of this rank, those before and those behind them.
template <int dim>
template <class Act>
void Fluid<dim>::split_by_owner(index_t begin, index_t end, Act&& act) const
{
  const std::array<index_t, 4> cuts{begin, std::clamp(team_.node_begin(), begin, end),
                                    std::clamp(team_.node_end(), begin, end), end};
  for (std::size_t k = 0; k < 3; ++k)
    if (cuts[k] < cuts[k + 1])
      act(cuts[k], cuts[k + 1], k == 1);
}

/// Nodes up to `end` move.
template <int dim>
void Fluid<dim>::move(InFlight& f, index_t end)
{
  const double dt = f.step.dt;
  while (f.moved < end)
  {
    const index_t begin = f.moved, block = contact_.empty() ? 0 : contact_.block_of(begin);
    f.moved = std::min(contact_.empty() ? begin + Walls<dim>::block_size : contact_.end_of(block), end);
    kick(dt, begin, f.moved);
    if (!contact_.empty())
      push_off_walls(f.step, block, team_.owns(begin) ? contact_.reaction() : *f.of_others);
    double fastest = 0.0;
    split_by_owner(begin, f.moved,
                   [&](index_t first, index_t last, bool own)
                   {
                     const double here = move_nodes(dt, first, last);
                     fastest = std::max(fastest, here);
                     if (own)
                       f.fastest = std::max(f.fastest, here);
                   });
    if (!contact_.empty())
      contact_.has_moved(block, f.step.number, dt * std::sqrt(fastest), nodes_.x);
  }
}

/// Nodes up to `end` find their state.
template <int dim>
void Fluid<dim>::find_state(InFlight& f, index_t end)
{
  if (f.known >= end)
    return;
  if constexpr (dim == 2)
    update_nodal_volumes(mesh_, f.known, end, nodes_);
  split_by_owner(f.known, end,
                 [&](index_t first, index_t last, bool own)
                 {
                   const index_t bad = update_state(first, last);
                   if (own)
                     f.bad = std::max(f.bad, bad);
                 });
  record_nodes<dim>(nodes_, config_.terms, f.known, end, sums_);
  f.known = end;
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
