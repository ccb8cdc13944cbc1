// The coupler program: joins one fluid and the solids.
#include "common/error.hpp"
#include "common/io/log.hpp"
#include "common/program/program.hpp"
#include "coupler/coupler_output.hpp"
#include "coupler/helpers.hpp"
#include "coupler/run.hpp"

#include <fmt/format.h>
#include <mpi.h>

#include <algorithm>
#include <cstdio>
#include <tuple>

namespace
{

using namespace undine;

/// The scheme of the case must be one that all participants can take part in.
void require_level(const CouplingConfig& coupling, const link::World& world)
{
  const std::string& scheme = coupling.scheme;
  const auto can = [&world](const std::string& role, std::uint64_t capability)
  { return (world.capabilities_of(role) & capability) != 0; };
  const auto named = [&world](const std::string& role)
  { return "'" + role + "' (" + world.solver_of(role) + ")"; };
  if (!can("fluid", link::capability::link))
    throw InputError(named("fluid") +
                     " does not give free velocities (level B); every scheme needs a fluid that does");
  for (const std::string& solid : coupling.solids)
  {
    if (scheme == "gc" && !can(solid, link::capability::link))
      throw InputError("coupling.scheme = \"gc\" needs a solid that gives free velocities (level B), but " +
                       named(solid) + " only takes forces (level A); write coupling.scheme = \"staggered\"");
    if (coupling.has_contact() &&
        !(can("fluid", link::capability::contact) && can(solid, link::capability::contact)))
      throw InputError(
          "separation = true needs participants that exchange in the middle of the step (capability "
          "\"contact\"), but 'fluid' is (" +
          world.solver_of("fluid") + ") and " + named(solid) + "; write separation = false");
    for (const auto& [form, bit, need] :
         {std::tuple{"macro_continuity", link::capability::rewind,
                     "participants that run a window on trial (capability \"rewind\")"},
          std::tuple{"half_step", link::capability::contact,
                     "participants that exchange in the middle of the step (capability \"contact\")"}})
      if (coupling.form == form && !(can("fluid", bit) && can(solid, bit)))
        throw InputError(
            fmt::format("coupling.form = \"{}\" needs {}, but 'fluid' is ({}) and {}; leave form out", form,
                        need, world.solver_of("fluid"), named(solid)));
    if (scheme == "staggered" && !can(solid, link::capability::force_in))
      throw InputError("coupling.scheme = \"staggered\" is for a solid that takes forces (level A), but " +
                       named(solid) + " gives free velocities (level B); write coupling.scheme = \"gc\"");
  }
}

/// Rank 0 couples the roles, the fluid first, with the help of its team.
ExitCode couple(const Launch& launch, const link::World& world, const std::vector<std::string>& roles,
                const link::Team& team)
{
  require_level(launch.coupling, world);
  const auto log = make_log(launch.output.dir, launch.role, false);
  std::vector<link::PartnerLink> partners;
  for (const std::string& role : roles)
  {
    partners.emplace_back(world.channel(role), role,
                          [&world, role](int rank) { return world.path(role, rank); });
    log->info("case {}: {} is '{}'", launch.file.path(), role, world.solver_of(role));
  }
  std::vector<link::PartnerLink*> of_solids;
  for (std::size_t k = 1; k < partners.size(); ++k)
    of_solids.push_back(&partners[k]);
  coupler::Group fluid({&partners[0]}), solids(of_solids);

  coupler::CouplerConfig config{
      .run = launch.run, .coupling = launch.coupling, .frame_interval = launch.output.frame_interval};
  config.flight = std::all_of(roles.begin(), roles.end(),
                              [&](const std::string& role)
                              { return (world.capabilities_of(role) & link::capability::flight) != 0; });
  if (launch.restart)
  {
    config.restart = launch.restart->folder;
    config.t_start = launch.restart->manifest.t;
    log->info("continues from {}, t = {:.9g} s", config.restart, config.t_start);
  }
  config.team = &team;
  coupler::CouplerOutput output(launch.output, config, launch.probes);
  Checkpoints checkpoints = launch.checkpoints(*log);
  const Persistence persistence =
      launch.persistence(checkpoints, [&](StateArchive& archive) { archive("output", output); });
  try
  {
    const auto windows = coupler::run(
        config, fluid, solids,
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
    for (const link::PartnerLink& p : partners)
      if (p.stop_requested())
        reason = "'" + p.role() + "': " + p.stop_reason();
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
    for (link::PartnerLink& p : partners)
      p.send_failure(static_cast<int>(failure.code()), failure.what());
    throw;
  }
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
  std::vector<std::string> roles{"fluid"};
  roles.insert(roles.end(), launch.coupling.solids.begin(), launch.coupling.solids.end());
  const link::World world = launch.meet(roles);
  // Rank 0 couples; the others help it. It waits for one of them half as long as a participant waits for the
  // coupler, so that it can say who is silent. They themselves wait for it as long as the run goes on.
  int rank = 0;
  MPI_Comm_rank(world.comm(), &rank);
  const link::Team team(world.comm(), rank == 0 ? 0.5 * launch.coupling.stall_timeout : 0.0);
  if (rank > 0)
  {
    coupler::help(team);
    return ExitCode::success;
  }
  return couple(launch, world, roles, team);
}

} // namespace

int main(int argc, char** argv) { return undine::run_program("coupler", argc, argv, start); }
