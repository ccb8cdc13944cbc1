// Abaqus input files: nodes, elements, sets, surfaces, and mistakes in them.
#include "common/error.hpp"
#include "common/mesh/mesh.hpp"

#include <catch2/catch.hpp>

#include <cstdio>
#include <filesystem>
#include <fstream>

using namespace undine;

namespace
{

/// A file that lives as long as this object.
class TextFile
{
public:
  explicit TextFile(const std::string& text)
      : path_(std::filesystem::temp_directory_path() /
              ("undine_abaqus_" + std::to_string(++count_) + "_" +
               std::to_string(std::hash<std::string>{}(text)) + ".inp"))
  {
    std::ofstream(path_) << text;
  }
  ~TextFile() { std::filesystem::remove(path_); }
  std::string path() const { return path_.string(); }

private:
  static inline int count_ = 0;
  std::filesystem::path path_;
};

const std::string plate = R"(*Heading
 two quadrilaterals and a triangle
** a comment
*Node, nset=all
 1, 0., 0.
 2, 1., 0.
 3, 2., 0.
 11, 0., 1.
 12, 1., 1.
 13, 2., 1.
 20, 3., 0.5, 0.
*ELEMENT, TYPE=CPE4R, ELSET=Plate
 1, 1, 2, 12, 11
 2, 2, 3, 13,
 12
*Element, type=CPE3, elset=Tip
 7, 3, 20, 13
*Nset, nset=Foot
 1, 11
*Nset, nset=row, generate
 1, 3, 1
*NSET, NSET=both
 foot, row, 20
*Elset, elset=plates, generate
 1, 2, 1
*Surface, name=Under, type=ELEMENT
 plates, S1
*Surface, name=Nose
 7, S2
 7, S1
*Material, name=steel
*Elastic
 2.1e11, 0.3
)";

} // namespace

TEST_CASE("an Abaqus file gives nodes, blocks, sets and outward surfaces", "[common][unit]")
{
  const TextFile file(plate);
  const auto mesh = read_abaqus<2>(file.path());
  CHECK(mesh.n_nodes() == 7);
  REQUIRE(mesh.blocks.size() == 2);
  CHECK(mesh.blocks[0].type == ElementType::quadrilateral4);
  CHECK(mesh.blocks[0].body == "Plate");
  CHECK(mesh.blocks[0].nodes == std::vector<index_t>{0, 1, 4, 3, 1, 2, 5, 4});
  CHECK(mesh.blocks[1].body == "Tip");
  CHECK(mesh.node_sets.at("Foot") == std::vector<index_t>{0, 3});
  CHECK(mesh.node_sets.at("row") == std::vector<index_t>{0, 1, 2});
  CHECK(mesh.node_sets.at("both") == std::vector<index_t>{0, 1, 2, 3, 6});
  CHECK(mesh.node_sets.at("all").size() == 7);
  const auto& under = mesh.surfaces.at("Under");
  REQUIRE(under.size() == 2);
  CHECK(under.nodes == std::vector<index_t>{0, 1, 1, 2}); // the body lies to the left
  CHECK(mesh.surfaces.at("Nose").nodes == std::vector<index_t>{6, 5, 2, 6});
}

TEST_CASE("the faces of Abaqus solids point outward", "[common][unit]")
{
  const TextFile file(R"(*NODE
1,0,0,0
2,1,0,0
3,1,1,0
4,0,1,0
5,0,0,1
6,1,0,1
7,1,1,1
8,0,1,1
9,0,0,2
*ELEMENT,TYPE=C3D8
1,1,2,3,4,5,6,7,8
*ELEMENT,TYPE=C3D4
2,5,6,8,9
*SURFACE,NAME=cube
1,S1
1,S2
1,S3
1,S4
1,S5
1,S6
*SURFACE,NAME=tet
2,S1
2,S2
2,S3
2,S4
)");
  const auto mesh = read_abaqus<3>(file.path());
  for (const auto& [name, middle, faces] :
       {std::tuple<const char*, Vec<3>, index_t>{"cube", {{0.5, 0.5, 0.5}}, 6},
        {"tet", {{0.25, 0.25, 1.25}}, 4}})
  {
    const auto& surface = mesh.surfaces.at(name);
    REQUIRE(surface.size() == faces);
    Vec<3> closed; // Σ area normals of a closed surface vanish
    for (index_t f = 0; f < surface.size(); ++f)
    {
      const auto at = [&](index_t k)
      {
        return mesh.x[static_cast<std::size_t>(
            surface.nodes[static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f)] + k)])];
      };
      const auto n =
          surface.offset[static_cast<std::size_t>(f) + 1] - surface.offset[static_cast<std::size_t>(f)];
      const auto normal = n == 4 ? cross(at(2) - at(0), at(3) - at(1)) : cross(at(1) - at(0), at(2) - at(0));
      CHECK(dot(normal, at(0) - middle) > 0.0);
      closed += normal;
    }
    CHECK(norm(closed) < 1e-15);
  }
}

TEST_CASE("mistakes in an Abaqus file are told with their line", "[common][unit]")
{
  const auto complaint = [](const std::string& text)
  {
    const TextFile file(text);
    try
    {
      read_abaqus<2>(file.path());
    }
    catch (const InputError& error)
    {
      CHECK(error.code() == ExitCode::bad_input_file);
      return std::string(error.what());
    }
    return std::string("nothing");
  };
  CHECK_THAT(complaint("*NODE\n1,0,zero\n"), Catch::Contains(":2: \"zero\" is no number"));
  CHECK_THAT(complaint("*NODE\n1,0,0\n*\n"), Catch::Contains(":3: a keyword is missing behind *"));
  CHECK_THAT(complaint("*NODE\n1,0,nan\n"), Catch::Contains(":2: \"nan\" is no number"));
  for (const std::string label : {"2.5", "0", "-1", "1e60", "1000000000"})
    CHECK_THAT(complaint("*NODE\n" + label + ",0,0\n"),
               Catch::Contains(":2: \"" + label + "\" is no whole number from 1 to 999999999"));
  CHECK_THAT(complaint("*NODE\n1,0,0\n*NSET,NSET=all,GENERATE\n1,900000000\n"),
             Catch::Contains(":4: the set has more than 50000000 members"));
  CHECK_THAT(complaint("*NODE\n1,0,0\n*NSET,NSET=all,GENERATE\n1,9,0\n"),
             Catch::Contains(":4: \"0\" is no whole number"));
  CHECK_THAT(complaint("*NODE\n1,0,0\n*ELEMENT,TYPE=C3D20\n1,1\n"), Catch::Contains("TYPE=C3D20"));
  CHECK_THAT(complaint("*NODE\n1,0,0\n1,0,1\n"), Catch::Contains("node 1 is there twice"));
  CHECK_THAT(complaint("*NODE\n1,0,0\n2,1,0\n*ELEMENT,TYPE=CPE3\n1,1,2,3\n"),
             Catch::Contains("there is no node 3"));
  CHECK_THAT(complaint("*NODE\n1,0,0\n"), Catch::Contains("no element of dimension 2"));
  CHECK_THAT(complaint(plate + "*SURFACE,NAME=s\n1,S5\n"), Catch::Contains("has no face S5"));
  CHECK_THAT(complaint("*INCLUDE,INPUT=a.inp\n"), Catch::Contains("*INCLUDE is not followed"));
}
