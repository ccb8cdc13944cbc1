// How a waiting process passes its time.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sched.h>
#include <time.h>

#include <algorithm>
#include <chrono>

namespace undine::link
{

/// First it spins (the answer of a running partner comes within microseconds), then it yields (partners may
/// outnumber the cores), then it sleeps, ever longer in proportion to the wait.
class Patience
{
public:
  /// `stall` [s] ≤ 0: no limit.
  explicit Patience(double stall) : stall_(stall) {}

  /// Forget what was waited: something came.
  void restart()
  {
    waited_ = 0.0;
    warned_ = false;
    last_ = Clock::now();
  }

  enum class Verdict
  {
    wait,
    warn,
    give_up
  };

  Verdict pause()
  {
    measure();
    if (waited_ >= yield_until)
      sleep();
    else if (waited_ >= spin_until)
      sched_yield();
    if (stall_ > 0.0 && waited_ >= stall_)
      return Verdict::give_up;
    if (stall_ > 0.0 && waited_ >= 0.5 * stall_ && !warned_)
    {
      warned_ = true;
      return Verdict::warn;
    }
    return Verdict::wait;
  }

  double waited() const { return waited_; }
  bool long_wait() const { return waited_ > yield_until; }

private:
  using Clock = std::chrono::steady_clock;
  static constexpr double spin_until = 200e-6;  // [s], about 500 to 2000 turns
  static constexpr double yield_until = 500e-6; // [s]

  void measure()
  {
    // A job that was suspended as a whole (SIGSTOP, scontrol suspend) must not wake up into a stall: one turn
    // of the loop counts as a second at most.
    const auto now = Clock::now();
    waited_ += std::min(1.0, std::chrono::duration<double>(now - last_).count());
    last_ = now;
  }

  void sleep() const
  {
    // Five per cent of the time waited so far: the delay stays small against the wait, and so does the CPU
    // time.
    const double seconds = std::clamp(0.05 * waited_, 25e-6, 1e-3);
    const timespec duration{.tv_sec = 0, .tv_nsec = static_cast<long>(seconds * 1e9)};
    nanosleep(&duration, nullptr);
  }

  double stall_;
  double waited_ = 0.0;
  bool warned_ = false;
  Clock::time_point last_ = Clock::now();
};

} // namespace undine::link
