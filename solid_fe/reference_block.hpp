// Elements of one type in the reference configuration: gradients, weights and bounds that never change,
// stored flat.
#pragma once

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

/// Everything the element loops need, element after element. Total-Lagrangian: computed once.
template <class ElementShape>
struct ReferenceBlock
{
  using Element = ElementShape;
  static constexpr int dim = Element::dim;
  static constexpr int gradients_per_element = Element::points * Element::nodes;

  std::vector<std::array<index_t, Element::nodes>> nodes; ///< node numbers, size n
  std::vector<index_t> number;  ///< element number in the mesh file's order, for messages and output, size n
  std::vector<Vec<dim>> grad_N; ///< ∂N_a/∂X at the points, n × points × nodes [1/m]
  std::vector<double> weight;   ///< det(∂X/∂ξ) × quadrature weight, n × points [m^dim]
  std::vector<double> gamma;    ///< see frequency_bounds.hpp, size n once computed
  std::vector<double> delta;    ///< the same for a divergence
  index_t n_interface = 0;      ///< the first n_interface elements touch wet nodes
  std::string body;             ///< physical group, "" if none

  index_t size() const { return static_cast<index_t>(nodes.size()); }
  double volume() const; ///< [m^dim]
};

template <int dim>
using AnyBlock =
    std::conditional_t<dim == 2, std::variant<ReferenceBlock<Triangle3>, ReferenceBlock<Quadrilateral4>>,
                       std::variant<ReferenceBlock<Tetrahedron4>, ReferenceBlock<Hexahedron8>>>;

/// Displacement gradient H = Σ_a u_a ⊗ ∇N_a at one point; grad_N points at the gradients of that point.
template <class Element, class Real>
Mat<Element::dim, Real> displacement_gradient(const std::array<Vec<Element::dim, Real>, Element::nodes>& u,
                                              const Vec<Element::dim>* grad_N)
{
  Mat<Element::dim, Real> H;
  for (int a = 0; a < Element::nodes; ++a)
    for (int i = 0; i < Element::dim; ++i)
      for (int j = 0; j < Element::dim; ++j)
        H(i, j) += u[static_cast<std::size_t>(a)][i] * Real(grad_N[a][j]);
  return H;
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

/// Blocks of the mesh's elements of dimension `dim`, elements that touch nodes below `n_wet` first in each
/// block; adds the row-sum volumes ∫ N_a dV of all elements into `nodal_volume` (size n_nodes).
/// @throws InputError (exit code 4) for an element that is inverted in the reference state: number and
/// position
template <int dim>
std::vector<AnyBlock<dim>> reference_blocks(const Mesh<dim>& mesh, index_t n_wet,
                                            std::span<double> nodal_volume);

} // namespace undine::solid
