// The largest stable time step of the fluid.
#pragma once

#include "common/parallel/halo.hpp"
#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/fluid_nodes.hpp"
#include "fluid_pfem/momentum.hpp"
#include "fluid_pfem/tait.hpp"
#include "fluid_pfem/team.hpp"

#include <vector>

namespace undine::fluid
{

/// Arrays that are kept from one evaluation to the next, so that a step allocates nothing.
struct StepWorkspace
{
  std::vector<double> stiffness, row_sum, shear;
  std::vector<double> largest; ///< ω² of each share
};

/// Bound on the highest acoustic frequency from the infinity norm of A = M⁻¹ B diag(ρc²/V) Bᵀ, B_ij =
/// ∂V_j/∂x_i:
///   ω² ≤ max_i (1/m_i) Σ_j |B_ij| (ρ_j c_j²/V_j) Σ_k |B_kj|,   Δt ≤ 2/ω · (√(1+ξ²) − ξ),
/// with the damping ratio ξ of the bulk viscosity, and Δt ≤ 2/λ of the shear viscosity. Rigorous for the
/// undamped operator, and finite on interior slivers: it sees the faces of elements, never their volume.
/// @param floor least volume of a node over the regular one, as in update_density_and_pressure
/// @param halo of the nodes; x is right on ghosts, and v where a viscous term needs it
/// @returns [s], the same on all ranks. Collective.
template <int dim>
double critical_time_step(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes, const Tait& tait,
                          const ElementTermsConfig& terms, double floor, const Team& team, Halo& halo,
                          StepWorkspace& workspace);

} // namespace undine::fluid
