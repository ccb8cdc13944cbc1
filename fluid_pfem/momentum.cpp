// Nodal forces, gathered node by node: no scatter, no races, a fixed order of summation.
#include "fluid_pfem/momentum.hpp"

#include "fluid_pfem/newtonian.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>

namespace undine::fluid
{

template <int dim>
void update_element_stress(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes,
                           const Viscosity& viscosity, double c0, ElementStress<dim>& stress)
{
  const bool bulk = viscosity.bulk_linear > 0.0 || viscosity.bulk_quadratic > 0.0;
  const bool shear = viscosity.mu > 0.0;
  stress.q.resize(bulk ? mesh.elements.size() : 0);
  stress.tau.resize(shear ? mesh.elements.size() : 0);
  stress.dissipation = 0.0;
  if (!bulk && !shear)
    return;
  for (std::size_t e = 0; e < mesh.elements.size(); ++e)
  {
    std::array<Vec<dim>, dim + 1> x;
    double rho = 0.0;
    for (std::size_t a = 0; a <= dim; ++a)
    {
      x[a] = nodes.x[static_cast<std::size_t>(mesh.elements[e][a])];
      rho += nodes.rho[static_cast<std::size_t>(mesh.elements[e][a])] * (1.0 / (dim + 1));
    }
    const double V = signed_volume<dim, double>(x);
    const auto V_grad_N = volume_gradients<dim, double>(x);
    Mat<dim> V_grad_v;
    double V2_grad_N2 = 0.0;
    for (std::size_t a = 0; a <= dim; ++a)
    {
      V_grad_v += outer(nodes.v[static_cast<std::size_t>(mesh.elements[e][a])], V_grad_N[a]);
      V2_grad_N2 += norm_squared(V_grad_N[a]);
    }
    const bool proper = V > 0.0; // an inverted sliver has no meaningful rate of deformation
    const Mat<dim> grad_v = proper ? V_grad_v * (1.0 / V) : Mat<dim>{};
    if (bulk)
    {
      const double height = V / std::sqrt(V2_grad_N2), div_v = trace(grad_v);
      const double b1 = viscosity.bulk_linear, b2 = viscosity.bulk_quadratic;
      stress.q[e] = -rho * height * (b1 * c0 - b2 * b2 * height * std::min(div_v, 0.0)) * div_v;
      stress.dissipation -= stress.q[e] * div_v * V;
    }
    if (shear)
    {
      stress.tau[e] = deviatoric_stress<dim, double>(grad_v, viscosity.mu);
      stress.dissipation += contract(stress.tau[e], grad_v) * V;
    }
  }
}

namespace
{

template <bool bulk, bool shear, int dim>
void gather(const FluidMesh<dim>& mesh, FluidNodes<dim>& nodes, const ElementStress<dim>& stress,
            const Vec<dim>& b, index_t begin, index_t end)
{
  const Vec<dim>* x = nodes.x.data();
  const double* p = nodes.p.data();
  for (index_t n = begin; n < end; ++n)
  {
    Vec<dim> F{};
    for (const auto& entry : mesh.fan(n))
    {
      std::array<Vec<dim>, dim> opposite;
      double p_bar = p[n];
      for (std::size_t k = 0; k < dim; ++k)
      {
        opposite[k] = x[entry.opposite[k]];
        p_bar += p[entry.opposite[k]];
      }
      p_bar *= 1.0 / (dim + 1);
      if constexpr (bulk)
        p_bar += stress.q[static_cast<std::size_t>(entry.element)];
      const Vec<dim> V_grad_N = volume_gradient<dim, double>(opposite);
      F += p_bar * V_grad_N;
      if constexpr (shear)
        F -= stress.tau[static_cast<std::size_t>(entry.element)] * V_grad_N;
    }
    const auto i = static_cast<std::size_t>(n);
    nodes.a[i] = (1.0 / nodes.m[i]) * F + b;
  }
}

} // namespace

template <int dim>
void update_acceleration(const FluidMesh<dim>& mesh, FluidNodes<dim>& nodes, const ElementStress<dim>& stress,
                         const Vec<dim>& b, index_t begin, index_t end)
{
  const bool bulk = !stress.q.empty(), shear = !stress.tau.empty();
  if (bulk && shear)
    gather<true, true, dim>(mesh, nodes, stress, b, begin, end);
  else if (bulk)
    gather<true, false, dim>(mesh, nodes, stress, b, begin, end);
  else if (shear)
    gather<false, true, dim>(mesh, nodes, stress, b, begin, end);
  else
    gather<false, false, dim>(mesh, nodes, stress, b, begin, end);
}

template void update_element_stress<2>(const FluidMesh<2>&, const FluidNodes<2>&, const Viscosity&, double,
                                       ElementStress<2>&);
template void update_element_stress<3>(const FluidMesh<3>&, const FluidNodes<3>&, const Viscosity&, double,
                                       ElementStress<3>&);
template void update_acceleration<2>(const FluidMesh<2>&, FluidNodes<2>&, const ElementStress<2>&,
                                     const Vec<2>&, index_t, index_t);
template void update_acceleration<3>(const FluidMesh<3>&, FluidNodes<3>&, const ElementStress<3>&,
                                     const Vec<3>&, index_t, index_t);

} // namespace undine::fluid
