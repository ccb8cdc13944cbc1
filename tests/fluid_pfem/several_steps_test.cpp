// Several steps in one sweep over the nodes.
#include "common/io/state_archive.hpp"
#include "fluid_pfem/fluid_output.hpp"
#include "fluid_pfem/run.hpp"
#include "fluid_pfem/step_looks.hpp"
#include "tests/fluid_pfem/fixtures.hpp"
#include "tests/fluid_pfem/random_scene.hpp"

#include <catch2/catch.hpp>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <unistd.h>

using namespace undine;
using namespace undine::fluid;

namespace
{

/// A folder of this test, gone at its end.
struct Folder
{
  std::filesystem::path path =
      std::filesystem::temp_directory_path() / ("undine_several_" + std::to_string(getpid()));
  Folder() { std::filesystem::create_directories(path); }
  ~Folder() { std::filesystem::remove_all(path); }
};

std::string bytes_of(const std::filesystem::path& path)
{
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

struct Run
{
  std::string state; ///< all that a later step depends on, and every ledger: a checkpoint, byte by byte
  std::int64_t remeshes = 0, in_sweeps = 0;
};

/// `steps` steps with the looks of run_alone, up to `together` of them at once.
Run run(FluidConfig config, std::int64_t steps, int together, int threads)
{
  config.threads = threads;
  Fluid<2> fluid(config);
  StepLooks looks;
  Run run;
  for (std::int64_t step = 0; step < steps;)
  {
    const bool remesh = step > 0 && step % 4 == 0 && fluid.is_distorted();
    if (remesh)
      fluid.remesh();
    if (remesh || looks.is_due(step))
      looks.look(step, fluid.critical_time_step());
    int count = 0;
    do
    {
      ++count;
      ++step;
    } while (count < together && step < steps && step % 4 != 0 && !looks.is_due(step));
    run.in_sweeps += fluid.in_one_sweep(count) > 1 ? count : 0;
    fluid.advance(looks.dt, count);
  }
  run.remeshes = fluid.remeshes();
  const Folder folder;
  StateArchive archive((folder.path / "state.h5").string(), fluid.ranks());
  fluid.for_each_state(archive);
  archive.save();
  run.state = bytes_of(folder.path / "state.h5");
  return run;
}

/// Threads and steps taken at once.
using Ways = std::vector<std::pair<int, int>>;

/// Truth: steps one by one. Every formula and the order of every sum are the same, hence all bits.
void check_same_bits(const FluidConfig& config, std::int64_t steps, std::int64_t least_remeshes,
                     const Ways& ways, bool in_sweeps)
{
  const Run single = run(config, steps, 1, 1);
  CHECK(single.remeshes >= least_remeshes);
  CHECK(single.in_sweeps == 0);
  for (const auto& [threads, together] : ways)
  {
    const Run several = run(config, steps, together, threads);
    CAPTURE(threads, together, several.in_sweeps);
    CHECK(several.remeshes == single.remeshes);
    CHECK((!in_sweeps || several.in_sweeps > steps / 2));
    CHECK(several.state.size() > 10000);
    CHECK((several.state == single.state)); // not to be printed
  }
}

} // namespace

TEST_CASE("several steps in one sweep have the bits of single ones", "[fluid][unit]")
{
  // Threads share a sweep only where each has nodes for all of its cuts; 400 are too few.
  const bool large = GENERATE(false, true);
  FluidConfig config = undine::test::dam_break_config(0.146 / (large ? 40 : 14));
  const auto check = [&](std::int64_t steps, std::int64_t remeshes)
  {
    if (large)
      check_same_bits(config, steps / 2, remeshes / 10, {{2, 4}, {3, 3}}, true);
    else
    {
      check_same_bits(config, steps, remeshes, {{1, 3}, {1, 4}}, true);
      check_same_bits(config, steps, remeshes, {{2, 4}}, false);
    }
  };
  SECTION("a dam break through its impact") { check(1000, 10); }
  SECTION("with viscosity")
  {
    config.terms.mu = 1.0;
    check(400, 2);
  }
  SECTION("without stabilisers")
  {
    config.terms = {};
    config.feedback_time = 0.0;
    check(400, 2);
  }
  SECTION("with quadratic viscosity, a free surface without tension and no floor")
  {
    config.terms.bulk_quadratic = 1.2;
    config.terms.residual_with_acceleration = false;
    config.surface_tension_allowed = false;
    config.inertia_floor = 0.0;
    check(400, 2);
  }
  SECTION("while gravity comes up")
  {
    config.gravity_ramp = 0.05;
    check(400, 0);
  }
  SECTION("between walls of the box, at which nodes stay")
  {
    config.walls = {{"left", WallKind::slip}, {"bottom", WallKind::no_slip}};
    check(400, 1);
  }
  SECTION("in a rolling tank")
  {
    config.contact_walls.front().motion.angle = Expression("0.2*sin(12*t)", "roll");
    config.contact_walls.front().no_slip = true;
    check(400, 2);
  }
  SECTION("in a periodic channel")
  {
    config.contact_walls.clear();
    config.gravity = {};
    config.period = {0.146, 0.0, 0.0};
    config.initial_velocity = {Expression("1", "flow"), Expression("0.1*cos(43.03*x)", "flow")};
    check(800, 1);
  }
}

TEST_CASE("random scenes have the bits of single steps", "[fluid][unit]")
{
  for (const std::uint64_t seed : {2, 4, 8, 43})
  {
    const FluidConfig config = undine::test::random_scene(seed).config;
    if (config.shape == Shape::none)
      continue;
    CAPTURE(seed);
    check_same_bits(config, 300, 0, {{1, 3}, {1, 4}}, true);
    check_same_bits(config, 300, 0, {{2, 4}}, false);
  }
}

// The observer that says when it wants to see the fluid against the one that is shown every step.
TEST_CASE("files are the same whether or not every step is shown to the output", "[fluid][unit]")
{
  const Folder folder;
  const bool gauge = GENERATE(false, true);
  std::int64_t seen = 0, steps = 0;
  const auto files = [&](const char* name, bool says_when)
  {
    OutputConfig asked;
    asked.dir = (folder.path / name).string();
    asked.history_interval = gauge ? 0.02 : 0.0033;
    std::filesystem::create_directories(folder.path / name / "history");
    std::vector<ProbeConfig> probes(gauge ? 2 : 1);
    probes[0].name = "force";
    probes[0].on = "fluid";
    probes[0].wall = "tank";
    probes[0].fields = {"F"};
    if (gauge)
    {
      probes[1].name = "gauge";
      probes[1].on = "fluid";
      probes[1].point = {0.01, 0.01};
      probes[1].radius = 0.02;
      probes[1].fields = {"p"};
    }
    Fluid<2> fluid(undine::test::dam_break_config(0.146 / 14));
    FluidOutput<2> output(asked, probes, fluid);
    seen = 0;
    const auto look = [&](double t, Fluid<2>& f, bool frame)
    {
      ++seen;
      output.observe(t, f, frame);
    };
    Observer<2> observer(look);
    if (says_when)
      observer.next = [&output] { return output.next(); };
    run_alone<2>(fluid, {.t_end = 0.2}, 0.05, observer);
    steps = fluid.steps();
    std::string all;
    for (const char* file : {"history/force.csv", "history/mass.csv", "history/fluid_energy.csv", "fluid.h5"})
      all += bytes_of(folder.path / name / file);
    return gauge ? all + bytes_of(folder.path / name / "history/gauge.csv") : all;
  };
  const std::string every = files("every", false);
  CHECK(seen == steps + 1);
  const std::string some = files("some", true);
  CHECK(seen < (gauge ? 0.7 : 0.5) * static_cast<double>(steps));
  CHECK(every.size() > 100000);
  CHECK((some == every)); // not to be printed
}
