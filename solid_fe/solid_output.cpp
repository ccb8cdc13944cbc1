// Fields and histories of the solid.
#include "solid_fe/solid_output.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <cstdio>
#include <limits>
#include <map>

namespace undine::solid
{

namespace
{

template <int dim>
std::vector<double> flat(const std::vector<Vec<dim>>& field)
{
  std::vector<double> values;
  values.reserve(field.size() * dim);
  for (const auto& x : field)
    values.insert(values.end(), x.c.begin(), x.c.end());
  return values;
}

/// A quantity with its unit.
struct Quantity
{
  const char* name;
  const char* unit;
  enum Kind
  {
    vector, ///< at nodes
    section,
    stress ///< a number of an element
  } kind;
};
constexpr Quantity quantities[] = {
    {"u", "[m]", Quantity::vector},          {"v", "[m/s]", Quantity::vector},
    {"a", "[m/s2]", Quantity::vector},       {"F", "[N]", Quantity::vector},
    {"S", "[N]", Quantity::section},         {"p", "[Pa]", Quantity::stress},
    {"von_mises", "[Pa]", Quantity::stress}, {"plastic_strain", "[1]", Quantity::stress}};

template <int dim>
std::vector<std::string> columns_of(const ProbeConfig& probe)
{
  std::vector<std::string> columns;
  for (const auto& name : probe.fields)
  {
    const auto* known = std::find_if(std::begin(quantities), std::end(quantities),
                                     [&name](const Quantity& quantity) { return name == quantity.name; });
    if (known == std::end(quantities))
      throw InputError("probe \"" + probe.name + "\": quantity \"" + name +
                       "\": the solid measures u, v, a, F, S, p, von_mises, plastic_strain");
    if (known->kind != Quantity::vector && !probe.at_point())
      throw InputError("probe \"" + probe.name + "\": quantity \"" + name + "\" needs a point");
    if (known->kind == Quantity::section && probe.normal.size() != dim)
      throw InputError("probe \"" + probe.name +
                       "\": quantity \"S\" needs a normal: the direction across the cut");
    if (known->kind == Quantity::stress)
    {
      columns.push_back(name + known->unit);
      continue;
    }
    for (int i = 0; i < dim; ++i)
      columns.push_back(name + "_" + std::string(1, "xyz"[i]) + known->unit);
    for (int i = dim == 2 ? 2 : 0; known->kind == Quantity::section && i < 3; ++i)
      columns.push_back("M_" + std::string(1, "xyz"[i]) + "[N m]");
  }
  return columns;
}

/// Middles of the elements in the reference state, in the order of cell_stress.
template <int dim>
std::vector<Vec<dim>> element_middles(const Solid<dim>& solid)
{
  std::vector<Vec<dim>> middles;
  const auto add = [&](const index_t* nodes, std::size_t count)
  {
    auto& middle = middles.emplace_back();
    for (std::size_t a = 0; a < count; ++a)
      middle += (1.0 / static_cast<double>(count)) * solid.nodes().X[static_cast<std::size_t>(nodes[a])];
  };
  if (solid.beam() != nullptr)
    for (const auto& block : solid.mesh().blocks)
      for (index_t e = 0; e < block.size(); ++e)
        add(&block.nodes[static_cast<std::size_t>(4 * e)], 4);
  for (std::size_t k = 0; k < solid.bodies().size(); ++k)
    std::visit(
        [&](const auto& block)
        {
          for (const auto& element : block.nodes)
            add(element.data(), element.size());
        },
        solid.whole_block(k));
  return middles;
}

template <int dim>
const std::vector<Vec<dim>>& field_of(const SolidNodes<dim>& nodes, const std::string& name)
{
  return name == "u" ? nodes.u : name == "v" ? nodes.v : nodes.a;
}

/// "(0.1, 0.2)".
template <int dim>
std::string text_of(const Vec<dim>& x)
{
  std::string text = "(";
  char number[32];
  for (int i = 0; i < dim; ++i)
  {
    std::snprintf(number, sizeof number, "%s%.9g", i > 0 ? ", " : "", x[i]);
    text += number;
  }
  return text + ")";
}

/// Where a probe measures: nodes with weights that sum to 1 (to 0 if it is relative to a point), and words
/// for the head of its file.
struct ProbePlace
{
  std::vector<index_t> nodes;
  std::vector<double> weight;
  std::string definition;
};

template <int dim>
ProbePlace place_of(const ProbeConfig& probe, const Solid<dim>& solid)
{
  const std::string key = "probe \"" + probe.name + "\"";
  std::map<index_t, double> weight;
  std::string definition;
  if (probe.at_point())
  {
    const index_t node = nearest_node(solid, to_vec<dim>(probe.point, key + ": point"));
    weight[node] = 1.0;
    definition = "material point of the solid: node " +
                 std::to_string(solid.given_number()[static_cast<std::size_t>(node)]) + " at " +
                 text_of(solid.nodes().X[static_cast<std::size_t>(node)]) +
                 " m in the reference state, nearest to " + text_of(to_vec<dim>(probe.point, key)) + " m";
    if (!probe.relative_to.empty())
    {
      const index_t other = nearest_node(solid, to_vec<dim>(probe.relative_to, key + ": relative_to"));
      weight[other] -= 1.0;
      definition += "; u, v and a relative to node " +
                    std::to_string(solid.given_number()[static_cast<std::size_t>(other)]) + " at " +
                    text_of(solid.nodes().X[static_cast<std::size_t>(other)]) + " m";
    }
  }
  else
  {
    const auto& surface = find_surface(solid.mesh(), probe.surface, key + ": surface");
    double area = 0.0;
    for (index_t f = 0; f < surface.size(); ++f)
    {
      const auto begin = static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f)]);
      const auto end = static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f) + 1]);
      const std::span<const index_t> facet(surface.nodes.data() + begin, end - begin);
      const auto weights = facet_weights(solid.mesh(), facet);
      for (std::size_t a = 0; a < facet.size(); ++a)
      {
        weight[facet[a]] += weights[a];
        area += weights[a];
      }
    }
    for (auto& [node, w] : weight)
      w /= area;
    definition = "surface \"" + probe.surface + "\" of the solid: u, v, a are means over its reference area";
  }
  if (std::find(probe.fields.begin(), probe.fields.end(), "F") != probe.fields.end())
    definition +=
        std::string("; F is the force of the supports on it") + (dim == 2 ? ", per metre of thickness" : "");

  ProbePlace place{.nodes = {}, .weight = {}, .definition = std::move(definition)};
  for (const auto& [node, w] : weight)
  {
    place.nodes.push_back(node);
    place.weight.push_back(w);
  }
  return place;
}

