// Hundreds of short coupled runs with random data: whatever the densities, stiffnesses, meshes, roles and
// step ratios, the interface makes no energy.
#include "tests/coupled/in_memory.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>

using namespace undine;
using undine::test::run_in_memory;

namespace
{

struct Scene
{
  double solid_density = 0.0, youngs_modulus = 0.0, sound_speed = 0.0, fluid_size = 0.0, solid_size = 0.0,
         speed = 0.0;
  std::optional<std::int64_t> substeps;
  std::string kind;
  bool contact = false;
};

/// A block of water and a block of solid on top of each other between slip walls, the water moving down
/// against the solid.
/// @returns energy made by the interface and the largest energy in motion [J]
std::pair<double, double> run(const Scene& scene, std::int64_t windows)
{
  fluid::FluidConfig f;
  f.dim = 2;
  const double c = scene.sound_speed;
  f.tait = {.rho0 = 1000.0, .p0 = 0.0, .B = 1000.0 * c * c / 7.0, .gamma = 7.0};
  f.origin = {0.0, 0.1, 0.0};
  f.size = {0.1, 0.1, 0.0};
  f.element_size = scene.fluid_size;
  f.terms.bulk_linear = 0.05;
  f.remesh.every = 20;
  f.interfaces = {{"wet", scene.contact ? "boundary" : "bottom"}};
  f.walls.push_back({"left"});
  f.walls.push_back({"right"});
  solid::SolidConfig s;
  s.dim = 2;
  s.geometry.origin = {0.0, 0.0};
  s.geometry.size = {0.1, 0.1};
  s.geometry.elements = solid::element_counts(s.geometry.size, scene.solid_size);
  s.material.law = "neo_hookean_ln";
  s.material.density = scene.solid_density;
  s.material.youngs_modulus = scene.youngs_modulus;
  s.material.poisson_ratio = 0.3;
  s.gravity = {0.0, 0.0};
  s.initial_velocity = {0.0, 0.0};
  s.fix = {{"bottom", {"x", "y"}}, {"left", {"x"}}, {"right", {"x"}}};
  s.wet = {{"wet", "top"}};
  fluid::Fluid<2> fluid(f);
  fluid.set_velocity(
      std::vector<Vec<2>>(static_cast<std::size_t>(fluid.nodes().size()), Vec<2>{{0.0, -scene.speed}}));
  solid::Solid<2> solid(s, solid::make_mesh<2>(s));

  coupler::CouplerConfig config;
  config.run.dim = 2;
  const double step = scene.substeps || scene.contact
                          ? std::min(fluid.critical_time_step(), solid.critical_time_step())
                          : std::max(fluid.critical_time_step(), solid.critical_time_step());
  config.run.t_end = static_cast<double>(windows) * step * static_cast<double>(scene.substeps.value_or(1));
  config.coupling.present = true;
  config.coupling.interfaces = {{"wet", f.interfaces[0].second, "top", scene.kind, scene.contact, "finer"}};
  config.coupling.substeps = scene.substeps;
  double made = 0.0, largest = 0.0;
  run_in_memory(fluid, solid, config,
                [&](const coupler::WindowRecord& r)
                {
                  largest = std::max(largest, r.fluid.kinetic_energy + r.solid.kinetic_energy);
                  made = std::max(made, r.balance.work[0] + r.balance.work[1]);
                });
  return {made, largest};
}

Scene random_scene(unsigned seed)
{
  std::mt19937 random(seed);
  const auto between = [&](double low, double high) // evenly in the logarithm
  { return low * std::pow(high / low, std::uniform_real_distribution<double>(0.0, 1.0)(random)); };
  Scene scene;
  scene.solid_density = between(1.0, 1e5); // 1e-3 to 1e2 of the water's
  scene.fluid_size = between(0.005, 0.02);
  scene.solid_size = std::clamp(scene.fluid_size * between(0.1, 10.0), 0.004, 0.05);
  scene.sound_speed = between(10.0, 1000.0);
  // Steps of the two sides at most 100 apart: wave speed of the solid from that of the water.
  const double wave = scene.sound_speed * scene.solid_size / scene.fluid_size * between(0.02, 50.0);
  scene.youngs_modulus = scene.solid_density * wave * wave;
  scene.speed = 1e-3 * scene.sound_speed;
  const int variant = static_cast<int>(random() % 4);
  scene.contact = variant == 0;
  scene.kind = variant == 1 || (variant == 0 && seed % 2 == 0) ? "no_slip" : "slip";
  return scene;
}

} // namespace

// With equal steps the interface makes nothing, with sub-cycling it can only lose (docs/theory.md [14]), for
// linear sides and a constant window. Works are trapezoidal sums at integer times: they may exceed zero in
// between by what is stored in the acceleration jump, a few percent of the energy of the first impact.
TEST_CASE("random coupled runs make no energy at the interface", "[coupled][stress]")
{
  const char* wanted = std::getenv("UNDINE_STRESS_RUNS");
  const unsigned runs = wanted ? static_cast<unsigned>(std::atoi(wanted)) : 300;
  double worst = 0.0;
  for (unsigned seed = 1; seed <= runs; ++seed)
  {
    const Scene scene = random_scene(seed);
    CAPTURE(seed, scene.solid_density, scene.youngs_modulus, scene.sound_speed, scene.fluid_size,
            scene.solid_size, scene.kind, scene.contact);
    const auto [made, largest] = run(scene, 40);
    worst = std::max(worst, made / largest);
    CHECK(made < 0.05 * largest);
  }
  WARN("largest energy made over the largest kinetic energy: " << worst);
}
