// Nodal volumes, densities and pressures.
#include "fluid_pfem/mass_conservation.hpp"

#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <array>

namespace undine::fluid
{

template <int dim>
void add_element_volumes(const FluidMesh<dim>& mesh, index_t begin, index_t end, FluidNodes<dim>& nodes)
{
  const Vec<dim>* x = nodes.x.data();
  double* V = nodes.V.data();
  for (auto e = static_cast<std::size_t>(begin); e < static_cast<std::size_t>(end); ++e)
  {
    const auto& n = mesh.elements[e];
    std::array<Vec<dim>, dim + 1> corner;
    for (std::size_t a = 0; a <= dim; ++a)
      corner[a] = x[n[a]];
    const double share = (1.0 / (dim + 1)) * signed_volume<dim, double>(corner);
    for (std::size_t a = 0; a <= dim; ++a)
      V[n[a]] += share;
  }
}

template <int dim>
void update_nodal_volumes(const FluidMesh<dim>& mesh, FluidNodes<dim>& nodes)
{
  std::fill(nodes.V.begin(), nodes.V.end(), 0.0);
  add_element_volumes<dim>(mesh, 0, mesh.n_elements(), nodes);
}

template <int dim>
index_t update_density_and_pressure(const FluidMesh<dim>& mesh, const Tait& tait, double floor,
                                    FluidNodes<dim>& nodes, index_t begin, index_t end)
{
  index_t bad = -1;
  for (index_t n = begin; n < end; ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    const double least_volume = floor * regular_volume<dim>(nodes.h[i]);
    if (nodes.V[i] > least_volume)
    {
      nodes.rho[i] = nodes.m[i] / nodes.V[i];
      nodes.p[i] = tait.pressure(nodes.rho[i]);
    }
    else if (nodes.V[i] > -0.5 * least_volume && !mesh.isolated(n))
    {
      nodes.rho[i] = (nodes.m[i] + tait.rho0 * (least_volume - nodes.V[i])) / least_volume;
      nodes.p[i] = tait.pressure(nodes.rho[i]);
    }
    else if (mesh.isolated(n))
    {
      nodes.rho[i] = tait.rho0;
      nodes.p[i] = tait.p0;
    }
    else if (bad < 0)
      bad = n;
  }
  return bad;
}

template void add_element_volumes<2>(const FluidMesh<2>&, index_t, index_t, FluidNodes<2>&);
template void update_nodal_volumes<2>(const FluidMesh<2>&, FluidNodes<2>&);
template void add_element_volumes<3>(const FluidMesh<3>&, index_t, index_t, FluidNodes<3>&);
template void update_nodal_volumes<3>(const FluidMesh<3>&, FluidNodes<3>&);
template index_t update_density_and_pressure<2>(const FluidMesh<2>&, const Tait&, double, FluidNodes<2>&,
                                                index_t, index_t);
template index_t update_density_and_pressure<3>(const FluidMesh<3>&, const Tait&, double, FluidNodes<3>&,
                                                index_t, index_t);

} // namespace undine::fluid
