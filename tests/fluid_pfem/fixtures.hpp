// Small boxes of fluid.
#pragma once

#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/momentum.hpp"

#include <algorithm>
#include <cmath>

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

/// Acceleration by pressure alone.
template <int dim>
void pressure_acceleration(const fluid::FluidMesh<dim>& mesh, fluid::FluidNodes<dim>& nodes)
{
  fluid::ElementSums<dim> sums;
  sums.make_room(nodes.size());
  sums.clear(0, nodes.size());
  fluid::record_nodes<dim>(nodes, {}, 0, nodes.size(), sums);
  fluid::add_element_forces<dim>(mesh, nodes, {}, 1.0, {}, 0.0, nullptr, 0, mesh.n_elements(),
                                 {.node_begin = 0, .node_end = nodes.size()}, sums);
  fluid::take_acceleration<dim>(nodes, {}, 0, nodes.size(), sums, {});
}

/// The `hydraulic` preset of the case file on a plane box.
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

/// The column of `cases/dam_break`, a × 2a in a tank of 4a, a = 0.146 m.
inline fluid::FluidConfig dam_break_config(double spacing)
{
  const double a = 0.146, g = 9.81;
  fluid::FluidConfig config = hydraulic(spacing, 10.0 * std::sqrt(g * 2.0 * a));
  config.size = {a, 2.0 * a, 0.0};
  config.gravity = {0.0, -g, 0.0};
  config.contact_walls = {tank(4.0 * a)};
  return config;
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
