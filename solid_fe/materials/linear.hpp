// Small-strain linear elasticity: σ = λ tr(ε) I + 2μ ε with ε = sym ∂u/∂X. Not objective; for verification.
#pragma once

#include "solid_fe/deformation.hpp"
#include "solid_fe/materials/elastic_constants.hpp"

#include <algorithm>

namespace undine::solid
{

struct Linear
{
  static constexpr const char* name = "linear";
  static constexpr bool small_strain = true; ///< first Piola and Cauchy stress are not told apart
  ElasticConstants elastic;

  /// W = λ/2 tr(ε)² + μ ε:ε [J/m³].
  template <int dim, class Real>
  Real strain_energy(const Mat<dim, Real>& H) const
  {
    const auto strain = symmetric_part(H);
    return Real(0.5 * elastic.lame_lambda) * trace(strain) * trace(strain) +
           Real(elastic.shear_modulus) * contract(strain, strain);
  }

  /// Stress [Pa]; out of plane λ tr(ε) in plane strain, which the in-plane force does not need.
  template <int dim, class Real>
  Mat<dim, Real> first_piola(const Mat<dim, Real>& H) const
  {
    const auto strain = symmetric_part(H);
    return Real(elastic.lame_lambda) * trace(strain) * Mat<dim, Real>::identity() +
           Real(2.0 * elastic.shear_modulus) * strain;
  }

  /// H:A:H = λ tr(H)² + 2μ |sym H|².
  template <int dim>
  TangentBound tangent_bound(const Mat<dim>&) const
  {
    return {.full = 2.0 * elastic.shear_modulus, .volumetric = std::max(elastic.lame_lambda, 0.0)};
  }

  /// ρ₀c² of the fastest plane wave: λ + 2μ, larger than μ for every admissible Poisson ratio. [Pa]
  template <int dim>
  double wave_modulus(const Mat<dim>&) const
  {
    return elastic.lame_lambda + 2.0 * elastic.shear_modulus;
  }
};

} // namespace undine::solid
