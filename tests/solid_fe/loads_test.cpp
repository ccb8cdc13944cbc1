// Loads over time and cuts; a block that turns for a hundred thousand steps.
#include "common/error.hpp"
#include "solid_fe/field_function.hpp"
#include "solid_fe/read_solid_config.hpp"
#include "solid_fe/solid.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

SolidConfig read_block(const std::string& tables)
{
  const auto file =
      CaseFile::parse("[solid]\ndensity = 1500\nyoungs_modulus = 2.3e5\npoisson_ratio = 0.4\nwidth = "
                      "0.05\nheight = 0.24\n" +
                          tables,
                      "case.toml");
  auto config = read_solid_config(file, 2, 0.05);
  file.reject_unknown_keys({"solid"});
  return config;
}

} // namespace

TEST_CASE("a table multiplies a load over time", "[solid][unit]")
{
  const auto config = read_block(R"case([[solid.velocity]]
on = "left"
value = [2.0, -1.0]
table = [1.0, 0.5, 2.0, 1.5, 4.0, -0.5]
[[solid.acceleration]]
on = "right"
value = [3.0, 0.0]
components = ["x"]
[[solid.traction]]
on = "top"
value = [0.0, 10.0]
table = [0.0, 0.0, 1.0, 1.0]
[[solid.pressure]]
on = "bottom"
function = "x + 1"
table = [0.0, 0.0, 1.0, 2.0]
)case");
  const FieldFunction velocity(config.velocity[0].function, "velocity");
  const Vec<2> X{{7.0, 0.0}};
  for (const auto& [t, factor] :
       {std::pair{0.0, 0.5}, {1.0, 0.5}, {1.25, 0.75}, {2.0, 1.5}, {3.0, 0.5}, {4.0, -0.5}, {9.0, -0.5}})
  {
    CHECK(velocity(0, X, t) == Approx(2.0 * factor).margin(1e-14));
    CHECK(velocity(1, X, t) == Approx(-factor).margin(1e-14));
  }
  CHECK(config.velocity[1].is_acceleration);
  CHECK(FieldFunction(config.velocity[1].function, "a")(0, X, 5.0) == 3.0);
  CHECK(FieldFunction(config.traction[0].function, "t")(1, X, 0.25) == Approx(2.5));
  CHECK(FieldFunction({config.pressure[0].function}, "p")(0, X, 0.5) == Approx(8.0));
  CHECK_THROWS_WITH(
      read_block("[[solid.traction]]\non = \"top\"\nvalue = [1.0, 0.0]\ntable = [1.0, 0.5, 0.5, 1.0]\n"),
      Catch::Contains("times ascending"));
}

// What is in front of a cut obeys Newton: S = Σ (m a − F_ext), to round-off, in motion and for every element.
TEST_CASE("the force through a cut moves what is in front of it", "[solid][unit]")
{
  for (const auto formulation :
       {Formulation::full, Formulation::one_point, Formulation::locking_free, Formulation::beam})
  {
    auto config = soft_config(2, "svk");
    config.formulation = formulation;
    config.gravity = {0.3, -2.0};
    config.fix = {{"left", {"x", "y"}}};
    if (formulation == Formulation::beam)
      config.fix[0].components.push_back("rotation");
    Solid<2> solid(config, box_mesh<2>({}, {{1.0, 0.1}}, {10, 1}, ElementType::quadrilateral4));
    const double dt = solid.critical_time_step();
    for (int k = 0; k < 300; ++k)
    {
      solid.predict(dt);
      solid.solve_free_motion(dt);
    }
    const Vec<2> point{{0.55, 0.0}}, normal{{1.0, 0.0}};
    Vec<2> expected;
    if (const Beam* beam = solid.beam())
      for (std::size_t k = 0; k < beam->n_nodes(); ++k)
      {
        if (beam->X()[k][0] > 0.55)
          expected += beam->mass(k) * (beam->acceleration(k) - Vec<2>{{0.3, -2.0}});
      }
    else
      for (std::size_t n = 0; n < solid.nodes().X.size(); ++n)
        if (solid.nodes().X[n][0] > 0.55)
          expected += solid.nodes().m[n] * (solid.nodes().a[n] - Vec<2>{{0.3, -2.0}});
    const auto [force, moment] = solid.section_force(point, normal);
    INFO("form " << static_cast<int>(formulation));
    CHECK(norm(force - expected) < 1e-10 * norm(expected));
    CHECK(norm(expected) > 1.0);
    CHECK(std::abs(moment[2]) > 1e-3 * norm(expected));
  }
}

// Newmark's explicit scheme keeps Σ x × m v exactly for forces that come from an objective energy; 1e5 sums
// of round-off 1e-16 leave 1e-13. The energy swings with O(Δt²) about its start and does not drift: the mean
// over the second half of the run is that of the first to a tenth of the swing.
TEMPLATE_TEST_CASE_SIG("a block turns for 1e5 steps without a trend", "[solid][verification]",
                       ((int dim), dim), 2, 3)
{
  const auto swing = [&](double fraction)
  {
    auto config = soft_config(dim, "neo_hookean_ln");
    config.formulation = Formulation::one_point;
    Vec<dim> size;
    std::array<int, dim> counts;
    counts.fill(2);
    for (auto& x : size.c)
      x = 1.0;
    Solid<dim> solid(config, box_mesh<dim>(-0.5 * size, size, counts, element_types<dim>()[1]));
    const double spin = 5.0;
    solid.set_motion(zero_field<dim>(),
                     [&](const Vec<dim>& X)
                     {
                       Vec<dim> v;
                       v[0] = -spin * X[1];
                       v[1] = spin * X[0];
                       return v;
                     });
    const double dt = fraction * solid.critical_time_step(), L0 = solid.angular_momentum()[2];
    const double E0 = solid.energies().kinetic;
    double mean[2] = {0.0, 0.0}, largest = 0.0, drift = 0.0;
    const int steps = 100000;
    for (int k = 0; k < steps; ++k)
    {
      solid.predict(dt);
      solid.solve_free_motion(dt);
      if (k % 10 == 0)
      {
        const double error = solid.energies().balance() / E0 - 1.0;
        mean[2 * k / steps] += error * 20.0 / steps;
        largest = std::max(largest, std::abs(error));
        drift = std::max(drift, std::abs(solid.angular_momentum()[2] / L0 - 1.0));
      }
    }
    INFO("fraction " << fraction << ": angular momentum " << drift << ", energy " << largest << ", means "
                     << mean[0] << " " << mean[1]);
    CHECK(drift < 1e-12);
    CHECK(std::abs(mean[1] - mean[0]) < 0.1 * largest);
    CHECK(largest < 0.05);
    return largest;
  };
  const double coarse = swing(0.8), fine = swing(0.4);
  CHECK(coarse / fine > 3.0);
}
