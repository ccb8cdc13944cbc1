// Conservation of momentum, Eqs. (2) and (5), and the exchange of mass that stabilises the pressure.
//
// The pressure force is minus the exact gradient of the discrete internal energy Σ m_i e(m_i/V_i):
//   F_j = Σ_e p̄_e V_e ∇N_j,  p̄_e the mean of the nodal pressures,
// so that between remeshes the inviscid, unstabilised fluid is a Hamiltonian system and central differences
// keep its energy. Everything else is a term of an element: a bulk viscosity q_e added to p̄_e, a viscous
// stress τ_e, a mass flux z_e. Without viscosity τ_e is not computed, without both stabilisers neither q_e
// nor z_e.
//
// One pass over the elements, eight at a time, reads one record per corner and adds force and mass flux to
// the corners, to the first minus what the others get. Elements are added in their order, so every sum has
// one order.
#pragma once

#include "common/lanes.hpp"
#include "common/parallel/untouched_rows.hpp"
#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/fluid_nodes.hpp"
#include "fluid_pfem/team.hpp"

#include <array>
#include <span>
#include <vector>

namespace undine::fluid
{

/// Constants of the terms beyond pressure. All zero: the fluid is Hamiltonian and no element pass is made.
struct ElementTermsConfig
{
  double mu = 0.0;                        ///< dynamic viscosity [Pa s]
  double bulk_linear = 0.0;               ///< b₁ of the bulk viscosity
  double bulk_quadratic = 0.0;            ///< b₂, in compression only
  double residual = 0.0;                  ///< α of the residual-based mass exchange
  bool residual_with_acceleration = true; ///< the residual is ∇p − ρ(b − a); without: ∇p − ρb

  bool bulk() const { return bulk_linear > 0.0 || bulk_quadratic > 0.0; }
  bool none() const { return mu == 0.0 && !bulk() && residual == 0.0; }
};

/// What elements read of a node, side by side: x, v, p, ρ, a − body. One cache line in the plane.
template <int dim>
struct alignas(64) NodeRecord
{
  static constexpr int x = 0, v = dim, p = 2 * dim, rho = 2 * dim + 1, a = 2 * dim + 2;
  static constexpr int size = dim == 2 ? 8 : 16;
  std::array<double, size> c{};
};

/// What elements read and add to during a step.
template <int dim>
struct ElementSums
{
  UntouchedRows<NodeRecord<dim>> record; ///< of nodes that this rank computes with, as the sums
  UntouchedRows<FourNumbers> sum; ///< force [N] in the first dim entries, mass flux [kg/s] in the last; zero
                                  ///< between steps
  std::vector<Vec<dim>> body;     ///< nodal body force beyond gravity [m/s²]; empty if there is none
  std::vector<double> heat;       ///< energy turned into heat by q and τ since the last remesh, per block of
                                  ///< elements [J]

  /// Records and sums for n nodes.
  void make_room(index_t n);
  /// The sums of nodes [begin, end) become zero.
  void clear(index_t begin, index_t end);
};

/// What an element pass sees of shapes by the way: no element that is_worse() would find.
struct ShapeLook
{
  std::span<const float> before; ///< quality of each element at the last remesh
  double limit = 0.0;            ///< as of is_worse
  bool good = true;              ///< false: perhaps one; always in space and without stabilisers
};

/// Records of nodes [begin, end): velocities at the half step, accelerations of the last instant.
template <int dim>
void record_nodes(const FluidNodes<dim>& nodes, const ElementTermsConfig& config, index_t begin, index_t end,
                  ElementSums<dim>& sums);

/// Add force and mass flux of elements list[begin], … list[end − 1] (null: begin … end − 1) to those of their
/// corners that the share owns, in their order. With S_i = V_e∇N_i, D = Σ S_i·v_i:
///   F_i = (p̄ + q) S_i − τ S_i,   ṁ_i = −S_i·z,
///   q = −ρ (b₁ c₀ − b₂² min(r, 0)) r,  r = D/√Σ|S|² = ℓ ∇·v       (von Neumann & Richtmyer 1950),
///   z = α √(2 dim)/c₀ (Σ S_k p_k − V ρ (b − ā))/√Σ|S|²              (residual of momentum; zero in
/// hydrostatic rest), τ = 2μ dev D. The length ℓ = (Σ|∇N|²)^(−1/2) is a height: q and z are bounded on
/// slivers and need no division by V. Over a step `dt` [s] z takes at most a twentieth of the smallest mass
/// of its element.
/// @param look null: nobody looks at shapes
/// @returns power that these elements turn into heat by q and τ [W]
template <int dim>
double add_element_forces(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes,
                          const ElementTermsConfig& config, double c0, const Vec<dim>& b, double dt,
                          const index_t* list, index_t begin, index_t end, const Share& share,
                          ElementSums<dim>& sums, ShapeLook* look = nullptr);

/// Acceleration a = F/inertia + b of nodes [begin, end), and the mass flux ṁ [kg/s] of the first of them, as
/// many as `mass_rate` holds. Takes the sums: they are zero afterwards.
template <int dim>
void take_acceleration(FluidNodes<dim>& nodes, const Vec<dim>& b, index_t begin, index_t end,
                       ElementSums<dim>& sums, std::span<double> mass_rate);

} // namespace undine::fluid
