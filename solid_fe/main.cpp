// The solid program: alone, or coupled to a fluid through the coupler.
#include "common/io/log.hpp"
#include "common/program/program.hpp"
#include "solid_fe/read_solid_config.hpp"
#include "solid_fe/run.hpp"
#include "solid_fe/solid.hpp"
#include "solid_fe/solid_output.hpp"

#include <fmt/format.h>

#include <cstdio>

namespace
{

using namespace undine;

template <int dim>
void run(const Launch& launch, const solid::SolidConfig& config)
{
  solid::Solid<dim> solid(config, solid::make_mesh<dim>(config));
  if (launch.line.check_only)
  {
    fmt::print("solid: {} nodes, {} elements, {} wet nodes, stable step {:.4g} s\n", solid.nodes().size(), solid.n_elements(),
               solid.n_wet_nodes(), solid.critical_time_step());
    return;
  }
  const bool coupled = launch.coupling.present;
  const link::World world = launch.meet(coupled ? std::vector<std::string>{"coupler"} : std::vector<std::string>{});
  const auto log = make_log(launch.output.dir, launch.role, !coupled);
  log->info("case {}: {} nodes, {} elements, {} wet nodes, stable step {:.4g} s", launch.file.path(), solid.nodes().size(),
            solid.n_elements(), solid.n_wet_nodes(), solid.critical_time_step());

  std::vector<solid::ProbeConfig> probes;
  for (const ProbeConfig& p : launch.probes)
    if (p.on == "solid")
      probes.push_back({.name = p.name, .point = p.point, .definition = ""});
  solid::SolidOutput<dim> output(launch.output.dir, probes, solid);
  const solid::RunTimes times{.t_end = launch.run.t_end,
                              .frame_interval = launch.output.frame_interval,
                              .history_interval = launch.output.history_interval};
  solid::RunResult result;
  if (coupled)
  {
    link::SolverLink link(world.channel("coupler"));
    result = solid::run_coupled<dim>(solid, link, times, &output);
  }
  else
    result = solid::run_alone<dim>(solid, times, &output);
  solid::summarise(solid, result).write(launch.output.dir + "/solid.json");
  log->info("done: {} steps, {:.3g} s of which {:.3g} s waiting", result.steps, result.compute_seconds + result.wait_seconds,
            result.wait_seconds);
}

void start(Launch& launch)
{
  const solid::SolidConfig config = solid::read_solid_config(launch.file, launch.run.dim, launch.run.element_size());
  launch.file.reject_unknown_keys({"solid"});
  if (launch.line.document_keys)
  {
    std::fputs(launch.file.documentation().c_str(), stdout);
    return;
  }
  config.dim == 2 ? run<2>(launch, config) : run<3>(launch, config);
}

} // namespace

int main(int argc, char** argv) { return undine::run_program("solid", argc, argv, start); }
