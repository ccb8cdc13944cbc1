// The loops over the elements of a body, for one law: what each law's own unit instantiates.
#pragma once

#include "common/tensor.hpp"
#include "common/types.hpp"
#include "solid_fe/body.hpp"
#include "solid_fe/internal_force.hpp"

#include <span>
#include <vector>

namespace undine::solid
{

/// See add_internal_force. `state` goes along.
template <int dim, class Law>
index_t add_forces_of(const Body<dim>& body, const Law& law, Part part, std::span<const Vec<dim>> u,
                      double dt, BodyState<dim>& state, std::span<Vec<dim>> F_int);

template <int dim, class Law>
void add_stored_energy_of(const Body<dim>& body, const Law& law, std::span<const Vec<dim>> u,
                          StoredEnergy& energy);

/// max_e (full γ_e + volumetric δ_e) at the current deformation [1/s²].
template <int dim, class Law>
double highest_frequency_squared_of(const Body<dim>& body, const Law& law, std::span<const Vec<dim>> u);

/// Append the mean Cauchy stress of each element [Pa] and, for plastic laws, the mean equivalent plastic
/// strain.
template <int dim, class Law>
void append_stress_of(const Body<dim>& body, const Law& law, std::span<const Vec<dim>> u,
                      std::vector<Mat<3>>& sigma, std::vector<double>& plastic_strain);

/// Lanes the history of a body needs.
template <int dim, class Law>
std::size_t history_lanes_of(const Body<dim>& body, const Law& law);

} // namespace undine::solid
