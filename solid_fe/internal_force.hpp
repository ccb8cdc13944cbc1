// Internal nodal forces F_int,a = Σ_e Σ_q w P(F) ∇N_a of element blocks, and the energy of the same sums.
#pragma once

#include "common/parallel/exact_sum.hpp"
#include "common/tensor.hpp"
#include "common/types.hpp"
#include "solid_fe/body.hpp"

#include <span>
#include <vector>

namespace undine::solid
{

/// Which elements of a body: those that touch wet nodes, or the others.
enum class Part
{
  interface,
  interior
};

/// Energies of elements [J], per metre of thickness in 2-D.
struct StoredEnergy
{
  ExactSum strain;    ///< Σ_e Σ_q w W
  ExactSum hourglass; ///< of the hourglass stiffness
  ExactSum plastic;   ///< plastic work so far
};

/// Add the internal forces [N] of `part` at displacement `u` to `F_int`, element by element in fixed order;
/// `state` (the body's own, or a copy for a trial) moves on by a step of `dt`.
/// @return an element (position in the block) whose det F is not positive, −1 if there is none; NaN counts as
/// not positive
template <int dim>
index_t add_internal_force(const Body<dim>& body, Part part, std::span<const Vec<dim>> u, double dt,
                           BodyState<dim>& state, std::span<Vec<dim>> F_int);

/// Add the energies of the elements that this rank counts.
template <int dim>
void add_stored_energy(const Body<dim>& body, std::span<const Vec<dim>> u, StoredEnergy& energy);

/// Append the mean Cauchy stress of each element [Pa] and its mean equivalent plastic strain (0 for elastic
/// laws).
template <int dim>
void append_stress(const Body<dim>& body, std::span<const Vec<dim>> u, std::vector<Mat<3>>& sigma,
                   std::vector<double>& plastic_strain);

} // namespace undine::solid
