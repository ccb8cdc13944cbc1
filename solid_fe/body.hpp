// An element block with its material: what the element loops run over.
#pragma once

#include "solid_fe/material.hpp"
#include "solid_fe/reference_block.hpp"

#include <vector>

namespace undine::solid
{

/// What the points of a body remember, and the work space of its loops.
template <int dim>
struct BodyState
{
  std::vector<Lanes> history;        ///< packs × points × numbers of the law
  std::vector<double> nodal_volume;  ///< nodal dilatation only: volume around each node [m^dim]
  std::vector<double> nodal_field;   ///< nodal dilatation only: J̄ − 1, then the pressures, of each node
  std::vector<Mat<dim>> element_tau; ///< nodal dilatation only: deviatoric Kirchhoff stress [Pa]

  template <class Archive>
  void for_each_state(Archive& archive)
  {
    archive("history", history);
    archive("nodal_volume", nodal_volume);
    archive("nodal_field", nodal_field);
    archive("element_tau", element_tau);
  }
};

template <int dim>
struct Body
{
  AnyBlock<dim> block;
  Material material;
  double density = 0.0;      ///< reference density [kg/m³]
  bool plane_stress = false; ///< 2-D only
  BodyState<dim> state{};
};

/// Room for the history of `body`, all points virgin.
template <int dim>
BodyState<dim> virgin_state(const Body<dim>& body, index_t n_nodes);

} // namespace undine::solid
