// An unstructured mesh as read or generated: nodes, element blocks, named surfaces and node sets.
#pragma once

#include "common/tensor.hpp"
#include "common/types.hpp"

#include <array>
#include <map>
#include <string>
#include <vector>

namespace undine
{

enum class ElementType
{
  line2,
  triangle3,
  quadrilateral4,
  tetrahedron4,
  hexahedron8
};

int nodes_per_element(ElementType);
int element_dimension(ElementType); ///< 1, 2 or 3
const char* element_name(ElementType);

/// Elements of one type; node numbers in the Gmsh/VTK order (positive Jacobian), row by row.
struct ElementBlock
{
  ElementType type = ElementType::triangle3;
  std::vector<index_t> nodes; ///< size n_elements × nodes_per_element(type)
  std::string body;           ///< name of the physical group, "" if none

  index_t size() const { return static_cast<index_t>(nodes.size()) / nodes_per_element(type); }
};

/// Facets of a surface; each facet's nodes are ordered so that its normal points out of the body
/// (2-D: the body lies to the left of a → b, so the outward normal is right_normal(x_b − x_a)).
struct Surface
{
  std::vector<index_t> offset{0}; ///< facet f has nodes[offset[f]] … nodes[offset[f+1]-1]
  std::vector<index_t> nodes;

  index_t size() const { return static_cast<index_t>(offset.size()) - 1; }
  std::vector<index_t> node_set() const; ///< sorted, unique
};

template <int dim>
struct Mesh
{
  std::vector<Vec<dim>> x; ///< [m]
  std::vector<ElementBlock> blocks;
  std::map<std::string, Surface> surfaces;
  std::map<std::string, std::vector<index_t>> node_sets; ///< named points and curves that bound no body facet

  index_t n_nodes() const { return static_cast<index_t>(x.size()); }
};

/// All facets of the mesh that belong to one element only, outward, in the order of the elements.
template <int dim>
Surface boundary_of(const Mesh<dim>& mesh);

/// Structured box [origin, origin + size] [m] with `cells` elements along each axis.
/// Types: triangle3, quadrilateral4 (dim = 2), tetrahedron4, hexahedron8 (dim = 3). Surfaces: left/right (x),
/// bottom/top (y), and in 3-D back/front (z); y is the vertical in both dimensions.
template <int dim>
Mesh<dim> box_mesh(const Vec<dim>& origin, const Vec<dim>& size,
                   const std::array<int, static_cast<std::size_t>(dim)>& cells, ElementType type);

/// Gmsh MSH 2.2 and 4.1, ASCII and binary: points, lines, triangles, quads, tets, hexes; physical groups
/// become blocks (dimension dim), surfaces (dimension dim − 1) and node sets (below). A group without a name
/// is called by its number. Elements are turned to positive Jacobians and facets outward; a facet between two
/// bodies points out of the first one. A physical group of dimension dim − 1 whose facets bound no element
/// becomes a node set. Nodes of no element are dropped. In a plane mesh all third coordinates must be equal.
/// @throws InputError (exit code 4) naming file, element number and physical group
template <int dim>
Mesh<dim> read_gmsh(const std::string& path);

/// Abaqus input file (.inp): *NODE, *ELEMENT (3- and 4-node plane and axisymmetric, C3D4, C3D8, B21 and their
/// variants), *NSET, *ELSET (GENERATE too), *SURFACE of element faces; materials, steps and the rest are
/// passed over. Elements of one ELSET and type become a block with that body name, node sets keep their
/// names. Facets are turned outward.
/// @throws InputError (exit code 4) naming file and line or element
template <int dim>
Mesh<dim> read_abaqus(const std::string& path);

} // namespace undine
