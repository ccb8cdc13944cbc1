// Which Delaunay simplices are fluid.
#pragma once

#include "fluid_pfem/fluid_mesh.hpp"

#include "common/tensor.hpp"

#include <span>
#include <vector>

namespace undine::fluid
{

/// Keep the simplices with circumradius R ≤ α h, h the smallest wanted spacing of their nodes [m]. Corners
/// are taken in the order of their numbers, so that the test gives the same bits wherever it is evaluated.
template <int dim>
std::vector<Simplex<dim>> alpha_shape(std::span<const Vec<dim>> x, std::span<const double> h, double alpha,
                                      const std::vector<Simplex<dim>>& delaunay);

} // namespace undine::fluid
