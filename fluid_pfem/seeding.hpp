// The first nodes of the bodies of fluid.
#pragma once

#include "fluid_pfem/fluid_config.hpp"
#include "fluid_pfem/fluid_nodes.hpp"
#include "fluid_pfem/size_field.hpp"

#include <functional>
#include <string>
#include <vector>

namespace undine::fluid
{

/// Named surfaces of the first body: left right bottom top (back front) of a box, edge_0, edge_1, ... of a
/// polygon. Bit s of a node's mask is surface s of this list.
template <int dim>
std::vector<PlaneSurface<dim>> body_surfaces(const Body& body);

template <int dim>
struct Seeds
{
  std::vector<Vec<dim>> x;
  std::vector<SurfaceMask> surface; ///< of the first body
  std::vector<int> body;            ///< each node belongs to
};

/// The first nodes of all bodies of fluid, and where fluid is: a simplex whose centroid is not `inside` is
/// not fluid. A box or an ellipse of uniform spacing without obstacles has regular nodes (`Seeding`);
/// everything else has nodes at the wanted spacing on outlines and obstacles and is filled in between.
template <int dim>
struct Scene
{
  Seeds<dim> seeds;
  std::function<bool(const Vec<dim>&)> inside; ///< empty: one convex body
};

/// @throws InputError for an obstacle (closed wall around which the fluid is) that cuts an outline
template <int dim>
Scene<dim> seed_scene(const FluidConfig& config, const SizeField<dim>& size, const Walls<dim>& walls);

} // namespace undine::fluid
