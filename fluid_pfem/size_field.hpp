// The wanted spacing of nodes as a function of place: what a scene asks for where.
#pragma once

#include "common/tensor.hpp"
#include "fluid_pfem/walls.hpp"

#include <array>
#include <limits>
#include <string>
#include <vector>

namespace undine::fluid
{

/// A zone of wanted spacing: a box, or a wall or a face of the first box of fluid.
struct SizeZone
{
  double factor = 1.0;                    ///< spacing in the zone over the fluid's element size
  double growth = 0.15;                   ///< of the spacing per distance from the zone
  std::array<double, 3> lower{}, upper{}; ///< corners of the box [m], if `near` is empty
  std::string near;                       ///< name of a wall or of a face
};

/// h(x) = min( coarsest, min over zones of factor · h₀ + growth · distance(x, zone) ): its slope is at most
/// the largest growth. Without zones h = h₀ everywhere.
template <int dim>
class SizeField
{
public:
  SizeField() = default;
  /// @param h0 the fluid's element size [m]  @param coarsest over h0
  /// @throws InputError for a zone near something that does not exist
  SizeField(double h0, double coarsest, std::vector<SizeZone> zones,
            const std::vector<PlaneSurface<dim>>& faces, const Walls<dim>& walls);

  bool uniform() const { return zones_.empty(); }
  double smallest() const { return smallest_; } ///< [m]
  /// Spacing at x with the walls where they are now [m].
  double operator()(const Vec<dim>& x, const Walls<dim>& walls) const;

private:
  struct Zone
  {
    SizeZone config;
    int wall = -1, face = -1;
  };
  double h0_ = 0.0, coarsest_ = std::numeric_limits<double>::max(), smallest_ = 0.0;
  std::vector<Zone> zones_;
  std::vector<PlaneSurface<dim>> faces_;
};

} // namespace undine::fluid
