// Small boxes of fluid.
#pragma once

#include "fluid_pfem/fluid_config.hpp"

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

} // namespace undine::test
