// CGAL's space Delaunay triangulation: of all points, or of those that some of them ask for.
#include "fluid_pfem/remesh/delaunay.hpp"
#include "fluid_pfem/remesh/local_delaunay.hpp"
#include "fluid_pfem/remesh/nested_boxes.hpp"
#include "fluid_pfem/simplex.hpp"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Delaunay_triangulation_cell_base_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_cell_base_with_info_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <algorithm>
#include <iterator>
#include <limits>
#include <numeric>
#include <utility>

namespace undine::fluid
{

namespace
{

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
/// What is known of a cell.
struct Completeness
{
  bool known = false; ///< its ball holds no point that one of its corners sees, but is no vertex
};
using Structure = CGAL::Triangulation_data_structure_3<
    CGAL::Triangulation_vertex_base_with_info_3<index_t, Kernel>,
    CGAL::Triangulation_cell_base_with_info_3<Completeness, Kernel,
                                              CGAL::Delaunay_triangulation_cell_base_3<Kernel>>>;
using Triangulation = CGAL::Delaunay_triangulation_3<Kernel, Structure>;
using Cell = Triangulation::Cell_handle;
using Vertex = Triangulation::Vertex_handle;

Kernel::Point_3 point(const Vec<3>& x) { return {x[0], x[1], x[2]}; }

Vec<3> place_of(const Vertex& v) { return {{v->point().x(), v->point().y(), v->point().z()}}; }

Simplex<3> nodes_of(const Cell& cell)
{
  return {cell->vertex(0)->info(), cell->vertex(1)->info(), cell->vertex(2)->info(), cell->vertex(3)->info()};
}

/// The ball circumscribed to a cell, or the half space beyond a facet of the hull: places v + q, v a corner,
/// with β·q − α|q|² > 0. With bounds of the rounding errors, so that it can be said where it certainly is
/// not.
class Ball
{
public:
  /// @param corner of the cell, its finite corners
  Ball(const Triangulation& triangulation, const Cell& cell, const Vertex& corner)
  {
    const auto order = even_order<3>(cell->index(corner));
    v_ = place_of(corner);
    std::array<Vec<3>, 3> edge{};
    std::size_t infinite = 3;
    for (std::size_t k = 0; k < 3; ++k)
      if (const Vertex other = cell->vertex(order[k + 1]); triangulation.is_infinite(other))
        infinite = k;
      else
        edge[k] = place_of(other) - v_;
    for (std::size_t k = 0; k < 3; ++k)
    {
      if (infinite < 3 && infinite != k)
        continue;
      const Vec<3>&b = edge[(k + 1) % 3], &d = edge[(k + 2) % 3];
      const double weight = infinite == k ? 1.0 : norm_squared(edge[k]);
      const Vec<3> normal = cross(b, d);
      Vec<3> size; // of the terms of the normal
      for (int i = 0; i < 3; ++i)
        size[i] = std::abs(b[(i + 1) % 3] * d[(i + 2) % 3]) + std::abs(b[(i + 2) % 3] * d[(i + 1) % 3]);
      beta_ += weight * normal;
      beta_terms_ += weight * size;
      if (infinite == 3 && k == 0)
      {
        alpha_ = std::max(0.0, dot(edge[0], normal)); // positive, if it were not for rounding
        for (int i = 0; i < 3; ++i)
          alpha_terms_ += std::abs(edge[0][i]) * size[i];
      }
    }
  }

  /// Its radius is certainly not above `limit` [m].
  bool is_within(double limit) const
  {
    constexpr double well_shaped = 1e-9, rounding = 1e-4;
    limit *= 2.0 * (1.0 - rounding) * alpha_;
    return alpha_ > well_shaped * alpha_terms_ && norm_squared(beta_) < limit * limit;
  }

