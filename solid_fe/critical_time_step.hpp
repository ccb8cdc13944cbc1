// The largest stable step of central differences, from an upper bound of each element's highest frequency.
#pragma once

#include "solid_fe/body.hpp"

#include <span>

namespace undine::solid
{

/// 2 / ω with ω² = max_e (full γ_e + volumetric δ_e) at the current displacement [s]: the law's TangentBound
/// times the element factors of frequency_bounds.hpp. Rigorous, hence never larger than the true limit up to
/// round-off; how much smaller it is, is told in the README.
template <int dim>
double stable_step(const Body<dim>& body, std::span<const Vec<dim>> u);

} // namespace undine::solid
