// Reference geometry of element blocks.
#include "solid_fe/reference_block.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <numeric>

namespace undine::solid
{

namespace
{

/// Order of a block's elements: those with a node below n_wet first, otherwise as in the mesh.
std::vector<index_t> wet_first(const ElementBlock& elements, index_t n_wet)
{
  const int n = nodes_per_element(elements.type);
  std::vector<index_t> order(static_cast<std::size_t>(elements.size()));
  std::iota(order.begin(), order.end(), 0);
  std::stable_partition(order.begin(), order.end(),
                        [&](index_t e)
                        {
                          const auto first = elements.nodes.begin() + e * n;
                          return std::any_of(first, first + n,
                                             [n_wet](index_t node) { return node < n_wet; });
                        });
  return order;
}

[[noreturn]] void fail_inverted(const char* name, index_t number, const std::string& body, double x, double y)
{
  throw InputError("mesh: " + std::string(name) + " number " + std::to_string(number) +
                       (body.empty() ? "" : " of \"" + body + "\"") + " near (" + std::to_string(x) + ", " +
                       std::to_string(y) +
                       ") is inverted or flat: the Jacobian must be positive at every quadrature point; "
                       "check the node order of the mesh",
                   ExitCode::bad_input_file);
}

template <class Element>
ReferenceBlock<Element> reference_block(const Mesh<Element::dim>& mesh, const ElementBlock& elements,
                                        index_t n_wet, index_t first_number, std::span<double> nodal_volume)
{
  constexpr int dim = Element::dim;
  ReferenceBlock<Element> block;
  block.body = elements.body;
  const auto order = wet_first(elements, n_wet);
  const auto n = order.size();
  block.nodes.reserve(n);
  block.number.reserve(n);
  block.grad_N.reserve(n * static_cast<std::size_t>(ReferenceBlock<Element>::gradients_per_element));
  block.weight.reserve(n * static_cast<std::size_t>(Element::points));

  for (const index_t e : order)
  {
    std::array<index_t, Element::nodes> nodes;
    std::copy_n(elements.nodes.begin() + e * Element::nodes, Element::nodes, nodes.begin());
    const auto X = gather<Element>(nodes, mesh.x);
    std::array<double, Element::nodes> volume{};
    for (int q = 0; q < Element::points; ++q)
    {
      const auto dN = Element::shape_gradient(Element::point(q));
      const auto N = Element::shape(Element::point(q));
      Mat<dim> jacobian; // ∂X/∂ξ
      for (std::size_t a = 0; a < X.size(); ++a)
        jacobian += outer(X[a], dN[a]);
      const double det = determinant(jacobian);
      if (!(det > 0.0))
        fail_inverted(element_name(elements.type), first_number + e, elements.body, X[0][0], X[0][1]);
      const auto inverse_transposed = transpose(inverse(jacobian));
      const double weight = det * Element::weight(q);
      for (std::size_t a = 0; a < X.size(); ++a)
      {
        block.grad_N.push_back(inverse_transposed * dN[a]);
        volume[a] += weight * N[a];
      }
      block.weight.push_back(weight);
    }
    block.nodes.push_back(nodes);
    block.number.push_back(first_number + e);
    for (std::size_t a = 0; a < nodes.size(); ++a)
      nodal_volume[static_cast<std::size_t>(nodes[a])] += volume[a];
    if (std::any_of(nodes.begin(), nodes.end(), [n_wet](index_t node) { return node < n_wet; }))
      ++block.n_interface;
  }
  return block;
}

} // namespace

template <class Element>
double ReferenceBlock<Element>::volume() const
{
  return std::accumulate(weight.begin(), weight.end(), 0.0);
}

template <int dim>
std::vector<AnyBlock<dim>> reference_blocks(const Mesh<dim>& mesh, index_t n_wet,
                                            std::span<double> nodal_volume)
{
  std::vector<AnyBlock<dim>> blocks;
  index_t first_number = 0;
  for (const auto& elements : mesh.blocks)
  {
    if constexpr (dim == 2)
    {
      if (elements.type == ElementType::triangle3)
        blocks.push_back(reference_block<Triangle3>(mesh, elements, n_wet, first_number, nodal_volume));
      else if (elements.type == ElementType::quadrilateral4)
        blocks.push_back(reference_block<Quadrilateral4>(mesh, elements, n_wet, first_number, nodal_volume));
    }
    else
    {
      if (elements.type == ElementType::tetrahedron4)
        blocks.push_back(reference_block<Tetrahedron4>(mesh, elements, n_wet, first_number, nodal_volume));
      else if (elements.type == ElementType::hexahedron8)
        blocks.push_back(reference_block<Hexahedron8>(mesh, elements, n_wet, first_number, nodal_volume));
    }
    first_number += elements.size();
  }
  return blocks;
}

template struct ReferenceBlock<Triangle3>;
template struct ReferenceBlock<Quadrilateral4>;
template struct ReferenceBlock<Tetrahedron4>;
template struct ReferenceBlock<Hexahedron8>;
template std::vector<AnyBlock<2>> reference_blocks(const Mesh<2>&, index_t, std::span<double>);
template std::vector<AnyBlock<3>> reference_blocks(const Mesh<3>&, index_t, std::span<double>);

} // namespace undine::solid
