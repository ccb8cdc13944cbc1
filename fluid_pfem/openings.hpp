// Openings of the domain: inlets that push rows of new nodes in, outlets that take nodes out.
#pragma once

#include "common/config/expression.hpp"
#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/fluid_nodes.hpp"
#include "fluid_pfem/tait.hpp"

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace undine::fluid
{

/// 2-D: fluid enters through the segment a → b, to its left; 3-D: through the rectangle with the corner a and
/// the sides a → b and a → c, along (b − a) × (c − a).
struct InletConfig
{
  std::string name;
  std::array<double, 3> a{}, b{}, c{}; ///< [m]
  std::vector<Expression> speed;       ///< one function of t [m/s]
};

/// Nodes that are found in this box at a remesh leave the run.
struct OutletConfig
{
  std::array<double, 3> lower{}, upper{}; ///< [m]
};

/// Behind an inlet stand rows of *driven* nodes that move with the inflow whatever the pressure; past the
/// opening they are free. Nodes of inlet k carry bit 31 − k of the surface mask while they are driven.
template <int dim>
class Openings
{
public:
  Openings() = default;
  Openings(std::vector<InletConfig> inlets, std::vector<OutletConfig> outlets, double spacing);

  bool empty() const { return inlets_.empty() && outlets_.empty(); }
  SurfaceMask driven_mask() const { return driven_; }
  /// The rows at the start, appended to a scene.
  void first_rows(std::vector<Vec<dim>>& x, std::vector<SurfaceMask>& surface, std::vector<int>& body) const;
  /// x lies in a driven row's strip.
  bool behind_inlet(const Vec<dim>& x) const;
  /// Give driven nodes their velocity and acceleration zero.
  void drive(FluidNodes<dim>& nodes, double t) const;
  /// Of each inlet, how far behind the opening the last of nodes begin, …, end − 1 that it drives is [m];
  /// 0: none is.
  std::vector<double> behind(const FluidNodes<dim>& nodes, std::size_t begin, std::size_t end) const;
  /// A last row has moved so far that the next one must follow.
  bool row_due(std::span<const double> behind) const;
  /// Free the nodes past the opening and add the rows that are due, with their elements. @returns mass [kg]
  double let_in(FluidNodes<dim>& nodes, std::vector<Simplex<dim>>& elements, global_index_t& next_id,
                double rho0) const;
  /// Take the share of all elements with a node in an outlet off their nodes, drop these elements and mark
  /// the nodes in outlets. @returns mass that leaves [kg]; `gone` is empty if none does
  double let_out(FluidNodes<dim>& nodes, std::vector<Simplex<dim>>& elements, std::vector<char>& gone) const;

private:
  struct Inlet
  {
    InletConfig config;
    Vec<dim> a{}, n{};                    ///< corner, unit normal into the domain
    std::array<Vec<dim>, dim - 1> side;   ///< from one node of a row to the next
    std::array<int, dim - 1> intervals{}; ///< of a row
    double row = 0.0;                     ///< distance of rows
    SurfaceMask bit = 0;

    double offset(const Vec<dim>& x) const { return dot(x - a, n); }
    /// Place in a row, in intervals along each side.
    std::array<double, dim - 1> place(const Vec<dim>& x) const;
    /// Number in a row of the node at that place.
    std::size_t number(const std::array<int, dim - 1>& place) const;
    std::size_t nodes_per_row() const;
  };
  std::vector<Inlet> inlets_;
  std::vector<OutletConfig> outlets_;
  SurfaceMask driven_ = 0;
};

} // namespace undine::fluid
