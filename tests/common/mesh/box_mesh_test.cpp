// Tests of element tables, boundaries and structured boxes.
#include <catch2/catch.hpp>

#include "common/mesh/mesh.hpp"
#include "tests/common/mesh/mesh_measures.hpp"

using namespace undine;

namespace
{

template <int dim>
struct Box;

template <>
struct Box<2>
{
  static Mesh<2> make(ElementType type) { return box_mesh<2>({{-1.0, 0.5}}, {{2.0, 0.75}}, {5, 3}, type); }
  static constexpr ElementType types[2] = {ElementType::triangle3, ElementType::quadrilateral4};
  static constexpr double volume = 2.0 * 0.75;
};

template <>
struct Box<3>
{
  static Mesh<3> make(ElementType type)
  {
    return box_mesh<3>({{-1.0, 0.5, 0.0}}, {{2.0, 0.75, 1.25}}, {4, 3, 2}, type);
  }
  static constexpr ElementType types[2] = {ElementType::tetrahedron4, ElementType::hexahedron8};
  static constexpr double volume = 2.0 * 0.75 * 1.25;
};

const char* const side_names[3][2] = {{"left", "right"}, {"bottom", "top"}, {"back", "front"}};

} // namespace

TEST_CASE("element types know their nodes, dimension and name", "[common][unit]")
{
  CHECK(nodes_per_element(ElementType::line2) == 2);
  CHECK(nodes_per_element(ElementType::triangle3) == 3);
  CHECK(nodes_per_element(ElementType::quadrilateral4) == 4);
  CHECK(nodes_per_element(ElementType::tetrahedron4) == 4);
  CHECK(nodes_per_element(ElementType::hexahedron8) == 8);
  CHECK(element_dimension(ElementType::line2) == 1);
  CHECK(element_dimension(ElementType::quadrilateral4) == 2);
  CHECK(element_dimension(ElementType::hexahedron8) == 3);
  CHECK(std::string(element_name(ElementType::tetrahedron4)) == "tetrahedron4");
}

TEMPLATE_TEST_CASE_SIG("a box mesh fills its box with positive elements", "[common][unit]", ((int dim), dim),
                       2, 3)
{
  for (const ElementType type : Box<dim>::types)
  {
    const Mesh<dim> mesh = Box<dim>::make(type);
    INFO(element_name(type));
    CHECK(volume_of_body(mesh, "") == Approx(Box<dim>::volume).epsilon(tolerance));
    CHECK(mesh.n_nodes() == (dim == 2 ? 6 * 4 : 5 * 4 * 3));
  }
}

TEMPLATE_TEST_CASE_SIG("the boundary of a box is closed and is the union of its named sides",
                       "[common][unit]", ((int dim), dim), 2, 3)
{
  for (const ElementType type : Box<dim>::types)
  {
    const Mesh<dim> mesh = Box<dim>::make(type);
    INFO(element_name(type));
    const Surface boundary = boundary_of(mesh);
    CHECK(norm(area_vector(mesh, boundary)) < tolerance);
    REQUIRE(mesh.surfaces.size() == 2 * dim);
    index_t facets = 0;
    for (int axis = 0; axis < dim; ++axis)
      for (int end = 0; end < 2; ++end)
      {
        const Surface& side = mesh.surfaces.at(side_names[axis][end]);
        facets += side.size();
        double side_area = Box<dim>::volume;
        const double length = axis == 0 ? 2.0 : axis == 1 ? 0.75 : 1.25;
        side_area /= length;
        const Vec<dim> total = area_vector(mesh, side);
        for (int i = 0; i < dim; ++i) // outward: along the axis at its upper end, against it at the lower
          CHECK(total[i] == Approx(i == axis ? (end == 1 ? side_area : -side_area) : 0.0).margin(tolerance));
      }
    CHECK(facets == boundary.size());
  }
}

TEST_CASE("a box without inner nodes has the facets of its cells as boundary", "[common][unit]")
{
  // Conforming: of the 24 facets of Kuhn's six tetrahedra 12 lie inside and pair up, 12 remain.
  const auto cube = box_mesh<3>({{0.0, 0.0, 0.0}}, {{1.0, 1.0, 1.0}}, {1, 1, 1}, ElementType::tetrahedron4);
  CHECK(cube.blocks[0].size() == 6);
  CHECK(boundary_of(cube).size() == 12);
  // 2·2·2 cells: 48 tetrahedra, 192 facets, 24 cell sides of 2 triangles on the outside.
  const auto cubes = box_mesh<3>({{0.0, 0.0, 0.0}}, {{1.0, 1.0, 1.0}}, {2, 2, 2}, ElementType::tetrahedron4);
  CHECK(boundary_of(cubes).size() == 48);
}

TEST_CASE("the ends of a box are met exactly", "[common][unit]")
{
  const auto mesh = box_mesh<2>({{0.1, 0.2}}, {{0.7, 0.3}}, {7, 3}, ElementType::quadrilateral4);
  CHECK(mesh.x.front() == Vec<2>{{0.1, 0.2}});
  CHECK(mesh.x.back() == Vec<2>{{0.1 + 0.7, 0.2 + 0.3}});
}

TEST_CASE("a surface's node set is sorted and names each node once", "[common][unit]")
{
  const auto mesh = box_mesh<2>({{0.0, 0.0}}, {{1.0, 1.0}}, {3, 2}, ElementType::triangle3);
  CHECK(mesh.surfaces.at("bottom").node_set() == std::vector<index_t>{0, 1, 2, 3});
  CHECK(mesh.surfaces.at("right").node_set() == std::vector<index_t>{3, 7, 11});
}
