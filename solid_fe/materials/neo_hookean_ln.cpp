// The element loops of the law "neo_hookean_ln".
#include "solid_fe/kernels/element_kernels.hpp"

namespace undine::solid
{
UNDINE_INSTANTIATE_LAW_IN(2, NeoHookeanLn)
UNDINE_INSTANTIATE_LAW_IN(3, NeoHookeanLn)
} // namespace undine::solid
