// Johnson-Cook plasticity: σ_y = (A + B αⁿ)(1 + C ln(α̇/ε̇₀))(1 − Tᵐ), adiabatic heating. Johnson & Cook
// (1983).
#pragma once

#include "solid_fe/materials/finite_plasticity.hpp"

namespace undine::solid
{

/// The rate term is 1 below ε̇₀; T = rise of temperature / (T_melt − T_room), the stress vanishes at T = 1.
struct JohnsonCookHardening
{
  static constexpr const char* name = "johnson_cook";
  static constexpr bool heats = true;
  double initial_yield_stress = 0.0; ///< A [Pa]
  double B = 0.0;                    ///< [Pa]
  double n = 1.0, C = 0.0, m = 1.0;
  double reference_rate = 1.0;   ///< ε̇₀ [1/s]
  double melting_rise = 0.0;     ///< T_melt − T_room [K]; 0: no softening
  double kelvin_per_joule = 0.0; ///< heating of a plastic work per volume [K m³/J]

  static JohnsonCookHardening from(const MaterialConfig& config)
  {
    return {.initial_yield_stress = config.yield_stress,
            .B = config.hardening_coefficient,
            .n = config.hardening_exponent,
            .C = config.rate_coefficient,
            .m = config.thermal_exponent,
            .reference_rate = config.reference_rate,
            .melting_rise = config.melting_rise,
            .kelvin_per_joule = config.heat_capacity > 0.0
                                    ? config.heat_fraction / (config.density * config.heat_capacity)
                                    : 0.0};
  }
  double yield_stress(double strain, double rate, double heating) const
  {
    const double hardened = initial_yield_stress + (strain > 0.0 ? B * std::pow(strain, n) : 0.0);
    const double rated = rate > reference_rate ? 1.0 + C * std::log(rate / reference_rate) : 1.0;
    const double T = melting_rise > 0.0 ? std::clamp(heating / melting_rise, 0.0, 1.0) : 0.0;
    return hardened * rated * (1.0 - (T > 0.0 ? std::pow(T, m) : 0.0));
  }
  double heating(double work) const { return kelvin_per_joule * work; }
};

using JohnsonCook = FinitePlasticity<JohnsonCookHardening>;

} // namespace undine::solid
