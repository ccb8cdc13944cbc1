// The built-in ring.
#include "solid_fe/read_solid_config.hpp"
#include "solid_fe/solid.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

#include <numbers>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

SolidConfig read_ring(const std::string& keys, int dim)
{
  const auto file = CaseFile::parse(
      "[solid]\ndensity = 1000\nyoungs_modulus = 1e6\npoisson_ratio = 0.3\n" + keys, "case.toml");
  auto config = read_solid_config(file, dim, 0.05);
  file.reject_unknown_keys({"solid"});
  return config;
}

} // namespace

// The polygon of n edges has the area n/2 sin(2π/n) r²; each node of a ring is an element's corner twice as
// often as in the open strip's ends, so a seam would show as missing mass or as a boundary of its own.
TEMPLATE_TEST_CASE_SIG("a ring is closed, has its mass and its two surfaces", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  const std::string depth = dim == 3 ? "\ndepth = 0.4" : "", along = dim == 3 ? ", 2" : "";
  for (const char* element : dim == 2 ? std::vector{"T3", "Q4"} : std::vector{"Tet4", "Hex8"})
  {
    const auto config = read_ring(std::string("inner_radius = 0.5\nouter_radius = 0.8\nelement = \"") +
                                      element + "\"\nelements = [24, 3" + along + "]" + depth,
                                  dim);
    const auto mesh = make_mesh<dim>(config);
    const Solid<dim> solid(config, mesh);
    const double polygon = 12.0 * std::sin(2.0 * std::numbers::pi / 24.0);
    CHECK(solid.mass() == Approx(1000.0 * polygon * (0.64 - 0.25) * (dim == 3 ? 0.4 : 1.0)).epsilon(1e-12));
    CHECK(mesh.n_nodes() == 24 * 4 * (dim == 3 ? 3 : 1));
    CHECK(mesh.surfaces.count("left") + mesh.surfaces.count("top") == 0);
    const auto faces = boundary_of(mesh).size();
    index_t named = 0;
    for (const auto& [name, surface] : mesh.surfaces)
      named += surface.size();
    CHECK(named == faces); // no face at the seam
    for (const index_t n : mesh.surfaces.at("inner").node_set())
    {
      const auto& x = mesh.x[static_cast<std::size_t>(n)];
      CHECK(std::hypot(x[0], x[1]) == Approx(0.5).epsilon(1e-14));
    }
  }
}

// Breathing mode of a thin ring, plane stress: ω = √(E/ρ)/R; thickness and chords change it by (h/R)² and
// (π/n)², 1e-3 each.
TEST_CASE("a thin ring breathes with its textbook frequency", "[solid][unit]")
{
  auto config = read_ring("inner_radius = 0.98\nouter_radius = 1.02\nelements = [120, 2]\nplane = "
                          "\"stress\"\norigin = [3.0, -1.0]",
                          2);
  config.material.poisson_ratio = 0.0;
  Solid<2> solid(config, make_mesh<2>(config));
  const auto out = [](const Vec<2>& X)
  {
    const Vec<2> r = X - Vec<2>{{3.0, -1.0}};
    return (1e-3 / norm(r)) * r;
  };
  solid.set_motion(zero_field<2>(), out);
  const double dt = solid.critical_time_step();
  double before = 1.0, turning = 0.0;
  while (turning == 0.0)
  {
    solid.predict(dt);
    solid.solve_free_motion(dt);
    double v = 0.0;
    for (std::size_t n = 0; n < solid.nodes().X.size(); ++n)
      v += solid.nodes().m[n] * dot(solid.nodes().v[n], 1e3 * out(solid.nodes().X[n]));
    v /= solid.mass() * 1e-3;
    if (v < 0.0) // a quarter of the period
      turning = solid.time() - dt * v / (v - before);
    before = v;
  }
  CHECK(turning == Approx(0.5 * std::numbers::pi / std::sqrt(1000.0)).epsilon(2e-3));
}

TEST_CASE("a ring says what it cannot be", "[solid][unit]")
{
  CHECK_THROWS_WITH(read_ring("inner_radius = 0.5\nouter_radius = 0.4", 2),
                    Catch::Contains("larger than inner_radius"));
  CHECK_THROWS_WITH(read_ring("inner_radius = 0.5\nouter_radius = 0.6\nwidth = 1.0", 2),
                    Catch::Contains("width"));
  CHECK_THROWS_WITH(read_ring("inner_radius = 0.5\nouter_radius = 0.6\nelements = [2, 1]", 2),
                    Catch::Contains("at least 3"));
}
