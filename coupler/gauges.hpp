// What a user measures on the wet surface of the solid: forces, moments, pressures, as means over a time
// window.
#pragma once

#include "common/config/run_config.hpp"
#include "common/coupling/messages.hpp"
#include "common/io/history.hpp"

#include <array>
#include <span>
#include <string>
#include <vector>

namespace undine::coupler
{

/// Files in the output folder: history/force_<interface>.csv with the force of the fluid on the solid and its
/// moment about the origin, and history/<probe>.csv for probes on = "interface" with the pressure over a
/// patch of the solid's surface. All are impulses of the link over the interval between two rows, divided by
/// it: point values of a contact pressure ring at the frequency of the mesh and mean nothing.
class SurfaceGauges
{
public:
  /// @param solid wet surface at the start; a patch holds the nodes within `radius` of `point` there
  /// @throws InputError for a patch without nodes
  SurfaceGauges(const OutputConfig& output, const std::vector<ProbeConfig>& probes,
                const link::SurfaceMesh& solid);

  /// One window: `f` [N], n × dim, acted on the solid's wet nodes during `dt` up to time `t`; `solid` is the
  /// surface then.
  void observe(double t, double dt, std::span<const double> f, const link::SurfaceMesh& solid);

  void for_each_state(StateArchive& archive)
  {
    archive("next", next_);
    archive("since", since_);
    archive("forces", forces_);
    archive("pressures", pressures_);
    archive("normal", normal_);
  }

private:
  struct Force
  {
    std::vector<std::int32_t> nodes;
    std::array<double, 3> impulse{}, angular{};
    History history;

    void for_each_state(StateArchive& archive)
    {
      archive("impulse", impulse);
      archive("angular", angular);
      archive("history", history);
    }
  };
  struct Pressure
  {
    std::vector<std::int32_t> nodes;
    double impulse = 0.0; ///< ∫ of the force against the outward normal [N s]
    double area = 0.0;    ///< ∫ of the patch's area over time [m^(dim−1) s]
    History history;

    void for_each_state(StateArchive& archive)
    {
      archive("impulse", impulse);
      archive("area", area);
      archive("history", history);
    }
  };
  void measure_nodes(const link::SurfaceMesh& solid);

  double interval_, next_ = 0.0, since_ = 0.0;
  std::vector<Force> forces_;
  std::vector<Pressure> pressures_;
  std::vector<std::array<double, 3>> normal_; ///< of each node times its tributary area, present surface
};

} // namespace undine::coupler
