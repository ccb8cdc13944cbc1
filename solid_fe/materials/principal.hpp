// Principal stretches and directions, and the tangent of isotropic laws in principal axes.
#pragma once

#include "solid_fe/deformation.hpp"
#include "solid_fe/materials/elastic_constants.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace undine::solid
{

/// Eigenvalues (in no order) and orthonormal eigenvectors (columns) of a symmetric matrix.
template <int dim>
struct Spectrum
{
  Vec<dim> value;
  Mat<dim> vector = Mat<dim>::identity();
};

/// Cyclic Jacobi rotations: small eigenvalues keep their digits, equal ones do no harm. Golub & Van Loan,
/// sec. 8.5.
template <int dim>
Spectrum<dim> spectrum(Mat<dim> A)
{
  Spectrum<dim> result;
  auto& V = result.vector;
  for (int sweep = 0; sweep < 10; ++sweep)
  {
    bool rotated = false;
    for (int p = 0; p < dim; ++p)
      for (int q = p + 1; q < dim; ++q)
      {
        if (std::abs(A(p, q)) <= 1e-17 * (std::abs(A(p, p)) + std::abs(A(q, q))))
          continue;
        rotated = true;
        const double theta = 0.5 * (A(q, q) - A(p, p)) / A(p, q);
        const double t = (theta < 0.0 ? -1.0 : 1.0) / (std::abs(theta) + std::sqrt(1.0 + theta * theta));
        const double c = 1.0 / std::sqrt(1.0 + t * t), s = t * c;
        const double shift = t * A(p, q);
        A(p, p) -= shift;
        A(q, q) += shift;
        A(p, q) = A(q, p) = 0.0;
        for (int k = 0; k < dim; ++k)
        {
          if (k != p && k != q)
          {
            const double a = A(k, p), b = A(k, q);
            A(k, p) = A(p, k) = c * a - s * b;
            A(k, q) = A(q, k) = s * a + c * b;
          }
          const double a = V(k, p), b = V(k, q);
          V(k, p) = c * a - s * b;
          V(k, q) = s * a + c * b;
        }
      }
    if (!rotated)
      break;
  }
  for (int i = 0; i < dim; ++i)
    result.value[i] = A(i, i);
  return result;
}

/// Principal stretches λᵢ of I + H in the dim directions of the problem.
template <int dim>
Vec<dim> principal_stretches(const Mat<dim>& H)
{
  auto stretch = spectrum(2.0 * green_lagrange(H)).value;
  for (int i = 0; i < dim; ++i)
    stretch[i] = std::sqrt(1.0 + stretch[i]);
  return stretch;
}

/// Tangent bound of an isotropic hyperelastic law from the derivatives W_i, W_ij of its energy by the
/// principal stretches. In the principal frames of F, with G the rotated gradient (Ogden 1984, sec. 6.1.4),
///     G:A:G = Σ_ij W_ij G_ii G_jj + Σ_i<j [ a_ij ½ (G_ij + G_ji)² + b_ij ½ (G_ij − G_ji)² ],
///     a_ij = (W_i − W_j)/(λ_i − λ_j),  b_ij = (W_i + W_j)/(λ_i + λ_j).
/// The part vol (Σ G_ii/λ_i)² is taken out of the first sum, with the vol that fits its off-diagonal.
template <int dim>
TangentBound principal_tangent_bound(const Vec<dim>& stretch, const Vec<dim>& W_i, const Mat<dim>& W_ij)
{
  double shortest = stretch[0], volumetric = 0.0, full = 0.0;
  for (int i = 0; i < dim; ++i)
  {
    shortest = std::min(shortest, stretch[i]);
    for (int j = 0; j < i; ++j)
    {
      volumetric = std::max(volumetric, W_ij(i, j) * stretch[i] * stretch[j]);
      const double gap = stretch[i] - stretch[j], sum = stretch[i] + stretch[j];
      const double symmetric =
          std::abs(gap) > 1e-5 * sum // W_i − W_j has lost its digits below; the limit is off by O(gap)
              ? (W_i[i] - W_i[j]) / gap
              : std::max(W_ij(i, i), W_ij(j, j)) - W_ij(i, j) + 1e-4 * std::abs(W_ij(i, i));
      full = std::max({full, symmetric, (W_i[i] + W_i[j]) / sum});
    }
  }
  Mat<dim> rest;
  for (int i = 0; i < dim; ++i)
    for (int j = 0; j < dim; ++j)
      rest(i, j) = W_ij(i, j) - volumetric / (stretch[i] * stretch[j]);
  return {.full = std::max(full, extreme_eigenvalues(rest).second),
          .volumetric = volumetric / (shortest * shortest)};
}

} // namespace undine::solid
