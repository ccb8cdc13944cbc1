// The first nodes of a box of fluid.
#pragma once

#include "fluid_pfem/fluid_config.hpp"
#include "fluid_pfem/fluid_nodes.hpp"

#include <string>
#include <vector>

namespace undine::fluid
{

/// A plane surface of the domain.
template <int dim>
struct PlaneSurface
{
  std::string name;
  Vec<dim> point;
  Vec<dim> normal; ///< unit, outward
};

/// The faces of the box: left right bottom top (back front). Bit s of a node's mask is surface s of this
/// list.
template <int dim>
std::vector<PlaneSurface<dim>> box_surfaces(const Vec<dim>& origin, const Vec<dim>& size);

template <int dim>
struct Seeds
{
  std::vector<Vec<dim>> x;
  std::vector<SurfaceMask> surface;
};

/// Nodes of spacing about `h` that fill the box, with nodes on all faces, edges and corners. The staggered
/// pattern is mirror-symmetric about each of its node columns (2-D), so that a one-dimensional motion along
/// the columns stays one-dimensional.
template <int dim>
Seeds<dim> seed_box(const Vec<dim>& origin, const Vec<dim>& size, double h, const Seeding& seeding);

/// The seeds inside the ellipse (ellipsoid) inscribed in the box, with nodes on its outline at spacing `h`.
template <int dim>
Seeds<dim> cut_ellipse(const Seeds<dim>& seeds, const Vec<dim>& origin, const Vec<dim>& size, double h);

} // namespace undine::fluid
