// Nodes of the fluid that a sharp corner of the solid holds, and when it lets them go.
#include "coupler/contact.hpp"

#include <algorithm>
#include <cmath>

namespace undine::coupler
{

/// Nodes on a corner whose neighbours on the boundary lie on the sides before and after it.
template <int dim>
void UnilateralContact<dim>::find_held()
{
  held_.assign(x_.size(), {});
  if constexpr (dim == 2)
  {
    constexpr double same_place = 1e-6, touching = 0.02; // of a facet
    const double size = before_.facet_size();
    std::vector<index_t> before(x_.size(), -1), after(x_.size(), -1); // neighbours on the boundary
    for (const auto& f : faces_)
    {
      after[static_cast<std::size_t>(f[0])] = f[1];
      before[static_cast<std::size_t>(f[1])] = f[0];
    }
    for (const auto& corner : before_.convex_corners(side_))
    {
      const auto& facet = before_.facets()[static_cast<std::size_t>(corner[0])];
      const Vec<dim> at = before_.x()[static_cast<std::size_t>(facet[1])];
      const auto lies_on = [&](index_t node, index_t of_side)
      {
        if (node < 0)
          return false;
        const Near near = before_.nearest(x_[static_cast<std::size_t>(node)], size);
        return near.facet >= 0 && std::abs(near.gap) < touching * size &&
               side_[static_cast<std::size_t>(near.facet)] == side_[static_cast<std::size_t>(of_side)];
      };
      for (std::size_t k = 0; k < x_.size(); ++k) // the fluid runs along the solid the other way round
        if (norm(x_[k] - at) < same_place * size && lies_on(after[k], corner[0]) &&
            lies_on(before[k], corner[1]))
          held_[k] = {corner, {before[k], after[k]}};
    }
  }
}

/// Held nodes that the water presses less than what would turn them around the corner slide or leave from the
/// next step on.
template <int dim>
void UnilateralContact<dim>::let_go(double dt, const std::array<std::vector<double>, 2>& v)
{
  for (std::size_t k = 0; k < x_.size(); ++k)
    if (Held& held = held_[k]; held.facet[0] >= 0)
    {
      Vec<dim> outward{};
      for (const index_t f : held.facet)
        outward += after_.normal_of(f);
      const double pressed = dot(outward, dv_fluid_[k]) / (norm(outward) * dt); // [m/s²]
      const Vec<dim> V = row_of(v[Side::solid], after_.facets()[static_cast<std::size_t>(held.facet[0])][1]);
      double turning = 0.0; // v²/r [m/s²]
      for (const index_t n : held.neighbour)
        turning = std::max(turning, norm_squared(row_of(v[Side::fluid], n) - V) /
                                        norm(x_[static_cast<std::size_t>(n)] - x_[k]));
      if (!(pressed > turning))
        held = {};
    }
}

template class UnilateralContact<2>;
template class UnilateralContact<3>;

} // namespace undine::coupler
