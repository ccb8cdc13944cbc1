// Points of given local spacing inside a region: an advancing front, then relaxation of its triangulation.
#pragma once

#include "common/tensor.hpp"

#include <cstdint>
#include <functional>
#include <vector>

namespace undine::fluid
{

/// Fill a region between points that are already on its boundary.
/// @param boundary stays as it is and comes first in the result [m]
/// @param depth distance to the boundary, negative outside [m]
/// @param spacing wanted distance of neighbours, slope below 0.5 [m]
/// Greedy: from each point in turn new ones at the wanted distance, unless others are near; then some sweeps
/// in which the edges of the Delaunay mesh push their ends apart like springs shorter than wanted (Persson &
/// Strang 2004). The same seed gives the same points.
template <int dim>
std::vector<Vec<dim>> fill(const std::vector<Vec<dim>>& boundary,
                           const std::function<double(const Vec<dim>&)>& depth,
                           const std::function<double(const Vec<dim>&)>& spacing, std::uint64_t seed);

/// Points from a to b, b excluded: intervals in proportion to the local spacing, a whole number of them.
template <int dim>
std::vector<Vec<dim>> divide(const Vec<dim>& a, const Vec<dim>& b,
                             const std::function<double(const Vec<dim>&)>& spacing);

} // namespace undine::fluid
