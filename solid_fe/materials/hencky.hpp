// Hencky's law: hyperelastic, linear in the logarithmic strain, W = μ Σ εᵢ² + λ/2 (Σ εᵢ)², εᵢ = ln λᵢ.
#pragma once

#include "solid_fe/materials/principal.hpp"

namespace undine::solid
{

struct Hencky
{
  static constexpr const char* name = "hencky";
  static constexpr bool small_strain = false;
  static constexpr bool in_lanes = false; ///< its eigenvectors are found one element at a time
  ElasticConstants elastic;

  /// W [J/m³].
  template <int dim>
  double strain_energy(const Mat<dim>& H) const
  {
    const auto b_minus_one = spectrum(left_cauchy_green_minus_one(H)).value;
    double sum = 0.0, squares = 0.0;
    for (int i = 0; i < dim; ++i)
    {
      const double strain = 0.5 * std::log1p(b_minus_one[i]);
      sum += strain;
      squares += strain * strain;
    }
    return elastic.shear_modulus * squares + 0.5 * elastic.lame_lambda * sum * sum;
  }

  /// P = τ F⁻ᵀ with τ = λ ln J I + 2μ ε, ε = ½ ln b. [Pa]
  template <int dim>
  Mat<dim> first_piola(const Mat<dim>& H) const
  {
    const auto b = spectrum(left_cauchy_green_minus_one(H));
    const double J = 1.0 + volume_strain(H),
                 pressure_part = elastic.lame_lambda * std::log1p(volume_strain(H));
    Mat<dim> tau;
    for (int k = 0; k < dim; ++k)
    {
      const double tau_k = pressure_part + elastic.shear_modulus * std::log1p(b.value[k]);
      for (int i = 0; i < dim; ++i)
        for (int j = 0; j < dim; ++j)
          tau(i, j) += tau_k * b.vector(i, k) * b.vector(j, k);
    }
    return tau * transpose(adjugate(deformation_gradient(H))) * (1.0 / J);
  }

  /// In principal axes: W_i = τ_i/λ_i, W_ij = (λ + (2μ − τ_i) δ_ij)/(λ_i λ_j).
  template <int dim>
  TangentBound tangent_bound(const Mat<dim>& H) const
  {
    const auto stretch = principal_stretches(H);
    const double pressure_part = elastic.lame_lambda * std::log1p(volume_strain(H));
    Vec<dim> W_i;
    Mat<dim> W_ij;
    for (int i = 0; i < dim; ++i)
    {
      const double tau = pressure_part + 2.0 * elastic.shear_modulus * std::log(stretch[i]);
      W_i[i] = tau / stretch[i];
      for (int j = 0; j < dim; ++j)
        W_ij(i, j) = (elastic.lame_lambda + (i == j ? 2.0 * elastic.shear_modulus - tau : 0.0)) /
                     (stretch[i] * stretch[j]);
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
