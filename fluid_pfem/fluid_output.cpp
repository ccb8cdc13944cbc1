// Fields and histories of the fluid.
#include "fluid_pfem/fluid_output.hpp"

#include "common/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <numeric>

namespace undine::fluid
{

namespace
{

template <int dim>
std::span<const double> flat(const std::vector<Vec<dim>>& field)
{
  return {field.front().c.data(), field.size() * dim};
}

/// Columns of a field in a history: x → position, v → velocity, p → pressure.
template <int dim>
std::vector<std::string> columns_of(const std::string& field)
{
  if (field == "p")
    return {"p[Pa]"};
  std::vector<std::string> columns;
  for (int i = 0; i < dim; ++i)
    columns.push_back(field == "x" ? std::string(1, "xyz"[i]) + "[m]"
                                   : field + "_" + std::string(1, "xyz"[i]) + "[m/s]");
  return columns;
}

} // namespace

template <int dim>
FluidOutput<dim>::FluidOutput(const OutputConfig& output, const std::vector<ProbeConfig>& probes,
                              const Fluid<dim>& fluid)
    : config_(output), frames_(output.dir, "fluid"),
      energy_(output.dir, "fluid_energy",
              fmt::format("energies of the fluid{}; kinetic + internal + potential + dissipated - "
                          "interface_work - remeshing stays "
                          "at its start up to O(dt^2)",
                          dim == 2 ? " per metre of depth" : ""),
              {"kinetic[J]", "internal[J]", "potential[J]", "dissipated[J]", "remeshing[J]",
               "interface_work[J]"}),
      mass_(output.dir, "mass",
            fmt::format("mass of the nodes and volume of the elements{}",
                        dim == 2 ? " per metre of depth" : ""),
            {"mass[kg]", "volume[m^dim]", "remeshes[]"}),
      mass_at_start_(fluid.mass())
{
  const auto& nodes = fluid.nodes();
  for (const ProbeConfig& probe : probes)
  {
    if (probe.on != "fluid")
      continue;
    std::vector<std::string> columns;
    for (const auto& field : probe.fields)
    {
      if (field != "x" && field != "v" && field != "p")
        throw InputError(fmt::format(
            "probe '{}': the fluid has no field '{}'; it has x (position), v (velocity), p (pressure)",
            probe.name, field));
      for (auto& column : columns_of<dim>(field))
        columns.push_back(std::move(column));
    }
    std::vector<global_index_t> id;
    std::string definition;
    if (probe.at_point())
    {
      std::size_t nearest = 0;
      double shortest = std::numeric_limits<double>::infinity();
      for (std::size_t n = 0; n < nodes.x.size(); ++n)
      {
        double distance = 0.0;
        for (int i = 0; i < dim; ++i)
          distance += (nodes.x[n][i] - probe.point[static_cast<std::size_t>(i)]) *
                      (nodes.x[n][i] - probe.point[static_cast<std::size_t>(i)]);
        if (distance < shortest)
        {
          shortest = distance;
          nearest = n;
        }
      }
      id.push_back(nodes.id[nearest]);
      definition = fmt::format("fluid node {} that started at ({:.6g}) m", nodes.id[nearest],
                               fmt::join(nodes.x[nearest].c, ", "));
    }
    else
    {
      std::vector<std::string> known;
      SurfaceMask mask = 0;
      for (std::size_t s = 0; s < fluid.surfaces().size(); ++s)
      {
        known.push_back(fluid.surfaces()[s].name);
        if (known.back() == probe.surface)
          mask = SurfaceMask{1} << s;
      }
      if (mask == 0)
        throw InputError(fmt::format("probe '{}': the fluid has no surface '{}'. Surfaces there: {}",
                                     probe.name, probe.surface, fmt::join(known, " ")));
      for (std::size_t n = 0; n < nodes.x.size(); ++n)
        if (nodes.surface[n] & mask)
          id.push_back(nodes.id[n]);
      definition = fmt::format("mean over the {} nodes of surface '{}'", id.size(), probe.surface);
    }
    std::sort(id.begin(), id.end());
    probes_.push_back({std::move(id), probe.fields, History(output.dir, probe.name, definition, columns)});
  }
}

template <int dim>
void FluidOutput<dim>::observe(double t, const Fluid<dim>& fluid, bool frame)
{
  if (frame && config_.frames)
    write_frame(t, fluid);
  if (frame || config_.history_interval <= 0.0 || t >= next_row_)
  {
    write_rows(t, fluid);
    if (config_.history_interval > 0.0)
      while (next_row_ <= t)
        next_row_ += config_.history_interval;
  }
}

template <int dim>
void FluidOutput<dim>::write_frame(double t, const Fluid<dim>& fluid)
{
  const auto& nodes = fluid.nodes();
  std::vector<index_t> connectivity;
  connectivity.reserve(fluid.mesh().elements.size() * (dim + 1));
  for (const auto& e : fluid.mesh().elements)
    connectivity.insert(connectivity.end(), e.begin(), e.end());
  FrameMesh mesh{.dim = dim, .x = flat(nodes.x), .blocks = {}};
  mesh.blocks.emplace_back(dim == 2 ? ElementType::triangle3 : ElementType::tetrahedron4, connectivity);
  frames_.write(t, mesh,
                {{.name = "velocity", .unit = "m/s", .components = dim, .values = flat(nodes.v)},
                 {.name = "pressure", .unit = "Pa", .components = 1, .values = nodes.p},
                 {.name = "density", .unit = "kg/m^3", .components = 1, .values = nodes.rho}});
}

template <int dim>
void FluidOutput<dim>::write_rows(double t, const Fluid<dim>& fluid)
{
  const FluidEnergy e = fluid.energy();
  energy_.write(t, {e.kinetic, e.internal, e.potential, e.dissipated, e.remeshing, e.interface_work});
  const auto& nodes = fluid.nodes();
  mass_.write(t, {fluid.mass(), std::accumulate(nodes.V.begin(), nodes.V.end(), 0.0),
                  static_cast<double>(fluid.remeshes())});
  if (probes_.empty())
    return;
  for (Probe& probe : probes_)
  {
    std::vector<double> row;
    for (const auto& field : probe.fields)
    {
      const int components = field == "p" ? 1 : dim;
      std::vector<double> sum(static_cast<std::size_t>(components), 0.0);
      for (std::size_t n = 0; n < nodes.x.size(); ++n)
        if (std::binary_search(probe.id.begin(), probe.id.end(), nodes.id[n]))
          for (int i = 0; i < components; ++i)
            sum[static_cast<std::size_t>(i)] += field == "p"   ? nodes.p[n]
                                                : field == "x" ? nodes.x[n][i]
                                                               : nodes.v[n][i];
      for (const double s : sum)
        row.push_back(s / static_cast<double>(probe.id.size()));
    }
    probe.history.write(t, row);
  }
}

template class FluidOutput<2>;
template class FluidOutput<3>;

} // namespace undine::fluid
