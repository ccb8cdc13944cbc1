// What all programs read from a case: the run, its output and its probes.
#pragma once

#include "common/config/case_file.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace undine
{

/// Table [run].
struct RunConfig
{
  std::string name;                   ///< of the case
  int dim = 2;                        ///< 2 (plane strain) or 3
  double t_begin = 0.0;               ///< [s]
  double t_end = 0.0;                 ///< [s]
  double resolution = 1.0;            ///< elements over the characteristic length
  double characteristic_length = 1.0; ///< [m]
  std::string preset = "hydraulic";   ///< or "impact": set of defaults for the fluid

  double rank_timeout = 300.0; ///< of a program that runs alone: longest wait for a rank [s]; 0: none

  /// Length of an element that the resolution asks for [m].
  double element_size() const { return characteristic_length / resolution; }
};

/// Table [output].
struct OutputConfig
{
  std::string dir;                 ///< output folder, from the command line
  std::string part = "solid";      ///< of the solid's files: its name
  double frame_interval = 0.0;     ///< time between field frames [s]; 0: the first and the last only
  double history_interval = 0.0;   ///< time between rows of a history [s]; 0: every window or step
  bool history_asked = false;      ///< the case says so
  bool frames = true;              ///< write field frames at all
  double progress_interval = 30.0; ///< wall time between progress lines [s], from the command line
};

/// Table [checkpoint].
struct CheckpointConfig
{
  double every = 0.0;      ///< simulated time between checkpoints [s]; 0: none
  double every_wall = 0.0; ///< wall time between checkpoints [s]; 0: none
  double wall_limit =
      0.0; ///< wall time after which the run writes a checkpoint and ends with code 3 [s]; 0: none
  std::int64_t keep = 2; ///< checkpoints that stay; 0: all
};

/// An entry of [[probe]]: a history at a point, or the mean over a named surface.
struct ProbeConfig
{
  std::string name;          ///< of the CSV file
  std::string on;            ///< "fluid", "interface" or the name of a solid
  std::vector<double> point; ///< dim coordinates [m]; empty if the probe is on a surface
  std::vector<double>
      relative_to;     ///< solid: another material point whose u, v and a are subtracted [m]; may be empty
  std::string surface; ///< name of a surface; empty if the probe is at a point
  std::vector<double>
      normal; ///< solid: direction across the cut through `point` whose force is measured; or empty
  double radius =
      0.0; ///< fluid gauge: mean over the nodes within this distance of the fixed point [m]; 0: follow a node
  std::string wall;                ///< fluid: name of a wall whose force is measured
  std::vector<std::string> fields; ///< e.g. {"u", "v"} or {"p"}

  bool at_point() const { return !point.empty(); }
};

/// @throws InputError with place, value and rule
RunConfig read_run_config(const CaseFile& file);
OutputConfig read_output_config(const CaseFile& file, const std::string& out_dir);
CheckpointConfig read_checkpoint_config(const CaseFile& file);
/// All probes, of both sides. `dim` is the number of coordinates of a point.
std::vector<ProbeConfig> read_probe_configs(const CaseFile& file, int dim);

} // namespace undine
