// The fluid's part among several ranks: ghosts, what all agree on, and the whole state.
#include "fluid_pfem/fluid.hpp"

#include <algorithm>
#include <numeric>

namespace undine::fluid
{

/// Ghosts are the nodes of other ranks in what this rank computes: elements that it owns, or that touch its
/// nodes, and gaps that it watches. All ranks know the whole mesh, so each makes its lists alone, from the
/// elements that it owns or that touch its nodes: these come before its own.
template <int dim>
void Fluid<dim>::find_ghosts()
{
  if (ranks().alone())
    return;
  const int me = ranks().rank();
  const auto size = static_cast<std::size_t>(ranks().size());
  const auto owner = [](std::span<const index_t> first, index_t k)
  { return static_cast<int>(std::upper_bound(first.begin() + 1, first.end(), k) - first.begin()) - 1; };
  std::vector<std::vector<index_t>> send(size), receive(size);
  const auto need = [&](int rank, index_t n)
  {
    const int of = owner(team_.nodes_of_ranks(), n);
    if (of != rank && rank == me)
      receive[static_cast<std::size_t>(of)].push_back(n);
    if (of == me && rank != me)
      send[static_cast<std::size_t>(rank)].push_back(n);
  };
  std::vector<index_t> near;
  for (const Share& share : team_.shares())
    near.insert(near.end(), share.before.begin(), share.before.end());
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
  halo_ = Halo(ranks(), std::move(send), std::move(receive));
}

/// Some rank says yes. The ranks also agree on how fast nodes have moved.
template <int dim>
bool Fluid<dim>::any_rank(bool yes)
{
  if (ranks().alone())
    return yes;
  std::vector<double> values{yes ? 1.0 : 0.0};
  for (const auto& [dt, speed] : moves_)
    values.push_back(speed);
  ranks().max(values);
  for (std::size_t k = 0; k < moves_.size(); ++k)
    move_on(moves_[k][0], values[k + 1]);
  moves_.clear();
  return values[0] > 0.0;
}

template <int dim>
void Fluid<dim>::collect()
{
  if (collected_)
    return;
  const auto first = team_.nodes_of_ranks();
  const auto rows = [&](auto&... fields) { (ranks().gather_rows(fields, first), ...); };
  rows(nodes_.x, nodes_.v, nodes_.a, nodes_.m, nodes_.M, nodes_.inertia, nodes_.rho, nodes_.p, nodes_.V,
       mass_rate_, exchange_energy_);
  if (!config_.body_force.empty())
  {
    sums_.body.resize(nodes_.x.size());
    rows(sums_.body);
  }
  ranks().gather_rows(sums_.heat, blocks_of_ranks());
  std::vector<ExactSum*> sums = contact_.sums();
  ranks().sum(sums);
  for (ExactSum* sum : sums)
    ranks().rank() == 0 ? sum->normalise() : static_cast<void>(*sum = {});
  any_rank(false);
  turned_over_ = static_cast<int>(ranks().max(turned_over_));
  collected_ = true;
}

/// What became heat, and what moved mass brought, since the last remesh is booked: of all rows, which are
/// right. Collective.
template <int dim>
void Fluid<dim>::cool()
{
  dissipated_ = std::accumulate(sums_.heat.begin(), sums_.heat.end(), dissipated_);
  std::fill(sums_.heat.begin(), sums_.heat.end(), 0.0);
  ExactSum exchanged;
  const auto [begin, end] = rows_of_rank(exchange_energy_.size(), ranks());
  for (std::size_t k = begin; k < end; ++k)
    exchanged.add(exchange_energy_[k]);
  ranks().sum({&exchanged});
  exchanged_ += exchanged.value();
  exchange_energy_.assign(nodes_.x.size(), 0.0);
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
