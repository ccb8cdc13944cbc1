// Elements beside a solid that is thinner than the spacing of the fluid.
#pragma once

#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/solid_surface.hpp"

#include <span>
#include <vector>

namespace undine::fluid
{

/// The Delaunay triangulation knows no solid: across a thin one it joins nodes of both sides, also where the
/// edge along the side should be, and without those elements voids are left on both sides. Here each hole is
/// filled again from its rim, the triangle with the smallest circumcircle first, as long as a triangle lies
/// on one side; what is left of the hole is the solid.
///
/// Plane only; in space nothing is filled.
/// @param erased elements of the triangulation that the solid blocks, positive orientation
/// @param h spacing of each node [m]; circumradii up to `largest_radius` of it are filled
/// @returns the elements that take their place
template <int dim>
std::vector<Simplex<dim>> fill_beside(const SolidSurface<dim>& solid, std::span<const Vec<dim>> x,
                                      std::span<const double> h, std::span<const Simplex<dim>> erased,
                                      double largest_radius);

} // namespace undine::fluid
