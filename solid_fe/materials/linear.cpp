// The element loops of the law "linear".
#include "solid_fe/kernels/element_kernels.hpp"

namespace undine::solid
{
UNDINE_INSTANTIATE_LAW_IN(2, Linear)
UNDINE_INSTANTIATE_LAW_IN(3, Linear)
} // namespace undine::solid
