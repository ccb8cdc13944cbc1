// What the fluid writes: frames, histories of probes, the energy and mass ledgers.
#pragma once

#include "common/config/run_config.hpp"
#include "common/io/frames.hpp"
#include "common/io/history.hpp"
#include "fluid_pfem/fluid.hpp"

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace undine::fluid
{

/// Files of one run in `out_dir`: fluid.h5/.xdmf, history/<probe>.csv, history/fluid_energy.csv,
/// history/mass.csv. A probe at a point follows the node that was nearest at the start; a probe on a surface
/// is the mean over its nodes; a gauge (radius > 0) is the mean over the nodes near its point and over the
/// time since the last row. On several ranks rank 0 writes, and all functions are collective.
template <int dim>
class FluidOutput
{
public:
  /// @throws InputError for a probe that names an unknown surface or field
  FluidOutput(const OutputConfig& output, const std::vector<ProbeConfig>& probes, const Fluid<dim>& fluid);

  /// Call at every synchronised time, or at those of frames and the first from next() on; rows are written
  /// when they are due.
  void observe(double t, Fluid<dim>& fluid, bool frame);
  /// Time from which on the next row is due, or the next sample of a gauge [s].
  double next() const;
  /// Each rank its part; across the ends of a period of what was collected.
  void write_frame(double t, const Fluid<dim>& fluid);
  void for_each_state(StateArchive& archive);

private:
  struct Probe
  {
    ProbeConfig config;
    std::vector<global_index_t> id; ///< nodes of the mean
    std::ptrdiff_t wall = -1;       ///< whose force is measured
    Vec<dim> last_impulse{};
    double last_t = 0.0;
    double highest = 0.0;    ///< −g·x of the free surface at the start [m²/s²]
    std::vector<double> sum; ///< of a gauge's samples since the last row
    int samples = 0;
    bool is_gauge() const { return config.radius > 0.0; }
    std::unique_ptr<History> history;

    void for_each_state(StateArchive& archive)
    {
      archive("id", id);
      archive("last_impulse", last_impulse);
      archive("last_t", last_t);
      archive("highest", highest);
      archive("sum", sum);
      archive("samples", samples);
      archive("history", history);
    }
  };
  Probe make_probe(const ProbeConfig& probe, const Fluid<dim>& fluid) const;
  std::vector<double> measure(Probe& probe, double t, const Fluid<dim>& fluid) const;
  bool has_gauges() const;
  bool needs_all_rows() const;
  void sample_gauges(double t, const Fluid<dim>& fluid);
  void write_rows(double t, const Fluid<dim>& fluid);

  OutputConfig config_;
  FrameWriter frames_;
  std::vector<Probe> probes_;
  History energy_, mass_;
  double next_row_ = 0.0, next_sample_ = 0.0;
  double rho0_ = 0.0;
  bool writes_ = true; ///< on rank 0
};

} // namespace undine::fluid
