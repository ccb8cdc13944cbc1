// What is left out when it is not needed, and that leaving it out changes nothing.
#include "fluid_pfem/fluid_output.hpp"
#include "fluid_pfem/run.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>

#include <filesystem>
#include <memory>
#include <string>

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
