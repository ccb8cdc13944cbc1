// Fields and histories of the fluid.
#include "fluid_pfem/fluid_output.hpp"

#include "common/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <utility>

namespace undine::fluid
{

namespace
{

constexpr int samples_per_row = 16; ///< of a gauge

template <int dim>
std::span<const double> flat(std::span<const Vec<dim>> field)
{
  return {reinterpret_cast<const double*>(field.data()), field.size() * dim};
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

template <int dim>
Vec<dim> as_point(const std::vector<double>& point)
{
  Vec<dim> p;
  for (int i = 0; i < dim; ++i)
    p[i] = point[static_cast<std::size_t>(i)];
  return p;
}

template <int dim>
Vec<dim> gravity_of(const Fluid<dim>& fluid)
{
  Vec<dim> g;
  for (int i = 0; i < dim; ++i)
    g[i] = fluid.config().gravity[static_cast<std::size_t>(i)];
  return g;
}

/// Largest value(n) of the nodes n of all ranks that have one. Collective.
template <int dim, class Value>
double largest(const Fluid<dim>& fluid, Value&& value)
{
  double most = std::numeric_limits<double>::lowest();
  const auto [begin, end] = fluid.node_range();
  for (auto n = static_cast<std::size_t>(begin); n < static_cast<std::size_t>(end); ++n)
    most = std::max(most, value(n));
  return fluid.ranks().max(most);
}

/// Largest −g·x.
template <int dim>
double highest_potential(const Fluid<dim>& fluid)
{
  return largest(fluid, [&](std::size_t n) { return -dot(gravity_of(fluid), fluid.nodes().x[n]); });
}

/// ‖p − p(rest)‖ / ‖p(rest)‖, nodes weighted with their volumes; of what was collected.
template <int dim>
double hydrostatic_error(const Fluid<dim>& fluid, double highest)
{
  const auto& nodes = fluid.nodes();
  const Tait& tait = fluid.config().tait;
  double error = 0.0, scale = 0.0;
  for (std::size_t n = 0; n < nodes.x.size(); ++n)
  {
    const double depth = std::max(0.0, highest + dot(gravity_of(fluid), nodes.x[n]));
    const double p = tait.pressure(tait.hydrostatic_density(depth));
    error += nodes.V[n] * (nodes.p[n] - p) * (nodes.p[n] - p);
    scale += nodes.V[n] * p * p;
  }
  return scale > 0.0 ? std::sqrt(error / scale) : 0.0;
}

/// Highest boundary facet above the point's horizontal position; in space the nearest boundary node within
/// one spacing. Each rank looks at its nodes. Collective.
template <int dim>
double elevation(const Fluid<dim>& fluid, const std::vector<double>& point)
{
  const auto& x = fluid.nodes().x;
  const auto [begin, end] = fluid.node_range();
  double highest = std::numeric_limits<double>::lowest();
  for (const auto& facet : fluid.mesh().boundary)
    for (const index_t n : facet)
    {
      if (n < begin || n >= end)
        continue;
      if constexpr (dim == 2)
      {
        const auto& period = fluid.nodes().period;
        const Vec<2> a = period.near(as_point<2>(point), x[static_cast<std::size_t>(facet[0])]),
                     b = period.near(a, x[static_cast<std::size_t>(facet[1])]);
        if ((a[0] - point[0]) * (b[0] - point[0]) <= 0.0 && a[0] != b[0])
          highest = std::max(highest, a[1] + (point[0] - a[0]) / (b[0] - a[0]) * (b[1] - a[1]));
        else if (a[0] == point[0])
          highest = std::max(highest, a[1]);
        break; // the facet has been looked at
      }
      else if (const auto& p = x[static_cast<std::size_t>(n)];
               std::hypot(p[0] - point[0], p[2] - point[2]) < fluid.config().element_size)
        highest = std::max(highest, p[1]);
    }
  return fluid.ranks().max(highest);
}

} // namespace

template <int dim>
FluidOutput<dim>::FluidOutput(const OutputConfig& output, const std::vector<ProbeConfig>& probes,
                              const Fluid<dim>& fluid)
    : config_(output), frames_(output.dir, "fluid", fluid.ranks()),
      energy_(
          output.dir, "fluid_energy",
          fmt::format("energies of the fluid{}, works cumulated; kinetic + internal + potential + "
                      "dissipated - exchanged - interface_work - wall_work - "
                      "remesh_gain - remesh_loss - openings keeps its value; exchanged: given by what moves "
                      "mass between nodes",
                      dim == 2 ? " per metre of depth" : ""),
          {"kinetic[J]", "internal[J]", "potential[J]", "dissipated[J]", "exchanged[J]", "remesh_gain[J]",
           "remesh_loss[J]", "wall_work[J]", "interface_work[J]", "openings[J]"}),
      mass_(output.dir, "mass",
            fmt::format("particle mass in elements, flying and deleted; mass of the density field; volume{}; "
                        "volume_error = rho0 volume / "
                        "meshed - 1; created and dropped: volume by decision of all remeshes",
                        dim == 2 ? " per metre of depth" : ""),
            {"meshed[kg]", "flying[kg]", "deleted[kg]", "dynamic[kg]", "volume[m^dim]", "volume_error[]",
             "created[m^dim]", "dropped[m^dim]", "nodes[]", "merged[]", "split[]", "remeshes[]", "inflow[kg]",
             "outflow[kg]"}),
      rho0_(fluid.config().tait.rho0), writes_(fluid.ranks().rank() == 0)
{
  for (const ProbeConfig& probe : probes)
    if (probe.on == "fluid")
      probes_.push_back(make_probe(probe, fluid));
}

namespace
{

/// @throws InputError for a quantity of the probe that is none of `fields`
void allow(const ProbeConfig& probe, std::initializer_list<const char*> fields)
{
  for (const auto& field : probe.fields)
    if (std::find(fields.begin(), fields.end(), field) == fields.end())
      throw InputError(fmt::format("probe '{}': quantity '{}' is not measured there; possible: {}",
                                   probe.name, field,
                                   fmt::join(std::vector<std::string>(fields.begin(), fields.end()), ", ")));
}

/// Of `list`, whose entries have names, the one called `name`.
template <class List>
std::ptrdiff_t index_of(const ProbeConfig& probe, const List& list, const std::string& name, const char* what,
                        const char* there)
{
  std::vector<std::string> known;
  for (const auto& item : list)
    known.push_back(item.name);
  const auto it = std::find(known.begin(), known.end(), name);
  if (it == known.end())
    throw InputError(fmt::format("probe '{}': the fluid has no {} '{}'. {}: {}", probe.name, what, name,
                                 there, fmt::join(known, " ")));
  return it - known.begin();
}

template <int dim>
struct Place
{
  double distance;
  global_index_t id;
  Vec<dim> x;
};

/// The node of all ranks nearest to the point, the first of those that are as near. Collective.
template <int dim>
Place<dim> nearest_to(const Vec<dim>& point, const Fluid<dim>& fluid)
{
  std::vector<Place<dim>> nearest;
  const auto& nodes = fluid.nodes();
  const auto [begin, end] = fluid.node_range();
  for (auto n = static_cast<std::size_t>(begin); n < static_cast<std::size_t>(end); ++n)
    if (const double d = norm(nodes.x[n] - point); nearest.empty() || d < nearest.front().distance)
      nearest = {{d, nodes.id[n], nodes.x[n]}};
  nearest = fluid.ranks().gather(nearest);
  return *std::min_element(nearest.begin(), nearest.end(),
                           [](const auto& a, const auto& b) { return a.distance < b.distance; });
}

} // namespace

template <int dim>
typename FluidOutput<dim>::Probe FluidOutput<dim>::make_probe(const ProbeConfig& probe,
                                                              const Fluid<dim>& fluid) const
{
  const auto& nodes = fluid.nodes();
  Probe result{.config = probe};
  std::vector<std::string> columns;
  std::string definition;
  if (!probe.wall.empty())
  {
    allow(probe, {"F"});
    result.wall =
        index_of(probe, fluid.walls().geometry(), probe.wall, "wall", "Walls that can be met and left");
    definition =
        "force of the fluid on the wall: contact impulse since the last row over the time since then";
    for (int i = 0; i < dim; ++i)
      columns.push_back(fmt::format("F_{}[N]", "xyz"[i]));
  }
  else if (probe.fields == std::vector<std::string>{"front"})
  {
    definition = "largest x of the nodes that belong to elements";
    columns = {"x[m]"};
  }
  else if (probe.fields == std::vector<std::string>{"hydrostatic_error"})
  {
    definition = "relative L2 error of the nodal pressure against barotropic rest under the highest point at "
                 "the start";
    columns = {"error[]"};
    result.highest = highest_potential(fluid);
  }
  else if (probe.fields == std::vector<std::string>{"angular_momentum"})
  {
    definition = "angular momentum about the point, sum of particle mass times (x - point) cross v, about z";
    columns = {"L[N m s]"};
  }
  else if (probe.fields == std::vector<std::string>{"elevation"})
  {
    definition = "highest point of the fluid's boundary above x = point[0]";
    columns = {"y[m]"};
  }
  else
  {
    allow(probe, {"x", "v", "p"});
    for (const auto& field : probe.fields)
      for (auto& column : columns_of<dim>(field))
        columns.push_back(std::move(column));
    if (!probe.surface.empty())
    {
      const auto surface = index_of(probe, fluid.surfaces(), probe.surface, "surface", "Surfaces there");
      for (std::size_t n = 0; n < nodes.x.size(); ++n)
        if (nodes.surface[n] >> surface & 1)
          result.id.push_back(nodes.id[n]);
      definition = fmt::format("mean over the {} nodes of surface '{}'", result.id.size(), probe.surface);
    }
    else if (probe.radius > 0.0)
      definition = fmt::format(
          "fixed gauge: mean over the nodes within {:.6g} m of the point, 0 when dry, and over the "
          "time since the last row{}",
          probe.radius,
          config_.history_interval > 0.0
              ? fmt::format(" ({:.6g} s, {} samples)", config_.history_interval, samples_per_row)
              : " (one step)");
    else
    {
      const auto place = nearest_to(as_point<dim>(probe.point), fluid);
      result.id.push_back(place.id);
      definition =
          fmt::format("fluid node {} that started at ({:.6g}) m", place.id, fmt::join(place.x.c, ", "));
    }
  }
  if (!probe.point.empty())
    definition += fmt::format("; point ({:.6g}) m", fmt::join(probe.point, ", "));
  std::sort(result.id.begin(), result.id.end());
  result.history = std::make_unique<History>(config_.dir, probe.name, definition, columns);
  return result;
}

template <int dim>
void FluidOutput<dim>::observe(double t, Fluid<dim>& fluid, bool frame)
{
  const bool by_interval = config_.history_interval > 0.0, sample = by_interval && t >= next_sample_,
             row = frame || !by_interval || t >= next_row_;
  while (by_interval && next_sample_ <= t)
    next_sample_ += config_.history_interval / samples_per_row;
  while (by_interval && next_row_ <= t)
    next_row_ += config_.history_interval;
  const bool writes_frame = frame && config_.frames;
  if ((writes_frame && fluid.nodes().period.any()) || (row && needs_all_rows()))
    fluid.collect();
  if (writes_frame)
    write_frame(t, fluid);
  if (sample)
    sample_gauges(t, fluid);
  if (row)
    write_rows(t, fluid);
}

template <int dim>
bool FluidOutput<dim>::has_gauges() const
{
  return std::any_of(probes_.begin(), probes_.end(), [](const Probe& p) { return p.is_gauge(); });
}

/// A sum over all nodes, in their order.
template <int dim>
bool FluidOutput<dim>::needs_all_rows() const
{
  return std::any_of(probes_.begin(), probes_.end(),
                     [](const Probe& p) {
                       return p.config.fields.front() == "angular_momentum" ||
                              p.config.fields.front() == "hydrostatic_error";
                     });
}

template <int dim>
double FluidOutput<dim>::next() const
{
  if (config_.history_interval <= 0.0)
    return std::numeric_limits<double>::lowest();
  return has_gauges() ? std::min(next_row_, next_sample_) : next_row_;
}

template <int dim>
void FluidOutput<dim>::for_each_state(StateArchive& archive)
{
  archive("next_row", next_row_);
  archive("next_sample", next_sample_);
  if (!writes_)
    return;
  archive("frames", frames_);
  archive("probes", probes_);
  archive("energy", energy_);
  archive("mass", mass_);
}

template <int dim>
void FluidOutput<dim>::sample_gauges(double t, const Fluid<dim>& fluid)
{
  for (Probe& probe : probes_)
  {
    if (!probe.is_gauge())
      continue;
    const std::vector<double> row = measure(probe, t, fluid);
    probe.sum.resize(row.size(), 0.0);
    for (std::size_t k = 0; k < row.size(); ++k)
      probe.sum[k] += row[k];
    ++probe.samples;
  }
}

template <int dim>
void FluidOutput<dim>::write_frame(double t, const Fluid<dim>& fluid)
{
  const auto& nodes = fluid.nodes();
  constexpr ElementType type = dim == 2 ? ElementType::triangle3 : ElementType::tetrahedron4;
  const auto write = [&](const FrameMesh& mesh, std::span<const double> v, std::span<const double> p,
                         std::span<const double> rho)
  {
    frames_.write(t, mesh,
                  {{.name = "velocity", .unit = "m/s", .components = dim, .values = v},
                   {.name = "pressure", .unit = "Pa", .components = 1, .values = p},
                   {.name = "density", .unit = "kg/m^3", .components = 1, .values = rho}});
  };
  std::vector<index_t> connectivity;
  const auto connect = [&](index_t begin, index_t end)
  {
    for (index_t e = begin; e < end; ++e)
    {
      const auto& corners = fluid.mesh().elements[static_cast<std::size_t>(e)];
      connectivity.insert(connectivity.end(), corners.begin(), corners.end());
    }
  };
  FrameMesh mesh{.dim = dim, .x = {}, .blocks = {}};
  if (!nodes.period.any())
  {
    const auto [begin, end] = fluid.node_range();
    const auto [first, last] = fluid.element_range();
    connect(first, last);
    const auto own = [begin = static_cast<std::size_t>(begin), n = static_cast<std::size_t>(end - begin)](
                         const auto& field) { return std::span(field).subspan(begin, n); };
    mesh.x = flat<dim>(own(nodes.x));
    mesh.blocks.emplace_back(type, connectivity);
    mesh.nodes = {.total = static_cast<std::size_t>(nodes.size()), .first = static_cast<std::size_t>(begin)};
    mesh.blocks_are = {.total = fluid.mesh().elements.size(), .first = static_cast<std::size_t>(first)};
    return write(mesh, flat<dim>(own(nodes.v)), own(nodes.p), own(nodes.rho));
  }

  // An element that reaches across the end of the cell is drawn at its first corner, with images of others;
  // rank 0, which has all rows, draws them.
  std::vector<Vec<dim>> x, v;
  std::vector<double> p, rho;
  if (writes_)
  {
    x = nodes.x, v = nodes.v, p = nodes.p, rho = nodes.rho;
    connect(0, static_cast<index_t>(fluid.mesh().elements.size()));
    std::map<std::pair<index_t, std::array<double, dim>>, index_t> images;
    for (std::size_t k = 0; k < connectivity.size(); ++k)
    {
      index_t& n = connectivity[k];
      const Vec<dim>& own = x[static_cast<std::size_t>(n)];
      const Vec<dim> image =
          nodes.period.near(x[static_cast<std::size_t>(connectivity[k - k % (dim + 1)])], own);
      if (image == own)
        continue;
      const auto [it, is_new] = images.try_emplace({n, image.c}, static_cast<index_t>(x.size()));
      if (is_new)
      {
        const auto i = static_cast<std::size_t>(n);
        x.push_back(image);
        v.push_back(nodes.v[i]);
        p.push_back(nodes.p[i]);
        rho.push_back(nodes.rho[i]);
      }
      n = it->second;
    }
  }
  mesh.x = flat<dim>(x);
  mesh.blocks.emplace_back(type, connectivity);
  write(mesh, flat<dim>(v), p, rho);
}

template <int dim>
void FluidOutput<dim>::write_rows(double t, const Fluid<dim>& fluid)
{
  const auto write = [&](History& history, const std::vector<double>& row)
  {
    if (writes_)
      history.write(t, row);
  };
  const FluidEnergy e = fluid.energy();
  write(energy_, {e.kinetic, e.internal, e.potential, e.dissipated, e.exchanged, e.remesh_gain, e.remesh_loss,
                  e.wall_work, e.interface_work, e.openings});
  const FluidMass m = fluid.mass_by_state();
  const RemeshLedger& r = fluid.ledger();
  write(mass_, {m.meshed, m.flying, m.deleted, m.dynamic, m.volume,
                m.meshed > 0.0 ? rho0_ * m.volume / m.meshed - 1.0 : 0.0, r.created, r.dropped,
                static_cast<double>(fluid.nodes().size()), static_cast<double>(r.merged),
                static_cast<double>(r.split), static_cast<double>(r.remeshes), m.inflow, m.outflow});
  for (Probe& probe : probes_)
  {
    std::vector<double> row = measure(probe, t, fluid);
    for (std::size_t k = 0; k < row.size() && probe.samples > 0; ++k)
      row[k] = probe.sum[k] / probe.samples;
    probe.sum.clear();
    probe.samples = 0;
    write(*probe.history, row);
  }
}

template <int dim>
std::vector<double> FluidOutput<dim>::measure(Probe& probe, double t, const Fluid<dim>& fluid) const
{
  const auto& nodes = fluid.nodes();
  if (probe.wall >= 0)
  {
    const Vec<dim> impulse = fluid.walls().impulse(fluid.ranks())[static_cast<std::size_t>(probe.wall)],
                   since = impulse - probe.last_impulse;
    std::vector<double> force(dim, 0.0);
    for (int i = 0; i < dim && t > probe.last_t; ++i)
      force[static_cast<std::size_t>(i)] = since[i] / (t - probe.last_t);
    probe.last_impulse = impulse;
    probe.last_t = t;
    return force;
  }
  if (probe.config.fields.front() == "front")
    return {largest(
        fluid, [&nodes](std::size_t n)
        { return nodes.flag[n] & isolated_node ? std::numeric_limits<double>::lowest() : nodes.x[n][0]; })};
  if (probe.config.fields.front() == "angular_momentum")
  {
    double L = 0.0;
    const Vec<dim> centre = as_point<dim>(probe.config.point);
    for (std::size_t n = 0; n < nodes.x.size(); ++n)
    {
      const Vec<dim> r = nodes.x[n] - centre;
      L += nodes.M[n] * (r[0] * nodes.v[n][1] - r[1] * nodes.v[n][0]);
    }
    return {L};
  }
  if (probe.config.fields.front() == "hydrostatic_error")
    return {hydrostatic_error(fluid, probe.highest)};
  if (probe.config.fields.front() == "elevation")
    return {elevation(fluid, probe.config.point)};

  const auto chosen = [&](std::size_t n)
  {
    if (probe.config.radius > 0.0)
      return !(nodes.flag[n] & isolated_node) &&
             norm(nodes.period.near(as_point<dim>(probe.config.point), nodes.x[n]) -
                  as_point<dim>(probe.config.point)) <= probe.config.radius;
    return std::binary_search(probe.id.begin(), probe.id.end(), nodes.id[n]);
  };
  struct Sample
  {
    Vec<dim> x, v;
    double p;
  };
  std::vector<Sample> samples;
  const auto [begin, end] = fluid.node_range();
  for (auto n = static_cast<std::size_t>(begin); n < static_cast<std::size_t>(end); ++n)
    if (chosen(n))
      samples.push_back({nodes.x[n], nodes.v[n], nodes.p[n]});
  samples = fluid.ranks().gather(samples); // in the order of the nodes
  std::vector<double> row;
  for (const auto& field : probe.config.fields)
    for (int i = 0; i < (field == "p" ? 1 : dim); ++i)
    {
      double sum = 0.0;
      for (const Sample& s : samples)
        sum += field == "p" ? s.p : field == "x" ? s.x[i] : s.v[i];
      row.push_back(samples.empty() ? 0.0 : sum / static_cast<double>(samples.size()));
    }
  return row;
}

template class FluidOutput<2>;
template class FluidOutput<3>;

} // namespace undine::fluid
