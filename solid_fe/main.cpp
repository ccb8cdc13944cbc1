// The solid program: alone, or coupled to a fluid through the coupler.
#include "common/error.hpp"
#include "common/io/log.hpp"
#include "common/parallel/time_split.hpp"
#include "common/program/program.hpp"
#include "solid_fe/describe.hpp"
#include "solid_fe/modes.hpp"
#include "solid_fe/read_solid_config.hpp"
#include "solid_fe/run.hpp"
#include "solid_fe/solid.hpp"
#include "solid_fe/solid_output.hpp"

#include <mpi.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <optional>

namespace
{

using namespace undine;

/// Logs the progress once per second on a terminal, every 30 s otherwise.
class Reporter
{
public:
  Reporter(std::shared_ptr<spdlog::logger> log, double t_end)
      : log_(std::move(log)), t_end_(t_end), period_(isatty(STDERR_FILENO) != 0 ? 1.0 : 30.0)
  {
  }
  bool operator()(double t, std::int64_t step, double dt)
  {
    const auto now = std::chrono::steady_clock::now();
    if (std::chrono::duration<double>(now - last_).count() > period_)
    {
      log_->info("t = {:.6g} s ({:.1f} %), step {}, dt {:.3g} s", t, 100.0 * t / t_end_, step, dt);
      last_ = now;
    }
    return true;
  }

private:
  std::shared_ptr<spdlog::logger> log_;
  double t_end_, period_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

/// The roles that must be there. A coupled case in a world of one process runs its solid alone.
std::vector<std::string> partners(const Launch& launch)
{
  int size = 1;
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  return launch.coupling.present && size > 1 ? std::vector<std::string>{"coupler"}
                                             : std::vector<std::string>{};
}

template <int dim>
ExitCode run(const Launch& launch, const solid::SolidConfig& config)
{
  solid::Solid<dim> solid(config, solid::make_mesh<dim>(config));
  solid::check_probes(launch.probes, solid);
  const std::string description = describe(config, solid, launch.run.t_end);
  if (launch.line.check_only)
  {
    std::fputs(description.c_str(), stdout);
    return ExitCode::success;
  }
  if (launch.line.modes > 0)
  {
    std::printf("mode  frequency [Hz]\n");
    const auto frequencies = solid::natural_frequencies(solid, launch.line.modes);
    for (std::size_t k = 0; k < frequencies.size(); ++k)
      std::printf("%4zu  %.9g\n", k + 1, frequencies[k]);
    return ExitCode::success;
  }
  const link::World world = launch.meet(partners(launch));
  const bool coupled = world.coupled();
  const Ranks ranks = launch.ranks(world);
  const bool first = ranks.rank() == 0;
  if (coupled)
    launch.require_owners(world, ranks);
  solid.distribute(ranks);
  const auto log = first ? make_log(launch.output.dir, launch.role, !coupled) : no_log();
  log->info("solid_fe {}, {}, {} rank{}\n{}", UNDINE_VERSION, coupled ? "coupled" : "alone", ranks.size(),
            ranks.alone() ? "" : "s", description);
  if (launch.coupling.present && !coupled)
    log->warn("the case has a [coupling] table but no coupler was started: the solid runs alone");

  solid::SolidOutput<dim> output(launch.output, launch.probes, solid);
  const solid::RunTimes times{.t_end = launch.run.t_end,
                              .frame_interval = launch.output.frame_interval,
                              .history_interval = launch.output.history_interval};
  std::optional<link::SolverLink> coupler;
  if (coupled) // every rank for its own wet nodes
    coupler.emplace(world.path("coupler", 0), ranks.rank());
  const TimeSplit split(ranks);
  const auto summarise = [&](const solid::RunResult& result, const char* status, ExitCode code)
  {
    const auto times = split.of_ranks(coupler ? coupler->wait_seconds() : 0.0);
    auto summary = solid::summarise(solid, result);
    if (!first)
      return;
    if (!ranks.alone())
      write(summary, "", times);
    summary.set("status", status);
    summary.set("exit_code", static_cast<int>(code));
    summary.write(launch.output.dir + "/" + launch.role + ".json");
  };
  Checkpoints checkpoints = launch.checkpoints(*log);
  const Persistence persistence = launch.persistence(
      checkpoints, [&](StateArchive& archive) { archive("output", output); }, ranks);
  try
  {
    const Reporter reporter(log, launch.run.t_end);
    const auto result = coupled ? solid::run_coupled<dim>(solid, {coupler ? &*coupler : nullptr, ranks},
                                                          times, &output, reporter, persistence)
                                : solid::run_alone<dim>(solid, times, &output, reporter, persistence);
    const bool stopped = !result.stop_reason.empty();
    const ExitCode code = stopped ? ExitCode::stopped : ExitCode::success;
    summarise(result, stopped ? "stopped" : "completed", code);
    if (stopped)
      log->info("stopped: {}; continue with --restart latest", result.stop_reason);
    log->info("{} at t = {:.9g} s after {} steps, {:.3g} s of computing, {:.3g} s of waiting; energy "
              "drift {:.3g}",
              stopped ? "stopped" : "completed", result.t_end, result.steps, result.compute_seconds,
              result.wait_seconds, result.energy_drift);
    return code;
  }
  catch (const NumericalError& error)
  {
    if (coupler && first)
      coupler->send_failure(static_cast<int>(error.code()), error.what());
    if (ranks.alone()) // the state that broke is what one wants to see; of several ranks the others are gone
                       // on
    {
      output.write_frame(solid);
      summarise({.t_end = solid.time(), .steps = solid.steps()}, "failed", error.code());
    }
    throw;
  }
  catch (const Failure& failure)
  {
    if (coupler && first)
      coupler->send_failure(static_cast<int>(failure.code()), failure.what());
    throw;
  }
}

ExitCode start(Launch& launch)
{
  const solid::SolidConfig config =
      solid::read_solid_config(launch.file, launch.run.dim, launch.run.element_size(), launch.role);
  launch.output.part = launch.role;
  std::erase_if(launch.probes, [&launch](const ProbeConfig& probe) { return probe.on != launch.role; });
  for (ProbeConfig& probe : launch.probes)
    probe.on = "solid";
  launch.file.reject_unknown_keys({"solid"});
  if (launch.line.document_keys)
  {
    std::fputs(launch.file.documentation().c_str(), stdout);
    return ExitCode::success;
  }
  return config.dim == 2 ? run<2>(launch, config) : run<3>(launch, config);
}

} // namespace

int main(int argc, char** argv) { return undine::run_program("solid", argc, argv, start); }
