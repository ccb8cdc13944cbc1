// solid_fe: the solid as a program, alone or under a coupler.
#include "common/config/command_line.hpp"
#include "common/config/run_config.hpp"
#include "common/coupling/bootstrap.hpp"
#include "common/error.hpp"
#include "common/io/log.hpp"
#include "solid_fe/read_solid_config.hpp"
#include "solid_fe/run.hpp"

#include <fmt/format.h>
#include <mpi.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <iterator>
#include <optional>

namespace
{

using namespace undine;
using namespace undine::solid;

constexpr const char* role = "solid";

volatile std::sig_atomic_t stop_asked = 0;
void ask_to_stop(int) { stop_asked = 1; }

/// Everything that is read before anything is computed.
struct Case
{
  CaseFile file;
  RunConfig run;
  OutputConfig output;
  std::vector<ProbeConfig> probes;
  SolidConfig solid;
  double stall_timeout = 300.0; ///< [s]
};

Case read_case(const CaseFile& file, const std::string& out_dir)
{
  if (!file.has_table("solid"))
    throw InputError(file.path() + ": there is no [solid] table; a case without a solid needs no solid_fe");
  const RunConfig run = read_run_config(file);
  Case c{file, run, read_output_config(file, out_dir), read_probe_configs(file, run.dim),
         read_solid_config(file, run.dim, run.element_size())};
  c.stall_timeout = file.table("coupling", "how fluid and solid are coupled")
                        .number({"stall_timeout", "s", "a partner may be silent for that long; 0: for ever"},
                                c.stall_timeout, non_negative());
  file.reject_unknown_keys({"run", "output", "probe", "solid"});
  return c;
}

/// What --check prints, and what the log begins with.
template <int dim>
std::string describe(const Case& c, const Solid<dim>& solid)
{
  const auto& material = c.solid.material;
  const auto law = make_material(material);
  const double speed =
      std::sqrt(std::visit([](const auto& l) { return l.wave_modulus(Mat<dim>{}); }, law) / material.density);
  const double dt = solid.critical_time_step();
  std::string text = fmt::format("case {}: {}-D solid{}, t = 0 ... {} s\n", c.run.name, dim,
                                 dim == 2 ? " (plane strain, per metre of thickness)" : "", c.run.t_end);
  text += fmt::format("  material   {}: density {} kg/m3, E {} Pa, nu {}; fastest wave {:.6g} m/s\n",
                      material.law, material.density, material.youngs_modulus, material.poisson_ratio, speed);
  for (const auto& body : solid.bodies())
    std::visit(
        [&]<class Element>(const ReferenceBlock<Element>& block)
        {
          text += fmt::format("  elements   {} {}{}, {} of them touch wet nodes\n", block.size(),
                              element_name(Element::type),
                              block.body.empty() ? "" : " of \"" + block.body + "\"", block.n_interface);
        },
        body.block);
  text += fmt::format("  nodes      {}, wet {}\n", solid.nodes().size(), solid.n_wet_nodes());
  text += fmt::format("  mass       {:.9g} kg{}\n", solid.mass(), dim == 2 ? "/m" : "");
  for (const auto& [name, surface] : solid.mesh().surfaces)
    text += fmt::format("  surface    {}: {} facets\n", name, surface.size());
  for (const auto& wet : c.solid.wet)
    text += fmt::format("  interface  {} on surface {}\n", wet.interface, wet.surface);
  for (const auto& fix : c.solid.fix)
    text += fmt::format("  fix        {}: {}\n", fix.on, fmt::join(fix.components, ", "));
  for (const auto& velocity : c.solid.velocity)
    text += fmt::format("  velocity   {}: ({}) m/s in {}\n", velocity.on, fmt::join(velocity.value, ", "),
                        fmt::join(velocity.components, ", "));
  for (const auto& traction : c.solid.traction)
    text += fmt::format("  traction   {}: ({}) Pa, ramp {} s\n", traction.on, fmt::join(traction.value, ", "),
                        traction.ramp);
  text += fmt::format("  gravity    ({}) m/s2\n", fmt::join(c.solid.gravity, ", "));
  text += fmt::format("  step       {:.6g} s = {} x the bound of the stable step; {:.0f} steps to the end\n",
                      dt, c.solid.step_safety, std::ceil(c.run.t_end / dt));
  return text;
}

/// Logs the progress once per second on a terminal, every 30 s otherwise, and passes a request to stop on.
class Reporter
{
public:
  Reporter(std::shared_ptr<spdlog::logger> log, double t_end)
      : log_(std::move(log)), t_end_(t_end), period_(isatty(STDERR_FILENO) != 0 ? 1.0 : 30.0)
  {
  }
  bool operator()(double t, std::int64_t step, double dt)
  {
    if (const auto now = std::chrono::steady_clock::now();
        std::chrono::duration<double>(now - last_).count() > period_)
    {
      log_->info("t = {:.6g} s ({:.1f} %), step {}, dt {:.3g} s", t, 100.0 * t / t_end_, step, dt);
      last_ = now;
    }
    return stop_asked == 0;
  }

private:
  std::shared_ptr<spdlog::logger> log_;
  double t_end_, period_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

/// Run the case; returns the exit code of an orderly end.
template <int dim>
ExitCode run(const Case& c, const link::World& world)
{
  Solid<dim> solid(c.solid, make_mesh<dim>(c.solid));
  const bool coupled = world.coupled();
  auto log = make_log(c.output.dir, role, !coupled);
  log->info("solid_fe {}, {}\n{}", UNDINE_VERSION, coupled ? "coupled" : "alone", describe(c, solid));
  if (!coupled && c.file.has_table("coupling"))
    log->warn("the case has a [coupling] table but no coupler was started: the solid runs alone");

  SolidOutput<dim> output(c.output, c.probes, solid);
  const RunTimes times{.t_end = c.run.t_end,
                       .frame_interval = c.output.frame_interval,
                       .history_interval = c.output.history_interval};
  const Reporter reporter(log, c.run.t_end);
  const auto write_summary = [&](const RunResult& result, const char* status, ExitCode code)
  {
    auto summary = summarise(solid, result);
    summary.set("status", status);
    summary.set("exit_code", static_cast<int>(code));
    summary.write(c.output.dir + "/solid.json");
  };

  std::optional<link::SolverLink> coupler;
  try
  {
    RunResult result;
    if (coupled)
    {
      coupler.emplace(world.channel("coupler"));
      result = run_coupled<dim>(solid, *coupler, times, &output, reporter);
    }
    else
      result = run_alone<dim>(solid, times, &output, reporter);
    const ExitCode code = result.completed ? ExitCode::success : ExitCode::stopped;
    write_summary(result, result.completed ? "completed" : "stopped", code);
    log->info(
        "{} at t = {:.9g} s after {} steps, {:.3g} s of computing, {:.3g} s of waiting; energy drift {:.3g}",
        result.completed ? "completed" : "stopped", result.t_end, result.steps, result.compute_seconds,
        result.wait_seconds, result.energy_drift);
    return code;
  }
  catch (const Failure& failure)
  {
    if (coupler)
      coupler->send_failure(static_cast<int>(failure.code()), failure.what());
    log->error("{}", failure.what());
    if (failure.code() == ExitCode::numerical_failure) // the state that broke is what one wants to see
    {
      output.write_frame(solid);
      write_summary({.t_end = solid.time(), .steps = solid.steps()}, "failed", failure.code());
    }
    throw;
  }
  catch (const std::exception& error)
  {
    if (coupler)
      coupler->send_failure(static_cast<int>(ExitCode::internal_error), error.what());
    log->error("{}", error.what());
    throw;
  }
}

/// Read, say what would be done, and stop: needs no partner and no MPI.
template <int dim>
void check(const Case& c)
{
  const Solid<dim> solid(c.solid, make_mesh<dim>(c.solid));
  check_probes(c.probes, solid);
  std::fputs(describe(c, solid).c_str(), stdout);
}

/// The documentation of all keys, by reading a case that is there for it.
std::string document_keys()
{
  const auto file = CaseFile::parse(
      "[run]\ndimension = 3\nt_end = 1\nresolution = 1\ncharacteristic_length = 1\n[output]\n"
      "[solid]\ndensity = 1\nyoungs_modulus = 1\npoisson_ratio = 0\nwidth = 1\nheight = 1\n"
      "depth = 1\n[[solid.fix]]\non = \"left\"\n[[solid.velocity]]\non = \"top\"\n"
      "value = [0, 0, 0]\n[[solid.traction]]\non = \"right\"\nvalue = [0, 0, 0]\n"
      "[[interface]]\nname = \"i\"\nsolid = \"top\"\n[[probe]]\nname = \"p\"\non = \"solid\"\n"
      "point = [0, 0, 0]\nquantity = \"u\"\n",
      "the documentation");
  read_case(file, ".");
  return file.documentation();
}

} // namespace

int main(int argc, char** argv)
{
  std::string out_dir;
  try
  {
    const CommandLine line = parse_command_line("solid_fe", argc, argv);
    if (!line.answer.empty() || line.document_keys)
    {
      std::fputs(line.document_keys ? document_keys().c_str() : line.answer.c_str(), stdout);
      return 0;
    }
    if (line.check_only)
    {
      const Case c = read_case(CaseFile::read(line.case_path, line.overrides), line.out_dir);
      c.run.dim == 2 ? check<2>(c) : check<3>(c);
      return 0;
    }

    out_dir = line.out_dir;
    link::arm_start_timer(role);
    int provided = 0;
    MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
    std::signal(SIGINT, ask_to_stop);
    std::signal(SIGTERM, ask_to_stop);
    const Case c = read_case(CaseFile::read(line.case_path, line.overrides), line.out_dir);
    int code = 0;
    {
      const auto world = link::World::connect({.role = role,
                                               .solver = std::string("Undine solid_fe ") + UNDINE_VERSION,
                                               .dim = c.run.dim,
                                               .case_hash = c.file.hash(),
                                               .partners = {}},
                                              {.stall = c.stall_timeout});
      int ranks = 0;
      MPI_Comm_size(world.comm(), &ranks);
      if (ranks > 1)
        throw InputError(fmt::format(
            "solid_fe was started on {} ranks: it runs on one; use mpirun -n 1 ... solid_fe", ranks));
      if (!world.coupled())
        std::filesystem::remove(std::filesystem::path(out_dir) / "FAILED.toml");
      code = static_cast<int>(c.run.dim == 2 ? run<2>(c, world) : run<3>(c, world));
    }
    MPI_Finalize();
    return code;
  }
  catch (const Failure& failure)
  {
    link::abort_world(static_cast<int>(failure.code()), role, failure.what(), out_dir);
  }
  catch (const link::ProtocolError& error)
  {
    link::abort_world(error.code(), role, error.what(), out_dir);
  }
  catch (const std::exception& error)
  {
    link::abort_world(static_cast<int>(ExitCode::internal_error), role, error.what(), out_dir);
  }
}
