// Compressible Mooney-Rivlin solid: W = c₁₀ (I₁−3) + c₀₁ (I₂−3) − 2(c₁₀ + 2c₀₁) ln J + λ'/2 (ln J)².
#pragma once

#include "solid_fe/material_config.hpp"
#include "solid_fe/materials/principal.hpp"

#include <array>

namespace undine::solid
{

/// c₁₀ + c₀₁ = μ/2 and λ' = λ − 4 c₀₁, so that small strains see Lamé's constants.
struct MooneyRivlin
{
  static constexpr const char* name = "mooney_rivlin";
  static constexpr bool small_strain = false;
  static constexpr std::array own_keys = {LawKey{
      "mooney_share", "", "share c01/(c10 + c01) of the second invariant, mooney_rivlin", 0.25, 0.0, 1.0}};
  double c10 = 0.0, c01 = 0.0, lambda = 0.0; ///< λ is λ' of the formulas [Pa]

  static MooneyRivlin from(const MaterialConfig& config)
  {
    const auto elastic = elastic_constants(config.youngs_modulus, config.poisson_ratio);
    const double c01 = 0.5 * elastic.shear_modulus * config.number(own_keys[0]);
    return {.c10 = 0.5 * elastic.shear_modulus - c01, .c01 = c01, .lambda = elastic.lame_lambda - 4.0 * c01};
  }

  /// W [J/m³] with B = b − I:  I₁ − 3 = tr B,  I₂ − 3 = 2 tr B + ½ ((tr B)² − B:B).
  template <int dim, class Real>
  Real strain_energy(const Mat<dim, Real>& H) const
  {
    using std::log1p;
    const auto B = left_cauchy_green_minus_one(H);
    const Real tr = trace(B), ln_J = log1p(volume_strain(H));
    return Real(c10) * tr + Real(c01) * (Real(2.0) * tr + Real(0.5) * (tr * tr - contract(B, B))) -
           Real(2.0 * (c10 + 2.0 * c01)) * ln_J + Real(0.5 * lambda) * ln_J * ln_J;
  }

  /// P = τ F⁻ᵀ with τ = 2c₁₀ (b − I) + 2c₀₁ (I₁ b − b² − 2I) + λ' ln J I. [Pa]
  template <int dim, class Real>
  Mat<dim, Real> first_piola(const Mat<dim, Real>& H) const
  {
    using std::log1p;
    const Real J_minus_one = volume_strain(H);
    const auto B = left_cauchy_green_minus_one(H);
    const Real tr = trace(B);
    // I₁ b − b² − 2I = tr B I + (1 + tr B) B − B²
    const auto tau = (Real(2.0 * c10) + Real(2.0 * c01) * (Real(1.0) + tr)) * B - Real(2.0 * c01) * (B * B) +
                     (Real(2.0 * c01) * tr + Real(lambda) * log1p(J_minus_one)) * Mat<dim, Real>::identity();
    const auto cofactor = transpose(adjugate(deformation_gradient(H)));
    return tau * cofactor * (Real(1.0) / (Real(1.0) + J_minus_one));
  }

  /// From the principal derivatives of W; in plane strain λ₃ = 1.
  template <int dim>
  TangentBound tangent_bound(const Mat<dim>& H) const
  {
    const auto stretch = principal_stretches(H);
    const double ln_J = std::log1p(volume_strain(H)), c = 2.0 * (c10 + 2.0 * c01);
    double sum = dim == 2 ? 1.0 : 0.0; // Σ λ²
    for (int i = 0; i < dim; ++i)
      sum += stretch[i] * stretch[i];
    Vec<dim> W_i;
    Mat<dim> W_ij;
    for (int i = 0; i < dim; ++i)
    {
      const double s = stretch[i], others = 2.0 * c10 + 2.0 * c01 * (sum - s * s);
      W_i[i] = others * s + (lambda * ln_J - c) / s;
      for (int j = 0; j < dim; ++j)
        W_ij(i, j) = i == j ? others + (lambda * (1.0 - ln_J) + c) / (s * s)
                            : 4.0 * c01 * s * stretch[j] + lambda / (s * stretch[j]);
    }
    return principal_tangent_bound(stretch, W_i, W_ij);
  }

  /// Upper bound of ρ₀c², exact at rest: |p ⊗ N| = 1 in the tangent bound. [Pa]
  template <int dim>
  double wave_modulus(const Mat<dim>& H) const
  {
    const auto bound = tangent_bound(H);
    return bound.full + bound.volumetric;
  }
};

} // namespace undine::solid
