// Geometry of a linear simplex seen from one of its corners.
#pragma once

#include "common/tensor.hpp"
#include "common/types.hpp"

#include <array>
#include <cmath>

namespace undine::fluid
{

/// z, or 0 in the plane.
template <int dim>
constexpr double third(const Vec<dim>& x)
{
  return dim == 3 ? x[dim - 1] : 0.0;
}

/// V_e ∇N_i of a positively oriented simplex (i, opposite…): independent of x_i, finite however flat the
/// element [m^(dim−1)].
template <int dim, class Real>
Vec<dim, Real> volume_gradient(const std::array<Vec<dim, Real>, dim>& opposite)
{
  if constexpr (dim == 2)
    return Real(0.5) * Vec<2, Real>{{opposite[0][1] - opposite[1][1], opposite[1][0] - opposite[0][0]}};
  else
    return Real(-1.0 / 6.0) * cross(opposite[1] - opposite[0], opposite[2] - opposite[0]);
}

/// Signed volume (area) of the simplex [m^dim].
template <int dim, class Real>
Real signed_volume(const std::array<Vec<dim, Real>, dim + 1>& x)
{
  if constexpr (dim == 2)
    return Real(0.5) * determinant(Mat<2, Real>{
                           {x[1][0] - x[0][0], x[1][1] - x[0][1], x[2][0] - x[0][0], x[2][1] - x[0][1]}});
  else
    return Real(1.0 / 6.0) * dot(x[1] - x[0], cross(x[2] - x[0], x[3] - x[0]));
}

/// The corners of a simplex rotated so that corner `a` comes first and the orientation stays.
template <int dim>
constexpr std::array<int, dim + 1> even_order(int a)
{
  if constexpr (dim == 2)
    return {a, (a + 1) % 3, (a + 2) % 3};
  else
  {
    constexpr std::array<std::array<int, 4>, 4> order{
        {{0, 1, 2, 3}, {1, 0, 3, 2}, {2, 0, 1, 3}, {3, 0, 2, 1}}};
    return order[static_cast<std::size_t>(a)];
  }
}

/// V_e ∇N_a of all corners.
template <int dim, class Real>
std::array<Vec<dim, Real>, dim + 1> volume_gradients(const std::array<Vec<dim, Real>, dim + 1>& x)
{
  std::array<Vec<dim, Real>, dim + 1> g;
  for (int a = 0; a <= dim; ++a)
  {
    const auto order = even_order<dim>(a);
    std::array<Vec<dim, Real>, dim> opposite;
    for (int k = 0; k < dim; ++k)
      opposite[static_cast<std::size_t>(k)] =
          x[static_cast<std::size_t>(order[static_cast<std::size_t>(k + 1)])];
    g[static_cast<std::size_t>(a)] = volume_gradient<dim, Real>(opposite);
  }
  return g;
}

/// Shape of a simplex, 1 for a regular one, in proportion to its height when flat, negative when inverted:
/// q = 4√3 A/Σl² in the plane, 12 (3V)^(2/3)/Σl² in space (mean ratio; Liu & Joe 1994). Here q, and q³ in
/// space.
template <int dim, class Real>
Real quality_power(const std::array<Vec<dim, Real>, dim + 1>& x)
{
  Real edges(0.0);
  for (std::size_t a = 0; a <= dim; ++a)
    for (std::size_t b = a + 1; b <= dim; ++b)
      edges += norm_squared(x[a] - x[b]);
  const Real V = signed_volume<dim, Real>(x);
  using std::abs;
  if constexpr (dim == 2)
    return Real(6.9282032302755091741) * V / edges;
  else
    return Real(15552.0) * V * abs(V) / (edges * edges * edges);
}

/// q of quality_power.
template <int dim>
double quality(const std::array<Vec<dim>, dim + 1>& x)
{
  const double power = quality_power<dim, double>(x);
  return dim == 2 ? power : std::cbrt(power);
}

/// Radius of the circumscribed sphere; infinity for a degenerate simplex [m].
template <int dim>
double circumradius(const std::array<Vec<dim>, dim + 1>& x)
{
  Mat<dim> A;
  Vec<dim> b;
  for (int i = 0; i < dim; ++i)
  {
    const Vec<dim> edge = x[static_cast<std::size_t>(i + 1)] - x[0];
    for (int j = 0; j < dim; ++j)
      A(i, j) = 2.0 * edge[j];
    b[i] = dot(edge, edge);
  }
  return norm(inverse(A) * b);
}

} // namespace undine::fluid
