// Nodes and elements shared out among the threads of a rank.
#pragma once

#include "common/lanes.hpp"
#include "fluid_pfem/fluid_mesh.hpp"

#include <algorithm>
#include <vector>

namespace undine::fluid
{

/// Elements are handled in blocks of so many, numbered from 0, whatever the number of threads: sums over
/// blocks then do not depend on it.
inline constexpr index_t element_block = 1024;

/// What one thread does: it owns nodes and adds to them only. Elements that touch nodes of two owners are
/// computed by both.
struct Share
{
  index_t node_begin = 0, node_end = 0;       ///< its nodes
  index_t element_begin = 0, element_end = 0; ///< its elements: whole blocks
  std::vector<index_t> before; ///< elements of shares before it, in order, by whole groups of eight that
                               ///< touch its nodes: the order in which a node is summed depends on the groups

  bool owns(index_t n) const { return n >= node_begin && n < node_end; }
};

/// The threads of a rank. With one thread nothing is started and nothing is shared.
class Team
{
public:
  explicit Team(int threads = 1) : threads_(threads) {}

  int threads() const { return threads_; }
  const std::vector<Share>& shares() const { return shares_; }
  std::size_t number(const Share& share) const { return static_cast<std::size_t>(&share - shares_.data()); }

  /// Cut nodes and elements into as many shares as there are threads, at ends of blocks.
  template <int dim>
  void share_out(index_t n_nodes, const FluidMesh<dim>& mesh)
  {
    const index_t n = mesh.n_elements(), blocks = (n + element_block - 1) / element_block;
    shares_.resize(static_cast<std::size_t>(threads_));
    for (index_t t = 0; t < threads_; ++t)
    {
      Share& s = shares_[static_cast<std::size_t>(t)];
      const auto cut = [&](index_t k)
      { return std::min(n, static_cast<index_t>(std::int64_t{blocks} * k / threads_ * element_block)); };
      const auto first_node = [&](index_t k)
      {
        return k == 0                         ? 0
               : k == threads_ || cut(k) == n ? n_nodes
                                              : mesh.elements[static_cast<std::size_t>(cut(k))][0];
      };
      s.element_begin = cut(t);
      s.element_end = cut(t + 1);
      s.node_begin = first_node(t);
      s.node_end = first_node(t + 1);
      s.before.clear();
      const auto touches = [&](index_t e)
      {
        const auto& nodes = mesh.elements[static_cast<std::size_t>(e)];
        return std::any_of(nodes.begin(), nodes.end(), [&s](index_t k) { return s.owns(k); });
      };
      for (index_t group = 0; group < s.element_begin; group += Lanes::size)
      {
        bool near = false;
        for (index_t e = group; e < group + Lanes::size && !near; ++e)
          near = touches(e);
        for (index_t e = group; e < group + Lanes::size && near; ++e)
          s.before.push_back(e);
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
  int threads_ = 1;
  std::vector<Share> shares_;
};

/// The elements of a share from `e_begin` on, block by block, and its nodes from `n_begin` on as soon as they
/// have got all they get: add(list, begin, end) with list[k] = k where list is null, then take(n_begin,
/// n_end) while both are in the cache. Elements are sorted by their smallest node.
template <int dim, class Add, class Take>
void sweep(const FluidMesh<dim>& mesh, const Share& share, index_t e_begin, index_t n_begin, Add&& add,
           Take&& take)
{
  const auto count = static_cast<index_t>(share.before.size());
  const auto group_of = [&](index_t k) { return share.before[static_cast<std::size_t>(k)] / Lanes::size; };
  for (auto k = static_cast<index_t>(std::lower_bound(share.before.begin(), share.before.end(), e_begin) -
                                     share.before.begin());
       k < count;)
  {
    index_t next = k + 1;
    while (next < count && group_of(next) == group_of(k))
      ++next;
    add(share.before.data(), k, next);
    k = next;
  }
  index_t done = std::max(share.node_begin, n_begin);
  for (index_t e = std::max(share.element_begin, e_begin); e < share.element_end;)
  {
    const index_t unit = e % Lanes::size == 0 ? element_block : Lanes::size;
    const index_t next = std::min((e / unit + 1) * unit, share.element_end);
    add(static_cast<const index_t*>(nullptr), e, next);
    e = next;
    if (e < share.element_end)
      if (const index_t ready = std::min(mesh.elements[static_cast<std::size_t>(e)][0], share.node_end);
          ready > done)
      {
        take(done, ready);
        done = ready;
      }
  }
  if (done < share.node_end)
    take(done, share.node_end);
}

} // namespace undine::fluid
