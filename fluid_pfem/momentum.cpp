// Nodal forces, gathered node by node: no scatter, no races, a fixed order of summation.
#include "fluid_pfem/momentum.hpp"

#include "fluid_pfem/newtonian.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>

namespace undine::fluid
{

namespace
{

template <bool bulk, bool shear, bool exchange, int dim>
void element_pass(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes, const ElementTermsConfig& config,
                  double c0, const Vec<dim>& b, double dt, index_t begin, index_t end,
                  ElementTerms<dim>& terms)
{
  const double weight = 1.0 / (dim + 1), alpha = config.residual * std::sqrt(2.0 * dim) / c0;
  const double with_a = config.residual_with_acceleration ? 1.0 : 0.0;
  double dissipation = 0.0;
  for (index_t e = begin; e < end; ++e)
  {
    const auto k = static_cast<std::size_t>(e);
    const Simplex<dim>& corner = mesh.elements[k];
    std::array<Vec<dim>, dim + 1> x;
    double rho = 0.0;
    for (std::size_t a = 0; a <= dim; ++a)
    {
      x[a] = nodes.x[static_cast<std::size_t>(corner[a])];
      rho += weight * nodes.rho[static_cast<std::size_t>(corner[a])];
    }
    const auto V_grad_N = volume_gradients<dim, double>(x);
    const double V = dot(V_grad_N[0], x[0] - x[1]);
    double V2_grad_N2 = 0.0;
    for (std::size_t a = 0; a <= dim; ++a)
      V2_grad_N2 += norm_squared(V_grad_N[a]);
    // A sliver that is inverted or as flat as round-off has no meaningful gradients.
    const bool has_gradients =
        dim == 2 ? V > 1e-9 * V2_grad_N2 : V * V > 1e-18 * V2_grad_N2 * std::sqrt(V2_grad_N2);
    const double proper = has_gradients ? 1.0 : 0.0;
    const double inverse_V = proper / (V + (1.0 - proper));
    const double height = proper * V / std::sqrt(V2_grad_N2);
    if constexpr (bulk || shear)
    {
      Mat<dim> grad_v;
      for (std::size_t a = 0; a <= dim; ++a)
        grad_v += outer(nodes.v[static_cast<std::size_t>(corner[a])], V_grad_N[a]);
      grad_v *= inverse_V;
      if constexpr (bulk)
      {
        const double div_v = trace(grad_v), b2 = config.bulk_quadratic;
        const double q =
            -rho * height * (config.bulk_linear * c0 - b2 * b2 * height * std::min(div_v, 0.0)) * div_v;
        terms.q[k] = q;
        dissipation -= q * div_v * V;
      }
      if constexpr (shear)
      {
        terms.tau[k] =
            deviatoric_stress<dim, double>(grad_v, config.mu * viscous_fraction<dim>(V, V2_grad_N2));
        dissipation += contract(terms.tau[k], grad_v) * V;
      }
    }
    if constexpr (exchange)
    {
      Vec<dim> grad_p{}, a_bar{};
      for (std::size_t a = 0; a <= dim; ++a)
      {
        grad_p += nodes.p[static_cast<std::size_t>(corner[a])] * V_grad_N[a];
        a_bar += (with_a * weight) * nodes.a[static_cast<std::size_t>(corner[a])];
        if (!terms.body.empty())
          a_bar -= weight * terms.body[static_cast<std::size_t>(corner[a])];
      }
      Vec<dim> z = (alpha * height) * (inverse_V * grad_p - (proper * rho) * (b - a_bar));
      double largest = 0.0, least_mass = nodes.m[static_cast<std::size_t>(corner[0])];
      for (std::size_t a = 0; a <= dim; ++a)
      {
        largest = std::max(largest, std::abs(dot(V_grad_N[a], z)));
        least_mass = std::min(least_mass, nodes.m[static_cast<std::size_t>(corner[a])]);
      }
      const double allowed = 0.05 * std::max(least_mass, 0.0);
      if (dt * largest > allowed)
        z *= allowed / (dt * largest);
      terms.z[k] = z;
    }
  }
  terms.dissipation += dissipation;
}

template <bool bulk, bool shear, bool exchange, int dim>
void node_pass(const FluidMesh<dim>& mesh, FluidNodes<dim>& nodes, const ElementTerms<dim>& terms,
               const Vec<dim>& b, index_t begin, index_t end, std::span<double> mass_rate)
{
  const Vec<dim>* x = nodes.x.data();
  const double* p = nodes.p.data();
  for (index_t n = begin; n < end; ++n)
  {
    Vec<dim> F{};
    double dm = 0.0;
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
        p_bar += terms.q[static_cast<std::size_t>(entry.element)];
      const Vec<dim> V_grad_N = volume_gradient<dim, double>(opposite);
      F += p_bar * V_grad_N;
      if constexpr (shear)
        F -= terms.tau[static_cast<std::size_t>(entry.element)] * V_grad_N;
      if constexpr (exchange)
        dm -= dot(V_grad_N, terms.z[static_cast<std::size_t>(entry.element)]);
    }
    const auto i = static_cast<std::size_t>(n);
    nodes.a[i] = (1.0 / nodes.inertia[i]) * F + b;
    if constexpr (exchange)
      mass_rate[i] = dm;
  }
}

/// Call `act.template operator()<bulk, shear, exchange>()` with the three run-time switches as constants.
template <class Act>
void with_switches(bool bulk, bool shear, bool exchange, Act&& act)
{
  const auto third = [&]<bool A, bool B>()
  { exchange ? act.template operator()<A, B, true>() : act.template operator()<A, B, false>(); };
  const auto second = [&]<bool A>()
  { shear ? third.template operator()<A, true>() : third.template operator()<A, false>(); };
  bulk ? second.template operator()<true>() : second.template operator()<false>();
}

} // namespace

