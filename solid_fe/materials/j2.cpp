// The element loops of the law "j2".
#include "solid_fe/kernels/element_kernels.hpp"

namespace undine::solid
{
UNDINE_INSTANTIATE_LAW_IN(2, J2)
UNDINE_INSTANTIATE_LAW_IN(3, J2)
} // namespace undine::solid
