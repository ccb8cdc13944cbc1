// Is the mesh still good?
#pragma once

#include "fluid_pfem/fluid_mesh.hpp"

#include <algorithm>
#include <span>
#include <vector>

namespace undine::fluid
{

/// Below it an element is worse than it may be: below `limit` and below 0.6 of what it was.
template <class Real>
Real least_quality(double limit, const Real& before)
{
  using std::min;
  return min(Real(limit), Real(0.6) * before);
}

/// The quality of one of the elements [begin, end) is below least_quality(), or not a number.
/// @param before quality of each element at the last remesh
template <int dim>
bool is_worse(const FluidMesh<dim>& mesh, index_t begin, index_t end, std::span<const Vec<dim>> x,
              std::span<const float> before, double limit, const Period<dim>& period);

/// An edge of the simplices has changed its length by more than `limit` · h since nodes were at x_before.
template <int dim>
bool is_strained(std::span<const Simplex<dim>> simplices, std::span<const Vec<dim>> x,
                 std::span<const Vec<dim>> x_before, std::span<const double> h, double limit,
                 const Period<dim>& period);

} // namespace undine::fluid
