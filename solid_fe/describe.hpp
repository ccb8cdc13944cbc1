// The resolved configuration of a solid in words: what --check prints and the log begins with.
#pragma once

#include "solid_fe/solid.hpp"
#include "solid_fe/solid_config.hpp"

#include <string>

namespace undine::solid
{

/// Material, elements, nodes, surfaces, supports, loads, the stable step and how many of them reach t_end
/// [s].
template <int dim>
std::string describe(const SolidConfig& config, const Solid<dim>& solid, double t_end);

} // namespace undine::solid
