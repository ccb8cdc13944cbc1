// Signals that ask a program to end in order.
#pragma once

#include <string>

namespace undine
{

/// From now on SIGUSR1, SIGTERM and SIGINT are remembered instead of ending the program; a SIGTERM or SIGINT
/// two seconds later or more ends it as usual. A SIGTERM of mpirun, which kills what is left a second later,
/// is obeyed within that second or ends the program.
void watch_stop_signals();

/// Name of the signal that came, or empty.
std::string stop_signal();

/// The program fails: signals end it again, at once if mpirun has already sent one (another program has said
/// why).
void let_signals_end();

} // namespace undine
