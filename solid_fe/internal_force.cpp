// From a body to the loops of its law.
#include "solid_fe/internal_force.hpp"

#include "solid_fe/kernels/law_kernels.hpp"

namespace undine::solid
{

template <int dim>
index_t add_internal_force(const Body<dim>& body, Part part, std::span<const Vec<dim>> u, double dt,
                           BodyState<dim>& state, std::span<Vec<dim>> F_int)
{
  return std::visit([&](const auto& law) { return add_forces_of(body, law, part, u, dt, state, F_int); },
                    body.material);
}

template <int dim>
void add_stored_energy(const Body<dim>& body, std::span<const Vec<dim>> u, StoredEnergy& energy)
{
  std::visit([&](const auto& law) { add_stored_energy_of(body, law, u, energy); }, body.material);
}

template <int dim>
void append_stress(const Body<dim>& body, std::span<const Vec<dim>> u, std::vector<Mat<3>>& sigma,
                   std::vector<double>& plastic_strain)
{
  std::visit([&](const auto& law) { append_stress_of(body, law, u, sigma, plastic_strain); }, body.material);
}

template <int dim>
BodyState<dim> virgin_state(const Body<dim>& body, index_t n_nodes)
{
  BodyState<dim> state;
  state.history.resize(
      std::visit([&](const auto& law) { return history_lanes_of(body, law); }, body.material));
  std::visit(
      [&]<class Element>(const ReferenceBlock<Element>& block)
      {
        if constexpr (Element::dilatation == Dilatation::of_nodes)
        {
          state.nodal_volume.resize(static_cast<std::size_t>(n_nodes));
          state.nodal_field.resize(static_cast<std::size_t>(n_nodes));
          state.element_tau.resize(static_cast<std::size_t>(block.size()));
          for (index_t e = 0; e < block.size(); ++e)
            for (const index_t n : block.nodes[static_cast<std::size_t>(e)])
              state.nodal_volume[static_cast<std::size_t>(n)] += block.geometry(e).weight[0];
        }
      },
      body.block);
  return state;
}

#define UNDINE_INSTANTIATE(dim)                                                                              \
  template index_t add_internal_force(const Body<dim>&, Part, std::span<const Vec<dim>>, double,             \
                                      BodyState<dim>&, std::span<Vec<dim>>);                                 \
  template void add_stored_energy(const Body<dim>&, std::span<const Vec<dim>>, StoredEnergy&);               \
  template void append_stress(const Body<dim>&, std::span<const Vec<dim>>, std::vector<Mat<3>>&,             \
                              std::vector<double>&);                                                         \
  template BodyState<dim> virgin_state(const Body<dim>&, index_t);
UNDINE_INSTANTIATE(2)
UNDINE_INSTANTIATE(3)

} // namespace undine::solid
