// Signals that ask a program to end in order.
#include "common/io/stop_signal.hpp"

#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <ctime>

namespace undine
{

namespace
{

volatile std::sig_atomic_t received = 0, of_launcher = 0;
volatile std::time_t first_time = 0; ///< [s]
volatile pid_t launcher = 0;         ///< mpirun or its helper on this machine

void end_by(int number)
{
  std::signal(number, SIG_DFL);
  std::raise(number);
}

void remember(int number, siginfo_t* info, void*)
{
  const std::time_t now = std::time(nullptr); // allowed in a handler, like all that follows
  if (number == SIGTERM && launcher != 0 && info->si_pid == launcher && !of_launcher)
  {
    of_launcher = 1;
    alarm(1);
  }
  if (received == 0)
  {
    received = number;
    first_time = now;
  }
  else if (number != SIGUSR1 && now - first_time >= 2) // mpirun sends SIGTERM twice at once
    end_by(number);
}

} // namespace

void watch_stop_signals()
{
  if (std::getenv("OMPI_COMM_WORLD_SIZE") != nullptr)
    launcher = getppid();
  for (const int number : {SIGUSR1, SIGTERM, SIGINT})
  {
    struct sigaction action = {};
    action.sa_sigaction = remember;
    action.sa_flags = SA_RESTART | SA_SIGINFO; // system calls go on
    sigaction(number, &action, nullptr);
  }
}

std::string stop_signal()
{
  switch (received)
  {
  case 0:
    return "";
  case SIGUSR1:
    return "SIGUSR1";
  case SIGTERM:
    return "SIGTERM";
  default:
    return "SIGINT";
  }
}

void let_signals_end()
{
  for (const int number : {SIGUSR1, SIGTERM, SIGINT})
    std::signal(number, SIG_DFL);
  if (of_launcher)
    std::raise(SIGTERM);
}

} // namespace undine
