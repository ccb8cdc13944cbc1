// The Delaunay triangulation of moving points, kept from one remesh to the next.
#pragma once

#include "common/parallel/untouched_rows.hpp"
#include "common/tensor.hpp"
#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/remesh/delaunay.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace undine::fluid
{

/// How often the triangulation was repaired and rebuilt.
struct DelaunayCount
{
  std::int64_t repairs = 0, rebuilds = 0, flips = 0;
};

/// Moved points are triangulated again by edge flips (Lawson 1977) where that works, else from the beginning;
/// both give the same set of simplices, ties between cocircular points included, because predicates are exact
/// and the ties of `delaunay` are broken by coordinates alone. It holds no state of the fluid: dropping it
/// costs one rebuild.
template <int dim>
class MovingDelaunay
{
public:
  /// @param threads that share the work in the plane; the result is the same
  explicit MovingDelaunay(int threads = 1) { static_cast<void>(threads); }

  /// Triangulate the points where they are now. Points are those of the last update() after the changes made
  /// by merge(), split() and renumber().
  /// @param extent the points may be taken to extend at least that far [m]
  void update(std::span<const Vec<dim>> x, double extent = 0.0);
  /// Only what delaunay_around says.
  void update_around(std::span<const Vec<dim>> x, std::span<const char> mine, double reach);
  /// All simplices whose circumscribed circle is small against the extent of the points, canonical: at least
  /// those with a radius below four extents.
  const std::vector<Simplex<dim>>& simplices() const { return simplices_; }
  const DelaunayCount& count() const { return count_; }
  /// Rebuild at the next update.
  void forget();

  /// Point `gone` disappears in favour of its neighbour `kept`.
  void merge(index_t kept, index_t gone);
  /// A new point `added` on the edge i–j.
  void split(index_t i, index_t j, index_t added);
  /// Point `gone` disappears.
  void remove(index_t gone);
  /// Numbers change; −1: the point has gone.
  void renumber(std::span<const index_t> new_number);

private:
  std::vector<Simplex<dim>> simplices_;
  DelaunayCount count_;
};

/// In the plane: a triangulation of the points and of the four corners of a far square. The square makes all
/// points inner ones, and is far enough to leave all triangles alone that can be fluid.
template <>
class MovingDelaunay<2>
{
public:
  explicit MovingDelaunay(int threads = 1) : threads_(threads) {}

  void update(std::span<const Vec<2>> x, double extent = 0.0);
  std::vector<Simplex<2>> simplices() const;
  const DelaunayCount& count() const { return count_; }
  void forget() { triangles_.clear(); }

  void merge(index_t kept, index_t gone);
  void split(index_t i, index_t j, index_t added);
  void remove(index_t gone);
  void renumber(std::span<const index_t> new_number);

private:
  static constexpr index_t frame = 4; ///< corners of the square come first: point n is vertex n + frame

  /// next[k] is the triangle across the edge opposite to corner v[k]; −1 outside the square.
  struct Triangle
  {
    std::array<index_t, 3> v, next;
  };

  void find_flips(std::vector<std::array<index_t, 2>>& edges, std::size_t begin, std::size_t end) const;
  bool repair();
  void rebuild(double least_extent);
  bool positive(const Triangle& t) const;
  bool wants_flip(index_t t, int k, bool may_walk) const;
  bool leaves_lens(index_t t, int k) const;
  void flip(index_t t, int k);
  int corner_of(index_t t, index_t v) const;
  int edge_to(index_t t, index_t other) const;
  void find_vertices();
  bool find_edge(index_t i, index_t j, index_t& t, int& k) const;
  bool ring(index_t v, std::vector<index_t>& triangles) const;
  void drop(const std::vector<index_t>& gone);
  bool collapse(index_t kept, index_t gone);

  int threads_;
  std::array<Vec<2>, frame> corner_{}; ///< of the square
  std::size_t points_ = 0;
  UnwrittenRows<Vec<2>> x_;         ///< of the corners and the points, during an update
  std::vector<Triangle> triangles_; ///< empty: rebuild
  bool complete_ = false;           ///< all points are vertices: no two coincided at the last rebuild
  UnwrittenRows<char> positive_;    ///< of each triangle, during a repair
  std::vector<index_t> at_vertex_;  ///< one triangle of each vertex while points are merged and split
  std::vector<std::array<index_t, 2>> stack_; ///< edges to be looked at
  DelaunayCount count_;
};

} // namespace undine::fluid
