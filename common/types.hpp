// Number types by role and the concepts shared by all programs.
#pragma once

#include <cstdint>

namespace undine
{

using index_t = std::int32_t;        ///< node or element number on this rank
using global_index_t = std::int64_t; ///< node or element number over all ranks

} // namespace undine
