// Mortar projection between two non-matching discretisations of one interface, with the dual basis.
//
// The multiplier lives on one side (the finer one unless told otherwise). With dual shape functions Ψ_a, ∫Ψ_a
// N_b = δ_ab ∫N_b, the discrete continuity of the velocities is  D v_mult − C v_other = 0 with
//
//   D_ab = ∫ Ψ_a N_b^mult  (diagonal),      C_ac = ∫ Ψ_a N_c^other ,
//
// integrated exactly over the common segments of both meshes; forces are Dᵀλ and −Cᵀλ, so that neither force
// nor power is lost. Wohlmuth (2000), Kloeppel, Popp & Wall (2011).
#pragma once

#include "common/coupling/messages.hpp"
#include "common/coupling/team.hpp"
#include "common/coupling/wire.hpp"
#include "common/tensor.hpp"
#include "coupler/interface_operator.hpp"

#include <array>
#include <string>
#include <vector>

namespace undine::coupler
{

/// Faces of one interface on one side. Nodes are rows of the participant's wet-surface vectors.
template <int dim>
struct InterfaceFaces
{
  std::vector<Vec<dim>> x;             ///< all wet-surface nodes [m]
  std::vector<std::vector<int>> faces; ///< node rows per face, outward of the participant's body

  /// Unit outward normal of a face.
  Vec<dim> normal(const std::vector<int>& face) const;
  double measure(const std::vector<int>& face) const; ///< length or area [m, m²]
  double total_measure() const;
  double mean_face_size() const; ///< mean length, or square root of the mean area [m]
};

/// Faces of interface `name` from a wet surface. @throws InputError if the surface does not know the name
template <int dim>
InterfaceFaces<dim> faces_of(const link::SurfaceMesh& surface, const std::string& name);

/// D and C with their nodes, and how well the two sides cover each other.
template <int dim>
struct Mortar
{
  std::vector<int> multiplier_node; ///< wet-surface row of each multiplier, on the multiplier side
  std::vector<Vec<dim>>
      normal;            ///< averaged unit normal at each multiplier node, outward of the multiplier side
  std::vector<double> D; ///< diagonal [m or m²]
  std::vector<std::vector<std::pair<int, double>>> C; ///< per multiplier: (row of the other side, value)
  std::array<double, 2> covered{0.0,
                                0.0}; ///< measure of the common part over that of (multiplier, other) side
  double largest_gap = 0.0;           ///< along the normal, over the common part [m]
};

/// Integrate D and C. Faces further apart than `search_distance`, or facing the same way, do not meet.
/// team: with other ranks of the coupler, which are in help(), if there are faces_worth_sharing;
/// nullptr: alone. The same bits in any case: what a face gives is summed on one rank, and the faces' sums
/// are added in the order of the faces.
template <int dim>
Mortar<dim> integrate_mortar(const InterfaceFaces<dim>& multiplier, const InterfaceFaces<dim>& other,
                             double search_distance, const link::Team* team = nullptr);

/// Multiplier faces from which on sharing pays: 20 ms of integration (4 us per face) against the millisecond
/// after which a sleeping rank wakes up and its answer; docs/benchmarks/scaling.md
inline constexpr std::size_t faces_worth_sharing = 5000;

/// What a helper does when rank 0 integrates: a stretch of the faces.
template <int dim>
void help_to_integrate(const link::Team& team, link::wire::Reader in);

enum class InterfaceKind
{
  slip,   ///< only the normal velocity is continuous: one multiplier per node
  no_slip ///< all components are: dim multipliers per node
};

/// Rows of L of both sides for one interface, appended to `rows`.
struct ConstraintRows
{
  std::array<std::vector<Eigen::Triplet<double>>, 2> entries; ///< per Side
  int count = 0;
};

template <int dim>
void append_constraints(const Mortar<dim>& mortar, Side multiplier_side, InterfaceKind kind,
                        ConstraintRows& rows);

} // namespace undine::coupler
