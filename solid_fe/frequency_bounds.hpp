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
/// lumped masses, size n_nodes. Idle elements count for nothing: their nodes move as one.
/// @return max_e (full γ_e + volumetric δ_e) of the laws at rest [1/s²]
template <int dim>
double bound_frequencies(std::vector<Body<dim>>& bodies, std::span<const double> m);

/// Mass scaling: raise `m` until max_e (full γ_e + volumetric δ_e) ≤ `allowed` [1/s²] at rest, and set
/// `gamma` and `delta` to match. Mass is added where all elements of a node together need more than the node
/// has; what other nodes have left over is used first, in some sweeps that lower the sum.
/// @return added mass of each body [kg]
template <int dim>
std::vector<double> scale_masses(std::vector<Body<dim>>& bodies, double allowed, std::span<double> m);

} // namespace undine::solid
