// What happens to large arrays that are let go.
#pragma once

namespace undine
{

/// From now on memory of arrays of 256 kB and more that are let go serves later ones
/// (common/large_arrays.hpp). The GNU allocator would keep it too, but later arrays fit badly into what it
/// keeps: after some hundred remeshes it holds twice what is in use.
void recycle_large_arrays();

} // namespace undine
