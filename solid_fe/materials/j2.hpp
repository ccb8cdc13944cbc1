// J2 plasticity with isotropic hardening, linear or tabulated.
#pragma once

#include "solid_fe/materials/finite_plasticity.hpp"

namespace undine::solid
{

/// σ_y(α) = σ_0 + H α, or linear between the points of a table and constant beyond its end.
struct IsotropicHardening
{
  static constexpr const char* name = "j2";
  static constexpr bool heats = false;
  double initial_yield_stress = 0.0; ///< [Pa]
  double modulus = 0.0;              ///< H [Pa]
  std::vector<double> table;         ///< α, σ_y alternately; α ascending from 0

  static IsotropicHardening from(const MaterialConfig& config)
  {
    const auto& table = config.hardening_table;
    return {table.empty() ? config.yield_stress : table[1], config.hardening_modulus, table};
  }
  double yield_stress(double strain, double, double) const
  {
    if (table.empty())
      return initial_yield_stress + modulus * strain;
    for (std::size_t k = 2; k < table.size(); k += 2)
      if (strain < table[k])
        return table[k - 1] +
               (table[k + 1] - table[k - 1]) * (strain - table[k - 2]) / (table[k] - table[k - 2]);
    return table.back();
  }
  double heating(double) const { return 0.0; }
};

using J2 = FinitePlasticity<IsotropicHardening>;

} // namespace undine::solid
