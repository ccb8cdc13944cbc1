// Reading the solid's tables of a case.
#include "common/error.hpp"
#include "solid_fe/read_solid_config.hpp"

#include <catch2/catch.hpp>

using namespace undine;
using namespace undine::solid;

namespace
{

SolidConfig read(const std::string& text, int dim = 2)
{
  const auto file = CaseFile::parse(text, "cases/x/case.toml");
  auto config = read_solid_config(file, dim, 0.05);
  file.reject_unknown_keys({"solid"});
  return config;
}

const std::string minimal =
    "[solid]\ndensity = 1500\nyoungs_modulus = 2.3e5\npoisson_ratio = 0.4\nwidth = 0.05\nheight = 0.24\n";

} // namespace

TEST_CASE("a minimal solid gets the documented defaults", "[solid][unit]")
{
  const auto config = read(minimal);
  CHECK(config.material.density == 1500.0);
  CHECK(config.material.law == "neo_hookean_ln");
  CHECK(config.geometry.element == ElementType::quadrilateral4);
  CHECK(config.geometry.size == std::vector<double>{0.05, 0.24});
  CHECK(config.geometry.elements == std::vector<int>{1, 5});
  CHECK(config.geometry.origin == std::vector<double>{0.0, 0.0});
  CHECK(config.gravity == std::vector<double>{0.0, 0.0});
  CHECK(config.step_safety == 0.9);
  CHECK(config.fix.empty());
  CHECK(config.wet.empty());
}

TEST_CASE("every key of the solid arrives", "[solid][unit]")
{
  const auto config = read(R"([solid]
density = 1000
youngs_modulus = 1e6
poisson_ratio = 0.3
law = "svk"
width = 1
height = 2
depth = 3
origin = [0.5, 1, 0]
element = "Tet4"
elements = [4, 5, 6]
gravity = [0, -9.81, 0]
initial_velocity = [1, 2, 3]
step_safety = 0.5
[[solid.fix]]
on = "bottom"
components = ["y"]
[[solid.velocity]]
on = "left"
value = [1, 0, 0]
components = ["x"]
[[solid.traction]]
on = "top"
value = [0, -1e3, 0]
ramp = 0.1
[[interface]]
name = "gamma"
fluid = "bottom"
solid = "top"
)",
                           3);
  CHECK(config.material.law == "svk");
  CHECK(config.geometry.element == ElementType::tetrahedron4);
  CHECK(config.geometry.elements == std::vector<int>{4, 5, 6});
  CHECK(config.geometry.origin == std::vector<double>{0.5, 1.0, 0.0});
  CHECK(config.initial_velocity == std::vector<double>{1.0, 2.0, 3.0});
  CHECK(config.step_safety == 0.5);
  REQUIRE(config.fix.size() == 1);
  CHECK(config.fix[0].components == std::vector<std::string>{"y"});
  REQUIRE(config.velocity.size() == 1);
  CHECK(config.velocity[0].value == std::vector<double>{1.0, 0.0, 0.0});
  REQUIRE(config.traction.size() == 1);
  CHECK(config.traction[0].ramp == 0.1);
  REQUIRE(config.wet.size() == 1);
  CHECK(config.wet[0].interface == "gamma");
  CHECK(config.wet[0].surface == "top");
}

