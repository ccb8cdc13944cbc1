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
// The threads of a rank sweep at once, each over nodes of its own. Between two of them is a ladder: the cut
// rises from step to step by so many nodes that the upper thread needs nothing of the lower one, and does not
// overwrite in one step what the lower one still has to read of the step before. So the nodes between two
// rungs get their first steps from the upper thread, which makes them first, and their last from the lower
// one, which comes there last: it waits for the upper one, but seldom has to.
//
// On several ranks each gets the nodes around its own, as many neighbours of neighbours as the steps need,
// and makes the first steps of those itself: two layers fewer with each step. Ranks then meet once in a
// sweep.
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/mass_conservation.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <span>
#include <thread>

namespace undine::fluid
{

/// A step of the sweep of one thread, and how far it has come.
template <int dim>
struct Fluid<dim>::InFlight
{
  Step<dim> step;
  double booked = 0.0; ///< as in exchange_mass
  /// Nodes that move in it, find their state, get their forces, exchange mass: each those that have not yet.
  Range moves, knows, gets, exchanges;
  Taken taken;         ///< elements
  index_t element = 0; ///< next one
  bool done = false;
  double fastest = 0.0; ///< squared speed of the fastest node of this rank [m²/s²]
  index_t bad = -1;     ///< a node of this rank whose elements have turned over, or −1
  ShapeLook look;       ///< in the last step
  Share inner, at_edge; ///< who gets forces: where all corners do, and where not
  const std::vector<index_t>* earlier = nullptr; ///< elements before its own that touch its nodes
  index_t stair = 0; ///< the thread below waits until all before this node have their forces
};

/// One thread of a sweep.
template <int dim>
struct Fluid<dim>::SweepOfThread
{
  std::array<InFlight, most_steps> flight;
  typename Walls<dim>::Reaction reaction, of_others; ///< of walls on nodes of this rank, and of other ranks
  const SweepOfThread* above = nullptr;              ///< has the nodes behind its own
  alignas(64) std::atomic<std::size_t> stairs =
      0; ///< so many steps have come as far as the thread below waits for