/// Stress of all elements (collective), or, with `places`, of those that this rank counts, whose places among
/// all it appends.
template <int dim>
CellStress stress_of(const Solid<dim>& solid, std::vector<index_t>* places)
{
  CellStress stress;
  index_t before = 0; // elements of the beam and of earlier bodies
  const auto append = [&stress](const Mat<3>& sigma, double plastic_strain)
  {
    stress.sigma.insert(stress.sigma.end(), sigma.c.begin(), sigma.c.end());
    stress.von_mises.push_back(von_mises(sigma));
    stress.plastic_strain.push_back(plastic_strain);
  };
  if constexpr (dim == 2)
    if (const Beam* beam = solid.beam())
    {
      const bool here = places == nullptr || solid.share().is_first(); // whose the beam is
      for (std::size_t e = 0; here && e < beam->n_elements(); ++e)
      {
        const auto s = beam->section(e);
        Mat<3> mean;
        for (int i = 0; i < 2; ++i)
          for (int j = 0; j < 2; ++j)
            mean(i, j) = (s.N * s.t[i] * s.t[j] + s.Q * (s.t[i] * s.n[j] + s.n[i] * s.t[j])) / s.thickness;
        append(mean, 0.0);
        if (places != nullptr)
          places->push_back(static_cast<index_t>(e));
      }
      before += static_cast<index_t>(beam->n_elements());
    }
  for (std::size_t k = 0; k < solid.bodies().size(); ++k)
  {
    std::vector<Mat<3>> sigma;
    std::vector<double> plastic_strain;
    append_stress(solid.bodies()[k], std::span<const Vec<dim>>(solid.nodes().u), sigma, plastic_strain);
    if (places == nullptr)
    {
      sigma = solid.of_all_elements(k, std::move(sigma));
      plastic_strain = solid.of_all_elements(k, std::move(plastic_strain));
    }
    const auto counted = places != nullptr ? solid.counted_elements(k) : std::vector<index_t>{};
    for (std::size_t e = 0; e < sigma.size(); ++e)
    {
      if (places != nullptr && counted[e] < 0)
        continue;
      append(sigma[e], plastic_strain[e]);
      if (places != nullptr)
        places->push_back(before + counted[e]);
    }
    before += std::visit([](const auto& block) { return block.size(); }, solid.whole_block(k));
  }
  return stress;
}

} // namespace

