// Delaunay triangulation of a point set; CGAL stays behind delaunay_2d.cpp and delaunay_3d.cpp.
#pragma once

#include "common/tensor.hpp"
#include "fluid_pfem/fluid_mesh.hpp"

#include <span>
#include <vector>

namespace undine::fluid
{

/// All simplices of the Delaunay triangulation of `x`, positively oriented. Exact predicates; ties between
/// cospherical points are broken by the coordinates alone, so the set does not depend on the order of the
/// points (Devillers & Teillaud 2003). Points that coincide exactly are kept once (the lowest index).
std::vector<Simplex<2>> delaunay(std::span<const Vec<2>> x);
std::vector<Simplex<3>> delaunay(std::span<const Vec<3>> x);

/// The same in a periodic space, of points in the cell: each simplex once, its corners numbered as the points
/// that they are images of. Simplices too large to lie in half a cell are left out. The images see exactly
/// the same neighbours, so that both ends of the cell agree, ties included.
template <int dim>
std::vector<Simplex<dim>> periodic_delaunay(std::span<const Vec<dim>> x, const Period<dim>& period);

/// Sign of the area of (a, b, c), exact.
int exact_orientation(const Vec<2>& a, const Vec<2>& b, const Vec<2>& c);
/// +1 if d lies inside the circle through the positive triangle (a, b, c), else −1; exact, with the tie rule
/// of `delaunay`: it flips an edge between cocircular points if and only if this is +1.
int exact_in_circle(const Vec<2>& a, const Vec<2>& b, const Vec<2>& c, const Vec<2>& d);

} // namespace undine::fluid
