// What a sweep of several steps needs to know of a mesh: how far blocks of elements reach, where its threads
// meet, and what of other ranks it takes.
#include "fluid_pfem/fluid.hpp"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>
#include <vector>

namespace undine::fluid
{

namespace
{

constexpr int most_steps_of_several = 4; ///< in one sweep, if there are several ranks or threads
constexpr double worth = 0.1; ///< so many nodes of others, over its own, may a rank take into a sweep

/// The next multiple of `unit`, but n at most.
index_t round_up(index_t k, index_t unit, index_t n) { return std::min((k + unit - 1) / unit * unit, n); }

} // namespace

/// Nothing that acts on nodes needs more than their neighbours.
template <int dim>
bool Fluid<dim>::may_sweep() const
{
  return dim == 2 && n_wet_ == 0 && solid_.empty() && forces_are_local();
}

/// Of this mesh, if it is not found yet. Collective.
template <int dim>
void Fluid<dim>::find_reach()
{
  if (reach_is_found_ || sweep_steps_ < 2)
    return;
  reach_is_found_ = true;
  if (!ranks().alone())
    find_far_halo();
  find_reach_of_blocks();
  if (team_.threads() > 1)
    sweep_steps_ = most_steps - static_cast<int>(ranks().max(most_steps - find_ladders()));
}

/// Of a new mesh, what this rank needs of others for a sweep, and of how many steps one may be. Collective.
template <int dim>
void Fluid<dim>::find_surroundings()
{
  const Range own{team_.node_begin(), team_.node_end()}, mine{team_.element_begin(), team_.element_end()};
  elements_here_ = mine;
  around_.assign(1, own);
  taken_.assign(1, {.elements = mine, .inner = mine});
  sweep_steps_ = may_sweep() && ranks().alone() ? most_steps : 1;
  if (!may_sweep() || ranks().alone())
    return;
  const auto first = team_.nodes_of_ranks();
  const int me = ranks().rank();
  const auto apart = static_cast<index_t>(ranks().max(static_cast<double>(widest<dim>(own_elements()))));
  constexpr index_t layers = 2 * most_steps_of_several;
  const auto near = [&](int r) -> Range // rank r, for sure
  {
    return {std::max(first[static_cast<std::size_t>(r)] - layers * apart, 0) / Lanes::size * Lanes::size,
            std::min(first[static_cast<std::size_t>(r) + 1] + layers * apart, nodes_.size())};
  };
  const bool small = own.end - own.begin <= layers * apart; // what is near may be more than the whole
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
  std::vector<std::vector<Numbered>> to(static_cast<std::size_t>(ranks().size()));
  for (int r = 0; r < ranks().size(); ++r)
    if (r != me)
    {
      const Range nodes = near(r);
      const index_t end = elements_from(nodes.end, mine);
      for (index_t e = elements_from(nodes.begin, mine); e < end; ++e)
        to[static_cast<std::size_t>(r)].push_back({e, mesh_.elements[static_cast<std::size_t>(e)]});
    }
  for (const auto& part : ranks().exchange(std::move(to)))
    for (const Numbered& e : part)
    {
      mesh_.elements[static_cast<std::size_t>(e.number)] = e.nodes;
      elements_here_ = {std::min(elements_here_.begin, e.number), std::max(elements_here_.end, e.number + 1)};
    }

  // A layer shares elements with the layer before; the first has all corners of this rank's elements too.
  // What is in no layer, between the lowest and the highest number of all layers so far, is computed from
  // incomplete neighbours, and nobody reads it.
  const Range known = near(me);
  std::vector<int> layer_of(static_cast<std::size_t>(known.end - known.begin), -1);
  const auto layer = [&](index_t n) -> int& { return layer_of[static_cast<std::size_t>(n - known.begin)]; };
  std::fill(&layer(own.begin), &layer(own.end - 1) + 1, 0);
  around_.assign(1, own);
  for (int k = 1; k <= layers; ++k)
  {
    const Range inside = around_.back();
    Range wider = inside;
    const auto widen = [&](index_t begin, index_t end)
    {
      for (index_t e = begin; e < end; ++e)
      {
        const auto& nodes = mesh_.elements[static_cast<std::size_t>(e)];
        if ((e < mine.begin || e >= mine.end) &&
            std::none_of(nodes.begin(), nodes.end(), [&](index_t n) { return layer(n) == k - 1; }))
          continue;
        for (const index_t n : nodes)
          if (layer(n) < 0)
          {
            layer(n) = k;
            wider = {std::min(wider.begin, n), std::max(wider.end, n + 1)};
          }
      }
    };
    widen(elements_from(inside.begin - apart, elements_here_), elements_from(own.begin, elements_here_));
    widen(elements_from(own.end - apart, elements_here_),
          std::max(elements_from(inside.end, elements_here_), mine.end));
    around_.push_back(wider);
  }
  taken_.clear();
  for (std::size_t k = 0; k < layers; k += 2)
    taken_.push_back({.elements = {elements_from(around_[k + 1].begin, elements_here_),
                                   std::max(elements_from(around_[k].end, elements_here_), mine.end)},
                      .inner = {elements_from(around_[k].begin, elements_here_),
                                elements_from(around_[k].end - apart, elements_here_)}});
  sweep_steps_ = most_steps_of_several;
  const auto others = [&](int steps) // among what so many steps need
  {
    const Range& all = around_[static_cast<std::size_t>(2 * steps)];
    return (all.end - all.begin) - (own.end - own.begin);
  };
  while (sweep_steps_ > 1 && others(sweep_steps_) > worth * static_cast<double>(own.end - own.begin))
    --sweep_steps_;
  sweep_steps_ = most_steps_of_several - static_cast<int>(ranks().max(most_steps_of_several - sweep_steps_));
  if (sweep_steps_ > 1)
    return around_.resize(static_cast<std::size_t>(2 * sweep_steps_ + 1));
  around_.resize(1);
  elements_here_ = mine;
}

/// Elements that touch this rank's nodes, but come before those that lie here in one piece.
template <int dim>
std::span<const index_t> Fluid<dim>::before_elements_here() const
{
  const auto& earlier = team_.earlier();
  return {earlier.begin(), std::lower_bound(earlier.begin(), earlier.end(), elements_here_.begin)};
}

/// Who gets which nodes of others before a sweep. Collective.
template <int dim>
void Fluid<dim>::find_far_halo()
{
  const auto first = team_.nodes_of_ranks();
  const int me = ranks().rank();
  const Range widest_range = around_.back();
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

/// The cuts between the threads of this rank.
/// @returns so many steps they are for: 1 if the nodes of a thread are too few for more
template <int dim>
int Fluid<dim>::find_ladders()
{
  const auto mean = [](const std::vector<Rung>& ladder)
  {
    double sum = 0.0;
    for (const Rung& rung : ladder)
      sum += rung.gets;
    return sum / static_cast<double>(ladder.size());
  };
  // Each thread shall have its share in the mean of the steps.
  const auto ladder_around = [&](index_t middle, int steps)
  {
    std::vector<Rung> best;
    for (index_t begin = middle; begin > team_.node_begin(); begin -= Walls<dim>::block_size)
    {
      std::vector<Rung> ladder = ladder_from(begin, steps);
      const double off = ladder.empty() ? 0.0 : mean(ladder) - middle;
      if (best.empty() || std::abs(off) < std::abs(mean(best) - middle))
        best = std::move(ladder);
      if (off < 0.0)
        break;
    }
    return best;
  };
  const auto& shares = team_.shares();
  for (int steps = std::min(sweep_steps_, most_steps_of_several); steps > 1; --steps)
  {
    ladders_.clear();
    index_t free = team_.node_begin(); // of what the threads below read and write
    for (std::size_t t = 1; t < shares.size(); ++t)
    {
      std::vector<Rung> ladder = ladder_around(shares[t].node_begin, steps);
      if (ladder.empty() || ladder.front().moves <= free)
        break;
      free = ladder.back().exchanges;
      ladders_.push_back(std::move(ladder));
    }
    if (ladders_.size() + 1 == shares.size())
      return steps;
  }
  return 1;
}

/// Rungs for so many steps, the first where nodes from `begin` on move; none if they do not fit.
///
/// With above(n), one behind the last node that shares an element with one below n, in every step
///   knows ≥ above(moves):    all neighbours of nodes whose state the upper thread finds it has moved itself;
///   gets ≥ above(knows):     all elements around nodes that get forces from it have records of its own;
///   exchanges ≥ all corners of elements of the lower thread;
///   moves of the next step ≥ exchanges.
/// So the upper thread needs nothing of the lower one. That one reads places below above(knows) ≤ gets,
/// records and masses below `exchanges`, and the upper thread writes none of these once they are there: in
/// the next step it moves nodes from `exchanges` on, and masses below change only when the elements around
/// them are done, by the lower thread. It comes to all of them, in every step, after the upper thread has
/// published its stair: all forces up to the nodes that it moves in the next step.
template <int dim>
auto Fluid<dim>::ladder_from(index_t begin, int steps) const -> std::vector<Rung>
{
  const auto elements = std::span(mesh_.elements)
                            .subspan(static_cast<std::size_t>(elements_here_.begin),
                                     static_cast<std::size_t>(elements_here_.end - elements_here_.begin));
  const auto element_from = [&](index_t n) // the first whose lowest node is n or a later one
  { return elements_here_.begin + first_element_from<dim>(elements, n); };
  const auto above = [&](index_t n) // all nodes that share an element with one below n, in whole groups
  {
    const index_t e_end = element_from(n), block = e_end / element_block * element_block;
    index_t end =
        block > elements_here_.begin ? reach_[static_cast<std::size_t>(block / element_block - 1)].known : n;
    for (index_t e = std::max(block, elements_here_.begin); e < e_end; ++e)
      for (const index_t k : mesh_.elements[static_cast<std::size_t>(e)])
        end = std::max(end, k + 1);
    return round_up(std::max(end, n), Lanes::size, team_.node_end());
  };
  std::vector<Rung> ladder;
  for (index_t free = begin; std::ssize(ladder) < steps; free = ladder.back().exchanges)
  {
    Rung rung;
    rung.moves = contact_.empty() ? free : contact_.end_of_block(free);
    rung.knows = above(rung.moves);
    const index_t gets = above(rung.knows);
    rung.element = round_up(element_from(gets), element_block, team_.element_end());
    if (rung.element == team_.element_end())
      return {};
    rung.gets = mesh_.elements[static_cast<std::size_t>(rung.element)][0] / Lanes::size * Lanes::size;
    rung.exchanges =
        std::max(rung.gets, reach_[static_cast<std::size_t>(rung.element / element_block - 1)].known);
    for (index_t e = element_from(rung.knows); e < rung.element; ++e)
    {
      const auto& nodes = mesh_.elements[static_cast<std::size_t>(e)];
      if (*std::max_element(nodes.begin(), nodes.end()) >= rung.gets)
        rung.earlier.push_back(e);
    }
    rung.inner_end =
        rung.earlier.empty() ? rung.element : rung.earlier.front() / element_block * element_block;
    ladder.push_back(std::move(rung));
  }
  return ladder;
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
