// The element loops of the law "mooney_rivlin".
#include "solid_fe/kernels/element_kernels.hpp"

namespace undine::solid
{
UNDINE_INSTANTIATE_LAW_IN(2, MooneyRivlin)
UNDINE_INSTANTIATE_LAW_IN(3, MooneyRivlin)
} // namespace undine::solid
