// The deforming solid as the fluid sees it: where contact may come and what no element may cover.
#pragma once

#include "common/coupling/messages.hpp"
#include "common/mesh/facet_surface.hpp"
#include "common/tensor.hpp"

#include <array>
#include <span>
#include <vector>

namespace undine::fluid
{

/// The wet surface of the solid at the time of the last SURFACE message.
template <int dim>
class SolidSurface
{
public:
  bool empty() const { return surface_.empty(); }
  /// @param t time of the positions [s]
  void show(const link::SurfaceMesh& solid, double t);
  /// Largest speed of a node between the last two calls of show() [m/s]; infinite after the first.
  double speed() const { return speed_; }

  template <class Archive>
  void for_each_state(Archive& archive)
  {
    archive("surface", surface_);
    archive("side", side_);
    archive("low", low_);
    archive("high", high_);
    archive("t", t_);
    archive("speed", speed_);
    archive("velocity", velocity_);
  }

  bool is_near(const Vec<dim>& x, double reach) const;
  /// Numbers of the smooth sides on which x lies within `tolerance` [m], at most three, −1 where fewer. They
  /// do not collide with those of rigid walls.
  std::array<int, 3> sides_at(const Vec<dim>& x, double tolerance) const;
  /// How deep x lies inside [m]; 0 outside, and where the surface is further than `reach`.
  double depth(const Vec<dim>& x, double reach) const;
  /// x, or the nearest point of the surface if x is inside by more than `allowed` and at most `depth` [m].
  Vec<dim> outside(const Vec<dim>& x, double allowed, double depth) const;
  /// The simplex with these corners lies in the solid, or passes through it.
  /// @param h spacing of the fluid [m]
  bool blocks(std::span<const Vec<dim>> corner, double h) const;
  struct Corner
  {
    Vec<dim> x; ///< [m]
    Vec<dim> v; ///< mean velocity between the last two calls of show() [m/s]
  };
  /// Where two smooth sides meet and the solid is convex; in space none.
  std::vector<Corner> convex_corners() const;

private:
  bool crossed_by(const Vec<dim>& a, const Vec<dim>& b, double tolerance) const;
  bool outside_box(const Vec<dim>& x, double margin) const;

  FacetSurface<dim> surface_;
  std::vector<int> side_;          ///< of each facet
  std::vector<Vec<dim>> velocity_; ///< of each node between the last two calls of show() [m/s]
  Vec<dim> low_{}, high_{};        ///< bounding box
  double t_ = 0.0, speed_ = 0.0;
};

} // namespace undine::fluid
