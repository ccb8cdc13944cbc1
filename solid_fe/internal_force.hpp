// Internal nodal forces F_int,a = Σ_e Σ_q w P(F) ∇N_a of element blocks, and the strain energy of the same
// sums.
#pragma once

#include "common/tensor.hpp"
#include "common/types.hpp"
#include "solid_fe/body.hpp"

#include <span>

namespace undine::solid
{

/// Which elements of a body: those that touch wet nodes, the others, or both.
enum class Part
{
  interface,
  interior
};

/// Add the internal forces [N] of `part` at displacement `u` to `F_int`, element by element in fixed order.
/// @return an element (position in the block) whose det F is not positive, −1 if there is none; NaN counts as
/// not positive
template <int dim>
index_t add_internal_force(const Body<dim>& body, Part part, std::span<const Vec<dim>> u,
                           std::span<Vec<dim>> F_int);

/// Σ_e Σ_q w W(F) [J], per metre of thickness in 2-D.
template <int dim>
double strain_energy(const Body<dim>& body, std::span<const Vec<dim>> u);

} // namespace undine::solid
