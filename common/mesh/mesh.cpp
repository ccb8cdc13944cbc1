// Element types, boundary facets and node sets of an unstructured mesh.
#include "common/mesh/mesh.hpp"

#include "common/error.hpp"
#include "common/mesh/facets.hpp"

#include <algorithm>

namespace undine
{

int nodes_per_element(ElementType type)
{
  switch (type)
  {
  case ElementType::line2:
    return 2;
  case ElementType::triangle3:
    return 3;
  case ElementType::quadrilateral4:
  case ElementType::tetrahedron4:
    return 4;
  case ElementType::hexahedron8:
    return 8;
  }
  throw InternalError("unknown element type");
}

int element_dimension(ElementType type)
{
  switch (type)
  {
  case ElementType::line2:
    return 1;
  case ElementType::triangle3:
  case ElementType::quadrilateral4:
    return 2;
  case ElementType::tetrahedron4:
  case ElementType::hexahedron8:
    return 3;
  }
  throw InternalError("unknown element type");
}

const char* element_name(ElementType type)
{
  switch (type)
  {
  case ElementType::line2:
    return "line2";
  case ElementType::triangle3:
    return "triangle3";
  case ElementType::quadrilateral4:
    return "quadrilateral4";
  case ElementType::tetrahedron4:
    return "tetrahedron4";
  case ElementType::hexahedron8:
    return "hexahedron8";
  }
  throw InternalError("unknown element type");
}

std::span<const LocalFacet> local_facets(ElementType type)
{
  static constexpr std::array<LocalFacet, 3> triangle{{{2, {0, 1}}, {2, {1, 2}}, {2, {2, 0}}}};
  static constexpr std::array<LocalFacet, 4> quadrilateral{
      {{2, {0, 1}}, {2, {1, 2}}, {2, {2, 3}}, {2, {3, 0}}}};
  static constexpr std::array<LocalFacet, 4> tetrahedron{
      {{3, {0, 2, 1}}, {3, {0, 1, 3}}, {3, {1, 2, 3}}, {3, {0, 3, 2}}}};
  static constexpr std::array<LocalFacet, 6> hexahedron{{{4, {0, 3, 2, 1}},
                                                         {4, {4, 5, 6, 7}},
                                                         {4, {0, 1, 5, 4}},
                                                         {4, {1, 2, 6, 5}},
                                                         {4, {2, 3, 7, 6}},
                                                         {4, {3, 0, 4, 7}}}};
  switch (type)
  {
  case ElementType::line2:
    return {};
  case ElementType::triangle3:
    return triangle;
  case ElementType::quadrilateral4:
    return quadrilateral;
  case ElementType::tetrahedron4:
    return tetrahedron;
  case ElementType::hexahedron8:
    return hexahedron;
  }
  throw InternalError("unknown element type");
}

FacetKey facet_key(std::span<const index_t> facet_nodes)
{
  FacetKey key{-1, -1, -1, -1};
  std::copy(facet_nodes.begin(), facet_nodes.end(), key.begin());
  std::sort(key.begin(), key.end());
  return key;
}

std::vector<index_t> Surface::node_set() const
{
  std::vector<index_t> set = nodes;
  std::sort(set.begin(), set.end());
  set.erase(std::unique(set.begin(), set.end()), set.end());
  return set;
}

template <int dim>
Surface boundary_of(const Mesh<dim>& mesh)
{
  struct Candidate
  {
    FacetKey key;
    std::size_t order; ///< of visit; the surface keeps the order of the elements
    int size;
    std::array<index_t, 4> nodes;
  };
  std::vector<Candidate> facets;
  for (const ElementBlock& block : mesh.blocks)
  {
    if (element_dimension(block.type) != dim)
      continue;
    const std::size_t per_element = static_cast<std::size_t>(nodes_per_element(block.type));
    for (std::size_t first = 0; first < block.nodes.size(); first += per_element)
      for (const LocalFacet& local : local_facets(block.type))
      {
        Candidate facet{{}, facets.size(), local.size, {}};
        for (std::size_t a = 0; a < static_cast<std::size_t>(local.size); ++a)
          facet.nodes[a] = block.nodes[first + static_cast<std::size_t>(local.nodes[a])];
        facet.key = facet_key(std::span(facet.nodes).first(static_cast<std::size_t>(local.size)));
        facets.push_back(facet);
      }
  }
  std::sort(facets.begin(), facets.end(),
            [](const Candidate& a, const Candidate& b)
            { return a.key != b.key ? a.key < b.key : a.order < b.order; });

  std::vector<Candidate> outer;
  for (std::size_t i = 0; i < facets.size();)
  {
    std::size_t next = i + 1;
    while (next < facets.size() && facets[next].key == facets[i].key)
      ++next;
    if (next == i + 1)
      outer.push_back(facets[i]);
    i = next;
  }
  std::sort(outer.begin(), outer.end(),
            [](const Candidate& a, const Candidate& b) { return a.order < b.order; });

  Surface surface;
  for (const Candidate& facet : outer)
  {
    surface.nodes.insert(surface.nodes.end(), facet.nodes.begin(), facet.nodes.begin() + facet.size);
    surface.offset.push_back(static_cast<index_t>(surface.nodes.size()));
  }
  return surface;
}

template Surface boundary_of(const Mesh<2>&);
template Surface boundary_of(const Mesh<3>&);

} // namespace undine
