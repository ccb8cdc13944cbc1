// Compressible neo-Hookean solid with logarithmic volume term: W = μ/2 (I₁−3) − μ ln J + λ/2 (ln J)². The
// default law.
#pragma once

#include "solid_fe/deformation.hpp"
#include "solid_fe/materials/elastic_constants.hpp"

#include <algorithm>
#include <cmath>

namespace undine::solid
{

struct NeoHookeanLn
{
  static constexpr const char* name = "neo_hookean_ln";
  static constexpr bool small_strain = false;
  ElasticConstants elastic;

  /// W [J/m³]; I₁ − 3 = tr(b − I) also in plane strain, where b₃₃ = 1.
  template <int dim, class Real>
  Real strain_energy(const Mat<dim, Real>& H) const
  {
    using std::log1p;
    const Real ln_J = log1p(volume_strain(H));
    return Real(0.5 * elastic.shear_modulus) * trace(left_cauchy_green_minus_one(H)) -
           Real(elastic.shear_modulus) * ln_J + Real(0.5 * elastic.lame_lambda) * ln_J * ln_J;
  }

  /// P = μ (F − F⁻ᵀ) + λ ln J F⁻ᵀ = τ F⁻ᵀ with τ = μ (b − I) + λ ln J I: symmetric τ keeps angular momentum
  /// to round-off. [Pa]
  template <int dim, class Real>
  Mat<dim, Real> first_piola(const Mat<dim, Real>& H) const
  {
    using std::log1p;
    const Real J_minus_one = volume_strain(H);
    const auto tau = Real(elastic.shear_modulus) * left_cauchy_green_minus_one(H) +
                     Real(elastic.lame_lambda) * log1p(J_minus_one) * Mat<dim, Real>::identity();
    const auto cofactor = transpose(adjugate(deformation_gradient(H)));
    return tau * cofactor * (Real(1.0) / (Real(1.0) + J_minus_one));
  }

  /// With h = H F⁻¹:  H:A:H = μ |H|² + λ (tr h)² + (μ − λ ln J) tr(h²), and |h| ≤ |H| / s with the smallest
  /// stretch s.
  template <int dim>
  TangentBound tangent_bound(const Mat<dim>& H) const
  {
    const double mu = elastic.shear_modulus, lambda = elastic.lame_lambda;
    const double stretch2 = extreme_stretches_squared(H).first;
    return {.full = mu + std::abs(mu - lambda * std::log1p(volume_strain(H))) / stretch2,
            .volumetric = std::max(lambda, 0.0) / stretch2};
  }

  /// ρ₀c² of the fastest plane wave: μ + (μ + λ(1 − ln J)) / s². [Pa]
  template <int dim>
  double wave_modulus(const Mat<dim>& H) const
  {
    const double mu = elastic.shear_modulus, lambda = elastic.lame_lambda;
    const double stretch2 = extreme_stretches_squared(H).first;
    return mu + std::max(mu + lambda * (1.0 - std::log1p(volume_strain(H))), 0.0) / stretch2;
  }
};

} // namespace undine::solid
