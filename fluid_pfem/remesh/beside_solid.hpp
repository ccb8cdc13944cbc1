// Elements beside a solid that is thinner than the spacing of the fluid.
#pragma once

#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/fluid_nodes.hpp"
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

/// A sharp corner of the solid that a facet of the fluid's boundary cuts off gets the facet's nearer node, if
/// that is nearer than `reach` spacings and its pressure p > ρv² turns it around the corner: water that flows
/// around it leaves a node behind there. Else the elements that cover the corner would go at some remesh, and
/// their volume with them; where p is less the flow separates. In space nothing is done.
/// @param boundary facets with the fluid on their left
/// @param nodes positions are changed
template <int dim>
void cling_to_corners(const SolidSurface<dim>& solid, std::span<const Facet<dim>> boundary, double reach,
                      FluidNodes<dim>& nodes);

} // namespace undine::fluid
