// Elements of one type in the reference configuration: gradients, weights and bounds that never change, in
// packs of as many elements as a processor works on at once.
#pragma once

#include "common/lanes.hpp"
#include "common/mesh/mesh.hpp"
#include "common/tensor.hpp"
#include "common/types.hpp"
#include "solid_fe/elements/reference_elements.hpp"

#include <array>
#include <span>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

namespace undine::solid
{

/// Geometry of one element, or of Lanes::size elements side by side.
template <class Element, class Real>
struct ElementGeometry
{
  static constexpr int dim = Element::dim;
  static constexpr std::size_t points = Element::points, nodes = Element::nodes,
                               ring_points = Element::axisymmetric ? Element::points : 0,
                               modes = Element::hourglass_modes;

  std::array<std::array<Vec<dim, Real>, nodes>, points> grad_N; ///< ∂N_a/∂X at the points [1/m]
  std::array<Real, points> weight; ///< det(∂X/∂ξ) × quadrature weight (× 2πR) [m^dim, ring m³]
  std::array<std::array<Real, nodes>, ring_points> N_over_R; ///< N_a / R [1/m]
  /// c_k = Σ_a h_ka X_a [m]: γ_k = (h_k − Σ_j c_kj ∂_j N) / nodes is orthogonal to all linear fields.
  std::array<Vec<dim, Real>, modes> hourglass;
  std::array<Real, modes == 0 ? 0 : 1> hourglass_stiffness; ///< energy ½ K |γ_k·u|² of each mode [N/m]
};

/// Everything the element loops need. Total-Lagrangian: computed once. Elements are kept in packs: first
/// those that touch wet nodes, then the others, then the idle ones, which keep their shape for ever; each
/// part is made of whole packs (the last one filled up with copies of its last element, which count for
/// nothing).
template <class ElementShape>
struct ReferenceBlock
{
  using Element = ElementShape;
  static constexpr int dim = Element::dim;

  std::vector<std::array<index_t, Element::nodes>> nodes; ///< node numbers, size n
  std::vector<index_t> number; ///< element number in the mesh file's order, for messages and output, size n
  std::vector<ElementGeometry<Element, Lanes>> pack;
  std::vector<double> gamma;                  ///< see frequency_bounds.hpp, size n once computed
  std::vector<double> delta;                  ///< the same for a divergence
  std::vector<double> hourglass_inverse_mass; ///< one-point elements: max_k Σ_a γ_ka²/M_ea [1/kg]
  index_t n_interface = 0;                    ///< the first n_interface elements touch wet nodes
  index_t n_active = 0; ///< elements from here on lie in one rigid or prescribed part: no forces, no bound
  std::string body;     ///< physical group, "" if none
  std::vector<char> is_copy; ///< on several ranks: elements that another rank counts too, size n; else empty

  index_t size() const { return static_cast<index_t>(nodes.size()); }
  double volume() const; ///< [m^dim]

  /// Energies, stresses and bounds of the element are this rank's to give.
  bool counts(index_t e) const { return is_copy.empty() || is_copy[static_cast<std::size_t>(e)] == 0; }
  /// The block of the elements `kept` of this one, ascending; without is_copy.
  ReferenceBlock part(std::span<const index_t> kept) const;

