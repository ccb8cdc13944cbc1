// When to look at the stable step again: the bound costs as much as one to five steps.
#pragma once

#include "solid_fe/solid.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace undine::solid
{

/// Remembers the solid's critical step and looks again when the trend says that it may have changed by
/// `allowed_change`; at most doubles the time between two looks, so that a quiet solid is looked at every
/// `longest_wait` steps and one in motion as often as it needs. What may change meanwhile is taken off the
/// step; the rest is the solid's step_safety.
template <int dim>
class StepWatch
{
public:
  static constexpr double allowed_change = 0.005;
  static constexpr std::int64_t longest_wait = 200;

  bool is_due(const Solid<dim>& solid) const { return solid.steps() >= next_; }

  /// The step limit now [s]; computed only if due.
  double limit(Solid<dim>& solid)
  {
    if (is_due(solid))
      look(solid);
    return limit_;
  }
  std::int64_t looks() const { return looks_; }
  void for_each_state(StateArchive& archive)
  {
    archive("bound", bound_);
    archive("limit", limit_);
    archive("wait", wait_);
    archive("last", last_);
    archive("next", next_);
    archive("looks", looks_);
  }

private:
  void look(Solid<dim>& solid)
  {
    solid.measure_frequency();
    const double bound = solid.critical_time_step();
    const std::int64_t passed = std::max<std::int64_t>(1, solid.steps() - last_);
    const double rate =
        bound_ > 0.0 ? std::abs(std::log(bound / bound_)) / static_cast<double>(passed) : allowed_change;
    wait_ = std::clamp<std::int64_t>(static_cast<std::int64_t>(allowed_change / std::max(rate, 1e-12)), 1,
                                     std::min(longest_wait, 2 * wait_));
    limit_ = bound * (1.0 - std::min(2.0 * rate * static_cast<double>(wait_), 2.0 * allowed_change));
    bound_ = bound;
    last_ = solid.steps();
    next_ = last_ + wait_;
    ++looks_;
  }

  double bound_ = 0.0, limit_ = 0.0;
  std::int64_t wait_ = 1, last_ = 0, next_ = 0, looks_ = 0;
};

} // namespace undine::solid
