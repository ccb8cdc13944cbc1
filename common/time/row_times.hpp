// When rows of a history are due.
#pragma once

#include "common/io/state_archive.hpp"

#include <cmath>

namespace undine
{

/// A row is due after the step (or window) whose end is nearest to a multiple of the interval. Programs that
/// are told the same times have rows at the same ones.
class RowTimes
{
public:
  /// @param interval between rows [s]; 0: a row after every step
  explicit RowTimes(double interval) : interval_(interval) {}

  /// After a step of length `dt` that ended at `t` [s]?
  bool due(double t, double dt) const { return interval_ <= 0.0 || t + 0.5 * dt >= next_; }
  /// A row of time `t` [s] is there.
  void written(double t)
  {
    if (interval_ > 0.0)
      next_ = interval_ * (std::floor(t / interval_ + 0.5) + 1.0);
  }
  void for_each_state(StateArchive& archive) { archive("next", next_); }

private:
  double interval_, next_ = 0.0; ///< [s]
};

} // namespace undine
