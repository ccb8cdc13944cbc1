// Compressible neo-Hookean solid with quadratic volume term: W = μ/2 (I₁−3) − μ ln J + λ/2 (J−1)².
#pragma once

#include "solid_fe/deformation.hpp"
#include "solid_fe/materials/elastic_constants.hpp"

#include <algorithm>
#include <cmath>

namespace undine::solid
{

struct NeoHookeanJ
{
  static constexpr const char* name = "neo_hookean_j";
  static constexpr bool small_strain = false;
  ElasticConstants elastic;

  /// W [J/m³]; I₁ − 3 = tr(b − I) also in plane strain, where b₃₃ = 1.
  template <int dim, class Real>
  Real strain_energy(const Mat<dim, Real>& H) const
  {
    using std::log1p;
    const Real J_minus_one = volume_strain(H);
    return Real(0.5 * elastic.shear_modulus) * trace(left_cauchy_green_minus_one(H)) -
           Real(elastic.shear_modulus) * log1p(J_minus_one) +
           Real(0.5 * elastic.lame_lambda) * J_minus_one * J_minus_one;
  }

  /// P = μ (F − F⁻ᵀ) + λ J (J−1) F⁻ᵀ = τ F⁻ᵀ with τ = μ (b − I) + λ J (J−1) I. [Pa]
  template <int dim, class Real>
  Mat<dim, Real> first_piola(const Mat<dim, Real>& H) const
  {
    const Real J_minus_one = volume_strain(H);
    const Real J = Real(1.0) + J_minus_one;
    const auto tau = Real(elastic.shear_modulus) * left_cauchy_green_minus_one(H) +
                     Real(elastic.lame_lambda) * J * J_minus_one * Mat<dim, Real>::identity();
    const auto cofactor = transpose(adjugate(deformation_gradient(H)));
    return tau * cofactor * (Real(1.0) / J);
  }

  /// With h = H F⁻¹:  H:A:H = μ |H|² + λ (2J² − J) (tr h)² + (μ − λ J (J−1)) tr(h²), and |h| ≤ |H| / s.
  template <int dim>
  TangentBound tangent_bound(const Mat<dim>& H) const
  {
    const double mu = elastic.shear_modulus, lambda = elastic.lame_lambda;
    const double stretch2 = extreme_stretches_squared(H).first;
    const double J = 1.0 + volume_strain(H);
    return {.full = mu + std::abs(mu - lambda * J * (J - 1.0)) / stretch2,
            .volumetric = std::max(lambda * (2.0 * J * J - J), 0.0) / stretch2};
  }

  /// ρ₀c² of the fastest plane wave: μ + (μ + λ J²) / s². [Pa]
  template <int dim>
  double wave_modulus(const Mat<dim>& H) const
  {
    const double mu = elastic.shear_modulus, lambda = elastic.lame_lambda;
    const double stretch2 = extreme_stretches_squared(H).first;
    const double J = 1.0 + volume_strain(H);
    return mu + std::max(mu + lambda * J * J, 0.0) / stretch2;
  }
};

} // namespace undine::solid
