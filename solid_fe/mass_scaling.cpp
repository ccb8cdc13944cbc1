// Added masses, element by element.
#include "solid_fe/mass_scaling.hpp"

#include "solid_fe/frequency_bounds.hpp"

#include <cmath>

namespace undine::solid
{

template <int dim>
std::vector<double> scale_masses(std::vector<Body<dim>>& bodies, double dt, std::span<double> m)
{
  const double allowed = 4.0 / (dt * dt);
  std::vector<double> added(bodies.size(), 0.0);
  // The bound splits a node's mass between its elements, so what one gets is shared: a few rounds.
  for (int round = 0; round < 60; ++round)
  {
    bound_frequencies<dim>(bodies, m);
    bool enough = true;
    for (std::size_t b = 0; b < bodies.size(); ++b)
      visit_body(bodies[b],
                 [&]<class Element, class Law>(const ReferenceBlock<Element>& block, const Law& law)
                 {
                   const auto tangent = law.tangent_bound(Mat<3>{});
                   for (std::size_t e = 0; e < block.nodes.size(); ++e)
                   {
                     const double omega2 =
                         tangent.full * block.gamma[e] + tangent.volumetric * block.delta[e];
                     if (!(omega2 > allowed))
                       continue;
                     enough = false;
                     const auto geometry = block.geometry(static_cast<index_t>(e));
                     double volume = 0.0;
                     for (const double w : geometry.weight)
                       volume += w;
                     const double lacks = (1.001 * omega2 / allowed - 1.0) * bodies[b].density * volume;
                     for (const index_t n : block.nodes[e])
                       m[static_cast<std::size_t>(n)] += lacks / Element::nodes;
                     added[b] += lacks;
                   }
                 });
    if (enough)
      break;
  }
  return added;
}

template std::vector<double> scale_masses(std::vector<Body<2>>&, double, std::span<double>);
template std::vector<double> scale_masses(std::vector<Body<3>>&, double, std::span<double>);

} // namespace undine::solid
