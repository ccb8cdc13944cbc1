// Geometry of a configuration: the built-in box or a mesh file.
#include "solid_fe/solid_config.hpp"

#include "common/error.hpp"
#include "solid_fe/strip.hpp"

#include <algorithm>
#include <cmath>

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
