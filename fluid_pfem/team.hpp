// Nodes and elements shared out among the ranks, and among the threads of each.
#pragma once

#include "common/lanes.hpp"
#include "common/parallel/ranks.hpp"
#include "fluid_pfem/fluid_mesh.hpp"

#include <algorithm>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace undine::fluid
{

/// Elements are handled in blocks of so many, numbered from 0, whatever the number of ranks and threads: sums
/// over blocks then do not depend on it.
inline constexpr index_t element_block = 256;

/// What one thread of one rank does: it owns nodes and adds to them only. Elements that touch nodes of two
/// owners are computed by both.
struct Share
{
  index_t node_begin = 0, node_end = 0;       ///< its nodes
  index_t element_begin = 0, element_end = 0; ///< its elements: whole blocks
  std::vector<index_t> before; ///< elements of shares before it, in order, by whole groups of eight that
                               ///< touch its nodes: the order in which a node is summed depends on the groups

  std::vector<char> mixed; ///< per block of its elements: has a corner that is another's; empty: none has

  bool owns(index_t n) const { return n >= node_begin && n < node_end; }
  /// Every corner of elements begin, … of one of its blocks is its own; of a list they may be anybody's.
  bool owns_corners(const index_t* list, index_t begin) const
  {
    return list == nullptr &&
           (mixed.empty() || !mixed[static_cast<std::size_t>((begin - element_begin) / element_block)]);
  }
};

/// The threads of a rank, and its part among the ranks: ranges of nodes and elements in their order, so that
/// every sum over the elements of a node has the order that it has on one rank. With one thread nothing is
/// started and nothing is shared.
class Team
{
public:
  explicit Team(int threads = 1, Ranks ranks = {}) : ranks_(std::move(ranks)), threads_(threads) {}

  const Ranks& ranks() const { return ranks_; }
  /// The rank's part of the nodes and of the elements, all threads together.
  index_t node_begin() const { return shares_.front().node_begin; }
  index_t node_end() const { return shares_.back().node_end; }
  index_t element_begin() const { return shares_.front().element_begin; }
  index_t element_end() const { return shares_.back().element_end; }
  bool owns(index_t n) const { return n >= node_begin() && n < node_end(); }
  /// First node (element) of every rank, and the number of nodes (elements).
  std::span<const index_t> nodes_of_ranks() const { return nodes_of_ranks_; }
  std::span<const index_t> elements_of_ranks() const { return elements_of_ranks_; }

  int threads() const { return threads_; }
  const std::vector<Share>& shares() const { return shares_; }
  std::size_t number(const Share& share) const { return static_cast<std::size_t>(&share - shares_.data()); }

  /// Cut nodes and elements into as many shares as there are threads on all ranks, at ends of blocks.
  /// @param e_interface elements before this one are the interface's: rank 0 has them all
  template <int dim>
  void share_out(index_t n_nodes, const FluidMesh<dim>& mesh, index_t e_interface)
  {
    const auto blocks_of = [](index_t elements) { return (elements + element_block - 1) / element_block; };
    const index_t n = mesh.n_elements(), blocks = blocks_of(n), parts = ranks_.size() * threads_;
    const auto part = [](index_t whole, index_t k, index_t of)
    { return static_cast<index_t>(std::int64_t{whole} * k / of); };
    const index_t of_first_rank = std::max(blocks_of(e_interface), part(blocks, threads_, parts));
    const auto cut = [&](index_t k)
    {
      const index_t block =
          k >= parts     ? blocks
          : k < threads_ ? part(of_first_rank, k, threads_)
                         : of_first_rank + part(blocks - of_first_rank, k - threads_, parts - threads_);
      return std::min(n, block * element_block);
    };
    const auto first_node = [&](index_t k)
    {
      return k == 0                      ? 0
             : k == parts || cut(k) == n ? n_nodes
                                         : mesh.elements[static_cast<std::size_t>(cut(k))][0];
    };
    nodes_of_ranks_.clear();
    elements_of_ranks_.clear();
    for (index_t k = 0; k <= parts; k += threads_)
    {
      nodes_of_ranks_.push_back(first_node(k));
      elements_of_ranks_.push_back(cut(k));
    }
    shares_.resize(static_cast<std::size_t>(threads_));
    for (index_t t = 0; t < threads_; ++t)
    {
      Share& s = shares_[static_cast<std::size_t>(t)];
      const index_t k = ranks_.rank() * threads_ + t;
      s.element_begin = cut(k);
      s.element_end = cut(k + 1);
      s.node_begin = first_node(k);
      s.node_end = first_node(k + 1);
      s.before.clear();
      s.mixed.clear();
      const auto touches = [&](index_t e)
      {
        const auto& nodes = mesh.elements[static_cast<std::size_t>(e)];
        return std::any_of(nodes.begin(), nodes.end(), [&s](index_t k) { return s.owns(k); });
      };
      for (index_t group = 0; group < s.element_begin; group += Lanes::size)
      {
        const index_t end = std::min(group + Lanes::size, s.element_begin); // all, where a rank has none
        bool near = false;
        for (index_t e = group; e < end && !near; ++e)
          near = touches(e);
        for (index_t e = group; e < end && near; ++e)
          s.before.push_back(e);
      }
      for (index_t block = s.element_begin; block < s.element_end && parts > 1; block += element_block)
      {
        bool mixed = false;
        for (index_t e = block; e < std::min(block + element_block, s.element_end) && !mixed; ++e)
          for (const index_t k : mesh.elements[static_cast<std::size_t>(e)])
            mixed = mixed || !s.owns(k);
        s.mixed.push_back(mixed);
      }
    }
  }

  /// act(share) for all shares at once; they have ended on return. No exception may leave `act`.
  template <class Act>
  void each(Act&& act) const
  {
    if (threads_ == 1)
      return act(shares_.front());
#pragma omp parallel for num_threads(threads_) schedule(static, 1)
    for (int t = 0; t < threads_; ++t)
      act(shares_[static_cast<std::size_t>(t)]);
  }

private:
  Ranks ranks_;
  int threads_ = 1;
  std::vector<Share> shares_;
  std::vector<index_t> nodes_of_ranks_, elements_of_ranks_;
};

/// The elements of a share from `e_begin` on, block by block, and its nodes from `n_begin` on as soon as they
/// have got all they get: add(list, begin, end) with list[k] = k where list is null, then take(n_begin,
/// n_end) while both are in the cache. Elements are sorted by their smallest node.
/// @param done elements before e_begin were added already (on the rank that has the interface)
template <int dim, class Add, class Take>
void sweep(const FluidMesh<dim>& mesh, const Share& share, bool done, index_t e_begin, index_t n_begin,
           Add&& add, Take&& take)
{
  const auto count = static_cast<index_t>(share.before.size());
  const auto element = [&](index_t k) { return share.before[static_cast<std::size_t>(k)]; };
  const auto together = [&](index_t k, index_t l) // groups of eight end at e_begin
  {
    return element(k) / Lanes::size == element(l) / Lanes::size &&
           (element(k) < e_begin) == (element(l) < e_begin);
  };
  const auto first =
      done ? std::lower_bound(share.before.begin(), share.before.end(), e_begin) : share.before.begin();
  for (auto k = static_cast<index_t>(first - share.before.begin()); k < count;)
  {
    index_t next = k + 1;
    while (next < count && together(next, k))
      ++next;
    add(share.before.data(), k, next);
    k = next;
  }
  index_t taken = std::max(share.node_begin, n_begin);
  for (index_t e = std::max(share.element_begin, e_begin); e < share.element_end;)
  {
    const index_t unit = e % Lanes::size == 0 ? element_block : Lanes::size;
    const index_t next = std::min((e / unit + 1) * unit, share.element_end);
    add(static_cast<const index_t*>(nullptr), e, next);
    e = next;
    if (e < share.element_end)
      if (const index_t ready = std::min(mesh.elements[static_cast<std::size_t>(e)][0], share.node_end);
          ready > taken)
      {
        take(taken, ready);
        taken = ready;
      }
  }
  if (taken < share.node_end)
    take(taken, share.node_end);
}

} // namespace undine::fluid
