// Volumes of elements and area vectors of facets, for tests of meshes.
#pragma once

#include "common/mesh/facets.hpp"
#include "common/mesh/mesh.hpp"

#include <catch2/catch.hpp>

namespace undine
{

// Sums of at most a hundred terms of size ≤ 1 with errors of 2⁻⁵³ each: below 1e-13. Curve nodes of gmsh's
// version-2.2 text have 16 significant digits, which moves boundary nodes along straight sides and by 1e-16
// off them.
constexpr double tolerance = 1e-13;

/// ∫ n dS over a facet with nodes `nodes` [m or m²]; exact for any facet with straight edges.
template <int dim>
Vec<dim> area_vector(const Mesh<dim>& mesh, std::span<const index_t> nodes)
{
  const auto x = [&](std::size_t a) { return mesh.x[static_cast<std::size_t>(nodes[a])]; };
  if constexpr (dim == 2)
    return right_normal(x(1) - x(0));
  else if (nodes.size() == 3)
    return 0.5 * cross(x(1) - x(0), x(2) - x(0));
  else
    return 0.5 * cross(x(2) - x(0), x(3) - x(1));
}

template <int dim>
Vec<dim> centre(const Mesh<dim>& mesh, std::span<const index_t> nodes)
{
  Vec<dim> sum;
  for (const index_t n : nodes)
    sum += mesh.x[static_cast<std::size_t>(n)];
  return sum * (1.0 / static_cast<double>(nodes.size()));
}

/// Σ over the facets of (x_c − x_0) · ∫n dS / dim: Gauss' theorem, exact for elements with plane facets
/// (a parallelogram's centre of area is the mean of its corners; facets of other quadrilaterals are not used
/// in 3-D).
template <int dim>
double volume(const Mesh<dim>& mesh, const ElementBlock& block, index_t element)
{
  const auto per_element = static_cast<std::size_t>(nodes_per_element(block.type));
  const std::span nodes =
      std::span(block.nodes).subspan(static_cast<std::size_t>(element) * per_element, per_element);
  double sum = 0.0;
  for (const LocalFacet& local : local_facets(block.type))
  {
    std::vector<index_t> facet;
    for (int a = 0; a < local.size; ++a)
      facet.push_back(nodes[static_cast<std::size_t>(local.nodes[static_cast<std::size_t>(a)])]);
    const Vec<dim> lever =
        centre(mesh, std::span<const index_t>(facet)) - mesh.x[static_cast<std::size_t>(nodes[0])];
    sum += dot(lever, area_vector(mesh, std::span<const index_t>(facet)));
  }
  return sum / dim;
}

/// Volume of all elements of the body [m² or m³]; every element must be positive on its own.
template <int dim>
double volume_of_body(const Mesh<dim>& mesh, const std::string& body)
{
  double sum = 0.0;
  for (const ElementBlock& block : mesh.blocks)
    if (block.body == body)
      for (index_t e = 0; e < block.size(); ++e)
      {
        const double v = volume(mesh, block, e);
        CHECK(v > 0.0);
        sum += v;
      }
  return sum;
}

inline std::span<const index_t> facet_nodes(const Surface& surface, index_t f)
{
  const auto first = static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f)]);
  const auto last = static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f) + 1]);
  return std::span(surface.nodes).subspan(first, last - first);
}

/// Σ ∫ n dS over a surface; zero for a closed one.
template <int dim>
Vec<dim> area_vector(const Mesh<dim>& mesh, const Surface& surface)
{
  Vec<dim> sum;
  for (index_t f = 0; f < surface.size(); ++f)
    sum += area_vector(mesh, facet_nodes(surface, f));
  return sum;
}

/// Σ |∫ n dS| [m or m²].
template <int dim>
double area(const Mesh<dim>& mesh, const Surface& surface)
{
  double sum = 0.0;
  for (index_t f = 0; f < surface.size(); ++f)
    sum += norm(area_vector(mesh, facet_nodes(surface, f)));
  return sum;
}

} // namespace undine
