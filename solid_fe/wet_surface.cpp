// Numbering of wet nodes and the MESH message.
#include "solid_fe/wet_surface.hpp"

#include "common/error.hpp"
#include "solid_fe/boundary_conditions.hpp"

#include <algorithm>

namespace undine::solid
{

template <int dim>
WetFirstMesh<dim> number_wet_nodes_first(const Mesh<dim>& given, const std::vector<WetConfig>& wet)
{
  const auto n_given = static_cast<std::size_t>(given.n_nodes());
  std::vector<bool> is_wet(n_given, false), is_used(n_given, false);
  for (const auto& block : given.blocks)
    if (element_dimension(block.type) == dim)
      for (const index_t n : block.nodes)
        is_used[static_cast<std::size_t>(n)] = true;
  for (const auto& entry : wet)
    for (const index_t n :
         find_surface(given, entry.surface, "interface \"" + entry.interface + "\": solid").nodes)
      is_wet[static_cast<std::size_t>(n)] = true;

  WetFirstMesh<dim> result;
  std::vector<index_t> new_number(n_given, -1);
  for (const bool wet_pass : {true, false})
  {
    for (std::size_t n = 0; n < n_given; ++n)
      if (is_used[n] && is_wet[n] == wet_pass)
      {
        new_number[n] = static_cast<index_t>(result.number.size());
        result.number.push_back(static_cast<index_t>(n));
      }
    if (wet_pass)
      result.n_wet = static_cast<index_t>(result.number.size());
  }

  const auto renumber = [&new_number](std::vector<index_t>& nodes)
  {
    for (auto& n : nodes)
      n = new_number[static_cast<std::size_t>(n)];
  };
  result.mesh = given;
  std::erase_if(result.mesh.blocks, [](const ElementBlock& b) { return element_dimension(b.type) != dim; });
  for (auto& block : result.mesh.blocks)
    renumber(block.nodes);
  for (auto& [name, surface] : result.mesh.surfaces)
  {
    if (std::any_of(surface.nodes.begin(), surface.nodes.end(),
                    [&](index_t n) { return !is_used[static_cast<std::size_t>(n)]; }))
      throw InputError("mesh: the surface \"" + name +
                           "\" has facets that belong to no element of dimension " + std::to_string(dim) +
                           "; mesh the body behind it or drop the group",
                       ExitCode::bad_input_file);
    renumber(surface.nodes);
  }
  for (auto& [name, set] : result.mesh.node_sets)
  {
    std::erase_if(set, [&](index_t n) { return !is_used[static_cast<std::size_t>(n)]; });
    renumber(set);
  }
  result.mesh.x.resize(result.number.size());
  for (std::size_t n = 0; n < result.number.size(); ++n)
    result.mesh.x[n] = given.x[static_cast<std::size_t>(result.number[n])];
  return result;
}

template <int dim>
link::SurfaceMesh surface_message(const WetFirstMesh<dim>& mesh, const std::vector<WetConfig>& wet,
                                  const SolidNodes<dim>& nodes)
{
  link::SurfaceMesh message;
  message.dim = dim;
  for (index_t k = 0; k < mesh.n_wet; ++k)
  {
    const auto n = static_cast<std::size_t>(k);
    message.node_id.push_back(mesh.number[n]);
    for (int i = 0; i < dim; ++i)
    {
      message.x.push_back(nodes.X[n][i] + nodes.u[n][i]);
      for (int j = 0; j < dim; ++j)
        message.inverse_mass.push_back(i == j ? nodes.inverse_mass[n][i] : 0.0);
    }
  }
  for (const auto& entry : wet)
  {
    auto& names = message.interfaces;
    auto named = std::find(names.begin(), names.end(), entry.interface);
    const auto interface = static_cast<std::int32_t>(named - names.begin());
    if (named == names.end())
      names.push_back(entry.interface);
    const auto& surface =
        find_surface(mesh.mesh, entry.surface, "interface \"" + entry.interface + "\": solid");
    for (index_t f = 0; f < surface.size(); ++f)
    {
      for (index_t k = surface.offset[static_cast<std::size_t>(f)];
           k < surface.offset[static_cast<std::size_t>(f) + 1]; ++k)
        message.face_nodes.push_back(surface.nodes[static_cast<std::size_t>(k)]);
      message.face_offset.push_back(static_cast<std::int32_t>(message.face_nodes.size()));
      message.face_interface.push_back(interface);
    }
  }
  return message;
}

template WetFirstMesh<2> number_wet_nodes_first(const Mesh<2>&, const std::vector<WetConfig>&);
template WetFirstMesh<3> number_wet_nodes_first(const Mesh<3>&, const std::vector<WetConfig>&);
template link::SurfaceMesh surface_message(const WetFirstMesh<2>&, const std::vector<WetConfig>&,
                                           const SolidNodes<2>&);
template link::SurfaceMesh surface_message(const WetFirstMesh<3>&, const std::vector<WetConfig>&,
                                           const SolidNodes<3>&);

} // namespace undine::solid
