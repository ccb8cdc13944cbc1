// Signals that ask a program to end in order.
#include "common/io/stop_signal.hpp"

#include <csignal>
#include <ctime>

namespace undine
{

namespace
{

volatile std::sig_atomic_t received = 0;
volatile std::time_t first_time = 0; ///< [s]

void remember(int number)
{
  const std::time_t now = std::time(nullptr); // allowed in a handler
  if (received == 0)
  {
    received = number;
    first_time = now;
  }
  else if (number != SIGUSR1 && now - first_time >= 2) // mpirun sends SIGTERM twice at once
  {
    std::signal(number, SIG_DFL);
    std::raise(number);
  }
}

} // namespace

void watch_stop_signals()
{
  for (const int number : {SIGUSR1, SIGTERM, SIGINT})
  {
    struct sigaction action = {};
    action.sa_handler = remember;
    action.sa_flags = SA_RESTART; // system calls go on
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

} // namespace undine