template <int dim>
CellStress cell_stress(const Solid<dim>& solid)
{
  return stress_of(solid, nullptr);
}

template <int dim>
index_t nearest_node(const Solid<dim>& solid, const Vec<dim>& point)
{
  index_t nearest = 0;
  double shortest = std::numeric_limits<double>::infinity();
  for (index_t n = 0; n < solid.nodes().size(); ++n)
  {
    const double distance = norm(solid.nodes().X[static_cast<std::size_t>(n)] - point);
    if (distance < shortest)
    {
      shortest = distance;
      nearest = n;
    }
  }
  return nearest;
}

std::vector<std::string> probe_quantities()
{
  std::vector<std::string> names;
  for (const auto& quantity : quantities)
    names.emplace_back(quantity.name);
  return names;
}

template <int dim>
void check_probes(const std::vector<ProbeConfig>& probes, const Solid<dim>& solid)
{
  for (const auto& probe : probes)
    if (probe.on == "solid")
    {
      place_of(probe, solid);
      columns_of<dim>(probe);
    }
}

template <int dim>
SolidOutput<dim>::SolidOutput(const OutputConfig& config, const std::vector<ProbeConfig>& probes,
                              const Solid<dim>& solid)
    : energy_(
          config.dir, config.part + "_energy",
          std::string("energies and cumulated works of the solid") +
              (dim == 2 ? " per metre of thickness" : "") +
              "; balance = kinetic + strain + hourglass + plastic + viscous + contact - external - interface "
              "stays at its start up to O(dt^2)",
          {"kinetic[J]", "strain[J]", "external_work[J]", "interface_work[J]", "balance[J]", "hourglass[J]",
           "plastic_work[J]", "viscous_work[J]", "contact[J]"}),
      writes_(solid.ranks().rank() == 0)
{
  if (config.frames)
    frames_.emplace(config.dir, config.part, solid.ranks());
  for (const auto& probe : probes)
    if (probe.on == "solid")
    {
      auto place = place_of(probe, solid);
      auto& made = probes_.emplace_back(
          Probe{std::move(place.nodes), std::move(place.weight), probe.fields,
                History(config.dir, probe.name, place.definition, columns_of<dim>(probe))});
      made.point = to_vec<dim>(probe.point, "probe: point");
      made.normal = to_vec<dim>(probe.normal, "probe: normal");
      const auto middles = element_middles(solid);
      for (std::size_t e = 0; e < middles.size(); ++e)
        if (norm_squared(middles[e] - made.point) < norm_squared(middles[made.element] - made.point))
          made.element = e;
    }
}

