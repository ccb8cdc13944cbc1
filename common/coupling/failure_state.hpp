// What the parts of the library must know about this process when it ends in an error.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>

namespace undine::link
{

/// True once a FAIL has left this process: then the coupler reports it, and abort_world() leaves it the time
/// to do so.
inline std::atomic<bool> failure_announced{false};

} // namespace undine::link
