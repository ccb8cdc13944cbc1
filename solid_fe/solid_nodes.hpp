// The fields of the solid's nodes: contiguous arrays, wet nodes first.
#pragma once

#include "common/tensor.hpp"
#include "common/types.hpp"

#include <vector>

namespace undine::solid
{

template <int dim>
struct SolidNodes
{
  std::vector<Vec<dim>> X;            ///< reference position [m]
  std::vector<Vec<dim>> u;            ///< displacement [m]
  std::vector<Vec<dim>> v;            ///< velocity [m/s]
  std::vector<Vec<dim>> a;            ///< acceleration [m/s²]
  std::vector<double> m;              ///< lumped mass [kg], per metre of thickness in 2-D
  std::vector<Vec<dim>> inverse_mass; ///< 1/m [1/kg], 0 in components with prescribed motion

  index_t size() const { return static_cast<index_t>(X.size()); }

  /// Visit every field once, with its name. Checkpoints go through here, so a new field cannot be forgotten.
  template <class Visitor>
  void for_each_field(Visitor&& visit)
  {
    visit("X", X);
    visit("u", u);
    visit("v", v);
    visit("a", a);
    visit("m", m);
    visit("inverse_mass", inverse_mass);
  }
};

} // namespace undine::solid
