// Nodal volumes, densities and pressures.
#include "fluid_pfem/mass_conservation.hpp"

#include "fluid_pfem/simplex.hpp"

namespace undine::fluid
{

template <int dim>
void update_nodal_volumes(const FluidMesh<dim>& mesh, FluidNodes<dim>& nodes, index_t begin, index_t end)
{
  const Vec<dim>* x = nodes.x.data();
  for (index_t n = begin; n < end; ++n)
  {
    double V = 0.0;
    for (const auto& entry : mesh.fan(n))
    {
      std::array<Vec<dim>, dim> opposite;
      for (std::size_t k = 0; k < dim; ++k)
        opposite[k] = x[entry.opposite[k]];
      // N_n falls from 1 at n to 0 on the opposite facet, so V_e = V_e∇N_n · (x_n − x_opposite).
      V += dot(volume_gradient<dim, double>(opposite), x[n] - opposite[0]);
    }
    nodes.V[static_cast<std::size_t>(n)] = V * (1.0 / (dim + 1));
  }
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

template void update_nodal_volumes<2>(const FluidMesh<2>&, FluidNodes<2>&, index_t, index_t);
template void update_nodal_volumes<3>(const FluidMesh<3>&, FluidNodes<3>&, index_t, index_t);
template index_t update_density_and_pressure<2>(const FluidMesh<2>&, const Tait&, double, FluidNodes<2>&,
                                                index_t, index_t);
template index_t update_density_and_pressure<3>(const FluidMesh<3>&, const Tait&, double, FluidNodes<3>&,
                                                index_t, index_t);

} // namespace undine::fluid