TEST_CASE("wrong values of the solid are refused with key and rule", "[solid][unit]")
{
  CHECK_THROWS_WITH(read("[solid]\ndensity = 1\nyoungs_modulus = 1\npoisson_ratio = 0.5\n"),
                    Catch::Contains("poisson_ratio") && Catch::Contains("0.5"));
  CHECK_THROWS_WITH(read("[solid]\ndensity = -1\n"),
                    Catch::Contains("density") && Catch::Contains("positive"));
  CHECK_THROWS_WITH(read(minimal + "law = \"hooke\"\n"), Catch::Contains("neo_hookean_ln"));
  CHECK_THROWS_WITH(read(minimal + "element = \"Hex8\"\n"), Catch::Contains("Q4"));
  CHECK_THROWS_WITH(read(minimal + "elements = [1.5, 2]\n"), Catch::Contains("whole numbers"));
  CHECK_THROWS_WITH(read(minimal + "mesh = \"a.msh\"\n"),
                    Catch::Contains("width") && Catch::Contains("solid.mesh"));
  CHECK_THROWS_WITH(read(minimal + "step_safety = 1.5\n"), Catch::Contains("step_safety"));
  CHECK_THROWS_WITH(read(minimal + "gravity = [0, 0, -9.81]\n"), Catch::Contains("gravity"));
  CHECK_THROWS_WITH(read(minimal + "densty = 3\n"), Catch::Contains("densty") && Catch::Contains("density"));
  CHECK_THROWS_WITH(read("[run]\nt_end = 1\n"), Catch::Contains("no [solid] table"));
  CHECK_THROWS_AS(read(minimal + "step_safety = 1.5\n"), InputError);
}

TEST_CASE("plastic laws, forms, contact and formulas arrive", "[solid][unit]")
{
  const auto config = read(minimal + R"case(law = "j2"
hardening_table = [0.0, 3e8, 0.1, 4e8]
plane = "axisymmetric"
formulation = "one_point"
hourglass_stiffness = 0.01
hourglass_viscosity = 0.05
mass_damping = 2.0
stiffness_damping = 1e-6
body_force_function = ["0", "-9.81*x"]
initial_velocity_function = ["y", "t"]
rigid = ["top"]
contact_stiffness = 0.2
[[solid.velocity]]
on = "left"
function = ["sin(t)", "0"]
[[solid.traction]]
on = "right"
function = ["x", "y"]
[[solid.pressure]]
on = "right"
function = "1e5*t"
[[solid.wall]]
point = [0.0, -1.0]
normal = [0.0, 1.0]
friction = 0.3
[[solid.contact]]
nodes = "top"
surface = "bottom"
)case");
  CHECK(config.material.hardening_table == std::vector<double>{0.0, 3e8, 0.1, 4e8});
  CHECK(config.plane == PlaneKind::axisymmetric);
  CHECK(config.formulation == Formulation::one_point);
  CHECK(config.hourglass_stiffness == 0.01);
  CHECK(config.hourglass_viscosity == 0.05);
  CHECK(config.material.mass_damping == 2.0);
  CHECK(config.material.stiffness_damping == 1e-6);
  CHECK(config.body_force_function.size() == 2);
  CHECK(config.initial_velocity_function[1] == "t");
  CHECK(config.rigid == std::vector<std::string>{"top"});
  CHECK(config.contact_stiffness == 0.2);
  CHECK(config.velocity[0].function[0] == "sin(t)");
  CHECK(config.traction[0].function[1] == "y");
  CHECK(config.pressure[0].function == "1e5*t");
  CHECK(config.wall[0].friction == 0.3);
  CHECK(config.contact[0].surface == "bottom");
  CHECK(read(minimal + "law = \"johnson_cook\"\nyield_stress = 9e7\nhardening_exponent = 0.3\n")
            .material.hardening_exponent == 0.3);
}

TEST_CASE("mistakes in plasticity and formulas are told", "[solid][unit]")
{
  CHECK_THROWS_WITH(read(minimal + "law = \"j2\"\n"), Catch::Contains("yield_stress"));
  CHECK_THROWS_WITH(read(minimal + "law = \"j2\"\nhardening_table = [0.1, 3e8]\n"),
                    Catch::Contains("ascending from 0"));
  CHECK_THROWS_WITH(read(minimal + "yield_stress = 1e8\n"),
                    Catch::Contains("yield_stress")); // no key of this law
  CHECK_THROWS_WITH(read(minimal + "body_force_function = [\"x\"]\n"),
                    Catch::Contains("one formula per component"));
}
