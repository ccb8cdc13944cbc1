// The element loops of the law "neo_hookean_j".
#include "solid_fe/kernels/element_kernels.hpp"

namespace undine::solid
{
UNDINE_INSTANTIATE_LAW_IN(2, NeoHookeanJ)
UNDINE_INSTANTIATE_LAW_IN(3, NeoHookeanJ)
} // namespace undine::solid
