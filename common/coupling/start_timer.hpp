// Ends the process when a piece of the start hangs inside MPI, where nothing else can end it.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace undine::link
{

/// Start a timer *before* MPI_Init: if the launch is incomplete after `seconds`, write why and _exit(31).
/// World::connect() starts it again for the hand-shake, and disarms it.
void arm_start_timer(const std::string& role, double seconds = 60.0);

/// The same for the hand-shake: after `seconds` write `text` and _exit(32).
void arm_hand_shake_timer(double seconds, const std::string& text);

void disarm_start_timer();

} // namespace undine::link
