// Conservation of mass, Eqs. (1) and (7) of Meduri et al. (2017), in nodal-volume form.
//
// M_ρ R = R₀ with M_ρ row-sum lumped in the current configuration and R₀, the nodal masses, frozen since the
// last remesh:
//   V_i = Σ_e V_e/(dim+1),   ρ_i = m_i / V_i,   p_i = p(ρ_i).
#pragma once

#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/fluid_nodes.hpp"
#include "fluid_pfem/tait.hpp"
#include "fluid_pfem/team.hpp"

#include <span>

namespace undine::fluid
{

/// Nodal volumes from the current positions, of all nodes, whatever elements there are. Isolated nodes get 0.
template <int dim>
void update_nodal_volumes(const FluidMesh<dim>& mesh, FluidNodes<dim>& nodes);
/// In the plane, the same of nodes [begin, end), which have fans: V_i is a third of the area that the ring of
/// its neighbours encloses, so no element is visited.
void update_nodal_volumes(const FluidMesh<2>& mesh, index_t begin, index_t end, FluidNodes<2>& nodes);
/// In space: add what elements list[begin], … list[end − 1] (null: begin … end − 1) give to the volumes of
/// those of their corners that the share owns, in their order.
void add_element_volumes(const FluidMesh<3>& mesh, const index_t* list, index_t begin, index_t end,
                         const Share& share, FluidNodes<3>& nodes);

/// ρ = m/V and p = p(ρ) of nodes [begin, end); isolated nodes are at ρ₀, p₀. A node whose volume is less than
/// V* = `floor` times the regular volume (one flat element, a corner) would be a stiff spring: it is
/// completed to V* by fluid at rest density, ρ = (m + ρ₀ (V* − V))/V*.
/// @returns the first node whose volume is not positive although it has elements, or −1
template <int dim>
index_t update_density_and_pressure(const FluidMesh<dim>& mesh, const Tait& tait, double floor,
                                    FluidNodes<dim>& nodes, index_t begin, index_t end);

/// Over a step `dt` [s], m and M of nodes [begin, end) take the stabilising flux; m also follows M, so that
/// what remeshing did to the density field heals; the mass of Newton's law follows m.
/// @param mass_rate flux into each of these nodes [kg/s]; empty: none
/// @param feedback_rate m goes towards M at this rate times 1/h: c/T_r, T_r in units of h/c [m/s]; 0: it
/// stays
/// @param least_mass of Newton's law, over the regular volume of a node [kg/m^dim]
/// @param free_inertia_from nodes below keep their mass of Newton's law: the coupler was told it
/// @param g      gravity [m/s²]
/// @param tension false: nodes of the free surface below ρ₀ have no internal energy
/// @param weight of this step in `energy`: time since its last call with one, over dt
/// @param energy empty: nobody asks; takes what each of these nodes gained of Σ ½Mv² + me − Mg·x [J]
/// otherwise than by forces on moved
///               mass: μ = ½v² − g·x + h per exchanged and h per fed back mass, h = e + p/ρ; and, because
///               forces and weight act on the masses of Newton's law and of the density field instead of M,
///               v·((M − inertia) a − (M − m) g) Δt
template <int dim>
void exchange_mass(std::span<const double> mass_rate, double feedback_rate, double dt, double least_mass,
                   const Tait& tait, const Vec<dim>& g, bool tension, FluidNodes<dim>& nodes, index_t begin,
                   index_t end, index_t free_inertia_from, double weight, std::span<double> energy);

} // namespace undine::fluid
