// Geometry of a configuration: the built-in box or a mesh file.
#include "solid_fe/solid_config.hpp"

#include "common/error.hpp"
#include "solid_fe/strip.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace undine::solid
{

std::vector<int> element_counts(const std::vector<double>& size, double element_size)
{
  std::vector<int> counts;
  for (const double length : size)
    counts.push_back(static_cast<int>(std::max(1.0, std::round(length / element_size))));
  return counts;
}

template <int dim>
Vec<dim> to_vec(const std::vector<double>& numbers, const std::string& key)
{
  Vec<dim> v;
  if (numbers.empty())
    return v;
  if (numbers.size() != dim)
    throw InputError(key + " has " + std::to_string(numbers.size()) + " numbers: must have " +
                     std::to_string(dim) + " in " + std::to_string(dim) + "-D");
  std::copy_n(numbers.begin(), dim, v.c.begin());
  return v;
}

namespace
{

/// A ring out of a box whose x goes around (downward, so that Jacobians stay positive) and whose y goes
/// across from `inner_radius`: the two ends are one. Surfaces inner, outer (and back, front).
template <int dim>
Mesh<dim> ring_of(const Mesh<dim>& box, const Vec<dim>& centre, double inner_radius)
{
  const double x0 = box.x.front()[0], y0 = box.x.front()[1], length = box.x.back()[0] - x0;
  Mesh<dim> ring;
  std::vector<index_t> number;
  index_t start_of_row = 0; // nodes come row by row along x
  for (const auto& X : box.x)
  {
    if (X[0] == x0)
      start_of_row = ring.n_nodes();
    const bool is_end = X[0] == box.x.back()[0];
    number.push_back(is_end ? start_of_row : ring.n_nodes());
    if (is_end)
      continue;
    const double angle = -2.0 * std::numbers::pi * (X[0] - x0) / length, r = inner_radius + X[1] - y0;
    Vec<dim> x = X;
    x[0] = centre[0] + r * std::cos(angle);
    x[1] = centre[1] + r * std::sin(angle);
    ring.x.push_back(x);
  }
  const auto renumbered = [&](std::vector<index_t> nodes)
  {
    for (auto& n : nodes)
      n = number[static_cast<std::size_t>(n)];
    return nodes;
  };
  ring.blocks = box.blocks;
  for (auto& block : ring.blocks)
    block.nodes = renumbered(block.nodes);
  for (const auto& [name, surface] : box.surfaces)
    if (name != "left" && name != "right")
    {
      auto& side = ring.surfaces[name == "bottom" ? "inner" : name == "top" ? "outer" : name];
      side = surface;
      side.nodes = renumbered(surface.nodes);
    }
  return ring;
}

} // namespace

template <int dim>
Mesh<dim> make_mesh(const SolidConfig& config)
{
  const auto& geometry = config.geometry;
  if constexpr (dim == 2)
    if (geometry.thickness > 0.0)
      return strip_about(geometry.mesh_file.empty() ? polyline(geometry.line, geometry.element_size)
                         : geometry.mesh_file.ends_with(".inp") ? read_abaqus<2>(geometry.mesh_file)
                                                                : read_gmsh<2>(geometry.mesh_file),
                         geometry.thickness);
  if (!geometry.mesh_file.empty())
    return geometry.mesh_file.ends_with(".inp") ? read_abaqus<dim>(geometry.mesh_file)
                                                : read_gmsh<dim>(geometry.mesh_file);
  std::array<int, dim> counts{};
  if (geometry.elements.size() != dim)
    throw InputError("solid.elements has " + std::to_string(geometry.elements.size()) +
                     " numbers: must have " + std::to_string(dim) + " in " + std::to_string(dim) + "-D");
  std::copy_n(geometry.elements.begin(), dim, counts.begin());
  const Vec<dim> origin = to_vec<dim>(geometry.origin, "solid.origin");
  Mesh<dim> mesh = box_mesh<dim>(origin, to_vec<dim>(geometry.size, "solid box"), counts, geometry.element);
  if (geometry.inner_radius > 0.0)
    return ring_of(mesh, origin, geometry.inner_radius);
  const double c = std::cos(geometry.angle), s = std::sin(geometry.angle);
  for (Vec<dim>& x : mesh.x)
    if (geometry.angle != 0.0)
    {
      const Vec<dim> r = x - origin;
      x[0] = origin[0] + c * r[0] - s * r[1];
      x[1] = origin[1] + s * r[0] + c * r[1];
    }
  return mesh;
}

template Vec<2> to_vec<2>(const std::vector<double>&, const std::string&);
template Vec<3> to_vec<3>(const std::vector<double>&, const std::string&);
template Mesh<2> make_mesh<2>(const SolidConfig&);
template Mesh<3> make_mesh<3>(const SolidConfig&);

} // namespace undine::solid
