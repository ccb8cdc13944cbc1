// The frame around each program's main: MPI, command line, case, the one place where failures end.
#pragma once

#include "common/config/case_file.hpp"
#include "common/config/command_line.hpp"
#include "common/config/coupling_config.hpp"
#include "common/config/run_config.hpp"
#include "common/coupling/bootstrap.hpp"
#include "common/error.hpp"
#include "common/io/checkpoint.hpp"
#include "common/io/log.hpp"
#include "common/parallel/ranks.hpp"

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace undine
{

/// What a program knows before it meets the others.
struct Launch
{
  std::string program; ///< "coupler", "fluid", "solid"
  std::string role;    ///< "coupler", "fluid", "solid" or the name of one of several solids
  CommandLine line;
  CaseFile file;
  RunConfig run;
  OutputConfig output;
  CouplingConfig coupling;
  std::vector<ProbeConfig> probes;
  CheckpointConfig checkpoint;
  std::optional<Checkpoint> restart; ///< of --restart

  /// Text that identifies the case in manifests.
  std::string case_hash() const;
  /// When this run writes checkpoints; a restart goes on from its own, and warns in the log if that is of
  /// another case.
  Checkpoints checkpoints(spdlog::logger& log) const;
  /// How the program's time loop continues and writes. `output` visits what its outputs have written so far.
  Persistence persistence(Checkpoints& checkpoints, StateVisitor output, const Ranks& ranks = {}) const;

  /// Meet the other programs. `partners`: roles that must be there.
  /// @throws link::ProtocolError; also for a coupler on several ranks
  link::World meet(const std::vector<std::string>& partners) const;
  /// The ranks of this program. One may keep the others waiting for run.rank_timeout; coupled twice as long
  /// as a program may keep the coupler waiting, so that the coupler speaks first.
  Ranks ranks(const link::World& world) const;
  /// A program on several ranks exchanges the rows of its wet nodes where they are: the coupler must offer
  /// that. @throws InputError
  void require_owners(const link::World& world, const Ranks& ranks) const;
};

/// `program` is "coupler", "fluid" or "solid".
/// Start MPI, read the command line and the case's common tables, run `body`, and turn every failure into one
/// message, FAILED.toml and its exit code; programs of the same mpirun line end together. Reports unknown
/// keys of the tables all programs share.
/// SIGUSR1, SIGTERM and SIGINT are remembered (common/io/stop_signal.hpp); `body` ends the run in order and
/// returns ExitCode::stopped.
/// @returns the exit code of the process
int run_program(const std::string& program, int argc, char** argv,
                const std::function<ExitCode(Launch&)>& body);

} // namespace undine
