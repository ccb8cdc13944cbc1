// Checkpoints of a run: when they are due, their folders, and the manifest that makes one valid.
#pragma once

#include "common/config/run_config.hpp"
#include "common/io/state_archive.hpp"
#include "common/parallel/ranks.hpp"

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace undine
{

/// `manifest.toml` of a checkpoint, written last: no manifest, no checkpoint.
struct Manifest
{
  struct File
  {
    std::string name; ///< in the folder of the checkpoint
    std::uint64_t bytes = 0;
    std::uint32_t crc32c = 0;
  };
  double t = 0.0;          ///< [s]
  std::int64_t window = 0; ///< windows (coupled) or steps (alone) so far
  std::string case_hash;   ///< of the case, without the tables that may change at a restart
  std::vector<File> files; ///< all of them
};

/// A checkpoint that is complete: folder and manifest.
struct Checkpoint
{
  std::string folder;
  Manifest manifest;
};

/// The checkpoint `which` ("latest", the name of one in `<out_dir>/checkpoints`, or a path to its folder)
/// whose files have the sizes and checksums of its manifest; "latest" is the newest of these, damaged ones
/// are passed over. @throws InputError (bad_input_file) that says what is wrong with which
Checkpoint find_checkpoint(const std::string& out_dir, const std::string& which);

/// Decides when, and takes care of the folders.
class Checkpoints
{
public:
  /// `case_hash`: text that identifies the case. Time counts from now.
  Checkpoints(const CheckpointConfig& config, std::string out_dir, std::string case_hash);
  /// Continue from `from`: the next one in simulated time is that which would have come.
  void continue_from(double t);

  /// Somebody wants the run to end early (signal, wall-clock limit): the words, or empty.
  std::string stop_reason() const;
  /// A checkpoint is due at time t, by the interval of simulated time.
  bool due(double t) const;
  /// A checkpoint is due by the clock on the wall, or because the run is to be stopped.
  bool due_now() const;
  /// The case asks for checkpoints.
  bool wanted() const { return config_.every > 0.0 || config_.every_wall > 0.0 || config_.wall_limit > 0.0; }

  /// Make the folder of the next checkpoint, "<out_dir>/checkpoints/000007", and return its path.
  std::string begin();
  /// All `files` are in `folder`: write its manifest and delete what is older than the last `keep`.
  void finish(const std::string& folder, double t, std::int64_t window,
              const std::vector<std::string>& files);
  /// There is a checkpoint of time t: when is the next one due?
  void passed(double t);
  /// Give up the folder (somebody could not write).
  void abandon(const std::string& folder);

private:
  CheckpointConfig config_;
  std::string out_dir_, case_hash_;
  std::chrono::steady_clock::time_point begin_, last_;
  double next_ = 0.0; ///< simulated time [s]
};

/// Visits everything that a time loop depends on.
using StateVisitor = std::function<void(StateArchive&)>;

/// How a time loop continues from a checkpoint and writes new ones. By default it does neither. On several
/// ranks all functions are collective: every rank visits its state, writes its share and reads what it needs.
struct Persistence
{
  std::string role;
  const Checkpoint* from = nullptr;   ///< continue from here
  Checkpoints* checkpoints = nullptr; ///< when to write and to stop; participants of a coupled run are told
  StateVisitor output;                ///< what was written so far: for_each_state of the output objects
  Ranks ranks;

  bool restarts() const { return from != nullptr; }
  std::string file_name() const { return role + ".h5"; }
  /// Take `state` and the output's from the checkpoint. @throws Failure(bad_input_file)
  void restore(const StateVisitor& state) const;
  /// Write them into `folder`.
  void save(const std::string& folder, const StateVisitor& state) const;
  /// A checkpoint is due at time t, by the interval of simulated time.
  bool due(double t) const { return checkpoints != nullptr && checkpoints->due(t); }
  /// For a run of one program, after a step that ended at t: write a checkpoint if one is due.
  /// @returns why the run shall stop, or empty
  std::string after_step(double t, std::int64_t step, const StateVisitor& state) const;
};

} // namespace undine
