// Meshes, materials and states shared by the solid's tests.
#pragma once

#include "common/mesh/mesh.hpp"
#include "solid_fe/solid.hpp"
#include "solid_fe/solid_config.hpp"

#include <array>
#include <random>
#include <string>
#include <vector>

namespace undine::solid::test
{

/// The element types of a dimension.
template <int dim>
std::vector<ElementType> element_types()
{
  if constexpr (dim == 2)
    return {ElementType::triangle3, ElementType::quadrilateral4};
  else
    return {ElementType::tetrahedron4, ElementType::hexahedron8};
}

/// An element type in one of its forms.
struct Kind
{
  ElementType type;
  Formulation formulation;
  PlaneKind plane = PlaneKind::strain;
};

/// Uniform numbers in [-size, size].
class Random
{
public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double operator()(double size = 1.0) { return size * (2.0 * uniform_(engine_) - 1.0); }
  template <int dim>
  Mat<dim> matrix(double size)
  {
    Mat<dim> A;
    for (auto& x : A.c)
      x = (*this)(size);
    return A;
  }
  template <int dim>
  Vec<dim> vector(double size)
  {
    Vec<dim> a;
    for (auto& x : a.c)
      x = (*this)(size);
    return a;
  }
  template <int dim>
  Vec<dim> direction()
  {
    Vec<dim> a;
    double length = 0.0;
    while (length < 0.1 || length > 1.0)
    {
      a = vector<dim>(1.0);
      length = norm(a);
    }
    return (1.0 / length) * a;
  }

private:
  std::mt19937 engine_;
  std::uniform_real_distribution<double> uniform_{0.0, 1.0};
};

/// Rotation by `angle` about the axis (1, 2, 3)/|.| (3-D) or out of plane (2-D).
template <int dim>
Mat<dim> rotation(double angle)
{
  const double c = std::cos(angle), s = std::sin(angle);
  if constexpr (dim == 2)
    return {{c, -s, s, c}};
  else
  {
    const double scale = 1.0 / std::sqrt(14.0);
    const Vec<3> n{{scale, 2.0 * scale, 3.0 * scale}};
    Mat<3> R;
    const double cross_matrix[3][3] = {{0, -n[2], n[1]}, {n[2], 0, -n[0]}, {-n[1], n[0], 0}};
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        R(i, j) = (i == j ? c : 0.0) + (1.0 - c) * n[i] * n[j] + s * cross_matrix[i][j];
    return R;
  }
}

/// A box of about unit size with `cells` elements along the first axis and fewer along the others, inner
/// nodes displaced by up to `distortion` of the element size.
template <int dim>
Mesh<dim> distorted_box(ElementType type, int cells = 4, double distortion = 0.2)
{
  Vec<dim> size;
  std::array<int, dim> counts{};
  for (int i = 0; i < dim; ++i)
  {
    size[i] = 1.0 - 0.25 * i;
    counts[static_cast<std::size_t>(i)] = std::max(2, cells - i);
  }
  auto mesh = box_mesh<dim>(Vec<dim>{}, size, counts, type);
  Random random(7);
  for (auto& x : mesh.x)
  {
    bool inner = true;
    for (int i = 0; i < dim; ++i)
      inner = inner && x[i] > 1e-9 && x[i] < size[i] - 1e-9;
    const auto shift = random.vector<dim>(distortion / cells);
    if (inner)
      x += shift;
  }
  return mesh;
}

/// A soft solid: E = 1e6 Pa, ρ = 1000 kg/m³; ν = 0.3.
inline SolidConfig soft_config(int dim, const std::string& law)
{
  SolidConfig config;
  config.dim = dim;
  config.material = {.density = 1000.0, .youngs_modulus = 1e6, .poisson_ratio = 0.3, .law = law};
  return config;
}

template <int dim>
auto zero_field()
{
  return [](const Vec<dim>&) { return Vec<dim>{}; };
}

} // namespace undine::solid::test
