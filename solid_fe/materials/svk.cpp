// The element loops of the law "svk".
#include "solid_fe/kernels/element_kernels.hpp"

namespace undine::solid
{
UNDINE_INSTANTIATE_LAW_IN(2, StVenantKirchhoff)
UNDINE_INSTANTIATE_LAW_IN(3, StVenantKirchhoff)
} // namespace undine::solid
