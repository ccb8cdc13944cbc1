// Natural frequencies of the discrete solid, a check of mesh, supports and material.
#pragma once

#include "solid_fe/solid.hpp"

#include <vector>

namespace undine::solid
{

/// The lowest `count` natural frequencies [Hz] at the solid's current displacement, from the lumped mass and
/// the stiffness by central differences of the internal force; fixed and driven components are held. Dense:
/// meant for up to some thousand components.
/// @throws InputError above 6000 free components
template <int dim>
std::vector<double> natural_frequencies(const Solid<dim>& solid, int count);

} // namespace undine::solid
