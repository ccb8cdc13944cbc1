// Fields and histories of the solid.
#include "solid_fe/solid_output.hpp"

#include <limits>

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

template <int dim>
std::vector<std::string> motion_columns()
{
  std::vector<std::string> columns;
  for (const char* quantity : {"u_", "v_"})
    for (int i = 0; i < dim; ++i)
      columns.push_back(quantity + std::string(1, "xyz"[i]) + (quantity[0] == 'u' ? "[m]" : "[m/s]"));
  return columns;
}

} // namespace

template <int dim>
CellStress cell_stress(const Solid<dim>& solid)
{
  CellStress stress;
  for (const auto& body : solid.bodies())
    visit_body(body,
               [&]<class Element, class Law>(const ReferenceBlock<Element>& block, const Law& law)
               {
                 const auto* grad_N = block.grad_N.data();
                 for (const auto& nodes : block.nodes)
                 {
                   const auto u = gather<Element>(nodes, std::span<const Vec<dim>>(solid.nodes().u));
                   Mat<3> sigma;
                   for (int q = 0; q < Element::points; ++q, grad_N += Element::nodes)
                     sigma += (1.0 / Element::points) *
                              cauchy_stress(law, displacement_gradient<Element>(u, grad_N));
                   stress.sigma.insert(stress.sigma.end(), sigma.c.begin(), sigma.c.end());
                   stress.von_mises.push_back(von_mises(sigma));
                 }
               });
  return stress;
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

template <int dim>
SolidOutput<dim>::SolidOutput(const std::string& out_dir, const std::vector<ProbeConfig>& probes,
                              const Solid<dim>& solid)
    : frames_(out_dir, "solid"),
      energy_(out_dir, "solid_energy",
              dim == 2 ? "energies and cumulated works of the solid, per metre of thickness; the balance "
                         "kinetic + strain - "
                         "external - interface stays at its start up to O(dt^2)"
                       : "energies and cumulated works of the solid; the balance kinetic + strain - external "
                         "- interface "
                         "stays at its start up to O(dt^2)",
              {"kinetic[J]", "strain[J]", "external_work[J]", "interface_work[J]", "balance[J]"})
{
  for (const auto& probe : probes)
  {
    const auto node =
        static_cast<std::size_t>(nearest_node(solid, to_vec<dim>(probe.point, "probe." + probe.name)));
    const auto& X = solid.nodes().X[node];
    std::string definition =
        probe.definition.empty() ? "motion of a material point of the solid" : probe.definition;
    definition += "; node " + std::to_string(solid.given_number()[node]) + " at (";
    for (int i = 0; i < dim; ++i)
      definition += (i > 0 ? ", " : "") + std::to_string(X[i]);
    definition += ") m in the reference state";
    probes_.push_back({node, History(out_dir, probe.name, definition, motion_columns<dim>())});
  }
}

template <int dim>
void SolidOutput<dim>::write_frame(const Solid<dim>& solid)
{
  const auto& nodes = solid.nodes();
  const auto u = flat(nodes.u), v = flat(nodes.v);
  auto x = flat(nodes.X);
  for (std::size_t k = 0; k < x.size(); ++k)
    x[k] += u[k];
  const auto stress = cell_stress(solid);

  std::vector<std::vector<index_t>> connectivity;
  FrameMesh mesh;
  mesh.dim = dim;
  mesh.x = x;
  connectivity.reserve(solid.bodies().size());
  for (const auto& body : solid.bodies())
    std::visit(
        [&]<class Element>(const ReferenceBlock<Element>& block)
        {
          auto& list = connectivity.emplace_back();
          for (const auto& element : block.nodes)
            list.insert(list.end(), element.begin(), element.end());
          mesh.blocks.emplace_back(Element::type, std::span<const index_t>(list));
        },
        body.block);
  frames_.write(
      solid.time(), mesh,
      {{.name = "displacement", .unit = "m", .components = dim, .values = u, .on_cells = false},
       {.name = "velocity", .unit = "m/s", .components = dim, .values = v, .on_cells = false},
       {.name = "sigma", .unit = "Pa", .components = 9, .values = stress.sigma, .on_cells = true},
       {.name = "von_mises", .unit = "Pa", .components = 1, .values = stress.von_mises, .on_cells = true}});
}

template <int dim>
void SolidOutput<dim>::write_history(const Solid<dim>& solid)
{
  for (auto& probe : probes_)
  {
    std::vector<double> row;
    for (const auto& x : {solid.nodes().u[probe.node], solid.nodes().v[probe.node]})
      row.insert(row.end(), x.c.begin(), x.c.end());
    probe.history.write(solid.time(), row);
  }
  const auto e = solid.energies();
  energy_.write(solid.time(), {e.kinetic, e.strain, e.external, e.interface, e.balance()});
}

template CellStress cell_stress(const Solid<2>&);
template CellStress cell_stress(const Solid<3>&);
template index_t nearest_node(const Solid<2>&, const Vec<2>&);
template index_t nearest_node(const Solid<3>&, const Vec<3>&);
template class SolidOutput<2>;
template class SolidOutput<3>;

} // namespace undine::solid
