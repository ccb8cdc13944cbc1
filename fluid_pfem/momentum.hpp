// Conservation of momentum, Eqs. (2) and (5), and the exchange of mass that stabilises the pressure.
//
// The pressure force is minus the exact gradient of the discrete internal energy Σ m_i e(m_i/V_i):
//   F_j = Σ_e p̄_e V_e ∇N_j,  p̄_e the mean of the nodal pressures,
// so that between remeshes the inviscid, unstabilised fluid is a Hamiltonian system and central differences
// keep its energy. Everything else is a term of an element: a bulk viscosity q_e added to p̄_e, a viscous
// stress τ_e, a mass flux z_e. A term that a scene does not need is not computed.
#pragma once

#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/fluid_nodes.hpp"

#include <span>
#include <vector>

namespace undine::fluid
{

/// Constants of the terms beyond pressure. All zero: the fluid is Hamiltonian and no element pass is made.
struct ElementTermsConfig
{
  double mu = 0.0;                        ///< dynamic viscosity [Pa s]
  double bulk_linear = 0.0;               ///< b₁ of the bulk viscosity
  double bulk_quadratic = 0.0;            ///< b₂, in compression only
  double residual = 0.0;                  ///< α of the residual-based mass exchange
  bool residual_with_acceleration = true; ///< the residual is ∇p − ρ(b − a); without: ∇p − ρb

  bool bulk() const { return bulk_linear > 0.0 || bulk_quadratic > 0.0; }
  bool none() const { return mu == 0.0 && !bulk() && residual == 0.0; }
};

/// The element terms at one instant.
template <int dim>
struct ElementTerms
{
  std::vector<double> q;      ///< bulk viscous pressure [Pa]; empty if there is none
  std::vector<Mat<dim>> tau;  ///< viscous stress [Pa]; empty if μ = 0
  std::vector<Vec<dim>> z;    ///< stabilising mass flux [kg/(m² s)]; empty if there is none
  std::vector<Vec<dim>> body; ///< nodal body force beyond gravity [m/s²]; empty if there is none
  double dissipation = 0.0;   ///< power turned into heat by q and τ [W]

  template <class Archive>
  void for_each_state(Archive& archive)
  {
    archive("q", q);
    archive("tau", tau);
    archive("z", z);
    archive("body", body);
    archive("dissipation", dissipation);
  }
};

/// Element terms of elements [begin, end) from positions, velocities at the half step and accelerations of
/// the last instant.
///   q = −ρ ℓ (b₁ c₀ − b₂² ℓ min(∇·v, 0)) ∇·v                 (von Neumann & Richtmyer 1950), ℓ the height
///   (Σ|∇N|²)^(−1/2), τ = 2μ dev D, z = α (√(2 dim) ℓ/c₀) (∇p − ρ (b − ā))                      (residual of
///   momentum; zero in hydrostatic rest).
/// The height as length keeps q and z bounded on slivers; over a step `dt` [s] z takes at most a twentieth of
/// the smallest mass of its element.
template <int dim>
void update_element_terms(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes,
                          const ElementTermsConfig& config, double c0, const Vec<dim>& b, double dt,
                          index_t begin, index_t end, ElementTerms<dim>& terms);

/// Acceleration a = F/inertia + b of nodes [begin, end), and where there is a mass flux ṁ_i = −Σ_e V_e
/// ∇N_i·z_e [kg/s].
template <int dim>
void update_acceleration(const FluidMesh<dim>& mesh, FluidNodes<dim>& nodes, const ElementTerms<dim>& terms,
                         const Vec<dim>& b, index_t begin, index_t end, std::span<double> mass_rate);

} // namespace undine::fluid
