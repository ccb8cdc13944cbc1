// The fields of the fluid's nodes.
#pragma once

#include "common/tensor.hpp"
#include "common/types.hpp"
#include "fluid_pfem/period.hpp"

#include <cstdint>
#include <limits>
#include <vector>

namespace undine::fluid
{

using SurfaceMask = std::uint32_t; ///< bit s: the node lies on named surface s

/// Volume of a node of a regular lattice of spacing `h` [m]: triangles in the plane, cubes in space [m^dim].
template <int dim, class Real = double>
constexpr Real regular_volume(const Real& h)
{
  return dim == 2 ? Real(0.86602540378443865) * h * h : h * h * h;
}

/// Row of a node that has none yet.
constexpr std::int64_t no_row = std::numeric_limits<std::int64_t>::max();

/// What a node is since the last remesh.
enum NodeFlag : std::uint8_t
{
  on_boundary = 1,     ///< on a boundary facet, or isolated
  on_free_surface = 2, ///< on a boundary facet that is neither wall nor interface
  on_wall = 4,         ///< on a rigid wall
  isolated_node = 8    ///< in no element: flies
};

/// Structure of arrays; row n of every field belongs to node n. Wet (interface) nodes come first.
template <int dim>
struct FluidNodes
{
  std::vector<Vec<dim>> x; ///< position [m]
  std::vector<Vec<dim>> v; ///< velocity [m/s]
  std::vector<Vec<dim>> a; ///< acceleration, link included [m/s²]
  std::vector<double> m;   ///< mass of the density field, m = ρV [kg], per unit thickness in 2-D
  std::vector<double> M; ///< particle mass: conserved to round-off, moved only by exchange between nodes [kg]
  std::vector<double> inertia; ///< mass of Newton's law: m, but not below a fraction of a regular node's; wet
                               ///< nodes: as told to the coupler [kg]
  std::vector<double> rho;     ///< density [kg/m³]
  std::vector<double> p;       ///< pressure [Pa]
  std::vector<double> V;       ///< nodal volume [m^dim]
  std::vector<double> h;       ///< wanted spacing: the size field here, at the last remesh [m]
  std::vector<SurfaceMask> surface; ///< named surfaces the node lies on
  std::vector<global_index_t> id;   ///< for ever
  std::vector<std::int64_t> row;    ///< of the sweep that numbers nodes: nodes are sorted by row, then id
  std::vector<std::uint8_t> flag;   ///< NodeFlag
  std::vector<std::uint8_t> alone;  ///< remeshes it has been isolated for

  Period<dim> period; ///< of the space they are in

  index_t size() const { return static_cast<index_t>(x.size()); }
  double distance(std::size_t i, std::size_t j) const
  {
    return norm(period.near(x[i], x[j]) - x[i]);
  } ///< [m]

  /// Visit every field once: renumbering, exchange and checkpoints go through here, so that no field can be
  /// forgotten.
  template <class Visitor>
  void for_each_field(Visitor&& visit)
  {
    visit("x", x);
    visit("v", v);
    visit("a", a);
    visit("m", m);
    visit("M", M);
    visit("inertia", inertia);
    visit("rho", rho);
    visit("p", p);
    visit("V", V);
    visit("h", h);
    visit("surface", surface);
    visit("id", id);
    visit("row", row);
    visit("flag", flag);
    visit("alone", alone);
  }
};

} // namespace undine::fluid
