// Reference geometry of element blocks.
#include "solid_fe/reference_block.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <numbers>

namespace undine::solid
{

namespace
{

/// 0: touches a wet node; 2: idle, all its nodes belong to one part that keeps its shape; 1: the others.
int rank_of(std::span<const index_t> nodes, index_t n_wet, std::span<const int> part)
{
  const auto part_of = [&](index_t node) { return part[static_cast<std::size_t>(node)]; };
  if (!part.empty() && part_of(nodes[0]) >= 0 &&
      std::all_of(nodes.begin(), nodes.end(),
                  [&](index_t node) { return part_of(node) == part_of(nodes[0]); }))
    return 2;
  return std::any_of(nodes.begin(), nodes.end(), [n_wet](index_t node) { return node < n_wet; }) ? 0 : 1;
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

/// The volumes ∫ N_a dV of one element, which its lumped mass is made of.
template <class Element>
std::array<double, Element::nodes> nodal_volumes(const std::array<Vec<Element::dim>, Element::nodes>& X)
{
  using Mass = typename Element::Mass;
  std::array<double, Element::nodes> volume{};
  for (int q = 0; q < Mass::points; ++q)
  {
    const auto N = Mass::shape(Mass::point(q));
    const auto dN = Mass::shape_gradient(Mass::point(q));
    Mat<Element::dim> jacobian;
    double R = 0.0;
    for (std::size_t a = 0; a < X.size(); ++a)
    {
      jacobian += outer(X[a], dN[a]);
      R += N[a] * X[a][0];
    }
    const double ring = Element::axisymmetric ? 2.0 * std::numbers::pi * R : 1.0;
    for (std::size_t a = 0; a < X.size(); ++a)
      volume[a] += ring * determinant(jacobian) * Mass::weight(q) * N[a];
  }
  return volume;
}

/// Geometry of one element; false if it is inverted or flat at one of its points.
template <class Element>
bool make_geometry(const std::array<Vec<Element::dim>, Element::nodes>& X, double hourglass_modulus,
                   ElementGeometry<Element, double>& g)
{
  for (std::size_t q = 0; q < Element::points; ++q)
  {
    const auto xi = Element::point(static_cast<int>(q));
    const auto dN = Element::shape_gradient(xi);
    const auto N = Element::shape(xi);
    Mat<Element::dim> jacobian; // ∂X/∂ξ
    double R = 0.0;
    for (std::size_t a = 0; a < X.size(); ++a)
    {
      jacobian += outer(X[a], dN[a]);
      R += N[a] * X[a][0];
    }
    const double det = determinant(jacobian);
    if (!(det > 0.0) || (Element::axisymmetric && !(R > 0.0)))
      return false;
    const auto inverse_transposed = transpose(inverse(jacobian));
    g.weight[q] = det * Element::weight(static_cast<int>(q));
    if constexpr (Element::axisymmetric)
    {
      g.weight[q] *= 2.0 * std::numbers::pi * R;
      for (std::size_t a = 0; a < X.size(); ++a)
        g.N_over_R[q][a] = N[a] / R;
    }
    for (std::size_t a = 0; a < X.size(); ++a)
      g.grad_N[q][a] = inverse_transposed * dN[a];
  }
  if constexpr (Element::hourglass_modes > 0)
  {
    double gradients = 0.0;
    for (const auto& grad_N : g.grad_N[0])
      gradients += norm_squared(grad_N);
    g.hourglass_stiffness[0] = hourglass_modulus * g.weight[0] * gradients;
    for (std::size_t k = 0; k < Element::hourglass_modes; ++k)
    {
      g.hourglass[k] = {};
      for (std::size_t a = 0; a < X.size(); ++a)
        g.hourglass[k] += Element::hourglass(static_cast<int>(k), static_cast<int>(a)) * X[a];
    }
  }
  return true;
}

/// A geometry is nothing but numbers: copy them to or from lane `k` of a pack.
template <class Element>
void put(const ElementGeometry<Element, double>& g, int k, ElementGeometry<Element, Lanes>& pack)
{
  const auto* from = reinterpret_cast<const double*>(&g);
  auto* to = reinterpret_cast<double*>(&pack);
  for (std::size_t i = 0; i < sizeof(g) / sizeof(double); ++i)
    to[i * Lanes::size + static_cast<std::size_t>(k)] = from[i];
}

/// The geometry of the next element of a block, at its place; the rest of its pack are copies so far.
template <class Element>
void append(const ElementGeometry<Element, double>& g, index_t e, ReferenceBlock<Element>& block)
{
  const auto [p, lane] = block.place(e);
  if (lane == 0)
  {
    auto& pack = block.pack.emplace_back();
    for (int k = 0; k < Lanes::size; ++k)
      put<Element>(g, k, pack);
  }
  for (int k = lane; k < Lanes::size; ++k)
    put<Element>(g, k, block.pack[static_cast<std::size_t>(p)]);
}

template <class Element>
ReferenceBlock<Element> reference_block(const Mesh<Element::dim>& mesh, const ElementBlock& elements,
                                        index_t n_wet, const BlockOptions& options, index_t first_number,
                                        std::span<double> nodal_volume)
{
  static_assert(sizeof(ElementGeometry<Element, Lanes>) ==
                Lanes::size * sizeof(ElementGeometry<Element, double>));
  ReferenceBlock<Element> block;
  block.body = elements.body;
  constexpr bool together = Element::dilatation == Dilatation::of_nodes;
  const auto size = static_cast<std::size_t>(elements.size());
  std::vector<int> rank(size);
  for (std::size_t e = 0; e < size; ++e)
    rank[e] = rank_of(std::span(elements.nodes).subspan(e * Element::nodes, Element::nodes), n_wet,
                      together ? std::span<const int>{} : options.part);
  block.nodes.reserve(size);
  block.number.reserve(size);
  for (const int wanted : {0, 1, 2}) // otherwise as in the mesh
  {
    for (std::size_t e = 0; e < size; ++e)
      if (rank[e] == wanted)
      {
        const auto first = static_cast<std::ptrdiff_t>(e * Element::nodes);
        std::copy_n(elements.nodes.begin() + first, Element::nodes, block.nodes.emplace_back().begin());
        block.number.push_back(first_number + static_cast<index_t>(e));
      }
    if (wanted < 2)
      (wanted == 0 ? block.n_interface : block.n_active) = block.size();
  }
  if (together && block.n_interface > 0)
    block.n_interface = block.size();

  for (index_t e = 0; e < block.size(); ++e)
  {
    const auto& nodes = block.nodes[static_cast<std::size_t>(e)];
    const auto X = gather<Element>(nodes, mesh.x);
    ElementGeometry<Element, double> geometry;
    if (!make_geometry<Element>(X, options.hourglass_modulus, geometry))
      fail_inverted(element_name(elements.type), block.number[static_cast<std::size_t>(e)], elements.body,
                    X[0][0], X[0][1]);
    append(geometry, e, block);
    const auto volume = nodal_volumes<Element>(X);
    for (std::size_t a = 0; a < nodes.size(); ++a)
      nodal_volume[static_cast<std::size_t>(nodes[a])] += volume[a];
  }
  return block;
}

[[noreturn]] void fail_combination(ElementType type, const char* words)
{
  throw InputError(std::string("solid.formulation: ") + element_name(type) + " has no such form in " + words);
}

} // namespace

template <class Element>
double ReferenceBlock<Element>::volume() const
{
  double volume = 0.0;
  for (index_t e = 0; e < size(); ++e)
    for (const double w : geometry(e).weight)
      volume += w;
  return volume;
}

template <class Element>
ElementGeometry<Element, double> ReferenceBlock<Element>::geometry(index_t e) const
{
  const auto [p, lane] = place(e);
  ElementGeometry<Element, double> g;
  const auto* from = reinterpret_cast<const double*>(&pack[static_cast<std::size_t>(p)]);
  auto* to = reinterpret_cast<double*>(&g);
  for (std::size_t i = 0; i < sizeof(g) / sizeof(double); ++i)
    to[i] = from[i * Lanes::size + static_cast<std::size_t>(lane)];
  return g;
}

template <class Element>
ReferenceBlock<Element> ReferenceBlock<Element>::part(std::span<const index_t> kept) const
{
  ReferenceBlock<Element> result;
  result.body = body;
  const auto below = [&](index_t end)
  { return static_cast<index_t>(std::lower_bound(kept.begin(), kept.end(), end) - kept.begin()); };
  result.n_interface = below(n_interface);
  result.n_active = below(n_active);
  const auto take = [&](const auto& from, auto& to)
  {
    for (const index_t e : kept)
      if (!from.empty())
        to.push_back(from[static_cast<std::size_t>(e)]);
  };
  take(nodes, result.nodes);
  take(number, result.number);
  take(gamma, result.gamma);
  take(delta, result.delta);
  take(hourglass_inverse_mass, result.hourglass_inverse_mass);
  for (index_t e = 0; e < result.size(); ++e)
    append(geometry(kept[static_cast<std::size_t>(e)]), e, result);
  return result;
}

template <int dim>
std::vector<AnyBlock<dim>> reference_blocks(const Mesh<dim>& mesh, index_t n_wet, const BlockOptions& options,
                                            std::span<double> nodal_volume)
{
  std::vector<AnyBlock<dim>> blocks;
  index_t first_number = 0;
  for (const auto& elements : mesh.blocks)
  {
    const auto add = [&]<class Element>(Element) {
      blocks.push_back(reference_block<Element>(mesh, elements, n_wet, options, first_number, nodal_volume));
    };
    const bool locking_free = options.formulation == Formulation::locking_free;
    const bool one_point = options.formulation == Formulation::one_point;
    if constexpr (dim == 2)
    {
      const bool ring = options.plane == PlaneKind::axisymmetric;
      if (locking_free && options.plane == PlaneKind::stress)
        fail_combination(elements.type, "plane stress: nothing locks there, use \"full\"");
      if (elements.type == ElementType::triangle3)
      {
        if (ring && locking_free)
          fail_combination(elements.type, "axial symmetry");
        ring ? add(Ring<Triangle3>{}) : locking_free ? add(Triangle3Nodal{}) : add(Triangle3{});
      }
      else if (elements.type == ElementType::quadrilateral4)
      {
        if (ring && options.formulation == Formulation::full)
          fail_combination(elements.type, "axial symmetry: it would lock, use \"locking_free\"");
        if (ring)
          one_point ? add(Ring<Quadrilateral4OnePoint>{}) : add(Ring<Quadrilateral4Mean>{});
        else
          one_point      ? add(Quadrilateral4OnePoint{})
          : locking_free ? add(Quadrilateral4Mean{})
                         : add(Quadrilateral4{});
      }
    }
    else
    {
      if (elements.type == ElementType::tetrahedron4)
        locking_free ? add(Tetrahedron4Nodal{}) : add(Tetrahedron4{});
      else if (elements.type == ElementType::hexahedron8)
        one_point ? add(Hexahedron8OnePoint{}) : locking_free ? add(Hexahedron8Mean{}) : add(Hexahedron8{});
    }
    first_number += elements.size();
  }
  return blocks;
}

template struct ReferenceBlock<Triangle3>;
template struct ReferenceBlock<Quadrilateral4>;
template struct ReferenceBlock<Triangle3Nodal>;
template struct ReferenceBlock<Quadrilateral4OnePoint>;
template struct ReferenceBlock<Quadrilateral4Mean>;
template struct ReferenceBlock<Ring<Triangle3>>;
template struct ReferenceBlock<Ring<Quadrilateral4OnePoint>>;
template struct ReferenceBlock<Ring<Quadrilateral4Mean>>;
template struct ReferenceBlock<Tetrahedron4>;
template struct ReferenceBlock<Hexahedron8>;
template struct ReferenceBlock<Tetrahedron4Nodal>;
template struct ReferenceBlock<Hexahedron8OnePoint>;
template struct ReferenceBlock<Hexahedron8Mean>;
template std::vector<AnyBlock<2>> reference_blocks(const Mesh<2>&, index_t, const BlockOptions&,
                                                   std::span<double>);
template std::vector<AnyBlock<3>> reference_blocks(const Mesh<3>&, index_t, const BlockOptions&,
                                                   std::span<double>);

} // namespace undine::solid
