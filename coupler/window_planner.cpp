// The negotiation of windows.
#include "coupler/window_planner.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace undine::coupler
{

namespace
{

/// Smallest n with total / n ≤ step, up to round-off.
std::int64_t divisions(double total, double step)
{
  return std::max<std::int64_t>(1, static_cast<std::int64_t>(std::ceil(total / step * (1.0 - 1e-12))));
}

} // namespace

WindowPlanner::WindowPlanner(const WindowRules& rules, double t_begin, double t_end)
    : rules_(rules), t_(t_begin), t_end_(t_end), anchor_(t_begin), finished_(!(t_end > t_begin))
{
}

WindowPlanner::Plan WindowPlanner::next(double stable_dt_fluid, double stable_dt_solid, std::int64_t flight)
{
  require(!finished_, "no window after t_end");
  if (!(stable_dt_fluid > 0.0 && stable_dt_solid > 0.0))
    throw NumericalError("a participant reports a stable time step that is not positive (fluid " +
                         std::to_string(stable_dt_fluid) + " s, solid " + std::to_string(stable_dt_solid) +
                         " s)");
  const std::array<double, 2> limit{stable_dt_fluid, stable_dt_solid};
  const std::int64_t m_largest = rules_.substeps.value_or(rules_.substeps_max);

  // The side with the smaller step is fine; it keeps that role until the ratio is clearly inverted.
  Side fine = rules_.fine.value_or(
      fine_.value_or(limit[Side::fluid] <= limit[Side::solid] ? Side::fluid : Side::solid));
  if (!rules_.fine && limit[fine] > rules_.swap_ratio * limit[other(fine)])
    fine = other(fine);
  if (fine_ && *fine_ != fine)
    m_ = 0;
  fine_ = fine;

  double dT_limit = std::min(limit[other(fine)], static_cast<double>(m_largest) * limit[fine]);
  if (rules_.dt_max > 0.0)
    dT_limit = std::min(dT_limit, rules_.dt_max);

  const double dT = rules_.ladder.next(dT_, dT_limit);
  if (dT != dT_ || left_ == 0)
  {
    anchor_ = t_;
    since_anchor_ = 0;
    left_ = divisions(t_end_ - t_, dT);
    dT_ = (t_end_ - t_) / static_cast<double>(left_);
  }

  // Equal fine steps; their number is held like ΔT, so that Δt does not flicker between two neighbours.
  const std::int64_t m_needed = divisions(dT_, limit[fine]);
  if (rules_.substeps)
    m_ = *rules_.substeps;
  else if (m_ < m_needed || m_ > 1.1 * static_cast<double>(m_needed) + 1.0)
    m_ = m_needed;

  Plan plan;
  plan.index = index_++;
  plan.t_begin = t_;
  plan.flight = std::min(flight, left_);
  since_anchor_ += plan.flight;
  left_ -= plan.flight;
  plan.last = left_ == 0;
  t_ = plan.last ? t_end_ : anchor_ + static_cast<double>(since_anchor_) * dT_;
  plan.t_end = t_;
  plan.steps = {.fine = fine, .m = m_, .coarse_dt = dT_};
  finished_ = plan.last;
  return plan;
}

void WindowPlanner::for_each_state(StateArchive& archive)
{
  archive("t", t_);
  archive("anchor", anchor_);
  archive("index", index_);
  archive("since_anchor", since_anchor_);
  archive("left", left_);
  archive("dT", dT_);
  archive("m", m_);
  archive("fine", fine_);
  double t_end = t_end_;
  archive("t_end", t_end);
  if (!archive.reading())
    return;
  if (t_end != t_end_)
    left_ = 0; // divide the way to another end anew
  finished_ = !(t_end_ > t_);
}

} // namespace undine::coupler
