// Start and end of a program.
#include "common/program/program.hpp"

#include "common/coupling/failure.hpp"
#include "common/coupling/start_timer.hpp"
#include "common/error.hpp"
#include "common/io/stop_signal.hpp"
#include "common/parallel/mpi_ranks.hpp"

#include <fmt/format.h>
#include <mpi.h>
#include <unistd.h>

#include <cstdio>
#include <exception>
#include <optional>
#include <utility>

namespace undine
{

namespace
{

int world_size()
{
  int size = 1;
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  return size;
}

int world_rank()
{
  int rank = 0;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  return rank;
}

/// Ends all programs of the line, or only this one if it is alone.
int end_with(int code, const std::string& role, const std::string& text, const std::string& out_dir)
{
  let_signals_end();
  if (world_size() > 1)
    link::abort_world(code, role, text, out_dir);
  link::report_failure(code, role, text, out_dir);
  MPI_Finalize();
  return code;
}

} // namespace

link::World Launch::meet(const std::vector<std::string>& partners) const
{
  return link::World::connect({.role = role,
                               .solver = "undine " + program + " " UNDINE_VERSION,
                               .dim = run.dim,
                               .case_hash = file.hash(),
                               .partners = partners,
                               .capabilities = link::capability::link | link::capability::contact |
                                               link::capability::rewind | link::capability::flight |
                                               link::capability::distributed},
                              {.hello = coupling.hello_timeout, .stall = coupling.stall_timeout});
}

Ranks Launch::ranks(const link::World& world) const
{
  return ranks_of(world.comm(), world.coupled() ? 2.0 * coupling.stall_timeout : run.rank_timeout);
}

void Launch::require_owners(const link::World& world, const Ranks& ranks) const
{
  if (!ranks.alone() && (world.capabilities_of("coupler") & link::capability::distributed) == 0)
    throw InputError("this coupler (" + world.solver_of("coupler") +
                     ") takes wet nodes from rank 0 only (it does not offer DISTRIBUTED); start '" + role +
                     "' on one rank");
}

std::string Launch::case_hash() const { return fmt::format("{:016x}", file.hash()); }

Checkpoints Launch::checkpoints(spdlog::logger& log) const
{
  Checkpoints result(checkpoint, output.dir, case_hash());
  if (!restart)
    return result;
  result.continue_from(restart->manifest.t);
  if (restart->manifest.case_hash != case_hash())
    log.warn(
        "the case, or what --set and --until change in it, is not that of the checkpoint: the run goes on, "
        "but it is no longer the same run");
  return result;
}

Persistence Launch::persistence(Checkpoints& checkpoints, StateVisitor output, const Ranks& ranks) const
{
  return {.role = role,
          .from = restart ? &*restart : nullptr,
          .checkpoints = &checkpoints,
          .output = std::move(output),
          .ranks = ranks};
}

int run_program(const std::string& program, int argc, char** argv,
                const std::function<ExitCode(Launch&)>& body)
{
  std::string role = program;
  CommandLine line;
  std::optional<CaseFile> file;
  std::exception_ptr mistake; // reported once MPI runs: then all programs of the line end together
  double start_limit = CouplingConfig{}.hello_timeout;
  try
  {
    line = parse_command_line(role, argc, argv);
    if (line.answer.empty())
    {
      file.emplace(CaseFile::read(line.case_path, line.overrides));
      if (program == "solid")
        role = file->choose("solid", line.name);
      start_limit = read_coupling(*file).hello_timeout;
    }
  }
  catch (...)
  {
    mistake = std::current_exception();
  }

  watch_stop_signals();
  // The coupler speaks for all; mpirun needs a second to end the others once it has.
  link::arm_start_timer(role, start_limit + (role == "coupler" ? 0.0 : 2.0));
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  std::string out_dir;
  try
  {
    if (!line.answer.empty())
    {
      if (world_rank() == 0)
        std::fputs(line.answer.c_str(), stdout);
      MPI_Finalize();
      return 0;
    }
    if (!line.check_only && !line.document_keys)
      out_dir = line.out_dir;
    if (!out_dir.empty() && world_rank() == 0)
      std::remove((out_dir + "/FAILED.toml").c_str()); // of an earlier run
    if (mistake)
      std::rethrow_exception(mistake);
    const RunConfig run = read_run_config(*file);
    Launch launch{.program = program,
                  .role = role,
                  .line = line,
                  .file = *file,
                  .run = run,
                  .output = read_output_config(*file, line.out_dir),
                  .coupling = read_coupling(*file),
                  .probes = read_probe_configs(*file, run.dim),
                  .checkpoint = read_checkpoint_config(*file),
                  .restart = std::nullopt};
    if (!line.restart.empty())
      launch.restart = find_checkpoint(line.out_dir, line.restart);
    launch.output.progress_interval = line.progress > 0.0          ? line.progress
                                      : isatty(STDERR_FILENO) != 0 ? 1.0
                                                                   : 30.0;
    file->reject_unknown_keys({"run", "output", "probe", "coupling", "interface", "checkpoint"});
    const ExitCode code = body(launch);
    MPI_Finalize();
    return static_cast<int>(code);
  }
  catch (const InputError& error)
  {
    const std::string text = file ? file->with_place(error.what()) : error.what();
    return end_with(static_cast<int>(error.code()), role, text, out_dir);
  }
  catch (const Failure& failure)
  {
    return end_with(static_cast<int>(failure.code()), role, failure.what(), out_dir);
  }
  catch (const link::ProtocolError& error)
  {
    return end_with(error.code(), role, error.what(), out_dir);
  }
  catch (const std::exception& error)
  {
    return end_with(static_cast<int>(ExitCode::internal_error), role,
                    std::string("internal error: ") + error.what(), out_dir);
  }
}

} // namespace undine
