// Element frequency bounds at the current deformation.
#include "solid_fe/critical_time_step.hpp"

#include <algorithm>
#include <cmath>

namespace undine::solid
{

template <int dim>
double stable_step(const Body<dim>& body, std::span<const Vec<dim>> u)
{
  const double omega2 =
      visit_body(body,
                 [&]<class Element, class Law>(const ReferenceBlock<Element>& block, const Law& law)
                 {
                   double highest = 0.0;
                   const auto* grad_N = block.grad_N.data();
                   for (std::size_t e = 0; e < block.nodes.size(); ++e)
                   {
                     const auto u_e = gather<Element>(block.nodes[e], u);
                     TangentBound worst;
                     for (int q = 0; q < Element::points; ++q, grad_N += Element::nodes)
                     {
                       const auto bound = law.tangent_bound(displacement_gradient<Element>(u_e, grad_N));
                       worst.full = std::max(worst.full, bound.full);
                       worst.volumetric = std::max(worst.volumetric, bound.volumetric);
                     }
                     highest =
                         std::max(highest, worst.full * block.gamma[e] + worst.volumetric * block.delta[e]);
                   }
                   return highest;
                 });
  return 2.0 / std::sqrt(omega2);
}

template double stable_step(const Body<2>&, std::span<const Vec<2>>);
template double stable_step(const Body<3>&, std::span<const Vec<3>>);

} // namespace undine::solid