  /// A point of the box may be inside.
  bool may_meet(const Vec<3>& lower, const Vec<3>& upper) const
  {
    constexpr double rounding = 32 * std::numeric_limits<double>::epsilon();
    double most = 0.0, error = 0.0;
    for (int i = 0; i < 3; ++i)
    {
      const double low = lower[i] - v_[i], high = upper[i] - v_[i],
                   q = 2.0 * alpha_ * high < beta_[i]  ? high
                       : 2.0 * alpha_ * low > beta_[i] ? low
                                                       : 0.5 * beta_[i] / alpha_,
                   far = std::max(std::abs(low), std::abs(high));
      most += beta_[i] * q - alpha_ * q * q;
      error += (beta_terms_[i] + alpha_terms_ * far) * far;
    }
    return most + rounding * error > 0.0;
  }

private:
  Vec<3> v_, beta_{},
      beta_terms_{}; ///< terms: sums of their sizes, to which rounding errors are in proportion
  double alpha_ = 0.0, alpha_terms_ = 0.0;
};

/// The points of these numbers are vertices afterwards.
void insert(Triangulation& triangulation, std::span<const Vec<3>> x, const std::vector<index_t>& numbers)
{
  std::vector<std::pair<Kernel::Point_3, index_t>> points;
  points.reserve(numbers.size());
  for (const index_t n : numbers)
    points.emplace_back(point(x[static_cast<std::size_t>(n)]), n);
  triangulation.insert(points.begin(), points.end());
}

bool has_corner(const Triangulation& triangulation, const Cell& cell, std::span<const char> mine)
{
  for (int k = 0; k < 4; ++k)
    if (const Vertex v = cell->vertex(k);
        !triangulation.is_infinite(v) && mine[static_cast<std::size_t>(v->info())])
      return true;
  return false;
}

/// What some points see of the others.
struct Sight
{
  std::span<const char> mine; ///< those that see,
  double reach;               ///< so far [m],
  NestedBoxes<3> rest;        ///< and what is no vertex yet
};

/// The nearest to corner v of a cell of the points that one of its corners sees in its ball; −1: none.
index_t nearest_inside(const Triangulation& triangulation, const Cell& cell, const Vertex& v,
                       const Sight& sight)
{
  const Vec<3> place = place_of(v);
  double width = 0.0;
  for (int k = 0; k < 4; ++k)
    if (const Vertex other = cell->vertex(k);
        !triangulation.is_infinite(other) && sight.mine[static_cast<std::size_t>(other->info())])
      width = std::max(width, norm(place_of(other) - place));
  const Ball ball(triangulation, cell, v);
  return sight.rest.nearest(
      place, sight.reach + width,
      [&ball](const Vec<3>& lower, const Vec<3>& upper) { return ball.may_meet(lower, upper); },
      [&](const Vec<3>& p)
      { return triangulation.side_of_sphere(cell, point(p), true) == CGAL::ON_BOUNDED_SIDE; });
}

/// As long as v sees a point in the ball of a cell around it, the nearest becomes a vertex. Around other
/// vertices balls stay as empty as they are, for the ball of a new cell lies in the two on both sides of one
/// of its facets.
void complete(Triangulation& triangulation, const Vertex& v, std::span<const Vec<3>> x, Sight& sight)
{
  std::vector<Cell> cells;
  std::vector<index_t> found;
  do
  {
    cells.clear();
    found.clear();
    triangulation.incident_cells(v, std::back_inserter(cells));
    for (const Cell& cell : cells)
      if (!cell->info().known)
      {
        if (const index_t n = nearest_inside(triangulation, cell, v, sight); n >= 0)
          found.push_back(n);
        else
          cell->info().known = true;
      }
    std::sort(found.begin(), found.end());
    found.erase(std::unique(found.begin(), found.end()), found.end());
    for (const index_t n : found)
    {
      sight.rest.take_out(n);
      const auto vertices = triangulation.number_of_vertices();
      const Vertex added = triangulation.insert(point(x[static_cast<std::size_t>(n)]), v);
      if (triangulation.number_of_vertices() > vertices) // else it coincides with another one
        added->info() = n;
    }
  } while (!found.empty());
}

std::vector<Simplex<3>> simplices_of(const Triangulation& triangulation, std::span<const char> mine)
{
  std::vector<Simplex<3>> simplices;
  if (mine.empty())
    simplices.reserve(triangulation.number_of_finite_cells());
  for (auto cell = triangulation.finite_cells_begin(); cell != triangulation.finite_cells_end(); ++cell)
    if (mine.empty() || has_corner(triangulation, cell, mine))
      simplices.push_back(nodes_of(cell));
  return simplices;
}

} // namespace

std::vector<Simplex<3>> delaunay(std::span<const Vec<3>> x)
{
  std::vector<index_t> all(x.size());
  std::iota(all.begin(), all.end(), 0);
  Triangulation triangulation;
  insert(triangulation, x, all);
  return simplices_of(triangulation, {});
}

std::vector<Simplex<3>> delaunay_around(std::span<const Vec<3>> x, std::span<const char> mine, double reach)
{
  const double first = reach / 6.0; // the balls of most cells have half of that, or less
  const std::vector<index_t> near = points_near<3>(x, mine, first);
  Triangulation triangulation;
  insert(triangulation, x, near);
  std::vector<index_t> far;
  for (index_t n = 0; n < static_cast<index_t>(x.size()); ++n)
    if (!std::binary_search(near.begin(), near.end(), n))
      far.push_back(n);
  if (triangulation.dimension() < 3)
    insert(triangulation, x, std::exchange(far, {}));
  Sight sight{.mine = mine, .reach = reach, .rest = NestedBoxes<3>(x, std::move(far))};
  std::vector<Vertex> see_further;
  std::vector<char> listed(x.size(), 0);
  const auto is_mine = [&](const Vertex& v)
  { return !triangulation.is_infinite(v) && mine[static_cast<std::size_t>(v->info())]; };
  if (triangulation.dimension() == 3)
    for (auto cell = triangulation.all_cells_begin(); cell != triangulation.all_cells_end(); ++cell)
      for (int k = 0; k < 4 && !cell->info().known; ++k)
        if (const Vertex v = cell->vertex(k); is_mine(v))
        {
          cell->info().known = Ball(triangulation, cell, v).is_within(0.5 * first);
          if (char& is_listed = listed[static_cast<std::size_t>(v->info())];
              !cell->info().known && !std::exchange(is_listed, 1))
            see_further.push_back(v);
        }
  for (const Vertex& v : see_further)
    complete(triangulation, v, x, sight);
  return simplices_of(triangulation, mine);
}

} // namespace undine::fluid
