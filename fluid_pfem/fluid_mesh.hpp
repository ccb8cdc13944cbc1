// Connectivity of the fluid between two remeshes: simplices, boundary facets and the fan of elements around
// every node.
#pragma once

#include "common/lanes.hpp"
#include "common/parallel/ranks.hpp"
#include "common/parallel/untouched_rows.hpp"
#include "common/tensor.hpp"
#include "common/types.hpp"
#include "fluid_pfem/period.hpp"

#include <algorithm>
#include <array>
#include <span>
#include <vector>

namespace undine::fluid
{

template <int dim>
using Simplex = std::array<index_t, dim + 1>;

template <int dim>
using Facet = std::array<index_t, dim>;

/// Positions of the corners of a simplex, in a periodic space the images next to the first.
template <int dim>
std::array<Vec<dim>, dim + 1> corners(std::span<const Vec<dim>> x, const Simplex<dim>& e,
                                      const Period<dim>& period)
{
  std::array<Vec<dim>, dim + 1> corner;
  for (std::size_t a = 0; a < corner.size(); ++a)
    corner[a] = x[static_cast<std::size_t>(e[a])];
  period.join(corner);
  return corner;
}

/// One element seen from a node: (node, opposite…) is positively oriented.
template <int dim>
struct FanEntry
{
  std::array<index_t, dim> opposite;
};

/// The elements around a node, counter-clockwise, in the plane: made of its ring when it is asked for.
class PlaneFan
{
public:
  explicit PlaneFan(std::size_t size) : size_(size)
  {
    if (size > few_.size())
      many_.resize(size);
  }
  FanEntry<2>* begin() { return many_.empty() ? few_.data() : many_.data(); }
  const FanEntry<2>* begin() const { return many_.empty() ? few_.data() : many_.data(); }
  const FanEntry<2>* end() const { return begin() + size_; }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  const FanEntry<2>& operator[](std::size_t k) const { return begin()[k]; }
  const FanEntry<2>& front() const { return *begin(); }
  const FanEntry<2>& back() const { return *(end() - 1); }

private:
  std::size_t size_;
  std::array<FanEntry<2>, 12> few_;
  std::vector<FanEntry<2>> many_; ///< if it has more
};

/// One closed chain of triangles.
inline bool is_closed(std::span<const FanEntry<2>> fan)
{
  bool joined = !fan.empty() && fan.back().opposite[1] == fan.front().opposite[0];
  for (std::size_t k = 0; k + 1 < fan.size(); ++k)
    joined = joined && fan[k].opposite[1] == fan[k + 1].opposite[0];
  return joined;
}

/// In the plane: the neighbours around every node with a fan, counter-clockwise, eight nodes side by side. A
/// node on the boundary is itself in its ring wherever that is open, so that the triangles between the node
/// and two that follow each other, the last and the first included, are its elements, and beside them flat
/// ones. In the order of the fan: sums around a ring do not depend on what is beside it.
struct Rings
{
  using Row = std::array<index_t, Lanes::size>;
  std::vector<index_t> begin; ///< first row of each group of eight nodes, and the end
  UnwrittenRows<Row> row; ///< row k of a group: twice the number of neighbour k of each of its nodes; where a
                          ///< ring has no more, its first again

  /// Of node n, number k among those with rings, at so many elements.
  PlaneFan fan(index_t n, std::size_t k, index_t elements) const
  {
    PlaneFan fan(static_cast<std::size_t>(elements));
    const std::size_t group = k / Lanes::size, lane = k % Lanes::size;
    const Row *first = row.data() + begin[group], *end = row.data() + begin[group + 1];
    FanEntry<2>* to = fan.begin();
    for (const Row* at = first; to != fan.end(); ++at)
    {
      const index_t from = (*at)[lane] / 2, next = (*(at + 1 == end ? first : at + 1))[lane] / 2;
      if (from != n && next != n)
        *to++ = {{from, next}};
    }
    return fan;
  }
};

template <int dim>
struct FluidMesh
{
  std::vector<Simplex<dim>>
      elements; ///< positive orientation, sorted, so that sums do not depend on how they were found
  std::vector<Facet<dim>> boundary;  ///< outward facets that belong to one element only
  std::vector<index_t> fan_begin;    ///< of each node with a fan, and the end
  UnwrittenRows<FanEntry<dim>> fans; ///< in space; in the plane there are rings instead
  Rings rings;                       ///< in the plane, of the nodes with a fan
  index_t first_with_fan = 0;        ///< of the nodes whose fans are here: those that find_fans was asked for

