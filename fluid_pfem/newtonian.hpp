// Newtonian deviatoric stress.
#pragma once

#include "common/tensor.hpp"

#include <cmath>

namespace undine::fluid
{

/// τ = 2μ dev D with D the symmetric part of ∇v [Pa]. 2-D is plane strain, so dev D = D − (tr D/3) I in both
/// dimensions.
template <int dim, class Real>
Mat<dim, Real> deviatoric_stress(const Mat<dim, Real>& grad_v, double mu)
{
  Mat<dim, Real> tau = symmetric_part(grad_v);
  const Real third = trace(grad_v) * Real(1.0 / 3.0);
  for (int i = 0; i < dim; ++i)
    tau(i, i) -= third;
  return tau * Real(2.0 * mu);
}

/// Fraction of the shear viscosity that a simplex of volume V acts with, given Σ|V∇N|². It is 1 to 1e-6 for
/// all but flat slivers, whose viscous stiffness would grow like 1/V and stop the time step: an element that
/// turns over between two remeshes passes through V = 0.
template <int dim, class Real>
Real viscous_fraction(Real V, Real V2_grad_N2)
{
  using std::sqrt;
  // Flatness squared: 1/3 for a regular triangle, 1/√3 for a regular tetrahedron too.
  const Real f2 = V * V / (V2_grad_N2 * (dim == 2 ? V2_grad_N2 : sqrt(V2_grad_N2))), epsilon2 = Real(4e-4);
  return f2 * f2 / (f2 * f2 + epsilon2 * epsilon2);
}

} // namespace undine::fluid
