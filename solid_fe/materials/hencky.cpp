// The element loops of the law "hencky".
#include "solid_fe/kernels/element_kernels.hpp"

namespace undine::solid
{
UNDINE_INSTANTIATE_LAW_IN(2, Hencky)
UNDINE_INSTANTIATE_LAW_IN(3, Hencky)
} // namespace undine::solid
