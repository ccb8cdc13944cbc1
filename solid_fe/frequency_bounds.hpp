// Element factors γ and δ that turn a bound of the material tangent into a bound of the solid's highest
// frequency.
#pragma once

#include "solid_fe/body.hpp"

#include <span>
#include <vector>

namespace undine::solid
{

/// Fill `gamma` and `delta` of every block. With nodal masses m split between the elements, Σ_e M_ea = m_a,
/// M_ea > 0,
///     Σ_q w |∇u|²         ≤ γ_e Σ_a M_ea |u_a|²
///     Σ_q w (M_q : ∇u)²   ≤ δ_e Σ_a M_ea |u_a|²      for all matrices M_q of spectral norm ≤ 1,
/// so that u·K u ≤ Σ_e (full γ_e + volumetric δ_e) Σ_a M_ea |u_a|² ≤ max_e (full γ_e + volumetric δ_e) · u·M
/// u, whatever the split. The split starts from the elements' own masses and is improved in a few sweeps that
/// give stiff elements (slivers) a larger share: on distorted tetrahedra that doubles the step. `m` [kg]:
/// lumped masses, size n_nodes.
template <int dim>
void bound_frequencies(std::vector<Body<dim>>& bodies, std::span<const double> m);

} // namespace undine::solid
