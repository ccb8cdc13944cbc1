// Small boxes of fluid.
#pragma once

#include "fluid_pfem/fluid.hpp"

#include <algorithm>

namespace undine::test
{

/// A unit square or cube of water with nodes `h` apart, free on all sides, no gravity.
template <int dim>
fluid::FluidConfig box_config(double h)
{
  fluid::FluidConfig config;
  config.dim = dim;
  config.tait = {.rho0 = 1000.0, .p0 = 0.0, .B = 2.2e9 / 7.0, .gamma = 7.0};
  config.size = {1.0, 1.0, 1.0};
  config.element_size = h;
  return config;
}

/// The `hydraulic` preset of the case file.
inline fluid::FluidConfig hydraulic(double spacing, double sound_speed)
{
  fluid::FluidConfig config = box_config<2>(spacing);
  config.tait.B = 1000.0 * sound_speed * sound_speed / 7.0;
  config.terms.bulk_linear = 0.05;
  config.terms.residual = 0.1;
  config.feedback_time = 100.0;
  config.inertia_floor = 0.1;
  config.remesh.shape.gap = 0.2;
  return config;
}

/// A tank with walls 20 m high.
inline fluid::WallGeometry tank(double width)
{
  fluid::WallGeometry wall;
  wall.name = "tank";
  wall.points = {{0.0, 20.0, 0.0}, {0.0, 0.0, 0.0}, {width, 0.0, 0.0}, {width, 20.0, 0.0}};
  return wall;
}

/// Largest x of the nodes in elements.
inline double front_of(const fluid::Fluid<2>& fluid)
{
  double front = -1e300;
  for (std::size_t n = 0; n < fluid.nodes().x.size(); ++n)
    if (!(fluid.nodes().flag[n] & fluid::isolated_node))
      front = std::max(front, fluid.nodes().x[n][0]);
  return front;
}

} // namespace undine::test
