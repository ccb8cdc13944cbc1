// Which Delaunay simplices are fluid.
#pragma once

#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/fluid_nodes.hpp"

#include "common/parallel/exact_sum.hpp"
#include "common/tensor.hpp"

#include <array>
#include <span>
#include <vector>

namespace undine::fluid
{

/// Keep the simplices with circumradius R ≤ α h, h the smallest wanted spacing of their nodes [m]. Corners
/// are taken in the order of their numbers, so that the test gives the same bits wherever it is evaluated.
template <int dim>
std::vector<Simplex<dim>> alpha_shape(std::span<const Vec<dim>> x, std::span<const double> h, double alpha,
                                      const std::vector<Simplex<dim>>& delaunay,
                                      const Period<dim>& period = {});

/// Thresholds of the hysteresis. Lengths in units of h.
struct ShapeRules
{
  double keep = 1.5;            ///< what was fluid stays fluid up to this circumradius …
  double keep_inner = 3.0;      ///< … and this one if no corner is on the boundary
  double create = 0.8;          ///< what was not fluid becomes fluid below this circumradius
  double gap = 0.0;             ///< > 0: instead, below this height across the gap, and only while it closes
  double sliver_quality = 0.15; ///< flat elements of boundary nodes only are dropped below this shape
};

/// The fluid after a remesh and what the decision did to the volume [m^dim].
template <int dim>
struct ShapeChoice
{
  std::vector<Simplex<dim>> elements;
  std::vector<Simplex<dim>>
      gaps;         ///< not fluid, with a corner on the boundary and a circumradius below watched_gap · h
  ExactSum created; ///< volume that was not fluid before
  ExactSum dropped; ///< volume that was fluid before
};

/// Hysteresis alpha shape: a simplex with a corner on the boundary is *old* if its centroid lies in the fluid
/// before the remesh, the elements `old_elements` of all `ranks` at the positions `old_x`. What it
/// chooses it leaves where `delaunay` is. Collective.
/// @param flag NodeFlag of each node before the remesh
/// @param wall_pieces for each node the wall pieces it lies on, −1 where fewer; a simplex on one piece only
/// is no fluid
template <int dim>
ShapeChoice<dim> choose_fluid(const FluidNodes<dim>& nodes,
                              const std::vector<std::array<int, 3>>& wall_pieces,
                              std::vector<Simplex<dim>> delaunay, std::span<const Vec<dim>> old_x,
                              std::span<const Simplex<dim>> old_elements, double bin, const ShapeRules& rules,
                              const Ranks& ranks = {}, int threads = 1);

/// A simplex that is not fluid would be after a remesh now.
template <int dim>
bool becomes_fluid(const Simplex<dim>& simplex, const FluidNodes<dim>& nodes, const ShapeRules& rules);

/// Between two remeshes gaps are watched up to this circumradius, over the spacing.
inline constexpr double watched_gap = 6.0;

/// No rule looks at simplices whose circumradius over the spacing is larger.
double largest_radius(const ShapeRules& rules);

} // namespace undine::fluid