  // Of a node with a fan.
  /// In the plane a PlaneFan, in space a span of `fans`.
  auto fan(index_t n) const
  {
    const auto k = static_cast<std::size_t>(n - first_with_fan);
    if constexpr (dim == 2)
      return rings.fan(n, k, n_elements_at(n));
    else
      return std::span<const FanEntry<dim>>{fans.data() + fan_begin[k], fans.data() + fan_begin[k + 1]};
  }
  index_t n_elements_at(index_t n) const
  {
    const auto k = static_cast<std::size_t>(n - first_with_fan);
    return fan_begin[k + 1] - fan_begin[k];
  }
  index_t end_with_fan() const { return first_with_fan + static_cast<index_t>(fan_begin.size()) - 1; }
  bool isolated(index_t n) const { return n_elements_at(n) == 0; }
  index_t n_elements() const { return static_cast<index_t>(elements.size()); }
};

/// The corners rotated so that the smallest comes first and the orientation stays: one form for every
/// simplex.
template <int dim>
Simplex<dim> canonical(const Simplex<dim>& e);
template <>
Simplex<3> canonical<3>(const Simplex<3>& e);
template <>
inline Simplex<2> canonical<2>(const Simplex<2>& e) // without branches that nobody can foresee
{
  const bool last = e[2] < e[0] && e[2] < e[1], middle = !last && e[1] < e[0];
  const auto one_of = [&](index_t first, index_t second, index_t third) {
    return last ? third : middle ? second : first;
  };
  return {one_of(e[0], e[1], e[2]), one_of(e[1], e[2], e[0]), one_of(e[2], e[0], e[1])};
}

/// So far apart are the numbers of an element's nodes, at most; elements in canonical form.
template <int dim>
index_t widest(std::span<const Simplex<dim>> elements)
{
  index_t most = 0;
  for (const auto& e : elements)
    for (std::size_t a = 1; a <= dim; ++a)
      most = std::max(most, e[a] - e[0]);
  return most;
}

/// Elements in the one form and order that depend on the set only.
template <int dim>
std::vector<Simplex<dim>> sorted_elements(std::vector<Simplex<dim>> elements, int threads = 1);

/// [begin, end) of n rows that all ranks have: the part that this one looks at.
std::array<std::size_t, 2> rows_of_rank(std::size_t n, const Ranks& ranks);

/// The sorted elements of all ranks in one order over the ranks: those of a rank come before those of the
/// next, about as many on each. Collective.
template <int dim>
std::vector<Simplex<dim>> sorted_over_ranks(std::vector<Simplex<dim>> sorted, const Ranks& ranks);

/// The first of sorted elements whose lowest node is `n` or a later one.
template <int dim>
index_t first_element_from(std::span<const Simplex<dim>> sorted, index_t n);

/// Fans of the nodes [begin, end) of a mesh of sorted elements, and the boundary facets of which one of them
/// is the first node (in space: the one of the lowest number). Those of consecutive ranges make up the whole.
/// @param earlier, e_begin, e_end the elements that touch the nodes are among these and [e_begin, e_end), in
/// their order
template <int dim>
void find_fans(FluidMesh<dim>& mesh, index_t begin, index_t end, std::span<const index_t> earlier,
               index_t e_begin, index_t e_end, int threads = 1);

/// Sort the elements, find the boundary and the fans.
template <int dim>
FluidMesh<dim> connect(index_t n_nodes, std::vector<Simplex<dim>> elements);

} // namespace undine::fluid
