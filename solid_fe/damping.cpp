// Viscous forces of element blocks.
#include "solid_fe/damping.hpp"

#include <algorithm>
#include <cmath>

namespace undine::solid
{

namespace
{

/// c √(K m_e) of a one-point element.
template <class Element>
double hourglass_coefficient(const Damping& damping, double density,
                             const ElementGeometry<Element, double>& g)
{
  double gradients = 0.0;
  for (const auto& grad_N : g.grad_N[0])
    gradients += norm_squared(grad_N);
  return damping.hourglass * g.weight[0] * std::sqrt(damping.hourglass_modulus * gradients * density);
}

template <class Element>
void add_forces(const ReferenceBlock<Element>& block, const Damping& damping, double density, index_t begin,
                index_t end, std::span<const Vec<Element::dim>> u, std::span<const Vec<Element::dim>> v,
                std::span<Vec<Element::dim>> F)
{
  using Gradient = Mat<strain_dim<Element>>;
  for (index_t e = begin; e < end; ++e)
  {
    const auto& nodes = block.nodes[static_cast<std::size_t>(e)];
    const auto g = block.geometry(e);
    const auto u_e = gather<Element>(nodes, u), v_e = gather<Element>(nodes, v);
    std::array<Vec<Element::dim>, Element::nodes> f{};
    for (int q = 0; q < Element::points; ++q)
    {
      const auto deformation = deformation_gradient(displacement_gradient<Element>(g, q, u_e));
      const auto rate = displacement_gradient<Element>(g, q, v_e);
      const auto strain_rate = symmetric_part(transpose(deformation) * rate); // Ė
      auto P = (g.weight[static_cast<std::size_t>(q)] * damping.stiffness) *
               (deformation * (damping.elastic.lame_lambda * trace(strain_rate) * Gradient::identity() +
                               2.0 * damping.elastic.shear_modulus * strain_rate));
      if constexpr (Element::hourglass_modes > 0)
      {
        auto force = hourglass_amplitudes<Element>(g, rate, v_e);
        for (auto& component : force)
          component *= hourglass_coefficient<Element>(damping, density, g);
        add_hourglass_force<Element>(g, force, P, f);
      }
      add_stress_divergence<Element>(g, q, P, f);
    }
    for (std::size_t a = 0; a < nodes.size(); ++a)
      F[static_cast<std::size_t>(nodes[a])] += f[a];
  }
}

} // namespace

template <int dim>
void add_viscous_force(const Body<dim>& body, const Damping& damping, Part part, std::span<const Vec<dim>> u,
                       std::span<const Vec<dim>> v, std::span<Vec<dim>> F)
{
  std::visit(
      [&](const auto& block)
      {
        const index_t begin = part == Part::interface ? 0 : block.n_interface;
        const index_t end = part == Part::interface ? block.n_interface : block.n_active;
        add_forces(block, damping, body.density, begin, end, u, v, F);
      },
      body.block);
}

template <int dim>
double damping_bound(const Body<dim>& body, const Damping& damping, std::span<const Vec<dim>> u)
{
  double highest = 0.0;
  if (damping.in_elements())
    std::visit(
        [&]<class Element>(const ReferenceBlock<Element>& block)
        {
          for (index_t e = 0; e < block.n_active; ++e)
          {
            const auto k = static_cast<std::size_t>(e);
            const auto g = block.geometry(e);
            const auto u_e = gather<Element>(block.nodes[k], u);
            double stretch2 = 0.0;
            for (int q = 0; q < Element::points; ++q)
              stretch2 = std::max(
                  stretch2, extreme_stretches_squared(displacement_gradient<Element>(g, q, u_e)).second);
            double bound = damping.stiffness * stretch2 *
                           (2.0 * damping.elastic.shear_modulus * block.gamma[k] +
                            std::max(damping.elastic.lame_lambda, 0.0) * block.delta[k]);
            if constexpr (Element::hourglass_modes > 0)
              if (damping.hourglass > 0.0)
                bound += hourglass_coefficient<Element>(damping, body.density, g) *
                         block.hourglass_inverse_mass[k];
            highest = std::max(highest, bound);
          }
        },
        body.block);
  return highest + damping.mass;
}

template void add_viscous_force(const Body<2>&, const Damping&, Part, std::span<const Vec<2>>,
                                std::span<const Vec<2>>, std::span<Vec<2>>);
template void add_viscous_force(const Body<3>&, const Damping&, Part, std::span<const Vec<3>>,
                                std::span<const Vec<3>>, std::span<Vec<3>>);
template double damping_bound(const Body<2>&, const Damping&, std::span<const Vec<2>>);
template double damping_bound(const Body<3>&, const Damping&, std::span<const Vec<3>>);

} // namespace undine::solid
