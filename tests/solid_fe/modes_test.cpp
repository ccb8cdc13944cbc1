// Natural frequencies: NAFEMS FV32, rigid modes; and a mesh that comes as an Abaqus input file.
#include "solid_fe/modes.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

// NAFEMS FV32: cantilevered tapered membrane, 10 m long, 5 to 1 m high, plane stress; 1 % with lumped mass.
TEST_CASE("the tapered membrane of NAFEMS FV32 has its six frequencies", "[solid][verification]")
{
  SolidConfig config;
  config.dim = 2;
  config.plane = PlaneKind::stress;
  config.material = {.density = 8000.0, .youngs_modulus = 200e9, .poisson_ratio = 0.3, .law = "linear"};
  config.fix = {{"left", {"x", "y"}}};
  auto mesh = box_mesh<2>({{0.0, -1.0}}, {{10.0, 2.0}}, {32, 16}, ElementType::quadrilateral4);
  for (auto& x : mesh.x)
    x[1] *= 2.5 - 0.2 * x[0];
  const auto f = natural_frequencies(Solid<2>(config, mesh), 6);
  const double expected[] = {44.623, 130.03, 162.70, 246.05, 379.90, 391.44};
  REQUIRE(f.size() == 6);
  for (std::size_t k = 0; k < 6; ++k)
  {
    INFO("mode " << k + 1 << ": " << f[k] << " Hz, expected " << expected[k]);
    CHECK(std::abs(f[k] / expected[k] - 1.0) < 0.01);
  }
}

// Three rigid motions of a free body: the finite difference leaves 1e-9 of the highest eigenvalue, 1e-4 of
// its root.
TEST_CASE("a free body has three modes without frequency", "[solid][unit]")
{
  const Solid<2> solid(soft_config(2, "neo_hookean_ln"), distorted_box<2>(ElementType::quadrilateral4));
  const auto f = natural_frequencies(solid, 5);
  REQUIRE(f.size() == 5);
  CHECK(f[2] < 1e-3 * f[3]);
  CHECK(f[3] > 1.0);
}
