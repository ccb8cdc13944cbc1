// The facets of each element type, ordered so that their normals point out of the element.
#pragma once

#include "common/mesh/mesh.hpp"

#include <array>
#include <span>

namespace undine
{

/// One facet of an element, as positions in the element's list of nodes.
struct LocalFacet
{
  int size = 0; ///< number of nodes
  std::array<int, 4> nodes{};
};

/// Facets of an element of type `type` with positive Jacobian, in Gmsh/VTK order; empty for line2.
std::span<const LocalFacet> local_facets(ElementType type);

/// The nodes of a facet without their order: sorted, filled with −1. Equal for the two sides of an inner
/// facet.
using FacetKey = std::array<index_t, 4>;
FacetKey facet_key(std::span<const index_t> facet_nodes);

} // namespace undine