  index_t n_interface_packs() const { return packs_of(n_interface); }
  index_t n_active_packs() const { return n_interface_packs() + packs_of(n_active - n_interface); }
  index_t n_packs() const { return n_active_packs() + packs_of(size() - n_active); }
  /// Pack of element `e`, and its lane there.
  std::pair<index_t, int> place(index_t e) const
  {
    const Range range = range_of(e >= n_interface, e >= n_active);
    const index_t k = e - range.first;
    return {range.first_pack + k / Lanes::size, k % Lanes::size};
  }
  /// First element of pack `p`, and how many it holds.
  std::pair<index_t, int> elements_of(index_t p) const
  {
    const Range range = range_of(p >= n_interface_packs(), p >= n_active_packs());
    const index_t first = range.first + (p - range.first_pack) * Lanes::size, rest = range.end - first;
    return {first, static_cast<int>(rest < Lanes::size ? rest : Lanes::size)};
  }
  ElementGeometry<Element, double> geometry(index_t e) const; ///< of one element

private:
  /// Elements [first, end) that fill whole packs from first_pack on.
  struct Range
  {
    index_t first, first_pack, end;
  };
  Range range_of(bool behind_interface, bool idle) const
  {
    if (!behind_interface)
      return {0, 0, n_interface};
    return idle ? Range{n_active, n_active_packs(), size()}
                : Range{n_interface, n_interface_packs(), n_active};
  }
  static index_t packs_of(index_t n) { return (n + Lanes::size - 1) / Lanes::size; }
};

template <int dim>
using AnyBlock = std::conditional_t<
    dim == 2,
    std::variant<ReferenceBlock<Triangle3>, ReferenceBlock<Quadrilateral4>, ReferenceBlock<Triangle3Nodal>,
                 ReferenceBlock<Quadrilateral4OnePoint>, ReferenceBlock<Quadrilateral4Mean>,
                 ReferenceBlock<Ring<Triangle3>>, ReferenceBlock<Ring<Quadrilateral4OnePoint>>,
                 ReferenceBlock<Ring<Quadrilateral4Mean>>>,
    std::variant<ReferenceBlock<Tetrahedron4>, ReferenceBlock<Hexahedron8>, ReferenceBlock<Tetrahedron4Nodal>,
                 ReferenceBlock<Hexahedron8OnePoint>, ReferenceBlock<Hexahedron8Mean>>>;

/// Displacement gradient H = Σ_a u_a ⊗ ∇N_a at point q; in axial symmetry H₃₃ = u_r/R.
template <class Element, class Real>
Mat<strain_dim<Element>, Real>
displacement_gradient(const ElementGeometry<Element, Real>& geometry, int q,
                      const std::array<Vec<Element::dim, Real>, Element::nodes>& u)
{
  const auto& grad_N = geometry.grad_N[static_cast<std::size_t>(q)];
  Mat<strain_dim<Element>, Real> H;
  for (std::size_t a = 0; a < Element::nodes; ++a)
    for (int i = 0; i < Element::dim; ++i)
      for (int j = 0; j < Element::dim; ++j)
        H(i, j) += u[a][i] * grad_N[a][j];
  if constexpr (Element::axisymmetric)
    for (std::size_t a = 0; a < Element::nodes; ++a)
      H(2, 2) += u[a][0] * geometry.N_over_R[static_cast<std::size_t>(q)][a];
  return H;
}

/// f_a ← f_a + P ∇N_a, and in axial symmetry the hoop stress P₃₃ N_a/R on the radial component: the transpose
/// of displacement_gradient.
template <class Element, class Real>
void add_stress_divergence(const ElementGeometry<Element, Real>& geometry, int q,
                           const Mat<strain_dim<Element>, Real>& P,
                           std::array<Vec<Element::dim, Real>, Element::nodes>& f)
{
  const auto& grad_N = geometry.grad_N[static_cast<std::size_t>(q)];
  for (std::size_t a = 0; a < Element::nodes; ++a)
    for (int i = 0; i < Element::dim; ++i)
      for (int j = 0; j < Element::dim; ++j)
        f[a][i] += P(i, j) * grad_N[a][j];
  if constexpr (Element::axisymmetric)
    for (std::size_t a = 0; a < Element::nodes; ++a)
      f[a][0] += P(2, 2) * geometry.N_over_R[static_cast<std::size_t>(q)][a];
}

/// Hourglass amplitudes q_k = γ_k · u = (Σ_a h_ka u_a − H c_k) / nodes of a one-point element.
template <class Element, class Real>
std::array<Vec<Element::dim, Real>, Element::hourglass_modes>
hourglass_amplitudes(const ElementGeometry<Element, Real>& geometry, const Mat<strain_dim<Element>, Real>& H,
                     const std::array<Vec<Element::dim, Real>, Element::nodes>& u)
{
  std::array<Vec<Element::dim, Real>, Element::hourglass_modes> amplitude;
  for (int k = 0; k < Element::hourglass_modes; ++k)
    for (int i = 0; i < Element::dim; ++i)
    {
      Real sum{};
      for (int a = 0; a < Element::nodes; ++a)
        if (Element::hourglass(k, a) > 0.0)
          sum += u[static_cast<std::size_t>(a)][i];
        else
          sum -= u[static_cast<std::size_t>(a)][i];
      for (int j = 0; j < Element::dim; ++j)
        sum -= H(i, j) * geometry.hourglass[static_cast<std::size_t>(k)][j];
      amplitude[static_cast<std::size_t>(k)][i] = sum * Real(1.0 / Element::nodes);
    }
  return amplitude;
}

/// f_a ← f_a + Σ_k γ_ka force_k; the part along ∇N goes into the stress `P` of the point, before its
/// divergence.
template <class Element, class Real>
void add_hourglass_force(const ElementGeometry<Element, Real>& geometry,
                         const std::array<Vec<Element::dim, Real>, Element::hourglass_modes>& force,
                         Mat<strain_dim<Element>, Real>& P,
                         std::array<Vec<Element::dim, Real>, Element::nodes>& f)
{
  for (int k = 0; k < Element::hourglass_modes; ++k)
  {
    const auto scaled = Real(1.0 / Element::nodes) * force[static_cast<std::size_t>(k)];
    for (int a = 0; a < Element::nodes; ++a)
      if (Element::hourglass(k, a) > 0.0)
        f[static_cast<std::size_t>(a)] += scaled;
      else
        f[static_cast<std::size_t>(a)] -= scaled;
    for (int i = 0; i < Element::dim; ++i)
      for (int j = 0; j < Element::dim; ++j)
        P(i, j) -= scaled[i] * geometry.hourglass[static_cast<std::size_t>(k)][j];
  }
}

/// Values of a nodal field at the nodes of one element.
template <class Element>
std::array<Vec<Element::dim>, Element::nodes> gather(const std::array<index_t, Element::nodes>& nodes,
                                                     std::span<const Vec<Element::dim>> field)
{
  std::array<Vec<Element::dim>, Element::nodes> local;
  for (std::size_t a = 0; a < nodes.size(); ++a)
    local[a] = field[static_cast<std::size_t>(nodes[a])];
  return local;
}

/// How the elements of a mesh are to work.
enum class Formulation
{
  full,         ///< full integration
  one_point,    ///< quadrilaterals and hexahedra with one point and hourglass control
  locking_free, ///< mean dilatation in quadrilaterals and hexahedra, nodal dilatation in simplices
  beam ///< 2-D: a strip of quadrilaterals whose fibres across the wall stay straight and as long as they are
};

/// What the plane of a 2-D case stands for.
enum class PlaneKind
{
  strain,      ///< F₃₃ = 1, per metre of thickness
  stress,      ///< P₃₃ = 0, per metre of thickness
  axisymmetric ///< x is the radius, the whole ring counts
};

struct BlockOptions
{
  Formulation formulation = Formulation::full;
  PlaneKind plane = PlaneKind::strain;
  double hourglass_modulus = 0.0; ///< K = this × V Σ_a |∇N_a|² [Pa]
  std::span<const int> part;      ///< see parts_that_keep_their_shape; empty: none
};

/// Blocks of the mesh's elements of dimension `dim`, elements that touch nodes below `n_wet` first in each
/// block (all of a block with nodal dilatation if one does: its elements work together, and none is idle);
/// adds the row-sum volumes ∫ N_a dV of all elements into `nodal_volume` (size n_nodes).
/// @throws InputError (exit code 4) for an element that is inverted in the reference state: number and
/// position; and for an element type that has not this formulation in this plane
template <int dim>
std::vector<AnyBlock<dim>> reference_blocks(const Mesh<dim>& mesh, index_t n_wet, const BlockOptions& options,
                                            std::span<double> nodal_volume);

} // namespace undine::solid
