// The fluid program: alone, or coupled to a solid through the coupler.
#include "common/io/log.hpp"
#include "common/io/summary.hpp"
#include "common/large_arrays.hpp"
#include "common/parallel/time_split.hpp"
#include "common/program/large_arrays.hpp"
#include "common/program/program.hpp"
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/fluid_config.hpp"
#include "fluid_pfem/fluid_output.hpp"
#include "fluid_pfem/run.hpp"

#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <optional>
#include <vector>

namespace
{

using namespace undine;

template <int dim>
ExitCode check(const fluid::FluidConfig& config)
{
  fluid::Fluid<dim> fluid(config);
  fmt::print("fluid: {} nodes, {} elements, {} wet nodes, spacing {:.4g} m, c = {:.5g} m/s, stable step "
             "{:.4g} s\n",
             fluid.nodes().size(), fluid.mesh().n_elements(), fluid.n_wet(), config.element_size,
             config.tait.sound_speed(config.tait.rho0), fluid.critical_time_step());
  return ExitCode::success;
}

/// @param drift of the mass  @param wall of the run [s]  @param wait of it for the coupler [s]
template <int dim>
Summary summary_of(const fluid::Fluid<dim>& fluid, const Ranks& ranks, double drift, double wall, double wait,
                   const std::vector<RankTime>& times)
{
  Summary summary;
  summary.set("fluid.t_end", fluid.time());
  summary.set("fluid.steps", fluid.steps());
  summary.set("fluid.ranks", ranks.size());
  summary.set("fluid.rank_wait_s", ranks.cost().wall);
  summary.set("fluid.wall_s", wall);
  summary.set("fluid.wait_s", wait);
  summary.set("fluid.nodes", fluid.nodes().size());
  summary.set("fluid.ns_per_node_step",
              1e9 * (wall - wait) / (static_cast<double>(fluid.steps()) * fluid.nodes().size()));
  summary.set("fluid.remeshes", fluid.remeshes());
  summary.set("fluid.mass_drift", drift);
  if (!ranks.alone())
    write(summary, "fluid.", times);
  return summary;
}

template <int dim>
ExitCode run(const Launch& launch, const fluid::FluidConfig& config)
{
  if (launch.line.check_only)
    return check<dim>(config);
  const bool coupled = launch.coupling.present;
  const link::World world =
      launch.meet(coupled ? std::vector<std::string>{"coupler"} : std::vector<std::string>{});
  const Ranks ranks = launch.ranks(world);
  const bool first = ranks.rank() == 0;
  if (coupled)
    launch.require_owners(world, ranks);
  if (ranks.alone())
    large_arrays().all_rows_will_be_touched();
  fluid::Fluid<dim> fluid(config, ranks);
  const auto log = first ? make_log(launch.output.dir, launch.role, !coupled) : no_log();
  log->info("case {}: {} nodes, {} elements, {} wet nodes, stable step {:.4g} s, {} rank{}",
            launch.file.path(), fluid.nodes().size(), fluid.mesh().n_elements(), fluid.n_wet(),
            fluid.critical_time_step(), ranks.size(), ranks.alone() ? "" : "s");

  OutputConfig asked = launch.output;
  if (!coupled && !asked.history_asked) // a row every step would cost half of the run
    asked.history_interval = (launch.run.t_end - launch.run.t_begin) / 1000.0;
  fluid::FluidOutput<dim> output(asked, launch.probes, fluid);
  const auto begin = std::chrono::steady_clock::now();
  const TimeSplit split(ranks);
  const double mass = fluid.mass();
  const fluid::Observer<dim> observe([&](double t, fluid::Fluid<dim>& f, bool frame)
                                     { output.observe(t, f, frame); },
                                     [&] { return output.next(); });
  Checkpoints checkpoints = launch.checkpoints(*log);
  const Persistence persistence = launch.persistence(
      checkpoints, [&](StateArchive& archive) { archive("output", output); }, ranks);
  std::string stopped;
  double wait = 0.0;
  const auto last_state = [&](const NumericalError& failure)
  {
    if (!ranks.alone()) // only what this rank computes is there
      return failure;
    std::string where = "the last state is the last frame of fluid.h5";
    try
    {
      output.write_frame(fluid.time(), fluid);
    }
    catch (const Failure&)
    {
      where = "the last state could not be written";
    }
    return NumericalError(fmt::format("{}; {}, t = {:.9g} s", failure.what(), where, fluid.time()));
  };
  if (coupled)
  {
    std::optional<link::SolverLink> link;
    link.emplace(world.path("coupler", 0), ranks.rank()); // every rank for its own wet nodes
    try
    {
      fluid::run_coupled<dim>(fluid, {&*link, ranks}, asked.history_interval, observe, persistence);
    }
    catch (const Failure& failure)
    {
      if (first)
        link->send_failure(static_cast<int>(failure.code()), failure.what());
      if (const auto* numerical = dynamic_cast<const NumericalError*>(&failure))
        throw last_state(*numerical);
      throw;
    }
    wait = link->wait_seconds();
  }
  else
    try
    {
      stopped = fluid::run_alone<dim>(fluid, launch.run, launch.output.frame_interval, observe, persistence);
    }
    catch (const NumericalError& failure)
    {
      throw last_state(failure);
    }

  const double drift = fluid.mass() / mass - 1.0;
  const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  const std::vector<RankTime> times = split.of_ranks(wait);
  if (!first)
    return stopped.empty() ? ExitCode::success : ExitCode::stopped;
  summary_of(fluid, ranks, drift, wall, wait, times).write(launch.output.dir + "/fluid.json");
  log->info("done: {} steps, {} remeshes, {:.3g} s of which {:.3g} s waiting", fluid.steps(),
            fluid.remeshes(), wall, wait);
  if (!stopped.empty())
    log->info("stopped at t = {:.9g} s: {}; continue with --restart latest", fluid.time(), stopped);
  return stopped.empty() ? ExitCode::success : ExitCode::stopped;
}

ExitCode start(Launch& launch)
{
  const fluid::FluidConfig config = fluid::read_fluid(launch.file, launch.run, launch.coupling);
  launch.file.reject_unknown_keys({"fluid"});
  if (launch.line.document_keys)
  {
    std::fputs(launch.file.documentation().c_str(), stdout);
    return ExitCode::success;
  }
  return config.dim == 2 ? run<2>(launch, config) : run<3>(launch, config);
}

} // namespace

int main(int argc, char** argv)
{
  undine::recycle_large_arrays();
  return undine::run_program("fluid", argc, argv, start);
}
