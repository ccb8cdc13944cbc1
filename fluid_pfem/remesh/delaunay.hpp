// Delaunay triangulation of a point set; CGAL stays behind delaunay_2d.cpp and delaunay_3d.cpp.
#pragma once

#include "common/tensor.hpp"
#include "fluid_pfem/fluid_mesh.hpp"

#include <limits>
#include <span>
#include <vector>

namespace undine::fluid
{

/// All simplices of the Delaunay triangulation of `x`, positively oriented. Exact predicates; ties between
/// cospherical points are broken by the coordinates alone, so the set does not depend on the order of the
/// points (Devillers & Teillaud 2003). Points that coincide exactly are kept once (the lowest index).
std::vector<Simplex<2>> delaunay(std::span<const Vec<2>> x);
std::vector<Simplex<3>> delaunay(std::span<const Vec<3>> x);

/// Of the triangulation of all points those simplices that have a corner in `mine`: up to a circumradius of
/// reach/2 none is missing or wrong. In space only what they see is triangulated: around points of `mine`
/// whose simplices are small that is little.
/// @param x at least all points within `reach` [m] of one of `mine`
/// @param mine of each point whether it is one, not empty
std::vector<Simplex<3>> delaunay_around(std::span<const Vec<3>> x, std::span<const char> mine, double reach);
/// The same in the plane: all simplices of `x`.
inline std::vector<Simplex<2>> delaunay_around(std::span<const Vec<2>> x, std::span<const char> /*mine*/,
                                               double /*reach*/)
{
  return delaunay(x);
}

/// Some of the points of a periodic space, and how much of the others is needed.
struct PartOfCell
{
  std::span<const char> mine; ///< simplices are asked for whose corner of the lowest number is one of these;
                              ///< empty: all
  double reach = std::numeric_limits<double>::infinity(); ///< as far as a circumradius of half of it [m]
  const std::vector<index_t>* among = nullptr; ///< ascending: only these points have a place; null: all
  double extent = 0.0; ///< no coordinate of any point is larger than this, or than those of `among` [m]
};

/// The same in a periodic space, of points in the cell: each simplex once, its corners numbered as the points
/// that they are images of. Simplices too large to lie in half a cell are left out. The images see exactly
/// the same neighbours, so that both ends of the cell agree, ties included; and so do several parts.
template <int dim>
std::vector<Simplex<dim>> periodic_delaunay(std::span<const Vec<dim>> x, const Period<dim>& period,
                                            const PartOfCell& part = {});

/// Sign of the area of (a, b, c), exact.
int exact_orientation(const Vec<2>& a, const Vec<2>& b, const Vec<2>& c);
/// +1 if d lies inside the circle through the positive triangle (a, b, c), else −1; exact, with the tie rule
/// of `delaunay`: it flips an edge between cocircular points if and only if this is +1.
int exact_in_circle(const Vec<2>& a, const Vec<2>& b, const Vec<2>& c, const Vec<2>& d);

} // namespace undine::fluid
