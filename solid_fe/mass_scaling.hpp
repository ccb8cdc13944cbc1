// Mass scaling: masses that make the stable step longer, where elements are small or stiff.
#pragma once

#include "solid_fe/body.hpp"

#include <span>
#include <vector>

namespace undine::solid
{

/// Add mass to the nodes of the elements whose frequency bound at rest is above 2/dt, as much as each of them
/// lacks, until none is. `m` [kg]: lumped masses. @return the mass added to each body [kg]
template <int dim>
std::vector<double> scale_masses(std::vector<Body<dim>>& bodies, double dt, std::span<double> m);

} // namespace undine::solid
