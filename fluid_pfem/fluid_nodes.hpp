// The fields of the fluid's nodes.
#pragma once

#include "common/tensor.hpp"
#include "common/types.hpp"
#include "fluid_pfem/period.hpp"

#include <cstdint>
#include <limits>
#include <span>
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

/// Some rows of a field get new numbers, the others none that matter.
/// @param numbers of these rows; −1: none
/// @param new_number of each row, −1: it goes
/// @param size of the field afterwards, not more than now
template <class T>
void renumber_rows(std::vector<T>& field, std::span<const index_t> numbers,
                   std::span<const index_t> new_number, std::size_t size)
{
  std::vector<T> rows;
  rows.reserve(numbers.size());
  for (const index_t n : numbers)
    rows.push_back(n < 0 ? T{} : field[static_cast<std::size_t>(n)]);
  field.resize(size);
  for (std::size_t k = 0; k < rows.size(); ++k)
    if (const index_t n = numbers[k] < 0 ? -1 : new_number[static_cast<std::size_t>(numbers[k])]; n >= 0)
      field[static_cast<std::size_t>(n)] = rows[k];
}

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
    for_each_field_of_owners(visit);
    for_each_field_of_all(visit);
  }
  /// Those of which a rank has rows around its nodes.
  template <class Visitor>
  void for_each_field_of_owners(Visitor&& visit)
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
  }
  /// Those that every rank moves for all nodes.
  template <class Visitor>
  void for_each_field_of_all(Visitor&& visit)
  {
    visit("h", h);
    visit("surface", surface);
    visit("id", id);
    visit("row", row);
    visit("flag", flag);
    visit("alone", alone);
  }
};

} // namespace undine::fluid
