// The fields of the fluid's nodes.
#pragma once

#include "common/tensor.hpp"
#include "common/types.hpp"

#include <cstdint>
#include <vector>

namespace undine::fluid
{

using SurfaceMask = std::uint32_t; ///< bit s: the node lies on named surface s

/// Structure of arrays; row n of every field belongs to node n. Wet (interface) nodes come first.
template <int dim>
struct FluidNodes
{
  std::vector<Vec<dim>> x;          ///< position [m]
  std::vector<Vec<dim>> v;          ///< velocity [m/s]
  std::vector<Vec<dim>> a;          ///< acceleration, link included [m/s²]
  std::vector<double> m;            ///< lumped mass [kg], per unit thickness in 2-D
  std::vector<double> rho;          ///< density [kg/m³]
  std::vector<double> p;            ///< pressure [Pa]
  std::vector<double> V;            ///< nodal volume [m^dim]
  std::vector<double> h;            ///< wanted spacing [m]
  std::vector<SurfaceMask> surface; ///< named surfaces the node lies on
  std::vector<global_index_t> id;   ///< for ever

  index_t size() const { return static_cast<index_t>(x.size()); }

  /// Visit every field once: renumbering, exchange and checkpoints go through here, so that no field can be
  /// forgotten.
  template <class Visitor>
  void for_each_field(Visitor&& visit)
  {
    visit("x", x);
    visit("v", v);
    visit("a", a);
    visit("m", m);
    visit("rho", rho);
    visit("p", p);
    visit("V", V);
    visit("h", h);
    visit("surface", surface);
    visit("id", id);
  }
};

} // namespace undine::fluid
