// Words for the resolved configuration.
#include "solid_fe/describe.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace undine::solid
{

template <int dim>
std::string describe(const SolidConfig& config, const Solid<dim>& solid, double t_end)
{
  const auto& material = config.material;
  const double modulus =
      std::visit([](const auto& law) { return law.wave_modulus(Mat<dim>{}); }, make_material(material));
  const double dt = solid.critical_time_step();
  std::string text =
      fmt::format("solid in {}-D{}\n", dim,
                  dim == 3                                  ? ""
                  : config.plane == PlaneKind::axisymmetric ? ", axisymmetric about x = 0, the whole ring"
                  : config.plane == PlaneKind::stress       ? ", plane stress, per metre of thickness"
                                                            : ", plane strain, per metre of thickness");
  text += fmt::format("  material   {}: density {} kg/m3, E {} Pa, nu {}; fastest wave {:.6g} m/s\n",
                      material.law, material.density, material.youngs_modulus, material.poisson_ratio,
                      std::sqrt(modulus / material.density));
  for (const auto& body : solid.bodies())
    std::visit(
        [&]<class Element>(const ReferenceBlock<Element>& block)
        {
          text +=
              fmt::format("  elements   {} {}{}, {} of them touch wet nodes\n", block.size(), Element::name,
                          block.body.empty() ? "" : " of \"" + block.body + "\"", block.n_interface);
          if (block.n_active < block.size())
            text += fmt::format("  idle       {} of them: rigid or prescribed as a whole\n",
                                block.size() - block.n_active);
        },
        body.block);
  if (const Beam* beam = solid.beam())
    text += fmt::format(
        "  elements   {} beams, {} fibres; {:.3g} % of the rotary inertia is added for the step\n",
        beam->n_elements(), beam->n_nodes(), 100.0 * beam->added_inertia());
  text += fmt::format("  nodes      {}, {} of them wet\n", solid.nodes().size(), solid.n_wet_nodes());
  text += fmt::format("  mass       {:.9g} kg\n", solid.mass());
  for (std::size_t k = 0; k < solid.added_mass().size(); ++k)
    std::visit(
        [&](const auto& block)
        {
          const double added = solid.added_mass()[k], own = solid.bodies()[k].density * block.volume();
          text += fmt::format(
              "  added mass {:.6g} kg, {:.3g} % of {}, for a step of {} s\n", added, 100.0 * added / own,
              block.body.empty() ? "the solid" : "\"" + block.body + "\"", config.scaled_step);
        },
        solid.bodies()[k].block);
  Vec<dim> low = solid.nodes().X.front(), high = low;
  for (const auto& X : solid.nodes().X)
    for (int i = 0; i < dim; ++i)
    {
      low[i] = std::min(low[i], X[i]);
      high[i] = std::max(high[i], X[i]);
    }
  text +=
      fmt::format("  box        ({:.6g}) to ({:.6g}) m\n", fmt::join(low.c, ", "), fmt::join(high.c, ", "));
  for (const auto& [name, surface] : solid.mesh().surfaces)
    text += fmt::format("  surface    {}: {} facets\n", name, surface.size());
  for (const auto& wet : config.wet)
    text += fmt::format("  interface  {} on surface {}\n", wet.interface, wet.surface);
  for (const auto& fix : config.fix)
    text += fmt::format("  fix        {}: {}\n", fix.on, fmt::join(fix.components, ", "));
  for (const auto& velocity : config.velocity)
    text += fmt::format("  velocity   {}: ({}) m/s in {}\n", velocity.on, fmt::join(velocity.value, ", "),
                        fmt::join(velocity.components, ", "));
  for (const auto& traction : config.traction)
    text += fmt::format("  traction   {}: ({}) Pa, ramp {} s\n", traction.on, fmt::join(traction.value, ", "),
                        traction.ramp);
  text += fmt::format("  gravity    ({}) m/s2\n", fmt::join(config.gravity, ", "));
  text += fmt::format("  step       {:.6g} s = {} x the bound of the stable step; {:.0f} steps to t = {} s\n",
                      dt, config.step_safety, std::ceil(t_end / dt), t_end);
  return text;
}

template std::string describe(const SolidConfig&, const Solid<2>&, double);
template std::string describe(const SolidConfig&, const Solid<3>&, double);

} // namespace undine::solid
