// Tests of the Gmsh reader with meshes that gmsh wrote in its four dialects, and with damaged ones.
#include <catch2/catch.hpp>

#include "common/error.hpp"
#include "common/mesh/mesh.hpp"
#include "tests/common/mesh/mesh_measures.hpp"

#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>

#include <unistd.h>

using namespace undine;

namespace
{

const std::vector<std::string> dialects = {"22", "22b", "41", "41b"};

std::string data(const std::string& name) { return std::string(UNDINE_TEST_DATA) + "/" + name; }

std::string content(const std::string& path)
{
  std::ifstream file(path, std::ios::binary);
  std::ostringstream bytes;
  bytes << file.rdbuf();
  REQUIRE(file);
  return bytes.str();
}

/// A mesh file that lives as long as the test.
struct TemporaryMesh
{
  std::string path;
  explicit TemporaryMesh(const std::string& bytes)
      : path((std::filesystem::temp_directory_path() / ("undine_gmsh_" + std::to_string(::getpid()) + ".msh"))
                 .string())
  {
    std::ofstream(path, std::ios::binary) << bytes;
  }
  ~TemporaryMesh() { std::filesystem::remove(path); }
};

/// The message about a mesh file with this content, behind its path; "" if it is read without one.
template <int dim>
std::string complaint_about(const std::string& bytes)
{
  const TemporaryMesh file(bytes);
  try
  {
    read_gmsh<dim>(file.path);
  }
  catch (const InputError& error)
  {
    CHECK(error.code() == ExitCode::bad_input_file);
    const std::string text = error.what();
    CHECK(text.starts_with(file.path + ": "));
    return text.substr(std::min(text.size(), file.path.size() + 2));
  }
  return "";
}

std::string replace(std::string text, const std::string& from, const std::string& to)
{
  const std::size_t found = text.find(from);
  REQUIRE(found != std::string::npos);
  return text.replace(found, from.size(), to);
}

/// A square of two triangles with a named lower side, to be damaged.
const std::string square = R"($MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
1 1 "bottom"
2 2 "water"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
$EndNodes
$Elements
3
1 1 2 1 1 2 1
2 2 2 2 1 1 2 3
3 2 2 2 1 1 4 3
$EndElements
)";

} // namespace

TEST_CASE("a plane mesh of two bodies is read alike from all four dialects", "[common][unit]")
{
  std::optional<Mesh<2>> first;
  for (const std::string& dialect : dialects)
  {
    INFO(dialect);
    const auto mesh = read_gmsh<2>(data("plane_" + dialect + ".msh"));
    REQUIRE(mesh.blocks.size() == 2);
    CHECK(mesh.blocks[0].type == ElementType::triangle3);
    CHECK(mesh.blocks[0].body == "water");
    CHECK(mesh.blocks[1].type == ElementType::quadrilateral4);
    CHECK(mesh.blocks[1].body == "wall");
    CHECK(mesh.blocks[1].size() == 6);
    CHECK(volume_of_body(mesh, "water") == Approx(2.0).epsilon(tolerance));
    CHECK(volume_of_body(mesh, "wall") == Approx(0.75).epsilon(tolerance));
    CHECK(norm(area_vector(mesh, boundary_of(mesh))) < tolerance);

    REQUIRE(mesh.surfaces.size() == 4);
    const Vec<2> bottom = area_vector(mesh, mesh.surfaces.at("bottom"));
    CHECK(bottom[0] == Approx(0.0).margin(tolerance));
    CHECK(bottom[1] == Approx(-2.0).epsilon(tolerance));
    const Vec<2> top = area_vector(mesh, mesh.surfaces.at("77")); // a group without a name
    CHECK(top[1] == Approx(2.0).epsilon(tolerance));
    const Vec<2> wet = area_vector(mesh, mesh.surfaces.at("wet")); // out of the first body, the water
    CHECK(wet[0] == Approx(1.0).epsilon(tolerance));
    // The wall without its wet side: the sum of its normals is minus that of the wet side.
    const Vec<2> outside = area_vector(mesh, mesh.surfaces.at("outside of the wall"));
    CHECK(outside[0] == Approx(1.0).epsilon(tolerance));
    CHECK(outside[1] == Approx(0.0).margin(tolerance));
    CHECK(area(mesh, mesh.surfaces.at("outside of the wall")) ==
          Approx(0.5 + std::sqrt(1.25) + 1.0).epsilon(tolerance));
    REQUIRE(mesh.node_sets.at("corner").size() == 1);
    CHECK(mesh.x[static_cast<std::size_t>(mesh.node_sets.at("corner")[0])] == Vec<2>{{3.0, 1.0}});
    for (const Vec<2>& x : mesh.x)
      CHECK(x[0] < 4.0); // the node at (7, 7) belongs to no element

    if (!first)
      first = mesh;
    CHECK(first->blocks[0].nodes == mesh.blocks[0].nodes);
    CHECK(first->surfaces.at("wet").nodes == mesh.surfaces.at("wet").nodes);
    REQUIRE(first->n_nodes() == mesh.n_nodes());
    for (std::size_t n = 0; n < mesh.x.size(); ++n)
      CHECK(norm(first->x[n] - mesh.x[n]) < 1e-15); // the texts hold 16 digits
  }
}

