// Flat pieces of walls: where they are, how far they reach, and how those of the case are made.
#pragma once

#include "common/tensor.hpp"
#include "fluid_pfem/wall_geometry.hpp"

#include <array>
#include <vector>

namespace undine::fluid
{

/// A flat piece of a wall at the present time: a segment, a triangle or an unbounded plane.
template <int dim>
struct WallPiece
{
  std::array<Vec<dim>, dim> corner{}; ///< of a plane only the first counts [m]
  Vec<dim> n{};                       ///< unit, into the fluid
  int wall = 0;                       ///< index of the wall it belongs to
  bool plane = false;
  int face = -1;                   ///< 3-D: first piece of the flat face this triangle is part of
  std::array<double, dim> reach{}; ///< how far it extends past its end (2-D: at corner k) or edge (3-D:
                                   ///< corner k to the next): past a concave one so that nothing slips
                                   ///< between two pieces, not past a convex one [m]
  std::array<Vec<dim>, dim> out{}; ///< unit, in its plane: out of it at corner k (2-D) or edge k (3-D)

  /// Set `out` of what is no plane, from corners and n.
  void find_ends();
  /// Signed distance to the plane of the piece, positive on the fluid's side [m].
  double distance(const Vec<dim>& x) const { return dot(x - corner[0], n); }
  /// How far the projection of x lies outside the piece, its reach included or not; negative inside [m].
  double overhang(const Vec<dim>& x, bool with_reach) const;
  /// Distance of x to the piece itself [m].
  double gap(const Vec<dim>& x) const;
};

/// Pieces of all walls as the case says them, wall by wall. @throws InputError for a wall with fewer than two
/// points
template <int dim>
std::vector<WallPiece<dim>> pieces_of(const std::vector<WallGeometry>& geometry, double spacing);

/// Sets `reach`: past the ends and edges that pieces share far for concave ones, a rounding for flat ones.
/// Pieces of walls that move apart share none.
/// @returns there is a convex one
template <int dim>
bool join(std::vector<WallPiece<dim>>& pieces, const std::vector<WallGeometry>& geometry, double spacing);

} // namespace undine::fluid