  /// For what is needed of step `number` at the upper end.
  void wait_for_stair(std::size_t number) const
  {
    for (int turn = 0; above->stairs.load(std::memory_order_acquire) <= number; ++turn)
      if (turn > 1000) // the core may be needed for the other one
        std::this_thread::yield();
  }
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
  if (steps < 2 || !may_sweep())
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

template <int dim>
void Fluid<dim>::skew(double dt, int steps)
{
  collected_ = ranks().alone();
  far_halo_.update(nodes_.x, nodes_.v, nodes_.a, nodes_.m, nodes_.M, nodes_.inertia, nodes_.rho, nodes_.p);
  if (!contact_.empty() && !ranks().alone())
  {
    const Range& all = around_[static_cast<std::size_t>(2 * steps)];
    contact_.surround(nodes_.x, all.begin, all.end);
  }
  std::vector<SweepOfThread> threads(static_cast<std::size_t>(team_.threads()));
  std::array<double, most_steps> times;
  for (int number = 0; number < steps; ++number)
  {
    t_ += dt;
    times[static_cast<std::size_t>(number)] = t_;
    Step<dim> step = present_step(dt);
    step.number = static_cast<std::size_t>(number);
    const double booked = time_to_book(dt);
    dt_before_ = dt;
    ++steps_;
    ++steps_since_remesh_;
    for (std::size_t t = 0; t < threads.size(); ++t)
      threads[t].flight[step.number] = in_flight(step, booked, t, steps);
  }
  for (std::size_t t = 0; t < threads.size(); ++t)
  {
    threads[t].reaction = threads[t].of_others = contact_.no_reaction();
    threads[t].above = t + 1 < threads.size() ? &threads[t + 1] : nullptr;
  }
  if (!contact_.empty())
    contact_.move_to(std::span(times).first(static_cast<std::size_t>(steps)));

  team_.each([&](const Share& share) { sweep_nodes(threads[team_.number(share)], steps); });

  halo_.update(nodes_.x); // of gaps that it watches
  for (const SweepOfThread& thread : threads)
    contact_.reaction() += thread.reaction;
  for (std::size_t number = 0; number < static_cast<std::size_t>(steps); ++number)
  {
    index_t bad = -1;
    double fastest = 0.0;
    for (const SweepOfThread& thread : threads)
    {
      bad = std::max(bad, thread.flight[number].bad);
      fastest = std::max(fastest, thread.flight[number].fastest);
    }
    check_state(bad);
    if (std::all_of(threads.begin(), threads.end(),
                    [&](const SweepOfThread& thread) { return thread.flight[number].look.good; }))
      good_at_ = steps_; // the last of these steps
    const Move move{.dt = dt, .speed = std::sqrt(fastest), .of_solid = 0.0};
    if (ranks().alone())
      move_on(move);
    else
      moves_.push_back(move);
  }
}

/// What thread t of this rank does in one of so many steps.
template <int dim>
auto Fluid<dim>::in_flight(const Step<dim>& step, double booked, std::size_t t, int steps) const -> InFlight
{
  const auto left = static_cast<std::size_t>(steps - 1) - step.number; // steps after it
  const auto around = [&](std::size_t layers) { return around_[std::min(layers, around_.size() - 1)]; };
  InFlight f{.step = step,
             .booked = booked,
             .moves = around(2 * left + 2),
             .knows = around(2 * left + 1),
             .gets = around(2 * left),
             .exchanges = around(2 * left),
             .taken = taken_[std::min(left, taken_.size() - 1)],
             .look = {.before = quality_, .limit = config_.remesh.quality, .good = left == 0}};
  // Of a ladder for more steps those in its middle.
  const auto rung = [&](std::size_t ladder) -> const Rung&
  { return ladders_[ladder][step.number + (ladders_[ladder].size() - static_cast<std::size_t>(steps)) / 2]; };
  if (t > 0)
  {
    const Rung& lower = rung(t - 1);
    f.moves.begin = lower.moves;
    f.knows.begin = lower.knows;
    f.gets.begin = lower.gets;
    f.exchanges.begin = lower.exchanges;
    f.taken.elements.begin = f.taken.inner.begin = lower.element;
    f.earlier = &lower.earlier;
    f.stair = left > 0 ? (&lower + 1)->moves : lower.exchanges;
  }
  if (t < ladders_.size())
  {
    const Rung& upper = rung(t);
    f.moves.end = upper.moves;
    f.knows.end = upper.knows;
    f.gets.end = upper.gets;
    f.exchanges.end = upper.exchanges;
    f.taken.elements.end = upper.element;
    f.taken.inner.end = upper.inner_end;
  }
  f.element = f.taken.elements.begin;
  f.inner = {.node_begin = f.gets.begin, .node_end = f.gets.end};
  f.at_edge = f.inner;
  f.at_edge.all_mixed = true;
  return f;
}

template <int dim>
void Fluid<dim>::sweep_nodes(SweepOfThread& thread, int steps)
{
  const auto begin = thread.flight.begin(), end = begin + steps;
  while (!(end - 1)->done)
  {
    take_block(thread, *begin, nodes_.size());
    for (auto f = begin + 1; f < end; ++f)
      while (take_block(thread, *f, (f - 1)->done ? nodes_.size() : (f - 1)->gets.begin))
        ;
  }
}

/// The next block of elements of a step, and all that it takes before and brings about.
/// @param may_move nodes below have completed the step before
/// @returns false if it cannot be done yet, or there is none
template <int dim>
bool Fluid<dim>::take_block(SweepOfThread& thread, InFlight& f, index_t may_move)
{
  if (f.done)
    return false;
  const index_t e = f.element, block = e / element_block,
                e_end = std::min((block + 1) * element_block, f.taken.elements.end);
  const bool last = e_end == f.taken.elements.end;
  Reach to = reach_[static_cast<std::size_t>(block)];
  if (last)
    to = {.moved = f.moves.end, .known = f.knows.end, .complete = f.gets.end};
  to.moved = contact_.empty() ? to.moved : contact_.end_of_block(to.moved);
  if (std::min(to.moved, f.moves.end) > may_move)
    return false;
  if (thread.above != nullptr && (last || to.moved > f.moves.end))
    thread.wait_for_stair(f.step.number);
  move(thread, f, std::min(to.moved, f.moves.end));
  find_state(f, std::min(to.known, f.knows.end));
  if (f.earlier != nullptr && e == f.taken.elements.begin)
    add_element_forces(f.step, f.earlier->data(), 0, static_cast<index_t>(f.earlier->size()), f.at_edge);
  if (e < e_end)
    add_element_forces(f.step, nullptr, e, e_end,
                       e >= f.taken.inner.begin && e_end <= f.taken.inner.end ? f.inner : f.at_edge,
                       f.look.good ? &f.look : nullptr);
  if (const index_t end = std::min(to.complete, f.gets.end); f.gets.begin < end)
  {
    accelerate(f.step, f.gets.begin, end);
    constrain_accelerations(f.gets.begin, end);
    kick(f.step.dt, f.gets.begin, end);
    f.gets.begin = end;
  }
  if (const index_t end = last ? f.exchanges.end : f.gets.begin; f.exchanges.begin < end)
  {
    exchange_mass(f.step, f.booked, f.exchanges.begin, end);
    f.exchanges.begin = end;
  }
  if (f.earlier != nullptr && f.gets.begin >= f.stair &&
      thread.stairs.load(std::memory_order_relaxed) == f.step.number)
    thread.stairs.store(f.step.number + 1, std::memory_order_release);
  f.element = e_end;
  f.done = last;
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
void Fluid<dim>::move(SweepOfThread& thread, InFlight& f, index_t end)
{
  const double dt = f.step.dt;
  while (f.moves.begin < end)
  {
    const index_t begin = f.moves.begin, block = contact_.empty() ? 0 : contact_.block_of(begin),
                  next = std::min(contact_.empty() ? begin + Walls<dim>::block_size : contact_.end_of(block),
                                  end);
    const bool touches = !contact_.empty() && contact_.has_candidates(block);
    if (touches)
    {
      kick(dt, begin, next);
      push_off_walls(f.step, block, team_.owns(begin) ? thread.reaction : thread.of_others);
    }
    double fastest = 0.0;
    split_by_owner(begin, next,
                   [&](index_t first, index_t last, bool own)
                   {
                     const double here =
                         touches ? move_nodes<false>(dt, first, last) : move_nodes<true>(dt, first, last);
                     fastest = std::max(fastest, here);
                     if (own)
                       f.fastest = std::max(f.fastest, here);
                   });
    if (!contact_.empty())
      contact_.has_moved(block, f.step.number, dt * std::sqrt(fastest), nodes_.x);
    f.moves.begin = next;
  }
}

/// Nodes up to `end` find their state.
template <int dim>
void Fluid<dim>::find_state(InFlight& f, index_t end)
{
  if (f.knows.begin >= end)
    return;
  if constexpr (dim == 2)
    update_nodal_volumes(mesh_, f.knows.begin, end, nodes_);
  split_by_owner(f.knows.begin, end,
                 [&](index_t first, index_t last, bool own)
                 {
                   const index_t bad = update_state(first, last);
                   if (own)
                     f.bad = std::max(f.bad, bad);
                 });
  record_nodes<dim>(nodes_, config_.terms, f.knows.begin, end, sums_);
  f.knows.begin = end;
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
