// Shape functions and quadrature of the solid's elements on their reference shapes; node order as in Gmsh and
// VTK.
#pragma once

#include "common/mesh/mesh.hpp"
#include "common/tensor.hpp"

#include <array>
#include <concepts>

namespace undine::solid
{

/// What an element type must offer. `point` and `weight` integrate over the reference shape; each type
/// integrates its own stiffness on a parallelepiped and its row-sum mass on any shape exactly.
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
};

/// Linear triangle on (0,0), (1,0), (0,1): constant strain, one point.
struct Triangle3
{
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
struct Tetrahedron4
{
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
struct Multilinear
{
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

static_assert(ReferenceElement<Triangle3> && ReferenceElement<Tetrahedron4>);
static_assert(ReferenceElement<Quadrilateral4> && ReferenceElement<Hexahedron8>);

} // namespace undine::solid
