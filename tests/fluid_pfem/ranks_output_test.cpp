// What the fluid writes does not show how many ranks it ran on. Run by mpirun; rank 0 also runs alone.
#include "common/parallel/mpi_ranks.hpp"
#include "fluid_pfem/fluid_output.hpp"
#include "fluid_pfem/run.hpp"
#include "tests/common/io/temporary_folder.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <string>
#include <vector>

using namespace undine;
using namespace undine::fluid;

namespace
{

/// One of each kind. Points lie at both ends of the column: whatever the cut, some are another rank's than 0.
std::vector<ProbeConfig> all_probes()
{
  std::vector<ProbeConfig> probes;
  const auto add = [&probes](const std::string& name, std::vector<std::string> fields) -> ProbeConfig&
  {
    ProbeConfig& probe = probes.emplace_back();
    probe.name = name;
    probe.on = "fluid";
    probe.fields = std::move(fields);
    return probe;
  };
  add("force", {"F"}).wall = "tank";
  add("front", {"front"});
  add("rest", {"hydrostatic_error"});
  add("spin", {"angular_momentum"}).point = {0.1, 0.1};
  add("elevation", {"elevation"}).point = {0.07, 0.0};
  add("bottom", {"x", "v", "p"}).point = {0.01, 0.01};
  add("top", {"x", "v", "p"}).point = {0.1, 0.28};
  add("surface", {"x", "v", "p"}).surface = "top";
  ProbeConfig& gauge = add("gauge", {"p", "v"});
  gauge.point = {0.01, 0.2};
  gauge.radius = 0.03;
  return probes;
}

} // namespace

TEST_CASE("histories of all probes have the same bytes on any number of ranks", "[ranks]")
{
  const TemporaryFolder folder;
  const auto probes = all_probes();
  const auto run = [&](const std::string& name, const Ranks& ranks)
  {
    OutputConfig asked;
    asked.dir = folder / name;
    asked.frames = false;
    asked.history_interval = 0.005;
    FluidConfig config = undine::test::dam_break_config(0.146 / 48);
    Fluid<2> fluid(config, ranks);
    FluidOutput<2> output(asked, probes, fluid);
    const Observer<2> observer([&output](double t, Fluid<2>& f, bool frame) { output.observe(t, f, frame); },
                               [&output] { return output.next(); });
    run_alone<2>(fluid, {.t_end = 0.08}, 0.05, observer);
    return fluid.remeshes();
  };
  const Ranks ranks = ranks_of(MPI_COMM_WORLD, 60.0);
  CHECK(run("ranks", ranks) > 1);
  if (ranks.rank() != 0)
    return;
  run("alone", {});
  std::vector<std::string> files{"fluid_energy", "mass"};
  for (const ProbeConfig& probe : probes)
    files.push_back(probe.name);
  for (const std::string& file : files)
  {
    const auto of = [&](const std::string& name)
    { return content_of(folder / name + "/history/" + file + ".csv"); };
    INFO(file);
    const std::string alone = of("alone");
    CHECK(std::count(alone.begin(), alone.end(), '\n') > 15);
    CHECK(of("ranks") == alone);
  }
}
