// The wet surface: nodes and faces of the solid that meet the fluid, and the numbering that puts them first.
#pragma once

#include "common/coupling/messages.hpp"
#include "common/mesh/mesh.hpp"
#include "solid_fe/solid_config.hpp"
#include "solid_fe/solid_nodes.hpp"

#include <vector>

namespace undine::solid
{

/// A mesh whose first `n_wet` nodes are those of its wet surfaces.
template <int dim>
struct WetFirstMesh
{
  Mesh<dim> mesh;
  index_t n_wet = 0;
  std::vector<index_t> number; ///< of node n in the mesh as it was given, size n_nodes
};

/// Renumber: nodes of the wet surfaces first, both groups in their given order. Nodes without an element are
/// dropped (Gmsh writes construction points). @throws InputError for an unknown surface
template <int dim>
WetFirstMesh<dim> number_wet_nodes_first(const Mesh<dim>& mesh, const std::vector<WetConfig>& wet);

/// The wet surface at the current position, for the coupler. Inverse masses are the diagonal ones of the
/// nodes: 0 in prescribed components.
template <int dim>
link::SurfaceMesh surface_message(const WetFirstMesh<dim>& mesh, const std::vector<WetConfig>& wet,
                                  const SolidNodes<dim>& nodes);

} // namespace undine::solid