TEST_CASE("a mesh of tetrahedra and hexahedra is read alike from all four dialects", "[common][unit]")
{
  std::optional<Mesh<3>> first;
  for (const std::string& dialect : dialects)
  {
    INFO(dialect);
    const auto mesh = read_gmsh<3>(data("space_" + dialect + ".msh"));
    REQUIRE(mesh.blocks.size() == 2);
    CHECK(mesh.blocks[0].type == ElementType::tetrahedron4);
    CHECK(mesh.blocks[0].body == "block");
    CHECK(mesh.blocks[1].type == ElementType::hexahedron8);
    CHECK(mesh.blocks[1].body == "slab");
    CHECK(mesh.blocks[1].size() == 8);
    CHECK(volume_of_body(mesh, "block") == Approx(1.0).epsilon(tolerance));
    CHECK(volume_of_body(mesh, "slab") == Approx(0.5).epsilon(tolerance));
    CHECK(norm(area_vector(mesh, boundary_of(mesh))) < tolerance);

    const Surface& skin = mesh.surfaces.at("skin of the slab");
    CHECK(skin.size() == 24);
    CHECK(norm(area_vector(mesh, skin)) < tolerance);
    // Lower and upper side 1 m² each; the others |edge × (0.2, 0.1, 0.5)|.
    CHECK(area(mesh, skin) ==
          Approx(2.0 + 2.0 * std::hypot(0.5, 0.1) + 2.0 * std::hypot(0.5, 0.2)).epsilon(tolerance));
    const Vec<3> front = area_vector(mesh, mesh.surfaces.at("front"));
    CHECK(front[2] == Approx(1.0).epsilon(tolerance));
    CHECK(mesh.node_sets.at("edge").size() >= 2);
    for (const index_t n : mesh.node_sets.at("edge"))
      CHECK(std::hypot(mesh.x[static_cast<std::size_t>(n)][1], mesh.x[static_cast<std::size_t>(n)][2]) <
            1e-15);
    REQUIRE(mesh.node_sets.at("tip").size() == 1);
    CHECK(mesh.x[static_cast<std::size_t>(mesh.node_sets.at("tip")[0])] == Vec<3>{{3.0, 1.0, 0.0}});

    if (!first)
      first = mesh;
    CHECK(first->blocks[0].nodes == mesh.blocks[0].nodes);
    CHECK(first->blocks[1].nodes == mesh.blocks[1].nodes);
    CHECK(first->n_nodes() == mesh.n_nodes());
  }
}

TEST_CASE("a small square is read and its second triangle turned", "[common][unit]")
{
  const TemporaryMesh file(square);
  const auto mesh = read_gmsh<2>(file.path);
  CHECK(mesh.blocks.at(0).nodes == std::vector<index_t>{0, 1, 2, 0, 2, 3});
  CHECK(mesh.surfaces.at("bottom").nodes == std::vector<index_t>{0, 1}); // written as 2, 1
}

TEST_CASE("elements without a physical group form a body without a name", "[common][unit]")
{
  const TemporaryMesh file(
      replace(replace(square, "2 2 2 2 1 1 2 3", "2 2 2 0 1 1 2 3"), "3 2 2 2 1", "3 2 2 0 1"));
  const auto mesh = read_gmsh<2>(file.path);
  REQUIRE(mesh.blocks.size() == 1);
  CHECK(mesh.blocks[0].body == "");
  CHECK(mesh.blocks[0].size() == 2);
}

TEST_CASE("a plane mesh may lie at any height, but at one", "[common][unit]")
{
  std::string raised = square;
  for (const std::string node : {"1 0 0 0", "2 1 0 0", "3 1 1 0", "4 0 1 0"})
    raised = replace(raised, node + "\n", node.substr(0, 6) + "2.5\n");
  CHECK(complaint_about<2>(raised) == "");
  CHECK(complaint_about<2>(replace(square, "3 1 1 0\n", "3 1 1 0.1\n")) ==
        "node 3 has z = 0.1, others z = 0: a plane mesh lies at one z");
}

