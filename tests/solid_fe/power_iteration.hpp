// The true highest frequency of a solid, for tests of its bound.
#pragma once

#include "tests/solid_fe/fixtures.hpp"

#include <cmath>
#include <vector>

namespace undine::solid::test
{

/// Highest frequency of M⁻¹K at displacement u: power iteration with K v by central differences of the
/// internal force, which approaches the true value from below.
template <int dim>
double highest_frequency(const Solid<dim>& solid, const std::vector<Vec<dim>>& u, int iterations = 1500)
{
  Random random(31);
  const auto& nodes = solid.nodes();
  std::vector<Vec<dim>> v(u.size());
  for (auto& x : v)
    x = random.vector<dim>(1.0);
  double omega2 = 0.0;
  for (int k = 0; k < iterations; ++k)
  {
    double length2 = 0.0; // in the metric of the mass, free components only
    for (std::size_t n = 0; n < v.size(); ++n)
      for (int i = 0; i < dim; ++i)
        length2 += nodes.inverse_mass[n][i] > 0.0 ? nodes.m[n] * v[n][i] * v[n][i] : (v[n][i] = 0.0);
    for (auto& x : v)
      x *= 1.0 / std::sqrt(length2);
    const double step = 1e-6;
    auto forward = u, backward = u;
    for (std::size_t n = 0; n < v.size(); ++n)
    {
      forward[n] += step * v[n];
      backward[n] -= step * v[n];
    }
    const auto F_forward = solid.internal_force_at(forward), F_backward = solid.internal_force_at(backward);
    omega2 = 0.0;
    for (std::size_t n = 0; n < v.size(); ++n)
    {
      const auto Kv = (0.5 / step) * (F_forward[n] - F_backward[n]);
      omega2 += dot(v[n], Kv);
      for (int i = 0; i < dim; ++i)
        v[n][i] = nodes.inverse_mass[n][i] * Kv[i];
    }
  }
  return std::sqrt(omega2);
}

} // namespace undine::solid::test
