// An element block with its material: what the element loops run over.
#pragma once

#include "solid_fe/material.hpp"
#include "solid_fe/reference_block.hpp"

namespace undine::solid
{

template <int dim>
struct Body
{
  AnyBlock<dim> block;
  Material material;
  double density = 0.0; ///< reference density [kg/m³]
};

/// Call `visit(block, law)` with the concrete types: the one place where element and law are looked up,
/// outside the loops.
template <int dim, class Visitor>
decltype(auto) visit_body(const Body<dim>& body, Visitor&& visit)
{
  return std::visit(std::forward<Visitor>(visit), body.block, body.material);
}

} // namespace undine::solid
