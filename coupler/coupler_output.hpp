// What the coupler writes: ledgers, progress, its part of the summary.
#pragma once

#include "common/config/run_config.hpp"
#include "common/io/history.hpp"
#include "common/time/row_times.hpp"
#include "coupler/gauges.hpp"
#include "coupler/run.hpp"

#include <chrono>
#include <optional>
#include <string>
#include <vector>

namespace undine::coupler
{

/// Energy of both participants and of the interface since the start [J], per metre of depth in 2-D.
struct EnergyBalance
{
  double kinetic = 0.0, internal = 0.0, external_work = 0.0, dissipated = 0.0;
  /// Kinetic + internal + dissipated − external work: changes only by what the interface and remeshing lose
  /// or make.
  double total() const { return kinetic + internal + dissipated - external_work; }
};

EnergyBalance energy_of(const link::Report& fluid, const link::Report& solid);

/// Files in `out_dir`: history/energy.csv, history/interface_<name>.csv, coupler.json; one progress line per
/// second on a terminal.
class CouplerOutput
{
public:
  CouplerOutput(const OutputConfig& output, const CouplerConfig& config,
                const std::vector<ProbeConfig>& probes = {});
  /// After each window. @throws NumericalError if the interface has made more energy than
  /// coupling.energy_limit allows
  void observe(const WindowRecord& record);
  /// @param status "completed" or "stopped"
  void write_summary(const std::string& status) const;
  void for_each_state(StateArchive& archive);
  double time() const { return t_; } ///< of the last record [s]

private:
  void show_progress(const WindowRecord& record);

  OutputConfig output_;
  CouplerConfig config_;
  History energy_;
  std::vector<History> interface_;
  std::vector<ProbeConfig> probes_;
  std::optional<SurfaceGauges> gauges_; ///< from the first record on
  link::SurfaceMesh solid_at_start_;    ///< where they were placed
  bool on_terminal_;
  std::chrono::steady_clock::time_point begin_, last_progress_;
  RowTimes rows_;

  // for the summary
  double total_at_start_ = 0.0, largest_energy_ = 0.0, total_now_ = 0.0, t_ = 0.0;
  std::int64_t windows_ = 0, substeps_least_ = 0, substeps_most_ = 0, fine_steps_ = 0, flown_ = 0;
  InterfaceBalance balance_;
  double largest_jump_ = 0.0, largest_gap_ = 0.0;
  std::array<double, 2> compute_{}, wait_{};
  double coupler_wait_ = 0.0;   ///< [s]
  double largest_window_ = 0.0; ///< [s]
  std::int64_t stalled_ = 0;    ///< windows in a row that were far shorter
  std::int64_t builds_ = 0, factorisations_ = 0, iterations_ = 0;
};

} // namespace undine::coupler
