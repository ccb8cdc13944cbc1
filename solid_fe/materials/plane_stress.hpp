// Plane stress for any law: the stretch across the plane follows from P₃₃ = 0.
#pragma once

#include "solid_fe/deformation.hpp"

#include <array>
#include <cmath>

namespace undine::solid
{

/// Numbers a law keeps per point in `dim` dimensions; 0 for laws without memory.
template <class Law>
constexpr int history_size(int dim)
{
  if constexpr (requires { Law::history(dim); })
    return Law::history(dim);
  else
    return 0;
}

/// Laws run in lanes unless they say otherwise.
template <class Law>
constexpr bool runs_in_lanes()
{
  if constexpr (requires { Law::in_lanes; })
    return Law::in_lanes;
  else
    return true;
}

/// The stress of any law: laws with memory take and change their history `h` over a step `dt` [s].
template <class Law, int dim, class Real, std::size_t n>
Mat<dim, Real> stress_of(const Law& law, const Mat<dim, Real>& H, [[maybe_unused]] std::array<Real, n>& h,
                         [[maybe_unused]] double dt)
{
  if constexpr (n == 0)
    return law.first_piola(H);
  else
    return law.first_piola(H, h, dt);
}

template <class Law, int dim, class Real, std::size_t n>
Real energy_of(const Law& law, const Mat<dim, Real>& H, [[maybe_unused]] const std::array<Real, n>& h)
{
  if constexpr (n == 0)
    return law.strain_energy(H);
  else
    return law.strain_energy(H, h);
}

template <class Law, int dim, std::size_t n>
auto bound_of(const Law& law, const Mat<dim>& H, [[maybe_unused]] const std::array<double, n>& h)
{
  if constexpr (n == 0)
    return law.tangent_bound(H);
  else
    return law.tangent_bound(H, h);
}

/// `Law` in plane stress. Keeps the history of the law in 3-D and the last H₃₃, from which the search starts.
template <class Law>
struct PlaneStress
{
  static constexpr const char* name = Law::name;
  static constexpr bool small_strain = Law::small_strain;
  static constexpr bool in_lanes = false; ///< the number of iterations differs from point to point
  static constexpr int history(int) { return history_size<Law>(3) + 1; }
  using History = std::array<double, static_cast<std::size_t>(history_size<Law>(3) + 1)>;
  using LawHistory = std::array<double, static_cast<std::size_t>(history_size<Law>(3))>;
  const Law& law;

  /// H of the plane with H₃₃.
  static Mat<3> in_3d(const Mat<2>& H, double H33)
  {
    auto H3 = embed_in_3d(H);
    H3(2, 2) = H33;
    return H3;
  }
  static LawHistory law_part(const History& h)
  {
    LawHistory part{};
    std::copy_n(h.begin(), part.size(), part.begin());
    return part;
  }

  /// In-plane stress; secant iteration on H₃₃ from the last one until P₃₃ is 1e-12 of the wave modulus. [Pa]
  Mat<2> first_piola(const Mat<2>& H, History& h, double dt) const
  {
    const double modulus = law.wave_modulus(Mat<3>{});
    auto kept = law_part(h);
    double x = h.back();
    auto P = stress_of(law, in_3d(H, x), kept, dt);
    double x_old = x, r_old = P(2, 2);
    x -= r_old / modulus; // the steepest the law can be at rest: a first step that does not overshoot
    for (int iteration = 0; iteration < 50 && std::abs(r_old) > 1e-12 * modulus; ++iteration)
    {
      kept = law_part(h);
      P = stress_of(law, in_3d(H, x), kept, dt);
      const double r = P(2, 2);
      double slope = x != x_old ? (r - r_old) / (x - x_old) : modulus;
      if (!(slope > 1e-6 * modulus)) // the search left the convex region
        slope = modulus;
      x_old = x;
      r_old = r;
      if (std::abs(r) > 1e-12 * modulus)
        x = std::max(x - r / slope, -1.0 + 0.5 * (1.0 + x)); // never through J = 0
    }
    h.back() = x_old;
    std::copy_n(kept.begin(), kept.size(), h.begin());
    Mat<2> plane;
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < 2; ++j)
        plane(i, j) = P(i, j);
    return plane;
  }
  double strain_energy(const Mat<2>& H, const History& h) const
  {
    return energy_of(law, in_3d(H, h.back()), law_part(h));
  }
  template <int dim>
  double dissipated(const History& h) const
  {
    if constexpr (requires { law.template dissipated<3>(law_part(h)); })
      return law.template dissipated<3>(law_part(h));
    else
      return 0.0;
  }
  /// Condensing the third direction only makes the tangent smaller.
  auto tangent_bound(const Mat<2>& H, const History& h) const
  {
    return bound_of(law, in_3d(H, h.back()), law_part(h));
  }
  double wave_modulus(const Mat<2>&) const { return law.wave_modulus(Mat<3>{}); }
};

} // namespace undine::solid
