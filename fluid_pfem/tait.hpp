// Tait equation of state, Eq. (3) of Meduri et al. (2017), in both readings of its modulus.
#pragma once

#include "common/lanes.hpp"

#include <cmath>

namespace undine::fluid
{

/// p = p₀ + B [(ρ/ρ₀)^γ − 1]. The paper prints B = K; then the tangent modulus ρ₀c² at ρ₀ is γK and water's K
/// = 2.2e9 Pa gives c = 3924 m/s. With B = K/γ the tangent modulus is K and c = 1483 m/s. The case says which
/// reading holds.
struct Tait
{
  double rho0 = 1000.0; ///< reference density [kg/m³]
  double p0 = 0.0;      ///< reference pressure [Pa]
  double B = 2.2e9 / 7; ///< K or K/γ [Pa]
  double gamma = 7.0;   ///< exponent

  /// Pressure above the floor that keeps ρ > 0 [Pa].
  template <class Real>
  Real pressure(const Real& rho) const
  {
    const Real r = rho / Real(rho0);
    Real power;
    if (gamma == 7.0)
    {
      const Real r3 = r * r * r;
      power = r3 * r3 * r;
    }
    else
      for (int k = 0; k < lanes_of<Real>; ++k)
        set_lane(power, k, std::pow(lane(r, k), gamma));
    return Real(p0) + Real(B) * (power - Real(1.0));
  }
  double density(double p) const { return rho0 * std::pow(1.0 + (p - p0) / B, 1.0 / gamma); }
  /// ρ c² = dp/dlnρ = γ (p − p₀ + B) [Pa].
  template <class Real>
  Real tangent_modulus(const Real& p) const
  {
    return Real(gamma) * (p - Real(p0) + Real(B));
  }
  double sound_speed(double rho) const { return std::sqrt(tangent_modulus(pressure(rho)) / rho); }
  /// Energy per mass e with de/dρ = (p − p₀)/ρ², e(ρ₀) = 0 [J/kg].
  double internal_energy(double rho) const
  {
    const double r = rho / rho0;
    if (gamma == 1.0)
      return B / rho0 * (std::log(r) + 1.0 / r - 1.0);
    // (B/ρ₀)[r^(γ−1)/(γ−1) + 1/r − γ/(γ−1)], written without the cancellation near r = 1
    if (gamma == 7.0) // by powers of s = r − 1, of which those below s² cancel
    {
      const double s = r - 1.0;
      return B / rho0 * s * s * (1.0 / r + 2.5 + s * (10.0 / 3.0 + s * (2.5 + s * (1.0 + s / 6.0))));
    }
    const double l = std::log(r);
    return B / rho0 * (std::expm1((gamma - 1.0) * l) / (gamma - 1.0) + std::expm1(-l));
  }
  /// Enthalpy e + (p − p₀)/ρ: what mass added at constant volume brings into the energy [J/kg].
  template <class Real>
  Real enthalpy(const Real& rho) const
  {
    const Real r = rho * Real(1.0 / rho0);
    Real power;
    if (gamma == 7.0)
    {
      const Real r2 = r * r;
      power = r2 * r2 * r2;
    }
    else
      for (int k = 0; k < lanes_of<Real>; ++k)
        set_lane(power, k, gamma == 1.0 ? std::log(lane(r, k)) : std::pow(lane(r, k), gamma - 1.0));
    return gamma == 1.0 ? Real(B / rho0) * power
                        : Real(B / rho0 * gamma / (gamma - 1.0)) * (power - Real(1.0));
  }
  /// Density at rest under `depth` of fluid with surface pressure p₀: ∫dp/ρ = g·depth in closed form.
  double hydrostatic_density(double g_depth) const
  {
    if (gamma == 1.0)
      return rho0 * std::exp(g_depth * rho0 / B);
    return rho0 * std::pow(1.0 + g_depth * rho0 * (gamma - 1.0) / (gamma * B), 1.0 / (gamma - 1.0));
  }
};

} // namespace undine::fluid