template <int dim>
void SolidOutput<dim>::write_frame(const Solid<dim>& solid)
{
  if (!frames_)
    return;
  const auto& nodes = solid.nodes();
  FrameMesh mesh;
  std::vector<index_t> own, cells; // places of this rank's rows among all
  std::vector<Vec<dim>> x, u, v;
  solid.share().for_own(
      [&](std::size_t n)
      {
        own.push_back(static_cast<index_t>(n));
        x.push_back(nodes.X[n] + nodes.u[n]);
        u.push_back(nodes.u[n]);
        v.push_back(nodes.v[n]);
      });
  const CellStress stress = stress_of(solid, &cells);
  mesh.dim = dim;
  const auto points = flat(x), displacement = flat(u), velocity = flat(v);
  mesh.x = points;
  mesh.nodes = {.total = static_cast<std::size_t>(nodes.size()), .places = own};
  mesh.cells = {.total = static_cast<std::size_t>(solid.n_elements()), .places = cells};

  std::vector<std::vector<index_t>> connectivity; // which every rank knows: rank 0 gives it
  connectivity.reserve(solid.bodies().size());
  for (std::size_t k = 0; writes_ && k < solid.bodies().size(); ++k)
    std::visit(
        [&]<class Element>(const ReferenceBlock<Element>& block)
        {
          auto& list = connectivity.emplace_back();
          for (const auto& element : block.nodes)
            list.insert(list.end(), element.begin(), element.end());
          mesh.blocks.emplace_back(Element::type, std::span<const index_t>(list));
        },
        solid.whole_block(k));
  if (writes_ && solid.beam() != nullptr)
    for (const auto& block : solid.mesh().blocks)
      mesh.blocks.emplace_back(block.type, std::span<const index_t>(block.nodes));
  frames_->write(
      solid.time(), mesh,
      {{.name = "displacement", .unit = "m", .components = dim, .values = displacement, .on_cells = false},
       {.name = "velocity", .unit = "m/s", .components = dim, .values = velocity, .on_cells = false},
       {.name = "sigma", .unit = "Pa", .components = 9, .values = stress.sigma, .on_cells = true},
       {.name = "von_mises", .unit = "Pa", .components = 1, .values = stress.von_mises, .on_cells = true},
       {.name = "plastic_strain",
        .unit = "",
        .components = 1,
        .values = stress.plastic_strain,
        .on_cells = true}});
}

template <int dim>
void SolidOutput<dim>::for_each_state(StateArchive& archive)
{
  if (!writes_)
    return;
  archive("frames", frames_);
  for (std::size_t k = 0; k < probes_.size(); ++k)
    archive("probe_" + std::to_string(k), probes_[k].history);
  archive("energy", energy_);
}

template <int dim>
void SolidOutput<dim>::write_history(const Solid<dim>& solid, const Energies& e)
{
  std::optional<CellStress> stress; // of this instant, once a probe asks for it
  for (auto& probe : probes_)
  {
    std::vector<double> row;
    for (const auto& name : probe.quantities)
    {
      if (name == "S")
      {
        const auto [force, moment] = solid.section_force(probe.point, probe.normal);
        row.insert(row.end(), force.c.begin(), force.c.end());
        row.insert(row.end(), moment.c.begin() + (dim == 2 ? 2 : 0), moment.c.end());
        continue;
      }
      if (name == "p" || name == "von_mises" || name == "plastic_strain")
      {
        if (!stress)
          stress = cell_stress(solid);
        const auto* sigma = &stress->sigma[9 * probe.element];
        row.push_back(name == "p"           ? -(sigma[0] + sigma[4] + sigma[8]) / 3.0
                      : name == "von_mises" ? stress->von_mises[probe.element]
                                            : stress->plastic_strain[probe.element]);
        continue;
      }
      Vec<dim> value;
      if (name == "F")
        value = solid.reaction(probe.nodes);
      else
      {
        const auto& field = field_of(solid.nodes(), name);
        const auto values = solid.at(probe.nodes, [&](std::size_t n) { return field[n]; });
        for (std::size_t k = 0; k < values.size(); ++k)
          value += probe.weight[k] * values[k];
      }
      row.insert(row.end(), value.c.begin(), value.c.end());
    }
    if (writes_)
      probe.history.write(solid.time(), row);
  }
  if (writes_)
    energy_.write(solid.time(), {e.kinetic, e.strain, e.external, e.interface, e.balance(), e.hourglass,
                                 e.plastic, e.viscous, e.contact});
}

template CellStress cell_stress(const Solid<2>&);
template CellStress cell_stress(const Solid<3>&);
template index_t nearest_node(const Solid<2>&, const Vec<2>&);
template index_t nearest_node(const Solid<3>&, const Vec<3>&);
template void check_probes(const std::vector<ProbeConfig>&, const Solid<2>&);
template void check_probes(const std::vector<ProbeConfig>&, const Solid<3>&);
template class SolidOutput<2>;
template class SolidOutput<3>;

} // namespace undine::solid
