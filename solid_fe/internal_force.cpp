// The hot loop of the solid: gather, deformation, stress, scatter.
#include "solid_fe/internal_force.hpp"

namespace undine::solid
{

namespace
{

/// Nodal forces of one element; false if det F is not positive at one of its points (or not a number).
template <class Element, class Law, class Real>
bool element_force(const Law& law, const std::array<Vec<Element::dim, Real>, Element::nodes>& u,
                   const Vec<Element::dim>* grad_N, const double* weight,
                   std::array<Vec<Element::dim, Real>, Element::nodes>& f)
{
  bool upright = true;
  for (int q = 0; q < Element::points; ++q)
  {
    const auto* grad_N_q = grad_N + q * Element::nodes;
    const auto H = displacement_gradient<Element>(u, grad_N_q);
    upright &= volume_strain(H) > Real(-1.0);
    const auto P = Real(weight[q]) * law.first_piola(H);
    for (int a = 0; a < Element::nodes; ++a)
      f[static_cast<std::size_t>(a)] += P * grad_N_q[a];
  }
  return upright;
}

template <class Element, class Law>
index_t add_forces(const ReferenceBlock<Element>& block, const Law& law, index_t begin, index_t end,
                   std::span<const Vec<Element::dim>> u, std::span<Vec<Element::dim>> F_int)
{
  index_t inverted = -1;
  for (index_t e = begin; e < end; ++e)
  {
    const auto& nodes = block.nodes[static_cast<std::size_t>(e)];
    const auto u_e = gather<Element>(nodes, u);
    std::array<Vec<Element::dim>, Element::nodes> f{};
    const bool upright = element_force<Element>(
        law, u_e,
        block.grad_N.data() + static_cast<std::ptrdiff_t>(e) * ReferenceBlock<Element>::gradients_per_element,
        block.weight.data() + static_cast<std::ptrdiff_t>(e) * Element::points, f);
    if (!upright)
      inverted = e;
    for (std::size_t a = 0; a < nodes.size(); ++a)
      F_int[static_cast<std::size_t>(nodes[a])] += f[a];
  }
  return inverted;
}

} // namespace

template <int dim>
index_t add_internal_force(const Body<dim>& body, Part part, std::span<const Vec<dim>> u,
                           std::span<Vec<dim>> F_int)
{
  return visit_body(body,
                    [&](const auto& block, const auto& law)
                    {
                      const index_t begin = part == Part::interface ? 0 : block.n_interface;
                      const index_t end = part == Part::interface ? block.n_interface : block.size();
                      return add_forces(block, law, begin, end, u, F_int);
                    });
}

template <int dim>
double strain_energy(const Body<dim>& body, std::span<const Vec<dim>> u)
{
  return visit_body(body,
                    [&]<class Element, class Law>(const ReferenceBlock<Element>& block, const Law& law)
                    {
                      double energy = 0.0;
                      const auto* grad_N = block.grad_N.data();
                      const auto* weight = block.weight.data();
                      for (const auto& nodes : block.nodes)
                      {
                        const auto u_e = gather<Element>(nodes, u);
                        for (int q = 0; q < Element::points; ++q, grad_N += Element::nodes, ++weight)
                          energy += *weight * law.strain_energy(displacement_gradient<Element>(u_e, grad_N));
                      }
                      return energy;
                    });
}

template index_t add_internal_force(const Body<2>&, Part, std::span<const Vec<2>>, std::span<Vec<2>>);
template index_t add_internal_force(const Body<3>&, Part, std::span<const Vec<3>>, std::span<Vec<3>>);
template double strain_energy(const Body<2>&, std::span<const Vec<2>>);
template double strain_energy(const Body<3>&, std::span<const Vec<3>>);

} // namespace undine::solid
