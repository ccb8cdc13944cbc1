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

} // namespace undine::fluid
