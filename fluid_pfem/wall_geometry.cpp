// Walls out of the boundary groups of a mesh.
#include "fluid_pfem/wall_geometry.hpp"

#include "common/error.hpp"
#include "common/mesh/mesh.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace undine::fluid
{
namespace
{

/// Facets of a plane group in the order of a walk along it; whether that is one closed walk.
bool put_in_order(std::vector<std::array<std::array<double, 3>, 3>>& facets)
{
  auto begin = facets.begin();
  int walks = 0;
  bool closed = false;
  while (begin != facets.end())
  {
    // A walk starts where no other segment ends; on a closed one anywhere.
    const auto start =
        std::find_if(begin, facets.end(),
                     [&](const auto& f) {
                       return std::none_of(begin, facets.end(), [&](const auto& g) { return g[1] == f[0]; });
                     });
    std::iter_swap(begin, start == facets.end() ? begin : start);
    const auto first = begin;
    for (auto next = begin; next != facets.end();)
    {
      std::iter_swap(begin++, next);
      next = std::find_if(begin, facets.end(), [&](const auto& f) { return f[0] == (*(begin - 1))[1]; });
    }
    closed = (*(begin - 1))[1] == (*first)[0];
    ++walks;
  }
  return walks == 1 && closed;
}

template <int dim>
std::vector<WallGeometry> walls_of(const std::string& path, const std::string& group, bool fluid_inside)
{
  const Mesh<dim> mesh = read_gmsh<dim>(path);
  std::vector<WallGeometry> walls;
  std::vector<std::string> names;
  for (const auto& [name, surface] : mesh.surfaces)
  {
    names.push_back(name);
    if (!group.empty() && name != group)
      continue;
    WallGeometry g;
    g.name = name;
    g.fluid_inside = fluid_inside;
    for (index_t f = 0; f < surface.size(); ++f)
    {
      std::vector<std::array<double, 3>> corner; // outward of what is meshed
      for (index_t k = surface.offset[static_cast<std::size_t>(f)];
           k < surface.offset[static_cast<std::size_t>(f) + 1]; ++k)
      {
        corner.push_back({});
        const auto& x = mesh.x[static_cast<std::size_t>(surface.nodes[static_cast<std::size_t>(k)])];
        std::copy(x.c.begin(), x.c.end(), corner.back().begin());
      }
      if (fluid_inside == (dim == 3)) // walls look into the fluid, and a segment has it on its left
        std::reverse(corner.begin(), corner.end());
      if (dim == 2)
        g.facets.push_back({corner[0], corner[1], {}});
      else
        for (std::size_t k = 2; k < corner.size(); ++k)
          g.facets.push_back({corner[0], corner[k - 1], corner[k]});
    }
    if (dim == 2)
      g.closed = put_in_order(g.facets);
    walls.push_back(std::move(g));
  }
  if (walls.empty())
    throw InputError(group.empty() ? path + ": no boundary group bounds an element; a wall needs one"
                                   : fmt::format("{}: there is no boundary group '{}'. Groups there: {}",
                                                 path, group, fmt::join(names, " ")));
  return walls;
}

} // namespace

std::vector<WallGeometry> walls_of_mesh(const std::string& path, int dim, const std::string& group,
                                        bool fluid_inside)
{
  return dim == 2 ? walls_of<2>(path, group, fluid_inside) : walls_of<3>(path, group, fluid_inside);
}

} // namespace undine::fluid
