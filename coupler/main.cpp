// The coupler program: joins one fluid and one solid.
#include "common/error.hpp"
#include "common/io/log.hpp"
#include "common/program/program.hpp"
#include "coupler/coupler_output.hpp"
#include "coupler/run.hpp"
#include "coupler/run_contact.hpp"
#include "coupler/staggered.hpp"

#include <fmt/format.h>

#include <cstdio>

namespace
{

using namespace undine;

/// The scheme of the case must be one that both participants can take part in.
void require_level(const CouplingConfig& coupling, const link::World& world)
{
  const std::string& scheme = coupling.scheme;
  const auto can = [&world](const char* role, std::uint64_t capability)
  { return (world.capabilities_of(role) & capability) != 0; };
  const std::string solid = "'solid' (" + world.solver_of("solid") + ")";
  if (!can("fluid", link::capability::link))
    throw InputError("'fluid' (" + world.solver_of("fluid") +
                     ") does not give free velocities (level B); every scheme needs a fluid that does");
  if (scheme == "gc" && !can("solid", link::capability::link))
    throw InputError("coupling.scheme = \"gc\" needs a solid that gives free velocities (level B), but " +
                     solid + " only takes forces (level A); write coupling.scheme = \"staggered\"");
  if (coupling.has_contact() &&
      !(can("fluid", link::capability::contact) && can("solid", link::capability::contact)))
    throw InputError(
        "separation = true needs participants that exchange in the middle of the step (capability "
        "\"contact\"), but 'fluid' is (" +
        world.solver_of("fluid") + ") and " + solid + "; write separation = false");
  if (scheme == "staggered" && !can("solid", link::capability::force_in))
    throw InputError("coupling.scheme = \"staggered\" is for a solid that takes forces (level A), but " +
                     solid + " gives free velocities (level B); write coupling.scheme = \"gc\"");
}

ExitCode start(Launch& launch)
{
  if (launch.line.document_keys)
  {
    std::fputs(launch.file.documentation().c_str(), stdout);
    return ExitCode::success;
  }
  if (!launch.coupling.present)
    throw InputError(launch.file.path() +
                     ": the case has no [coupling] and no [[interface]]; run fluid_pfem or solid_fe alone");
  if (launch.line.check_only)
  {
    fmt::print("coupler: {} interface(s), scheme {}, t = {:.6g} to {:.6g} s\n",
               launch.coupling.interfaces.size(), launch.coupling.scheme, launch.run.t_begin,
               launch.run.t_end);
    return ExitCode::success;
  }
  const link::World world = launch.meet({"fluid", "solid"});
  require_level(launch.coupling, world);
  const auto log = make_log(launch.output.dir, launch.role, false);
  link::PartnerLink fluid(world.channel("fluid"), "fluid"), solid(world.channel("solid"), "solid");
  log->info("case {}: fluid is '{}', solid is '{}'", launch.file.path(), world.solver_of("fluid"),
            world.solver_of("solid"));

  coupler::CouplerConfig config{
      .run = launch.run, .coupling = launch.coupling, .frame_interval = launch.output.frame_interval};
  if (launch.restart)
  {
    config.restart = launch.restart->folder;
    config.t_start = launch.restart->manifest.t;
    log->info("continues from {}, t = {:.9g} s", config.restart, config.t_start);
    if (const std::string warning = launch.restart_warning(); !warning.empty())
      log->warn(warning);
  }
  coupler::CouplerOutput output(launch.output, config, launch.probes);
  Checkpoints checkpoints(launch.checkpoint, launch.output.dir, launch.case_hash());
  const Persistence persistence{.role = launch.role,
                                .from = launch.restart ? &*launch.restart : nullptr,
                                .checkpoints = &checkpoints,
                                .output = [&](StateArchive& archive) { archive("output", output); }};
  try
  {
    const auto run = launch.coupling.has_contact()    ? coupler::run_contact
                     : launch.coupling.scheme == "gc" ? coupler::run_coupler
                                                      : coupler::run_staggered;
    const auto windows = run(
        config, fluid, solid,
        [&](const coupler::WindowRecord& r)
        {
          if (r.plan.t_end == r.plan.t_begin)
            for (const auto& i : r.interfaces)
              log->info("interface '{}': {} multipliers on the {}, fluid side {:.6g} m covered {:.4g}, "
                        "solid side {:.6g} m covered {:.4g}, largest gap {:.3g} m",
                        i.name, i.multipliers, i.multiplier_side == coupler::Side::fluid ? "fluid" : "solid",
                        i.measure[0], i.covered[0], i.measure[1], i.covered[1], i.largest_gap);
          output.observe(r);
        },
        persistence,
        [&](const std::string& text)
        {
          log->warn(text);
          fmt::print(stderr, "warning: {}\n", text);
        });
    std::string reason = checkpoints.stop_reason();
    for (const link::PartnerLink* p : {&fluid, &solid})
      if (p->stop_requested())
        reason = "'" + p->role() + "': " + p->stop_reason();
    const bool stopped = output.time() < launch.run.t_end;
    output.write_summary(stopped ? "stopped" : "completed");
    log->info("{} after {} windows, t = {:.9g} s{}", stopped ? "stopped" : "done", windows, output.time(),
              stopped ? " (" + reason + ")" : "");
    if (stopped)
      fmt::print(stderr, "stopped at t = {:.9g} s: {}; continue with --restart latest\n", output.time(),
                 reason);
    return stopped ? ExitCode::stopped : ExitCode::success;
  }
  catch (const Failure& failure)
  {
    fluid.send_failure(static_cast<int>(failure.code()), failure.what());
    solid.send_failure(static_cast<int>(failure.code()), failure.what());
    throw;
  }
}

} // namespace

int main(int argc, char** argv) { return undine::run_program("coupler", argc, argv, start); }
