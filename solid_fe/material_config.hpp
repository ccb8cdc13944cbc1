// What a case says about the material; each law picks what it needs.
#pragma once

#include <functional>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace undine::solid
{

/// A number that one law reads from [solid] under a key of its own, in [low, high]; a law lists them as
/// `own_keys`.
struct LawKey
{
  std::string_view name, unit, meaning;
  double usual, low, high;
};

struct MaterialConfig
{
  double density = 0.0;        ///< in the reference state [kg/m³]
  double youngs_modulus = 0.0; ///< [Pa]
  double poisson_ratio = 0.0;  ///< in (−1, ½)
  std::string law = "neo_hookean_ln";

  std::map<std::string, double, std::less<>> own; ///< numbers of the law's own keys, where not as usual
  double number(const LawKey& key) const
  {
    const auto found = own.find(key.name);
    return found == own.end() ? key.usual : found->second;
  }

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
