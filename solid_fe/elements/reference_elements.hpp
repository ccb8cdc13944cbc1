// Shape functions and quadrature of the solid's elements on their reference shapes; node order as in Gmsh and
// VTK.
#pragma once

#include "common/mesh/mesh.hpp"
#include "common/tensor.hpp"

#include <array>
#include <concepts>

namespace undine::solid
{

/// Where the volume change of a point comes from.
enum class Dilatation
{
  of_point,   ///< its own
  of_element, ///< F̄ = (J̄/J)^(1/d) F with the mean J̄ of the element: no locking near ν = ½
  of_nodes    ///< J̄ is the mean over the element's nodes of the mean over each node's elements
};

/// What an element type must offer. `point` and `weight` integrate over the reference shape; each type
/// integrates its row-sum mass on any shape exactly with the points of its `Mass` type.
template <class E>
concept ReferenceElement = requires(const Vec<E::dim>& xi, int q)
{
  {
    E::shape(xi)
    } -> std::same_as<std::array<double, E::nodes>>;
  {
    E::shape_gradient(xi)
    } -> std::same_as<std::array<Vec<E::dim>, E::nodes>>;
  {
    E::point(q)
    } -> std::same_as<Vec<E::dim>>;
  {
    E::weight(q)
    } -> std::same_as<double>;
  typename E::Mass;
};

/// What most element types are: a solid element whose points see their own volume change.
struct Standard
{
  static constexpr Dilatation dilatation = Dilatation::of_point;
  static constexpr bool axisymmetric = false;
  static constexpr int hourglass_modes = 0;
};

/// Linear triangle on (0,0), (1,0), (0,1): constant strain, one point.
struct Triangle3 : Standard
{
  using Mass = Triangle3;
  static constexpr const char* name = "T3";
  static constexpr int dim = 2, nodes = 3, points = 1;
  static constexpr ElementType type = ElementType::triangle3;

  static constexpr std::array<double, nodes> shape(const Vec<dim>& xi)
  {
    return {1.0 - xi[0] - xi[1], xi[0], xi[1]};
  }
  static constexpr std::array<Vec<dim>, nodes> shape_gradient(const Vec<dim>&)
  {
    return {Vec<dim>{{-1.0, -1.0}}, Vec<dim>{{1.0, 0.0}}, Vec<dim>{{0.0, 1.0}}};
  }
  static constexpr Vec<dim> point(int) { return {{1.0 / 3.0, 1.0 / 3.0}}; }
  static constexpr double weight(int) { return 0.5; }
};

/// Linear tetrahedron on the origin and the three unit points: constant strain, one point.
struct Tetrahedron4 : Standard
{
  using Mass = Tetrahedron4;
  static constexpr const char* name = "Tet4";
  static constexpr int dim = 3, nodes = 4, points = 1;
  static constexpr ElementType type = ElementType::tetrahedron4;

  static constexpr std::array<double, nodes> shape(const Vec<dim>& xi)
  {
    return {1.0 - xi[0] - xi[1] - xi[2], xi[0], xi[1], xi[2]};
  }
  static constexpr std::array<Vec<dim>, nodes> shape_gradient(const Vec<dim>&)
  {
    return {Vec<dim>{{-1.0, -1.0, -1.0}}, Vec<dim>{{1.0, 0.0, 0.0}}, Vec<dim>{{0.0, 1.0, 0.0}},
            Vec<dim>{{0.0, 0.0, 1.0}}};
  }
  static constexpr Vec<dim> point(int) { return {{0.25, 0.25, 0.25}}; }
  static constexpr double weight(int) { return 1.0 / 6.0; }
};

/// Corners of the reference square or cube [-1, 1]^dim: counter-clockwise, in 3-D the face z = -1 first.
template <int dim>
constexpr Vec<dim> cube_corner(int a)
{
  Vec<dim> corner;
  corner[0] = (a % 4 == 0 || a % 4 == 3) ? -1.0 : 1.0;
  corner[1] = (a % 4 < 2) ? -1.0 : 1.0;
  if constexpr (dim == 3)
    corner[2] = a < 4 ? -1.0 : 1.0;
  return corner;
}

/// Multilinear element on [-1, 1]^dim with 2^dim Gauss points (full integration).
template <int dimension>
struct Multilinear : Standard
{
  using Mass = Multilinear;
  static constexpr const char* name = dimension == 2 ? "Q4" : "Hex8";
  static constexpr int dim = dimension, nodes = 1 << dimension, points = 1 << dimension;
  static constexpr ElementType type = dimension == 2 ? ElementType::quadrilateral4 : ElementType::hexahedron8;

