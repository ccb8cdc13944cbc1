// Supports and loads of the solid on named surfaces and node sets of its mesh.
#pragma once

#include "common/mesh/mesh.hpp"
#include "solid_fe/solid_config.hpp"

#include <array>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace undine::solid
{

/// The facets of the surface `name`. @throws InputError listing the surfaces there are and the nearest name;
/// `key` says who asks
template <int dim>
const Surface& find_surface(const Mesh<dim>& mesh, const std::string& name, const std::string& key);

/// The nodes of a surface or node set (both are searched). @throws InputError as find_surface
template <int dim>
std::vector<index_t> find_nodes(const Mesh<dim>& mesh, const std::string& name, const std::string& key);

/// Motion of one node that the case prescribes.
template <int dim>
struct PrescribedMotion
{
  std::array<bool, dim> fixed{}; ///< components with prescribed velocity
  Vec<dim> v{};                  ///< their constant velocity [m/s], 0 elsewhere
};

/// All prescribed motions by node.
/// @throws InputError for unknown names, components outside the dimension, and one component told two
/// different velocities
template <int dim>
std::map<index_t, PrescribedMotion<dim>> prescribed_motion(const Mesh<dim>& mesh, const SolidConfig& config);

/// Dead load of one traction: consistent nodal forces at full load.
template <int dim>
struct NodalLoad
{
  std::vector<index_t> nodes;
  std::vector<Vec<dim>> force; ///< ∫ N_a t dA over the reference surface [N], per metre in 2-D
  double ramp = 0.0;           ///< [s]

  /// Fraction of the load that acts at time t after the start.
  double factor(double t) const { return ramp > 0.0 && t < ramp ? t / ramp : 1.0; }
};

template <int dim>
std::vector<NodalLoad<dim>> nodal_loads(const Mesh<dim>& mesh, const SolidConfig& config);

/// ∫ N_a dA of a facet with 2 (dim 2), 3 or 4 nodes (dim 3): one number per facet node [m^(dim-1)].
template <int dim>
std::vector<double> facet_weights(const Mesh<dim>& mesh, std::span<const index_t> facet);

} // namespace undine::solid
