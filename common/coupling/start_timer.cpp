// The thread that watches the start.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/start_timer.hpp"

#include "common/coupling/exit_codes.hpp"
#include "common/coupling/own_process.hpp"
#include "common/coupling/text.hpp"

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

namespace undine::link
{
namespace
{

class Watchdog
{
public:
  /// `during_mpi_init`: only if MPI_Init has not returned by then.
  void arm(double seconds, int code, std::string text, bool during_mpi_init)
  {
    const std::lock_guard lock(mutex_);
    time_ = {};
    limit_ = seconds;
    code_ = code;
    text_ = std::move(text);
    during_mpi_init_ = during_mpi_init;
    armed_ = true;
    if (!running_)
    {
      running_ = true;
      // Signals stay with the main thread.
      sigset_t all;
      sigset_t old;
      sigfillset(&all);
      pthread_sigmask(SIG_SETMASK, &all, &old);
      std::thread([this] { watch(); }).detach();
      pthread_sigmask(SIG_SETMASK, &old, nullptr);
    }
    changed_.notify_all();
  }

  void disarm()
  {
    const std::lock_guard lock(mutex_);
    armed_ = false;
    changed_.notify_all();
  }

private:
  void watch()
  {
    std::unique_lock lock(mutex_);
    while (armed_)
    {
      if (const double left = limit_ - time_.seconds(); left > 0.0)
      {
        changed_.wait_for(lock, std::chrono::duration<double>(std::min(left, 0.25)));
        continue;
      }
      if (during_mpi_init_ && mpi_is_running())
        break; // started; from here on the deadline of the hello counts
      print("error: " + text_ + "\n");
      _exit(code_); // exit() could wait for the thread that hangs inside MPI
    }
    armed_ = false;
    running_ = false;
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  OwnTime time_;
  double limit_ = 0.0; ///< [s]
  int code_ = 0;
  std::string text_;
  bool during_mpi_init_ = false;
  bool armed_ = false;
  bool running_ = false;
};

/// Never destroyed: its thread may outlive main().
Watchdog& watchdog()
{
  static Watchdog* const dog = new Watchdog;
  return *dog;
}

} // namespace

void arm_start_timer(const std::string& role, double seconds)
{
  if (seconds <= 0.0 || mpi_is_running())
    return;
  // The coupler's timer, or that of the first process, runs out first, so that the message comes once.
  const double delay = rank_from_launcher() == 0 ? 0.0 : 0.5;
  watchdog().arm(
      seconds + delay, code::mpi_start_incomplete,
      "'" + role + "' still waits in MPI_Init after " + number_text(seconds) +
          " s: at least one program on the mpirun line never called MPI_Init"
          "\n       check that every name on the line is an MPI program, built with the MPI of this mpirun.",
      true);
}

void arm_hand_shake_timer(double seconds, const std::string& text)
{
  watchdog().arm(seconds, code::no_hello, text, false);
}

void disarm_start_timer() { watchdog().disarm(); }

} // namespace undine::link
