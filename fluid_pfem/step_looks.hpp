// When a fluid looks at its stable step, and the step that follows.
#pragma once

#include "common/time/step_ladder.hpp"

#include <cstdint>

namespace undine::fluid
{

/// The stable step is looked at at each remesh and every so many steps. Where the limit was found to have
/// fallen below the step it may fall on, in an impact by a factor of four in eight steps, and steps beyond it
/// make energy: the next look comes after one step, and the ones after it after 2, 4, … as long as it holds.
struct StepLooks
{
  std::int64_t every = 8; ///< steps between two looks while the limit holds
  bool soon = true;       ///< look again soon where it does not; false: never earlier
  StepLadder ladder{};    ///< how the step follows the limit
  double dt = 0.0;        ///< present step [s]; 0: none yet
  std::int64_t last = 0;  ///< step of the last look
  std::int64_t wait = 0;  ///< so many steps after it comes the next, 0: with its turn

  bool is_due(std::int64_t step) const { return step % every == 0 || (wait > 0 && step - last >= wait); }
  /// @param limit present stable step [s]
  void look(std::int64_t step, double limit)
  {
    wait = soon && limit < dt ? 1 : 2 * wait < every ? 2 * wait : 0;
    last = step;
    dt = ladder.next(dt, limit);
  }
};

/// Beside a solid the coupler chooses the step; what it needs to know of the fluid's limit is whether it is
/// near. The limit is looked at in every window while the step is within a factor of it, the one by which
/// limits fell in eight steps of an impact, and else every so many steps.
struct LimitLooks
{
  std::int64_t every = 8; ///< steps between two looks while the limit is far from the step
  double near = 4.0;      ///< limit over step from which on it is far
  double limit = 0.0;     ///< as last seen [s]; 0: look
  std::int64_t last = 0;  ///< step of the last look

  bool is_due(std::int64_t step, double dt) const { return limit <= near * dt || step - last >= every; }
  void look(std::int64_t step, double limit_now)
  {
    limit = limit_now;
    last = step;
  }
  /// The mesh is another one: what was seen says nothing of it.
  void forget() { limit = 0.0; }
};

} // namespace undine::fluid
