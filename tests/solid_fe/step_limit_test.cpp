// Longer steps: the measured frequency, and mass scaling.
#include "solid_fe/solid.hpp"
#include "solid_fe/step_watch.hpp"
#include "solid_fe/true_frequency.hpp"
#include "tests/solid_fe/fixtures.hpp"
#include "tests/solid_fe/power_iteration.hpp"

#include <catch2/catch.hpp>

#include <numeric>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

const std::vector<std::string> elastic_laws = {"svk", "neo_hookean_ln", "neo_hookean_j", "hencky",
                                               "mooney_rivlin"};

/// Highest energy over the start's of a random motion at the solid's own step, which is looked at as in a
/// run.
template <int dim>
double highest_energy(const SolidConfig& config, const Mesh<dim>& mesh, double speed, int steps)
{
  Solid<dim> solid(config, mesh);
  Random random(41);
  solid.set_motion(zero_field<dim>(), [&](const Vec<dim>&) { return random.template vector<dim>(speed); });
  const double E0 = solid.energies().kinetic;
  StepWatch<dim> watch;
  double dt = watch.limit(solid), highest = 0.0;
  for (int k = 0; k < steps; ++k)
  {
    dt = std::min(dt, watch.limit(solid));
    solid.predict(dt);
    solid.solve_free_motion(dt);
    if (k % 10 == 0)
    {
      const auto e = solid.energies();
      highest = std::max(highest, (e.kinetic + e.strain + e.hourglass) / E0);
    }
  }
  return highest;
}

} // namespace

// Power iteration, 1500 times, comes to the truth from below, within 1e-3 on these meshes; Lanczos' method
// adds its residual, at most 1 % of ω², and 1 % more.
TEMPLATE_TEST_CASE_SIG("the measured frequency is the true one and at most 2 % more", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
    for (const auto form : {Formulation::full, Formulation::locking_free})
    {
      auto config = soft_config(dim, "neo_hookean_ln");
      config.formulation = form;
      config.fix = {{"bottom", {"x", "y"}}};
      Solid<dim> solid(config, distorted_box<dim>(type, dim == 2 ? 5 : 3));
      Random random(3);
      const auto H = random.matrix<dim>(0.1);
      for (const double amount : {0.0, 1.0})
      {
        solid.set_motion([&](const Vec<dim>& X) { return amount * (H * X); }, zero_field<dim>());
        const double truth = highest_frequency<dim>(solid, solid.nodes().u);
        const double measured = std::sqrt(true_frequency_squared(solid));
        INFO(element_name(type) << " form " << static_cast<int>(form) << ": " << measured / truth);
        CHECK(measured >= truth);
        CHECK(measured < 1.02 * truth);
      }
    }
}

// The plain energy may exceed the conserved one by 1/(1 − 0.85²) = 3.6. (At 0.9 of the limit two of these 20
// motions are caught by the resonance of third order at 0.866.)
TEMPLATE_TEST_CASE_SIG("a motion at the measured step stays bounded for 3000 steps", "[solid][verification]",
                       ((int dim), dim), 2, 3)
{
  double gain = 0.0;
  for (const auto type : element_types<dim>())
    for (const auto& law : elastic_laws)
    {
      auto config = soft_config(dim, law);
      const auto mesh = distorted_box<dim>(type, dim == 2 ? 4 : 3);
      const double bound = Solid<dim>(config, mesh).critical_time_step();
      config.measures_frequency = true;
      const double measured = Solid<dim>(config, mesh).critical_time_step();
      const double highest = highest_energy<dim>(config, mesh, 0.3, 3000);
      INFO(element_name(type) << " " << law << ": step " << measured / bound << " of the bound's, energy "
                              << highest);
      CHECK(measured >= bound);
      CHECK(highest < 3.6);
      gain = std::max(gain, measured / bound);
    }
  CHECK(gain > 1.1);
}

TEST_CASE("a frequency that cannot be measured is refused", "[solid][unit]")
{
  auto config = soft_config(2, "j2");
  config.material.yield_stress = 1e3;
  config.measures_frequency = true;
  CHECK_THROWS_WITH(Solid<2>(config, distorted_box<2>(ElementType::quadrilateral4)),
                    Catch::Contains("solid.step_limit"));
}

// A layer of flat elements in a box: the step wanted is three times theirs.
TEMPLATE_TEST_CASE_SIG("mass scaling gives the wanted step, tells what it added and leaves the weight alone",
                       "[solid][verification]", ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
    for (const auto form : {Formulation::full, Formulation::one_point})
    {
      auto config = soft_config(dim, "neo_hookean_ln");
      config.formulation = form;
      config.gravity = std::vector<double>(dim, 0.0);
      config.gravity[1] = -10.0;
      auto mesh = distorted_box<dim>(type, 6, 0.05);
      const double row = mesh.x.back()[1] / std::max(2, 6 - 1);
      for (auto& x : mesh.x)
        if (x[1] > 0.5 * row)
          x[1] -= 0.8 * row; // the lowest layer is a fifth as high as the others
      const Solid<dim> plain(config, mesh);
      config.scaled_step = 3.0 * plain.critical_time_step();
      const Solid<dim> scaled(config, mesh);
      const double added = std::accumulate(scaled.added_mass().begin(), scaled.added_mass().end(), 0.0);
      INFO(element_name(type) << ": added " << added / plain.mass() << " of the mass");
      CHECK(scaled.critical_time_step() >= config.scaled_step);
      CHECK(scaled.critical_time_step() < 1.2 * config.scaled_step);
      CHECK(scaled.mass() - plain.mass() == Approx(added).epsilon(1e-12));
      CHECK(added > 0.0);
      CHECK(scaled.critical_time_step() <= 2.0 / highest_frequency<dim>(scaled, scaled.nodes().u, 500));
      Vec<dim> weight;
      for (std::size_t n = 0; n < mesh.x.size(); ++n)
      {
        CHECK(scaled.nodes().m[n] >= plain.nodes().m[n] * (1.0 - 1e-14));
        weight += scaled.nodes().m[n] * scaled.nodes().a[n];
      }
      CHECK(weight[1] == Approx(-10.0 * plain.mass()).epsilon(1e-12));
      auto weightless = config;
      weightless.gravity.clear();
      CHECK(highest_energy<dim>(weightless, mesh, 0.1, 2000) < 5.3);

      config.scaled_step = 0.9 * plain.critical_time_step(); // nothing to add
      const Solid<dim> untouched(config, mesh);
      CHECK(untouched.mass() == plain.mass());
      CHECK(untouched.added_mass() == std::vector<double>(untouched.bodies().size(), 0.0));
    }
}