  static constexpr std::array<double, nodes> shape(const Vec<dim>& xi)
  {
    std::array<double, nodes> N{};
    for (int a = 0; a < nodes; ++a)
    {
      N[static_cast<std::size_t>(a)] = 1.0;
      for (int i = 0; i < dim; ++i)
        N[static_cast<std::size_t>(a)] *= 0.5 * (1.0 + cube_corner<dim>(a)[i] * xi[i]);
    }
    return N;
  }
  static constexpr std::array<Vec<dim>, nodes> shape_gradient(const Vec<dim>& xi)
  {
    std::array<Vec<dim>, nodes> dN{};
    for (int a = 0; a < nodes; ++a)
      for (int j = 0; j < dim; ++j)
      {
        double g = 0.5 * cube_corner<dim>(a)[j];
        for (int i = 0; i < dim; ++i)
          if (i != j)
            g *= 0.5 * (1.0 + cube_corner<dim>(a)[i] * xi[i]);
        dN[static_cast<std::size_t>(a)][j] = g;
      }
    return dN;
  }
  static constexpr Vec<dim> point(int q)
  {
    constexpr double gauss = 0.577350269189625764509148780501957456; // 1/sqrt(3)
    return gauss * cube_corner<dim>(q);
  }
  static constexpr double weight(int) { return 1.0; }
};

using Quadrilateral4 = Multilinear<2>;
using Hexahedron8 = Multilinear<3>;

/// The same with one point in the middle; its zero-energy modes are held by hourglass control.
template <int dimension>
struct OnePoint : Multilinear<dimension>
{
  using Mass = Multilinear<dimension>;
  static constexpr const char* name = dimension == 2 ? "Q4, one point" : "Hex8, one point";
  static constexpr int dim = dimension, points = 1;
  static constexpr int hourglass_modes = dimension == 2 ? 1 : 4;

  static constexpr Vec<dim> point(int) { return {}; }
  static constexpr double weight(int) { return dimension == 2 ? 4.0 : 8.0; }
  /// Value of mode k at node a: ξη, and in 3-D ηζ, ζξ, ξη, ξηζ.
  static constexpr double hourglass(int k, int a)
  {
    const auto x = cube_corner<dim>(a);
    if constexpr (dimension == 2)
      return x[0] * x[1];
    else
      return k == 0 ? x[1] * x[2] : k == 1 ? x[2] * x[0] : k == 2 ? x[0] * x[1] : x[0] * x[1] * x[2];
  }
};

using Quadrilateral4OnePoint = OnePoint<2>;
using Hexahedron8OnePoint = OnePoint<3>;

/// The same with the element's mean volume change (F-bar in its variational form).
template <int dimension>
struct MeanDilatation : Multilinear<dimension>
{
  using Mass = Multilinear<dimension>;
  static constexpr const char* name = dimension == 2 ? "Q4, mean dilatation" : "Hex8, mean dilatation";
  static constexpr Dilatation dilatation = Dilatation::of_element;
};

using Quadrilateral4Mean = MeanDilatation<2>;
using Hexahedron8Mean = MeanDilatation<3>;

/// Simplices with nodally averaged volume change. Bonet & Burton (1998).
struct Triangle3Nodal : Triangle3
{
  using Mass = Triangle3;
  static constexpr const char* name = "T3, nodal dilatation";
  static constexpr Dilatation dilatation = Dilatation::of_nodes;
};

struct Tetrahedron4Nodal : Tetrahedron4
{
  using Mass = Tetrahedron4;
  static constexpr const char* name = "Tet4, nodal dilatation";
  static constexpr Dilatation dilatation = Dilatation::of_nodes;
};

/// An element of the plane (r, z) that stands for a ring; forces, masses and energies of the whole ring.
template <class Plane>
struct Ring : Plane
{
  using Mass = Ring<typename Plane::Mass>;
  static constexpr bool axisymmetric = true;
};
template <class Element>
concept OwnMass = std::same_as<typename Element::Mass, Element>;
template <OwnMass Plane>
struct Ring<Plane> : Plane
{
  using Mass = Ring;
  static constexpr bool axisymmetric = true;
};

/// Size of the displacement gradient that the laws see: 3 also in axial symmetry.
template <class Element>
constexpr int strain_dim = Element::axisymmetric ? 3 : Element::dim;

static_assert(ReferenceElement<Triangle3> && ReferenceElement<Tetrahedron4>);
static_assert(ReferenceElement<Quadrilateral4> && ReferenceElement<Hexahedron8>);

} // namespace undine::solid
