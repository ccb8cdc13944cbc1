// Signals that ask a program to end in order.
#pragma once

#include <string>

namespace undine
{

/// From now on SIGUSR1, SIGTERM and SIGINT are remembered instead of ending the program; a SIGTERM or SIGINT
/// two seconds later or more ends it as usual.
void watch_stop_signals();

/// Name of the signal that came, or empty.
std::string stop_signal();

} // namespace undine
