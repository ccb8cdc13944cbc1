// Conservation of mass, Eqs. (1) and (7) of Meduri et al. (2017), in nodal-volume form.
//
// M_ρ R = R₀ with M_ρ row-sum lumped in the current configuration and R₀, the nodal masses, frozen since the
// last remesh:
//   V_i = Σ_e V_e/(dim+1),   ρ_i = m_i / V_i,   p_i = p(ρ_i).
#pragma once

#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/fluid_nodes.hpp"
#include "fluid_pfem/tait.hpp"

namespace undine::fluid
{

/// Nodal volumes from the current positions. Isolated nodes get 0.
template <int dim>
void update_nodal_volumes(const FluidMesh<dim>& mesh, FluidNodes<dim>& nodes);
/// Its part: add what elements [begin, end) give to the volumes of their corners, in their order.
template <int dim>
void add_element_volumes(const FluidMesh<dim>& mesh, index_t begin, index_t end, FluidNodes<dim>& nodes);

/// ρ = m/V and p = p(ρ) of nodes [begin, end); isolated nodes are at ρ₀, p₀. A node whose volume is less than
/// V* = `floor` times the regular volume (one flat element, a corner) would be a stiff spring: it is
/// completed to V* by fluid at rest density, ρ = (m + ρ₀ (V* − V))/V*.
/// @returns the first node whose volume is not positive although it has elements, or −1
template <int dim>
index_t update_density_and_pressure(const FluidMesh<dim>& mesh, const Tait& tait, double floor,
                                    FluidNodes<dim>& nodes, index_t begin, index_t end);

} // namespace undine::fluid
