// Means of the link's impulses over space and time.
#include "coupler/gauges.hpp"

#include "common/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace undine::coupler
{

namespace
{

std::array<double, 3> position(const link::SurfaceMesh& mesh, std::size_t n)
{
  std::array<double, 3> x{};
  for (int i = 0; i < mesh.dim; ++i)
    x[static_cast<std::size_t>(i)] =
        mesh.x[n * static_cast<std::size_t>(mesh.dim) + static_cast<std::size_t>(i)];
  return x;
}

std::array<double, 3> cross(const std::array<double, 3>& a, const std::array<double, 3>& b)
{
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

double dot(const std::array<double, 3>& a, const std::array<double, 3>& b)
{
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

} // namespace

SurfaceGauges::SurfaceGauges(const OutputConfig& output, const std::vector<ProbeConfig>& probes,
                             const link::SurfaceMesh& solid)
    : interval_(output.history_interval)
{
  const bool plane = solid.dim == 2;
  std::vector<int> interface_of(static_cast<std::size_t>(solid.n_nodes()), -1);
  for (std::size_t f = 0; f < solid.face_interface.size(); ++f)
    for (auto k = solid.face_offset[f]; k < solid.face_offset[f + 1]; ++k)
      if (int& i = interface_of[static_cast<std::size_t>(solid.face_nodes[static_cast<std::size_t>(k)])];
          i < 0)
        i = solid.face_interface[f];
  for (std::size_t i = 0; i < solid.interfaces.size(); ++i)
  {
    Force force{.nodes = {},
                .history = History(
                    output.dir, "force_" + solid.interfaces[i],
                    fmt::format("force of the fluid on the solid through interface '{}' and its moment about "
                                "the origin{}; means over the time since the row before",
                                solid.interfaces[i], plane ? ", per metre of thickness" : ""),
                    plane ? std::vector<std::string>{"F_x[N]", "F_y[N]", "M_z[N m]"}
                          : std::vector<std::string>{"F_x[N]", "F_y[N]", "F_z[N]", "M_x[N m]", "M_y[N m]",
                                                     "M_z[N m]"})};
    for (std::size_t n = 0; n < interface_of.size(); ++n)
      if (interface_of[n] == static_cast<int>(i))
        force.nodes.push_back(static_cast<std::int32_t>(n));
    forces_.push_back(std::move(force));
  }
  for (const ProbeConfig& probe : probes)
  {
    if (probe.on != "interface")
      continue;
    if (!probe.at_point() || probe.radius <= 0.0 || probe.fields != std::vector<std::string>{"p"})
      throw InputError(fmt::format("probe \"{}\": on = \"interface\" measures quantity = \"p\" over the part "
                                   "of the solid's surface within radius > 0 "
                                   "of a point of it; give point, radius and quantity = \"p\"",
                                   probe.name));
    std::array<double, 3> centre{};
    std::copy(probe.point.begin(), probe.point.end(), centre.begin());
    Pressure pressure{.nodes = {},
                      .history = History(
                          output.dir, probe.name,
                          fmt::format("contact pressure on the solid: link impulse against the surface's "
                                      "normal, over the nodes within {:.6g} m of ({:.6g}) m at the start and "
                                      "their tributary area, mean over the time since the row before",
                                      probe.radius, fmt::join(probe.point, ", ")),
                          {"p[Pa]"})};
    for (std::size_t n = 0; n < static_cast<std::size_t>(solid.n_nodes()); ++n)
    {
      const auto x = position(solid, n);
      const std::array<double, 3> r{x[0] - centre[0], x[1] - centre[1], x[2] - centre[2]};
      if (dot(r, r) <= probe.radius * probe.radius * (1.0 + 1e-9))
        pressure.nodes.push_back(static_cast<std::int32_t>(n));
    }
    if (pressure.nodes.empty())
      throw InputError(
          fmt::format("probe \"{}\": no node of the solid's wet surface lies within radius = {:.6g} m of "
                      "point = ({:.6g}); enlarge the radius or move the point onto the surface",
                      probe.name, probe.radius, fmt::join(probe.point, ", ")));
    pressures_.push_back(std::move(pressure));
  }
}

/// Area vectors: each face's is shared by its nodes.
void SurfaceGauges::measure_nodes(const link::SurfaceMesh& solid)
{
  normal_.assign(static_cast<std::size_t>(solid.n_nodes()), {});
  for (std::size_t f = 0; f < solid.face_interface.size(); ++f)
  {
    const auto begin = static_cast<std::size_t>(solid.face_offset[f]),
               end = static_cast<std::size_t>(solid.face_offset[f + 1]);
    const auto at = [&](std::size_t k)
    { return position(solid, static_cast<std::size_t>(solid.face_nodes[k])); };
    std::array<double, 3> area{};
    if (solid.dim == 2)
    {
      const auto a = at(begin), b = at(begin + 1);
      area = {b[1] - a[1], a[0] - b[0], 0.0};
    }
    else
      for (std::size_t k = begin; k < end; ++k)
      {
        const auto part = cross(at(k), at(k + 1 < end ? k + 1 : begin));
        for (std::size_t i = 0; i < 3; ++i)
          area[i] += 0.5 * part[i];
      }
    for (std::size_t k = begin; k < end; ++k)
      for (std::size_t i = 0; i < 3; ++i)
        normal_[static_cast<std::size_t>(solid.face_nodes[k])][i] +=
            area[i] / static_cast<double>(end - begin);
  }
}

void SurfaceGauges::observe(double t, double dt, std::span<const double> f, const link::SurfaceMesh& solid)
{
  const auto dim = static_cast<std::size_t>(solid.dim);
  const auto force_on = [&](std::int32_t n)
  {
    std::array<double, 3> force{};
    std::copy_n(f.begin() + static_cast<std::ptrdiff_t>(n) * solid.dim, dim, force.begin());
    return force;
  };
  for (Force& part : forces_)
    for (const auto n : part.nodes)
    {
      const auto force = force_on(n), moment = cross(position(solid, static_cast<std::size_t>(n)), force);
      for (std::size_t i = 0; i < 3; ++i)
      {
        part.impulse[i] += dt * force[i];
        part.angular[i] += dt * moment[i];
      }
    }
  if (!pressures_.empty())
  {
    measure_nodes(solid);
    for (Pressure& patch : pressures_)
      for (const auto n : patch.nodes)
      {
        const auto& area = normal_[static_cast<std::size_t>(n)];
        const double size = std::sqrt(dot(area, area));
        if (size > 0.0)
          patch.impulse -= dt * dot(force_on(n), area) / size;
        patch.area += dt * size;
      }
  }
  since_ += dt;
  if (!(since_ > 0.0) || t < next_ - 1e-12 * std::abs(t))
    return;
  for (Force& part : forces_)
  {
    std::vector<double> row;
    for (std::size_t i = 0; i < dim; ++i)
      row.push_back(part.impulse[i] / since_);
    for (std::size_t i = dim == 2 ? 2 : 0; i < 3; ++i)
      row.push_back(part.angular[i] / since_);
    part.history.write(t, row);
    part.impulse = part.angular = {};
  }
  for (Pressure& patch : pressures_)
  {
    patch.history.write(t, {patch.area > 0.0 ? patch.impulse / patch.area : 0.0});
    patch.impulse = patch.area = 0.0;
  }
  since_ = 0.0;
  while (interval_ > 0.0 && next_ <= t)
    next_ += interval_;
}

} // namespace undine::coupler