template <int dim>
void update_element_terms(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes,
                          const ElementTermsConfig& config, double c0, const Vec<dim>& b, double dt,
                          index_t begin, index_t end, ElementTerms<dim>& terms)
{
  const bool bulk = config.bulk(), shear = config.mu > 0.0, exchange = config.residual > 0.0;
  terms.q.resize(bulk ? mesh.elements.size() : 0);
  terms.tau.resize(shear ? mesh.elements.size() : 0);
  terms.z.resize(exchange ? mesh.elements.size() : 0);
  if (begin == 0)
    terms.dissipation = 0.0;
  if (config.none())
    return;
  with_switches(bulk, shear, exchange,
                [&]<bool B, bool S, bool X>()
                { element_pass<B, S, X, dim>(mesh, nodes, config, c0, b, dt, begin, end, terms); });
}

template <int dim>
void update_acceleration(const FluidMesh<dim>& mesh, FluidNodes<dim>& nodes, const ElementTerms<dim>& terms,
                         const Vec<dim>& b, index_t begin, index_t end, std::span<double> mass_rate)
{
  with_switches(!terms.q.empty(), !terms.tau.empty(), !terms.z.empty(),
                [&]<bool B, bool S, bool X>()
                { node_pass<B, S, X, dim>(mesh, nodes, terms, b, begin, end, mass_rate); });
}

template void update_element_terms<2>(const FluidMesh<2>&, const FluidNodes<2>&, const ElementTermsConfig&,
                                      double, const Vec<2>&, double, index_t, index_t, ElementTerms<2>&);
template void update_element_terms<3>(const FluidMesh<3>&, const FluidNodes<3>&, const ElementTermsConfig&,
                                      double, const Vec<3>&, double, index_t, index_t, ElementTerms<3>&);
template void update_acceleration<2>(const FluidMesh<2>&, FluidNodes<2>&, const ElementTerms<2>&,
                                     const Vec<2>&, index_t, index_t, std::span<double>);
template void update_acceleration<3>(const FluidMesh<3>&, FluidNodes<3>&, const ElementTerms<3>&,
                                     const Vec<3>&, index_t, index_t, std::span<double>);

} // namespace undine::fluid
