// Starts the program under test once per script and judges how the runs end.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "common/coupling/conform/scripts.hpp"

namespace undine::link::conform
{

/// @param self  path of this executable. @returns 0 if every rule was kept, 1 otherwise
int run_all(const Options&, const char* self);

} // namespace undine::link::conform
