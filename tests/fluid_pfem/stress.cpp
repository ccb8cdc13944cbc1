// Runs random scenes of fluid and reports what fails: `stress_fluid FIRST_SEED COUNT STEPS [FRACTION]`, a CSV
// row per scene. FRACTION of the step bound that the scenes run with, 0: a random one of each scene between
// 0.3 and 1; without it the preset's.
#include "common/error.hpp"
#include "fluid_pfem/step_looks.hpp"
#include "tests/fluid_pfem/random_scene.hpp"

#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <random>

using namespace undine;
using namespace undine::test;

namespace
{

StressResult run(std::uint64_t seed, std::int64_t steps, double fraction)
{
  StressResult result;
  RandomScene scene = random_scene(seed);
  if (fraction > 0.0)
    scene.config.step_safety = fraction;
  else if (fraction == 0.0)
  {
    std::mt19937_64 random(seed);
    scene.config.step_safety = std::uniform_real_distribution<double>(0.3, 1.0)(random);
  }
  if (scene.config.shape == fluid::Shape::none)
    return result;
  const auto fail = [&](const std::string& what)
  {
    if (result.failure.empty())
      result.failure = what;
  };
  try
  {
    fluid::Fluid<2> fluid(scene.config);
    fluid::StepLooks looks;
    const double& dt = looks.dt;
    const double first = fluid.critical_time_step(), M = fluid.mass(), start = fluid.energy().total(),
                 g = std::hypot(scene.config.gravity[0], scene.config.gravity[1]),
                 moving = fluid.energy().kinetic + M * g;
    std::int64_t slow = 0;
    result.nodes = fluid.nodes().size();
    for (std::int64_t step = 0; step < steps && result.failure.empty();)
    {
      const bool remesh = step > 0 && step % 4 == 0 && fluid.is_distorted();
      if (remesh)
        fluid.remesh();
      if (remesh || looks.is_due(step))
        looks.look(step, fluid.critical_time_step());
      const std::int64_t before = step;
      const auto must_see = [&] { return (step - 1) % 10 == 0; };
      do
        ++step;
      while (step < steps && step % 4 != 0 && !looks.is_due(step) && !must_see());
      fluid.advance(dt, step - before);
      result.steps = step;
      result.slowest = std::min(result.slowest, dt / first);
      slow = dt < first / 50.0 ? slow + step - before : 0;
      if (slow > 100)
        fail("stall");
      if (!must_see())
        continue;
      const auto& nodes = fluid.nodes();
      for (std::size_t n = 0; n < nodes.x.size(); ++n)
      {
        if (!(std::isfinite(nodes.x[n][0] + nodes.x[n][1] + nodes.v[n][0] + nodes.v[n][1] + nodes.p[n])))
          fail("not finite");
        result.behind_wall =
            std::max(result.behind_wall, scene.behind(nodes.x[n]) / scene.config.element_size);
      }
      result.mass = std::max(result.mass, std::abs(fluid.mass() / M - 1.0));
      const fluid::FluidEnergy e = fluid.energy();
      result.energy = std::max(result.energy, (e.total() - start) / std::max(moving, 1e-300));
    }
    result.remeshes = fluid.remeshes();
  }
  catch (const std::exception& error)
  {
    fail(error.what());
  }
  if (result.behind_wall > 0.02)
    fail("behind a wall");
  if (result.mass > 1e-10)
    fail("mass");
  if (result.energy > 0.02)
    fail("energy");
  return result;
}

} // namespace

int main(int argc, char** argv)
{
  const std::uint64_t first = argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 1;
  const std::uint64_t count = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 20;
  const std::int64_t steps = argc > 3 ? std::strtoll(argv[3], nullptr, 10) : 3000;
  const double fraction = argc > 4 ? std::atof(argv[4]) : -1.0;
  fmt::print("seed,nodes,steps,remeshes,slowest_step,behind_wall,mass,energy_rise,seconds,failure\n");
  int failed = 0;
  for (std::uint64_t seed = first; seed < first + count; ++seed)
  {
    const auto begin = std::chrono::steady_clock::now();
    const StressResult r = run(seed, steps, fraction);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    failed += !r.failure.empty();
    fmt::print("{},{},{},{},{:.3g},{:.3g},{:.2g},{:.3g},{:.2g},\"{}\"\n", seed, r.nodes, r.steps, r.remeshes,
               r.slowest, r.behind_wall, r.mass, r.energy, seconds, r.failure);
    std::fflush(stdout);
  }
  fmt::print("# {} of {} scenes failed\n", failed, count);
  return failed > 0;
}
