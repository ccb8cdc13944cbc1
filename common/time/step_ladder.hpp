// How a time step may change: falls at once, holds, and grows slowly.
#pragma once

#include <algorithm>
#include <limits>

namespace undine
{

/// Central differences lose stability when their step jumps from step to step (parametric resonance), so a
/// step is *held* until the stable limit falls below it or has risen by more than `hold`, and then grows by
/// at most `growth` per step.
struct StepLadder
{
  double growth = 1.02;  ///< largest ratio of successive steps
  double hold = 1.10;    ///< the limit must exceed the step by this factor before the step grows
  double reserve = 0.98; ///< after a fall the step is this fraction of the limit, so that small further falls
                         ///< change nothing

  /// Next step from the last one (0: none yet) and the present limit [s].
  double next(double last, double limit) const
  {
    if (last <= 0.0)
      return limit;
    if (limit < last)
      return reserve * limit;
    if (limit > hold * last)
      return std::min(growth * last, limit);
    return last;
  }
};

} // namespace undine
