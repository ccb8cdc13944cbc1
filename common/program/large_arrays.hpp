// What happens to large arrays that are let go.
#pragma once

#include <cstdlib>
#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace undine
{

/// From now on arrays of 1 MB and more go back to the system when they are let go. The GNU allocator would
/// keep them for later ones, among which they fit badly: after some hundred remeshes it holds twice what is
/// in use. Elsewhere nothing is done.
inline void return_large_arrays()
{
#if defined(__GLIBC__)
  mallopt(M_MMAP_THRESHOLD, 1 << 20);
#endif
}

} // namespace undine
