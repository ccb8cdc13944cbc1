// Which nodes of the solid this rank computes, and how it hears of the others.
#pragma once

#include "common/io/row_file.hpp"
#include "common/parallel/halo.hpp"
#include "common/parallel/ranks.hpp"
#include "common/types.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace undine::solid
{

/// All ranks number the nodes alike and have room for all of them. A rank computes the rows of its own nodes
/// and holds copies (ghosts) of the others that its elements touch; rows of all other nodes are out of date
/// until they are collected. By default all nodes belong to the only rank.
class NodeShare
{
public:
  NodeShare() = default;
  /// The only rank.
  explicit NodeShare(std::size_t n) : own_{{0, n}}, held_{{0, n}} {}
  /// owner: rank of each node; held: nodes of this rank and those that its elements touch. Collective.
  NodeShare(const Ranks& ranks, std::vector<int> owner, const std::vector<char>& held)
      : ranks_(ranks), owner_(std::move(owner)),
        own_(ranges([this](std::size_t n) { return owner_[n] == ranks_.rank(); })),
        held_(ranges([&held](std::size_t n) { return held[n] != 0; }))
  {
    std::vector<std::vector<index_t>> receive(static_cast<std::size_t>(ranks.size()));
    for (std::size_t n = 0; n < owner_.size(); ++n)
      if (held[n] && !owns(n))
        receive[static_cast<std::size_t>(owner_[n])].push_back(static_cast<index_t>(n));
    auto send = ranks.exchange(receive);
    halo_ = Halo(ranks, std::move(send), std::move(receive));
  }

  const Ranks& ranks() const { return ranks_; }
  bool is_first() const { return ranks_.rank() == 0; }
  const Halo& halo() const { return halo_; }
  Halo& halo() { return halo_; }
  const std::vector<int>& owner() const { return owner_; } ///< of each node; empty on the only rank
  bool owns(std::size_t n) const { return owner_.empty() || owner_[n] == ranks_.rank(); }
  std::size_t n_own() const
  {
    std::size_t count = 0;
    for (const auto& [first, last] : own_)
      count += last - first;
    return count;
  }

  /// This rank's nodes as rows of a field, of which there are `n`: of all nodes, or of the first.
  std::vector<RowRun> own_rows(std::size_t n) const
  {
    std::vector<RowRun> rows;
    for (const auto& [first, last] : own_)
      if (first < n)
        rows.push_back({first, first, std::min(last, n) - first});
    return rows;
  }

  /// visit(n) for this rank's nodes from `begin` to `end` − 1, in order.
  template <class Visit>
  void for_own(std::size_t begin, std::size_t end, Visit&& visit) const
  {
    for (const auto& [first, last] : own_)
      for (std::size_t n = std::max(first, begin), stop = std::min(last, end); n < stop; ++n)
        visit(n);
  }
  template <class Visit>
  void for_own(Visit&& visit) const
  {
    for (const auto& [first, last] : own_)
      for (std::size_t n = first; n < last; ++n)
        visit(n);
  }
  /// Rows of this rank's nodes and ghosts become zero; `field` may be empty.
  template <class T>
  void clear(std::vector<T>& field) const
  {
    if (!field.empty())
      for (const auto& [first, last] : held_)
        std::fill(field.begin() + static_cast<std::ptrdiff_t>(first),
                  field.begin() + static_cast<std::ptrdiff_t>(last), T{});
  }

  /// Every row gets the numbers of its owner: `width` items per row of `rows`; owners of nodes if `owner` is
  /// not given. Collective.
  template <class T>
  void collect(std::vector<T>& rows, std::span<const int> owner, std::size_t width = 1) const
  {
    if (ranks_.alone())
      return;
    std::vector<T> mine;
    for (std::size_t k = 0; k < owner.size(); ++k)
      if (owner[k] == ranks_.rank())
        for (std::size_t j = 0; j < width; ++j)
          mine.push_back(rows[k * width + j]);
    std::vector<std::size_t> counts;
    const auto all = ranks_.gather(mine, &counts);
    std::vector<std::size_t> at(counts.size(), 0);
    for (std::size_t r = 1; r < at.size(); ++r)
      at[r] = at[r - 1] + counts[r - 1];
    for (std::size_t k = 0; k < owner.size(); ++k)
      for (std::size_t j = 0; j < width; ++j)
        rows[k * width + j] = all[at[static_cast<std::size_t>(owner[k])]++];
  }
  template <class T>
  void collect(std::vector<T>& field) const
  {
    if (!field.empty())
      collect(field, owner_);
  }

private:
  using Range = std::array<std::size_t, 2>;
  template <class Belongs>
  std::vector<Range> ranges(Belongs&& belongs) const
  {
    std::vector<Range> found;
    for (std::size_t n = 0; n < owner_.size(); ++n)
      if (belongs(n))
      {
        if (!found.empty() && found.back()[1] == n)
          ++found.back()[1];
        else
          found.push_back({n, n + 1});
      }
    return found;
  }

  Ranks ranks_;
  std::vector<int> owner_;
  std::vector<Range> own_, held_;
  Halo halo_;
};

} // namespace undine::solid
