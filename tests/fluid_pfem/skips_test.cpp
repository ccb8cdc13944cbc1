// What is left out when it is not needed, and that leaving it out changes nothing.
#include "common/error.hpp"
#include "fluid_pfem/fluid_output.hpp"
#include "fluid_pfem/run.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include <unistd.h>

using namespace undine;
using namespace undine::fluid;

namespace
{

/// The collapsing column with its splash to t, `observe`d.
template <class Observe>
Fluid<2> dam_break(double mu, double t, Observe&& observe)
{
  FluidConfig config = undine::test::dam_break_config(0.146 / 10);
  config.terms.mu = mu;
  Fluid<2> fluid(config);
  run_alone<2>(fluid, {.t_end = t}, 0.02, observe);
  return fluid;
}

void check_same_bits(const Fluid<2>& a, const Fluid<2>& b)
{
  CHECK(a.steps() == b.steps());
  CHECK(a.nodes().x == b.nodes().x);
  CHECK(a.nodes().v == b.nodes().v);
  CHECK(a.nodes().M == b.nodes().M);
  CHECK(a.nodes().p == b.nodes().p);
}

} // namespace

// Truth: stresses 1e-300 times those of water are far below the last bit of every force, so the fluid that
// computes them is the one that does not.
TEST_CASE("without viscosity no viscous work is done, and nothing else changes", "[fluid][unit]")
{
  const auto nothing = [](double, const Fluid<2>&, bool) {};
  const Fluid<2> without = dam_break(0.0, 0.5, nothing), with = dam_break(1e-300, 0.5, nothing);
  CHECK(without.remeshes() > 20);
  check_same_bits(without, with);
}

TEST_CASE("output does not change the run, and what nobody asked for is not written", "[fluid][unit]")
{
  const std::filesystem::path dir =
      std::filesystem::temp_directory_path() / ("undine_skips_" + std::to_string(getpid()));
  const auto run = [&](const char* name, bool asked)
  {
    OutputConfig config;
    config.dir = (dir / name).string();
    config.frames = asked;
    config.history_interval = asked ? 0.0 : 1e9;
    std::filesystem::create_directories(dir / name / "history");
    std::unique_ptr<FluidOutput<2>> output;
    return dam_break(0.0, 0.3,
                     [&](double t, Fluid<2>& fluid, bool frame)
                     {
                       if (!output)
                         output = std::make_unique<FluidOutput<2>>(config, std::vector<ProbeConfig>{}, fluid);
                       output->observe(t, fluid, frame);
                     });
  };
  const Fluid<2> silent = dam_break(0.0, 0.3, [](double, const Fluid<2>&, bool) {});
  check_same_bits(silent, run("asked", true));
  check_same_bits(silent, run("not_asked", false));
  const auto size = [&](const char* name, const char* file)
  {
    const auto path = dir / name / file;
    return std::filesystem::exists(path) ? std::filesystem::file_size(path) : 0;
  };
  CHECK(size("asked", "fluid.h5") > 15 * 1000);
  CHECK(size("not_asked", "fluid.h5") < 5000); // a file without frames
  CHECK(size("not_asked", "history/mass.csv") < 0.05 * size("asked", "history/mass.csv"));
  std::filesystem::remove_all(dir);
}

// Rows that are not written change none that is: those of a run with a row every 10 ms are among those of a
// row every step, and the forces on a wall, means over the time since the row before, carry the same impulse.
TEST_CASE("a row now and then says what a row every step says at that time", "[fluid][unit]")
{
  const std::filesystem::path dir =
      std::filesystem::temp_directory_path() / ("undine_rows_" + std::to_string(getpid()));
  const auto run = [&](const char* name, double interval)
  {
    OutputConfig config;
    config.dir = (dir / name).string();
    config.frames = false;
    config.history_interval = interval;
    std::filesystem::create_directories(dir / name / "history");
    ProbeConfig force;
    force.name = "force";
    force.on = "fluid";
    force.wall = "tank";
    force.fields = {"F"};
    std::unique_ptr<FluidOutput<2>> output;
    dam_break(0.0, 0.3,
              [&](double t, Fluid<2>& fluid, bool frame)
              {
                if (!output)
                  output = std::make_unique<FluidOutput<2>>(config, std::vector<ProbeConfig>{force}, fluid);
                output->observe(t, fluid, frame);
              });
  };
  run("all", 0.0);
  run("some", 0.01);
  const auto rows = [&](const char* name, const char* file)
  {
    std::ifstream in(dir / name / "history" / file);
    std::vector<std::string> lines;
    for (std::string line; std::getline(in, line);)
      if (!line.empty() && std::string("#t").find(line[0]) == std::string::npos)
        lines.push_back(line);
    return lines;
  };
  for (const char* file : {"mass.csv", "fluid_energy.csv"})
  {
    const auto all = rows("all", file), some = rows("some", file);
    CHECK(some.size() >= 30);
    CHECK(some.size() < all.size() / 10);
    CHECK(std::all_of(some.begin(), some.end(),
                      [&](const std::string& row)
                      { return std::find(all.begin(), all.end(), row) != all.end(); }));
  }
  const auto impulse = [&](const char* name)
  {
    double sum = 0.0, before = 0.0;
    for (const std::string& row : rows(name, "force.csv"))
    {
      double t = 0.0, Fx = 0.0, Fy = 0.0;
      REQUIRE(std::sscanf(row.c_str(), "%lf,%lf,%lf", &t, &Fx, &Fy) == 3);
      sum += Fy * (t - before);
      before = t;
    }
    return sum;
  };
  CHECK(impulse("some") == Approx(impulse("all")).epsilon(1e-6)); // digits of the file
  std::filesystem::remove_all(dir);
}

// The splash takes steps below three quarters of the longest one; with that as the limit it ends the run,
// with the limit of the default it does not.
TEST_CASE("a step that stays below a fraction of the largest one ends the run", "[fluid][unit]")
{
  const auto run = [](double collapse)
  {
    FluidConfig config = undine::test::dam_break_config(0.146 / 10);
    config.collapse = collapse;
    Fluid<2> fluid(config);
    run_alone<2>(fluid, {.t_end = 1.0}, 0.0, [](double, const Fluid<2>&, bool) {});
  };
  CHECK_NOTHROW(run(1e-3));
  CHECK_NOTHROW(run(0.0));
  try
  {
    run(0.75);
    FAIL("no failure");
  }
  catch (const NumericalError& error)
  {
    CHECK(error.code() == ExitCode::numerical_failure);
    for (const char* part :
         {"fluid step ", "collapsed", "fluid.collapse = 0.75", "nodes", " at (", "quality"})
      CHECK_THAT(error.what(), Catch::Contains(part));
  }
}
