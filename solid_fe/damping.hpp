// Viscous forces: stiffness-proportional damping and the viscous form of hourglass control.
#pragma once

#include "solid_fe/internal_force.hpp"

#include <span>

namespace undine::solid
{

/// Coefficients of the forces that grow with the velocity.
struct Damping
{
  double mass = 0.0;        ///< α of the nodal force −α m v [1/s]
  double stiffness = 0.0;   ///< β of the second Piola stress β (λ tr Ė I + 2μ Ė) [s]
  ElasticConstants elastic; ///< λ, μ of that stress
  double hourglass = 0.0;   ///< c of the modal force c √(K m_e) q̇, K that of unit hourglass stiffness
  double hourglass_modulus = 0.0; ///< modulus of that K [Pa]

  bool any() const { return mass > 0.0 || in_elements(); }
  bool in_elements() const { return stiffness > 0.0 || hourglass > 0.0; }
};

/// Add the viscous forces [N] of `part` at displacement u and velocity v, as they enter the internal force:
/// they do work on the way of their negative, and their power F·v is never negative.
template <int dim>
void add_viscous_force(const Body<dim>& body, const Damping& damping, Part part, std::span<const Vec<dim>> u,
                       std::span<const Vec<dim>> v, std::span<Vec<dim>> F);

/// Upper bound of the eigenvalues of M⁻¹C [1/s], element by element as in frequency_bounds.hpp; the
/// mass-proportional part included.
template <int dim>
double damping_bound(const Body<dim>& body, const Damping& damping, std::span<const Vec<dim>> u);

} // namespace undine::solid
