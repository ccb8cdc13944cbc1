// The coupler's other ranks than 0, which help it where an interface is large.
#pragma once

#include "common/coupling/team.hpp"

#include <cstdint>

namespace undine::coupler
{

/// First number of what rank 0 tells them; nothing at all: they are dismissed.
enum class Task : std::int32_t
{
  integrals_2d = 2, ///< mortar integrals over a stretch of faces
  integrals_3d = 3,
  rows = 4,    ///< a new operator: keep a stretch of rows
  solution = 5 ///< multipliers by conjugate gradients, of the last operator
};

/// What they do until rank 0 dismisses them. They wait without using their cores, and wake within a twentieth
/// of the time they have waited, or a millisecond.
void help(const link::Team& team);
void dismiss_helpers(const link::Team& team);

} // namespace undine::coupler
