// What the case says about walls and plane surfaces of the fluid's domain.
#pragma once

#include "common/config/expression.hpp"
#include "common/tensor.hpp"

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace undine::fluid
{

/// Rigid motion of a wall: turn by angle(t) about `centre`, then shift by displacement(t). Without formulas
/// it stands still.
struct WallMotion
{
  std::vector<Expression> displacement; ///< [m], empty or dim formulas of t
  std::optional<Expression> angle;      ///< [rad], about the z axis through `centre`
  std::array<double, 3> centre{};       ///< [m]

  bool moves() const { return !displacement.empty() || angle.has_value(); }
};

/// What the case says about one wall.
struct WallGeometry
{
  std::string name;
  std::vector<std::array<double, 3>>
      points;                     ///< 2-D: a polyline, the fluid on its left when it is walked along [m]
  bool closed = false;            ///< the last point is joined to the first
  bool plane = false;             ///< points[0] and `normal` define an unbounded plane
  std::array<double, 3> normal{}; ///< into the fluid
  std::vector<std::array<std::array<double, 3>, 3>>
      facets;               ///< segments (2-D: two corners each) or triangles of a mesh file, as polylines
  bool box = false;         ///< 3-D: points[0] and points[1] are the lowest and the highest corner of a box
  bool fluid_inside = true; ///< of the box
  bool no_slip = false;     ///< a node on the wall moves with it until it is pulled off
  WallMotion motion;
};

/// Walls out of the boundary groups of a Gmsh mesh, each a wall of its name: the mesh is that of the room of
/// the fluid (`fluid_inside`) or of an obstacle in it.
/// @param dim of the mesh; in space quadrilaterals become triangles
/// @param group the only one wanted; empty: all
/// @throws InputError for a file that cannot be read, or without such a group
std::vector<WallGeometry> walls_of_mesh(const std::string& path, int dim, const std::string& group,
                                        bool fluid_inside);

/// A plane surface of the domain.
template <int dim>
struct PlaneSurface
{
  std::string name;
  Vec<dim> point;
  Vec<dim> normal; ///< unit, outward
};

} // namespace undine::fluid
