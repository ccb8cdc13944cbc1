// Conservation of momentum, Eqs. (2) and (5): nodal forces of pressure, viscosity and shock capturing.
//
// The pressure force is minus the exact gradient of the discrete internal energy Σ m_i e(m_i/V_i):
//   F_j = Σ_e p̄_e V_e ∇N_j,  p̄_e the mean of the nodal pressures,
// so that between remeshes the inviscid fluid is a Hamiltonian system and central differences keep its
// energy.
#pragma once

#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/fluid_nodes.hpp"

#include <span>
#include <vector>

namespace undine::fluid
{

/// Constants of the dissipative terms. All zero: the fluid is Hamiltonian and no element pass is made.
struct Viscosity
{
  double mu = 0.0;             ///< dynamic viscosity [Pa s]
  double bulk_linear = 0.0;    ///< b₁ of the bulk viscosity
  double bulk_quadratic = 0.0; ///< b₂, in compression only

  bool none() const { return mu == 0.0 && bulk_linear == 0.0 && bulk_quadratic == 0.0; }
};

/// Stress of the elements beyond the mean nodal pressure: q_e (a pressure) and, for μ > 0, τ_e.
template <int dim>
struct ElementStress
{
  std::vector<double> q;     ///< [Pa], empty if there is no bulk viscosity
  std::vector<Mat<dim>> tau; ///< [Pa], empty if μ = 0
  double dissipation = 0.0;  ///< power turned into heat [W]
};

/// Bulk viscosity q_e = −ρ ℓ (b₁ c − b₂² ℓ min(∇·v, 0)) ∇·v with the element's height ℓ = (Σ|∇N|²)^(−1/2),
/// bounded on slivers (von Neumann & Richtmyer 1950; method of Cremonesi et al. 2017 has none), and τ_e = 2μ
/// dev D. `c0` sound speed at ρ₀ [m/s].
template <int dim>
void update_element_stress(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes,
                           const Viscosity& viscosity, double c0, ElementStress<dim>& stress);

/// Acceleration a = F/m + b of nodes [begin, end) from pressures, element stresses and body force b [m/s²].
template <int dim>
void update_acceleration(const FluidMesh<dim>& mesh, FluidNodes<dim>& nodes, const ElementStress<dim>& stress,
                         const Vec<dim>& b, index_t begin, index_t end);

} // namespace undine::fluid
