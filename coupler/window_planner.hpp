// Which side is fine, how long the window is, and how many fine steps it holds.
#pragma once

#include "common/io/state_archive.hpp"
#include "common/time/step_ladder.hpp"
#include "coupler/gravouil_combescure.hpp"

#include <cstdint>
#include <optional>

namespace undine::coupler
{

/// Wishes of the case.
struct WindowRules
{
  std::optional<Side> fine;             ///< nothing: the side with the smaller stable step
  std::optional<std::int64_t> substeps; ///< nothing: as many as the stable steps ask for
  std::int64_t substeps_max = 300;
  double dt_max = 0.0;     ///< longest window [s]; 0: no limit
  double swap_ratio = 1.2; ///< the fine side changes only if the stable steps are inverted by more than this
  StepLadder ladder;
};

/// Plans windows one after another. Time is counted in integers: t = anchor + k ΔT, where the anchor moves
/// only when ΔT changes, and ΔT always divides the rest of the run, so that the last window ends at t_end
/// exactly.
class WindowPlanner
{
public:
  WindowPlanner(const WindowRules& rules, double t_begin, double t_end);

  struct Plan
  {
    std::int64_t index = 0;
    double t_begin = 0.0, t_end = 0.0;
    WindowSteps steps;
    std::int64_t flight = 1; ///< coarse steps that the window has, without exchange if more than one
    bool last = false;
  };

  /// The next window, given the largest step each side can take (safety factor included) [s].
  /// @param flight at most so many coarse steps
  Plan next(double stable_dt_fluid, double stable_dt_solid, std::int64_t flight = 1);
  bool finished() const { return finished_; }
  double time() const { return t_; }
  /// t_end is not part of it: a restart may go on for longer.
  void for_each_state(StateArchive& archive);

private:
  WindowRules rules_;
  double t_, t_end_;
  double anchor_;
  std::int64_t index_ = 0, since_anchor_ = 0,
               left_ = 0; ///< windows done, since the anchor, still to do with this ΔT
  double dT_ = 0.0;
  std::int64_t m_ = 0;
  std::optional<Side> fine_;
  bool finished_ = false;
};

} // namespace undine::coupler
