// The largest stable step of central differences, from an upper bound of each element's highest frequency.
#pragma once

#include "solid_fe/body.hpp"

#include <span>

namespace undine::solid
{

/// ω² = max_e (full γ_e + volumetric δ_e) at the current displacement [1/s²]: the law's TangentBound times
/// the element factors of frequency_bounds.hpp. Rigorous at rest for every element, and deformed for those
/// whose points see their own volume change; how much larger than the truth it is, is told in the README.
template <int dim>
double highest_frequency_squared(const Body<dim>& body, std::span<const Vec<dim>> u);

/// Largest Δt with M − Δt/2 C − Δt²/4 K ≥ 0 [s], where ω² bounds M⁻¹K and `damping` bounds M⁻¹C [1/s], whose
/// force is taken with the velocity half a step before:  2 / (√(ω² + d²/4) + d/2).
double stable_step(double omega2, double damping);

} // namespace undine::solid
