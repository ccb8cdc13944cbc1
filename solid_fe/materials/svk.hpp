// St.Venant-Kirchhoff: S = λ tr(E) I + 2μ E with the Green-Lagrange strain E. Softens in compression:
// moderate strains only.
#pragma once

#include "solid_fe/deformation.hpp"
#include "solid_fe/materials/elastic_constants.hpp"

#include <algorithm>

namespace undine::solid
{

struct StVenantKirchhoff
{
  static constexpr const char* name = "svk";
  static constexpr bool small_strain = false;
  ElasticConstants elastic;

  /// W = λ/2 tr(E)² + μ E:E [J/m³].
  template <int dim, class Real>
  Real strain_energy(const Mat<dim, Real>& H) const
  {
    const auto E = green_lagrange(H);
    return Real(0.5 * elastic.lame_lambda) * trace(E) * trace(E) +
           Real(elastic.shear_modulus) * contract(E, E);
  }

  /// Second Piola-Kirchhoff stress [Pa].
  template <int dim, class Real>
  Mat<dim, Real> second_piola(const Mat<dim, Real>& H) const
  {
    const auto E = green_lagrange(H);
    return Real(elastic.lame_lambda) * trace(E) * Mat<dim, Real>::identity() +
           Real(2.0 * elastic.shear_modulus) * E;
  }

  /// P = F S [Pa].
  template <int dim, class Real>
  Mat<dim, Real> first_piola(const Mat<dim, Real>& H) const
  {
    return deformation_gradient(H) * second_piola(H);
  }

  /// H:A:H = S : HᵀH + λ (F:H)² + 2μ |sym FᵀH|², and |sym FᵀH| ≤ s |H| with the largest stretch s.
  template <int dim>
  TangentBound tangent_bound(const Mat<dim>& H) const
  {
    const double stretch2 = extreme_stretches_squared(H).second;
    const double tension = std::max(extreme_eigenvalues(second_piola(H)).second, 0.0);
    return {.full = tension + 2.0 * elastic.shear_modulus * stretch2,
            .volumetric = std::max(elastic.lame_lambda, 0.0) * stretch2};
  }

  /// Upper bound of ρ₀c²: N·S·N + (λ+μ)(p·FN)² + μ|FN|² over unit normals N and polarisations p. [Pa]
  template <int dim>
  double wave_modulus(const Mat<dim>& H) const
  {
    const double stretch2 = extreme_stretches_squared(H).second;
    return extreme_eigenvalues(second_piola(H)).second +
           (std::max(elastic.lame_lambda + elastic.shear_modulus, 0.0) + elastic.shear_modulus) * stretch2;
  }
};

} // namespace undine::solid
