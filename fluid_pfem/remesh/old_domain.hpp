// Was this point inside the fluid before the remesh?
#pragma once

#include "fluid_pfem/fluid_mesh.hpp"

#include "common/tensor.hpp"

#include <span>
#include <vector>

namespace undine::fluid
{

/// For every query point whether it lies in one of the positively oriented elements. The points are sorted
/// into a grid of bins of size `bin`, about the spacing of nodes [m]; each element looks at the points near
/// it. In a periodic space the points lie in the cell.
template <int dim>
std::vector<char> inside(std::span<const Vec<dim>> x, std::span<const Simplex<dim>> elements,
                         std::span<const Vec<dim>> queries, double bin, const Period<dim>& period = {},
                         int threads = 1);

/// The same for the elements of all ranks: each asks those whose elements may contain its points. Collective.
/// @param elements of this rank, at `x`
template <int dim>
std::vector<char> inside(std::span<const Vec<dim>> x, std::span<const Simplex<dim>> elements,
                         std::span<const Vec<dim>> queries, double bin, const Period<dim>& period,
                         const Ranks& ranks, int threads = 1);

} // namespace undine::fluid
