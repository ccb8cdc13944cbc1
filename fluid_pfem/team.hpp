// Nodes and elements shared out among the ranks, and among the threads of each.
#pragma once

#include "common/lanes.hpp"
#include "common/parallel/ranks.hpp"
#include "fluid_pfem/fluid_mesh.hpp"

#include <algorithm>
#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

namespace undine::fluid
{

/// Elements are handled in blocks of so many, numbered from 0, whatever the number of ranks and threads: sums
/// over blocks then do not depend on it.
inline constexpr index_t element_block = 256;

/// The rank that has item k, where that of rank r begins at first[r].
inline int owner(std::span<const index_t> first, index_t k)
{
  return static_cast<int>(std::upper_bound(first.begin() + 1, first.end(), k) - first.begin()) - 1;
}

/// What one thread of one rank does: it owns nodes and adds to them only. Elements that touch nodes of two
/// owners are computed by both.
struct Share
{
  index_t node_begin = 0, node_end = 0;       ///< its nodes
  index_t element_begin = 0, element_end = 0; ///< its elements: whole blocks
  std::vector<index_t> before;                ///< elements of shares before it that touch its nodes, in order

  std::vector<char> mixed; ///< per block of its elements: has a corner that is another's; empty: none has
  bool all_mixed = false;  ///< any block may have

  bool owns(index_t n) const { return n >= node_begin && n < node_end; }
  /// Every corner of elements begin, … of one of its blocks is its own; of a list they may be anybody's.
  bool owns_corners(const index_t* list, index_t begin) const
  {
    return list == nullptr && !all_mixed &&
           (mixed.empty() || !mixed[static_cast<std::size_t>((begin - element_begin) / element_block)]);
  }
};

/// First block of elements of share k of so many: 0 for k = 0, all blocks for k = shares, and never falling.
/// All ranks must give the same answers, however uneven.
using Cut = std::function<index_t(index_t blocks, index_t k, index_t shares)>;

/// Shares that differ by a block at most.
inline index_t even_cut(index_t blocks, index_t k, index_t shares)
{
  return static_cast<index_t>(std::int64_t{blocks} * k / shares);
}

/// The threads of a rank, and its part among the ranks: ranges of nodes and elements in their order, so that
/// every sum over the elements of a node has the order that it has on one rank. With one thread nothing is
/// started and nothing is shared.
class Team
{
public:
  explicit Team(int threads = 1, Ranks ranks = {}, Cut cut = even_cut)
      : ranks_(std::move(ranks)), threads_(threads), cut_(std::move(cut))
  {
  }

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

  /// Elements of other ranks that touch nodes of this one, in order: all come before its own.
  const std::vector<index_t>& earlier() const { return earlier_; }

  /// First of n elements for every share, as many as there are threads on all ranks, and n: cut at ends of
  /// blocks.
  std::vector<index_t> cut_elements(index_t n) const
  {
    const index_t blocks = (n + element_block - 1) / element_block, parts = ranks_.size() * threads_;
    std::vector<index_t> first;
    for (index_t k = 0; k <= parts; ++k)
      first.push_back(std::min(n, cut_(blocks, k, parts) * element_block));
    return first;
  }

  /// Take up shares that begin with these elements and nodes.
  /// @param element of cut_elements
  /// @param node the lowest one of each of these elements, but 0 for the first, and for all that begin at the
  /// end the number of nodes
  void share_out(std::span<const index_t> element, std::span<const index_t> node)
  {
    nodes_of_ranks_.clear();
    elements_of_ranks_.clear();
    for (std::size_t k = 0; k < element.size(); k += static_cast<std::size_t>(threads_))
    {
      nodes_of_ranks_.push_back(node[k]);
      elements_of_ranks_.push_back(element[k]);
    }
    shares_.assign(static_cast<std::size_t>(threads_), {});
    for (std::size_t t = 0; t < shares_.size(); ++t)
    {
      const std::size_t k = static_cast<std::size_t>(ranks_.rank()) * shares_.size() + t;
      shares_[t] = {.node_begin = node[k],
                    .node_end = node[k + 1],
                    .element_begin = element[k],
                    .element_end = element[k + 1]};
    }
  }

  /// Then, with the elements of this rank and those that touch its nodes in their places: which elements
  /// belong to several shares.
  /// @param earlier elements of other ranks that touch nodes of this one, in order
  template <int dim>
  void find_shared(const FluidMesh<dim>& mesh, std::vector<index_t> earlier)
  {
    earlier_ = std::move(earlier);
    for (Share& s : shares_)
    {
      const auto note = [&](index_t e)
      {
        const auto& nodes = mesh.elements[static_cast<std::size_t>(e)];
        if (std::any_of(nodes.begin(), nodes.end(), [&s](index_t k) { return s.owns(k); }))
          s.before.push_back(e);
      };
      std::for_each(earlier_.begin(), earlier_.end(), note);
      for (index_t e = element_begin(); e < s.element_begin; ++e)
        note(e);
      const bool one = ranks_.alone() && threads_ == 1;
      for (index_t block = s.element_begin; block < s.element_end && !one; block += element_block)
      {
        bool mixed = false;
        for (index_t e = block; e < std::min(block + element_block, s.element_end) && !mixed; ++e)
          for (const index_t k : mesh.elements[static_cast<std::size_t>(e)])
            mixed = mixed || !s.owns(k);
        s.mixed.push_back(mixed);
      }
    }
  }

  /// The same for a rank that has the whole mesh.
  template <int dim>
  void share_out(index_t n_nodes, const FluidMesh<dim>& mesh)
  {
    const std::vector<index_t> element = cut_elements(mesh.n_elements());
    std::vector<index_t> node;
    for (const index_t e : element)
      node.push_back(e == mesh.n_elements() ? n_nodes : mesh.elements[static_cast<std::size_t>(e)][0]);
    node.front() = 0;
    share_out(element, node);
    find_shared(mesh, {});
  }

  /// act(share) for all shares at once; they have ended on return. No exception may leave `act`. One share
  /// may wait for a later one: those begin first, should there be fewer threads than shares.
  template <class Act>
  void each(Act&& act) const
  {
    if (threads_ == 1)
      return act(shares_.front());
#pragma omp parallel for num_threads(threads_) schedule(static, 1)
    for (int t = 0; t < threads_; ++t)
      act(shares_[static_cast<std::size_t>(threads_ - 1 - t)]);
  }

private:
  Ranks ranks_;
  int threads_ = 1;
  Cut cut_;
  std::vector<Share> shares_;
  std::vector<index_t> nodes_of_ranks_, elements_of_ranks_, earlier_;
};

/// The elements of a share from `e_begin` on, block by block, and its nodes from `n_begin` on as soon as they
/// have got all they get: add(list, begin, end) with list[k] = k where list is null, then take(n_begin,
/// n_end) while both are in the cache. Elements are sorted by their smallest node.
/// @param done elements before e_begin were added already (on ranks that have nodes of the interface)
template <int dim, class Add, class Take>
void sweep(const FluidMesh<dim>& mesh, const Share& share, bool done, index_t e_begin, index_t n_begin,
           Add&& add, Take&& take)
{
  const auto first =
      done ? std::lower_bound(share.before.begin(), share.before.end(), e_begin) : share.before.begin();
  if (first != share.before.end())
    add(share.before.data(), static_cast<index_t>(first - share.before.begin()),
        static_cast<index_t>(share.before.size()));
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
