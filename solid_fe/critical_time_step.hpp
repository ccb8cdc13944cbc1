// The largest stable step of central differences, from an upper bound of each element's highest frequency.
#pragma once

#include "solid_fe/body.hpp"

#include <span>

namespace undine::solid
{

/// 2 / ω with ω² = max_e (full γ_e + volumetric δ_e) / ρ₀ at the current displacement [s].
///
/// Rigorous: the highest frequency of the assembled, constrained solid is at most that of a free element with
/// its own lumped mass (Rayleigh quotient), and u·K_e·u = Σ_q w H:A:H is bounded by the law's TangentBound
/// and the block's γ, δ. Never larger than the true limit up to round-off; how much smaller it is, is told in
/// the README.
template <int dim>
double stable_step(const Body<dim>& body, std::span<const Vec<dim>> u);

} // namespace undine::solid
