// Measures of deformation as functions of the displacement gradient H = ∂u/∂X, written without cancellation
// at small H.
#pragma once

#include "common/tensor.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace undine::solid
{

/// Deformation gradient F = I + H.
template <int dim, class Real>
constexpr Mat<dim, Real> deformation_gradient(const Mat<dim, Real>& H)
{
  return Mat<dim, Real>::identity() + H;
}

/// J − 1 = det(I + H) − 1 as the polynomial in H: no difference of numbers near 1. In 2-D F₃₃ = 1.
template <int dim, class Real>
constexpr Real volume_strain(const Mat<dim, Real>& H)
{
  if constexpr (dim == 2)
    return trace(H) + determinant(H);
  else
  {
    const Real minors = H(0, 0) * H(1, 1) - H(0, 1) * H(1, 0) + H(0, 0) * H(2, 2) - H(0, 2) * H(2, 0) +
                        H(1, 1) * H(2, 2) - H(1, 2) * H(2, 1);
    return trace(H) + minors + determinant(H);
  }
}

/// Green-Lagrange strain E = ½ (FᵀF − I) = ½ (H + Hᵀ + HᵀH).
template <int dim, class Real>
constexpr Mat<dim, Real> green_lagrange(const Mat<dim, Real>& H)
{
  return Real(0.5) * (H + transpose(H) + transpose(H) * H);
}

/// b − I with the left Cauchy-Green tensor b = F Fᵀ: H + Hᵀ + H Hᵀ.
template <int dim, class Real>
constexpr Mat<dim, Real> left_cauchy_green_minus_one(const Mat<dim, Real>& H)
{
  return H + transpose(H) + H * transpose(H);
}

/// The plane-strain gradient as a 3-D one: H₃ⱼ = Hᵢ₃ = 0. In 3-D the argument itself.
template <int dim, class Real>
constexpr Mat<3, Real> embed_in_3d(const Mat<dim, Real>& H)
{
  Mat<3, Real> A;
  for (int i = 0; i < dim; ++i)
    for (int j = 0; j < dim; ++j)
      A(i, j) = H(i, j);
  return A;
}

/// Smallest and largest eigenvalue of a symmetric matrix, closed form (Smith 1961 for 3 × 3). Absolute error
/// about 1e-8 times the spread of the eigenvalues when two of them coincide, round-off otherwise.
inline std::pair<double, double> extreme_eigenvalues(const Mat<2>& A)
{
  const double mean = 0.5 * trace(A);
  const double difference = 0.5 * (A(0, 0) - A(1, 1)), shear = 0.5 * (A(0, 1) + A(1, 0));
  const double radius = std::sqrt(difference * difference + shear * shear); // std::hypot is ten times slower
  return {mean - radius, mean + radius};
}

inline std::pair<double, double> extreme_eigenvalues(const Mat<3>& A)
{
  const double mean = trace(A) / 3.0;
  const Mat<3> D = A - mean * Mat<3>::identity();
  const double p = std::sqrt(contract(D, D) / 6.0);
  if (!(p > 1e-300))
    return {mean, mean};
  const double r = std::clamp(0.5 * determinant((1.0 / p) * D), -1.0, 1.0);
  const double phi = std::acos(r) / 3.0;
  return {mean + 2.0 * p * std::cos(phi + 2.0 * std::numbers::pi / 3.0), mean + 2.0 * p * std::cos(phi)};
}

/// Squares of the smallest and largest principal stretch in the dim directions of the problem (not the 1 of
/// plane strain).
template <int dim>
std::pair<double, double> extreme_stretches_squared(const Mat<dim>& H)
{
  const auto [lowest, highest] = extreme_eigenvalues(2.0 * green_lagrange(H));
  return {1.0 + lowest, 1.0 + highest};
}

} // namespace undine::solid
