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
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/mass_conservation.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace undine::fluid
{

namespace
{

constexpr int most_steps = 8; ///< of one sweep

/// The next multiple of `unit`, but n at most.
index_t round_up(index_t k, index_t unit, index_t n) { return std::min((k + unit - 1) / unit * unit, n); }

} // namespace

/// A step of the sweep, and how far it has come.
template <int dim>
struct Fluid<dim>::InFlight
{
  Step<dim> step;
  double booked = 0.0; ///< as in exchange_mass
  index_t moved = 0, known = 0,
          complete = 0;  ///< first node that has not moved, has no state, waits for forces
  std::size_t block = 0; ///< next block of elements
  double fastest = 0.0;  ///< squared speed of the fastest node [m²/s²]
  index_t bad = -1;      ///< a node whose elements have turned over, or −1
};

template <int dim>
void Fluid<dim>::advance(double dt, std::int64_t steps)
{
  while (steps > 0)
  {
    const int together = static_cast<int>(std::min<std::int64_t>(steps, most_steps));
    if (together > 1 && in_one_sweep(together))
      skew(dt, together);
    else
      for (int k = 0; k < together; ++k)
      {
        predict(dt);
        solve_free_motion(dt);
      }
    steps -= together;
  }
}

template <int dim>
bool Fluid<dim>::in_one_sweep(int steps) const
{
  // Nor may a node be found to be turned over for too long: whoever reads that wants to see its step.
  return dim == 2 && ranks().alone() && team_.threads() == 1 && n_wet_ == 0 && solid_.empty() &&
         forces_are_local() && !contact_.moves() && turned_over_ + steps <= may_be_turned_over;
}

/// How far each block of elements reaches.
template <int dim>
void Fluid<dim>::find_reach()
{
  const index_t n_nodes = nodes_.size(), n_elements = mesh_.n_elements();
  index_t known = 0, moved = 0, group = 0;
  for (index_t begin = 0; begin == 0 || begin < n_elements; begin += element_block)
  {
    const index_t end = std::min(begin + element_block, n_elements);
    for (index_t e = begin; e < end; ++e)
      for (const index_t n : mesh_.elements[static_cast<std::size_t>(e)])
        known = std::max(known, n + 1);
    const index_t complete =
        end < n_elements ? mesh_.elements[static_cast<std::size_t>(end)][0] / Lanes::size * Lanes::size
                         : n_nodes;
    known = round_up(std::max(known, complete), Lanes::size, n_nodes);
    moved = std::max(moved, known);
    for (; group * Lanes::size < known; ++group)
    {
      const auto& rings = mesh_.rings;
      for (index_t r = rings.begin[static_cast<std::size_t>(group)];
           r < rings.begin[static_cast<std::size_t>(group) + 1]; ++r)
        for (const index_t twice : rings.row[static_cast<std::size_t>(r)])
          moved = std::max(moved, twice / 2 + 1);
    }
    moved = round_up(moved, Walls<dim>::block_size, n_nodes);
    reach_.push_back({.moved = moved, .known = known, .complete = complete});
  }
}

template <int dim>
void Fluid<dim>::skew(double dt, int steps)
{
  if (reach_.empty())
    find_reach();
  std::array<InFlight, most_steps> flight;
  const auto end = flight.begin() + steps;
  for (auto f = flight.begin(); f < end; ++f)
  {
    t_ += dt;
    f->step = present_step(dt);
    f->booked = time_to_book(dt);
    dt_before_ = dt;
    ++steps_;
    ++steps_since_remesh_;
  }

  for (auto last = end - 1; last->block < reach_.size();)
  {
    take_block(flight.front(), nodes_.size());
    for (auto f = flight.begin() + 1; f < end; ++f)
      while (take_block(*f, (f - 1)->complete))
        ;
  }

  for (auto f = flight.begin(); f < end; ++f)
  {
    check_state(f->bad);
    move_on({.dt = dt, .speed = std::sqrt(f->fastest), .of_solid = 0.0});
  }
}

/// The next block of elements of a step, and all that it takes before and brings about.
/// @param may_move nodes below have completed the step before
/// @returns false if it cannot be done yet, or there is none
template <int dim>
bool Fluid<dim>::take_block(InFlight& f, index_t may_move)
{
  if (f.block == reach_.size() || reach_[f.block].moved > may_move)
    return false;
  const Reach& reach = reach_[f.block];
  const double dt = f.step.dt;
  for (; f.moved < reach.moved;)
  {
    const index_t begin = f.moved, block = begin / Walls<dim>::block_size;
    f.moved = std::min(begin + Walls<dim>::block_size, reach.moved);
    kick(dt, begin, f.moved);
    if (!contact_.empty())
      push_off_walls(f.step, block, contact_.reaction());
    const double fastest = move_nodes(dt, begin, f.moved);
    if (!contact_.empty())
      contact_.has_moved(block, dt * std::sqrt(fastest), nodes_.x);
    f.fastest = std::max(f.fastest, fastest);
  }
  if (f.known < reach.known)
  {
    if constexpr (dim == 2)
      update_nodal_volumes(mesh_, f.known, reach.known, nodes_);
    f.bad = std::max(f.bad, update_state(f.known, reach.known));
    record_nodes<dim>(nodes_, config_.terms, f.known, reach.known, sums_);
    f.known = reach.known;
  }
  const index_t e = static_cast<index_t>(f.block) * element_block,
                e_end = std::min(e + element_block, mesh_.n_elements());
  if (e < e_end)
    add_element_forces(f.step, nullptr, e, e_end, {.node_begin = 0, .node_end = nodes_.size()});
  if (f.complete < reach.complete)
  {
    accelerate(f.step, f.complete, reach.complete);
    constrain_accelerations(f.complete, reach.complete);
    kick(dt, f.complete, reach.complete);
    exchange_mass(f.step, f.booked, f.complete, reach.complete);
    f.complete = reach.complete;
  }
  ++f.block;
  return true;
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
