// Newtonian deviatoric stress.
#pragma once

#include "common/tensor.hpp"

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

} // namespace undine::fluid
