// What a case says about the material; each law picks what it needs.
#pragma once

#include <limits>
#include <string>
#include <vector>

namespace undine::solid
{

struct MaterialConfig
{
  double density = 0.0;        ///< in the reference state [kg/m³]
  double youngs_modulus = 0.0; ///< [Pa]
  double poisson_ratio = 0.0;  ///< in (−1, ½)
  std::string law = "neo_hookean_ln";

  double mooney_share = 0.25; ///< mooney_rivlin: c₀₁ / (c₁₀ + c₀₁), in [0, 1]

  double yield_stress = std::numeric_limits<double>::infinity(); ///< plastic laws [Pa]; infinite: elastic
  double hardening_modulus = 0.0; ///< j2: slope of yield stress over equivalent plastic strain [Pa]
  /// j2: equivalent plastic strain and yield stress [Pa] alternately; instead of the two above if not empty.
  std::vector<double> hardening_table;

  double hardening_coefficient = 0.0; ///< johnson_cook: B [Pa]
  double hardening_exponent = 1.0;    ///< johnson_cook: n
  double rate_coefficient = 0.0;      ///< johnson_cook: C
  double reference_rate = 1.0;        ///< johnson_cook: ε̇₀ [1/s]
  double thermal_exponent = 1.0;      ///< johnson_cook: m
  double melting_rise =
      0.0; ///< johnson_cook: T_melt − T_room [K], from the temperature at the start; 0: no softening
  double heat_capacity = 0.0; ///< johnson_cook: per mass [J/(kg K)]; 0: isothermal
  double heat_fraction = 0.9; ///< johnson_cook: share of the plastic work that heats

  double mass_damping = 0.0;      ///< α of the force −α m v [1/s]
  double stiffness_damping = 0.0; ///< β of the viscous stress β ℂ:Ė [s]
};

} // namespace undine::solid
