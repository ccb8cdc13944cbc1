// The element loops of the law "johnson_cook".
#include "solid_fe/kernels/element_kernels.hpp"

namespace undine::solid
{
UNDINE_INSTANTIATE_LAW_IN(2, JohnsonCook)
UNDINE_INSTANTIATE_LAW_IN(3, JohnsonCook)
} // namespace undine::solid