TEST_CASE("a bad element is named with its number and physical group", "[common][unit]")
{
  CHECK(complaint_about<2>(replace(square, "3 2 2 2 1 1 4 3", "3 2 2 2 1 1 2 2")) ==
        "element 3 (physical group 'water') is flat: it has no area");
  CHECK(complaint_about<2>(replace(square, "3 2 2 2 1 1 4 3", "3 2 2 2 1 1 4 9")) ==
        "element 3 (physical group 'water') names node 9, which the file does not hold");
  CHECK(complaint_about<2>(replace(square, "3 2 2 2 1 1 4 3", "3 2 2 5 1 1 4 9")) ==
        "element 3 (physical group '5') names node 9, which the file does not hold");
  CHECK(complaint_about<2>(replace(square, "3 2 2 2 1 1 4 3", "3 9 2 2 1 1 4 3 5 6 7")) ==
        "element 3 is of Gmsh type 9: only points, and 2-node lines, 3-node triangles, 4-node "
        "quadrilaterals, 4-node "
        "tetrahedra and 8-node hexahedra are read (Mesh.ElementOrder = 1)");
  CHECK(complaint_about<2>(replace(square, "3 2 2 2 1 1 4 3", "3 3 2 2 1 1 2 4 3")) ==
        "element 3 (physical group 'water') is flat, twisted or not convex");
  CHECK(complaint_about<2>(replace(replace(square, "$Elements\n3", "$Elements\n4"), "3 2 2 2 1 1 4 3",
                                   "3 2 2 2 1 1 4 3\n4 2 2 2 1 1 4 3\n5 2 2 2 1 1 4 3")) ==
        "section $Elements does not end where its counts say");
  CHECK(complaint_about<2>(replace(replace(square, "$Elements\n3", "$Elements\n5"), "3 2 2 2 1 1 4 3",
                                   "3 2 2 2 1 1 4 3\n4 2 2 2 1 1 4 3\n5 2 2 2 1 1 4 3")) ==
        "element 4 (physical group 'water') shares a side with two others, element 2 (physical group "
        "'water') among "
        "them: is it listed twice, or in two physical groups?");
}

TEST_CASE("a named side must bound the body as a whole or not at all", "[common][unit]")
{
  const std::string two_lines = replace(replace(square, "$Elements\n3", "$Elements\n4"), "2 2 2 2 1 1 2 3",
                                        "9 1 2 1 1 2 4\n2 2 2 2 1 1 2 3");
  CHECK(complaint_about<2>(two_lines) ==
        "element 9 (physical group 'bottom') is the side of no element, although others of its group are");
  CHECK(complaint_about<2>(replace(two_lines, "9 1 2 1 1 2 4", "9 1 2 1 1 1 2")) ==
        "element 9 (physical group 'bottom') repeats element 1");
  const TemporaryMesh file(replace(square, "1 1 2 1 1 2 1", "1 1 2 1 1 2 4"));
  const auto mesh = read_gmsh<2>(file.path);
  CHECK(mesh.surfaces.empty());
  CHECK(mesh.node_sets.at("bottom") == std::vector<index_t>{1, 3});
}

TEST_CASE("a mesh of the wrong dimension is refused", "[common][unit]")
{
  const std::string message = complaint_about<2>(content(data("space_22.msh")));
  CHECK(message.find("is a tetrahedron4, but the case is plane (run.dimension = 2)") != std::string::npos);
  CHECK(complaint_about<3>(square) == "has no tetrahedra and no hexahedra");
}

TEST_CASE("what is no mesh file is refused with the reason", "[common][unit]")
{
  CHECK(complaint_about<2>("solid of something\n") ==
        "is not a Gmsh mesh: it does not begin with $MeshFormat");
  CHECK(complaint_about<2>("") == "is not a Gmsh mesh: it does not begin with $MeshFormat");
  CHECK(complaint_about<2>(replace(square, "2.2 0 8", "4 0 8")) ==
        "MSH version 4: write version 4.1 or 2.2 (gmsh -format msh41 or msh22)");
  CHECK(complaint_about<2>(replace(square, "2 1 0 0", "2 one 0 0")) == "section $Nodes: 'one' is no number");
  CHECK(complaint_about<2>(replace(square, "2 1 0 0", "2 nan 0 0")) ==
        "node 2 has a coordinate that is no finite number");
  CHECK(complaint_about<2>(replace(square, "2 1 0 0", "1 1 0 0")) == "node 1 is listed twice");
  try
  {
    read_gmsh<2>("/nonexistent/mesh.msh");
    FAIL("no error");
  }
  catch (const InputError& error)
  {
    CHECK(error.code() == ExitCode::bad_input_file);
    CHECK(std::string(error.what()) == "/nonexistent/mesh.msh: the mesh file cannot be read");
  }
}

TEST_CASE("a mesh file cut off anywhere is refused, never read past its end", "[common][unit]")
{
  for (const std::string& dialect : dialects)
  {
    const std::string whole = content(data("plane_" + dialect + ".msh"));
    const std::size_t elements_end = whole.rfind("$EndElements");
    for (std::size_t length = 0; length < elements_end; length += 7)
    {
      INFO(dialect << " cut at " << length);
      CHECK(complaint_about<2>(whole.substr(0, length)) != "");
    }
  }
}
