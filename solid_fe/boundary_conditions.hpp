// Supports and loads of the solid on named surfaces and node sets of its mesh.
#pragma once

#include "common/mesh/mesh.hpp"
#include "solid_fe/field_function.hpp"
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
  std::array<int, dim> function =
      filled(-1); ///< number of the [[solid.velocity]] whose formula drives it, −1 none

  static constexpr std::array<int, dim> filled(int value)
  {
    std::array<int, dim> all{};
    all.fill(value);
    return all;
  }
};

/// All prescribed motions by node.
/// @throws InputError for unknown names, components outside the dimension, and one component told two
/// different velocities
template <int dim>
std::map<index_t, PrescribedMotion<dim>> prescribed_motion(const Mesh<dim>& mesh, const SolidConfig& config);

/// Parts of the solid that keep their shape, whatever happens: a rigid body of `config.rigid`, and nodes all
/// of whose components are prescribed with the same constant velocity (of a ring: none along the radius).
/// @return number of the part of each node, −1 of the others, size n_nodes
template <int dim>
std::vector<int> parts_that_keep_their_shape(const Mesh<dim>& mesh, const SolidConfig& config,
                                             const std::map<index_t, PrescribedMotion<dim>>& motion);

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

/// Load that follows a formula: a traction per reference area, or a pressure on the deformed surface.
template <int dim>
struct FormulaLoad
{
  FieldFunction function; ///< dim formulas of a traction, one of a pressure
  bool follows = false;   ///< a pressure
  bool ring = false;      ///< of an axisymmetric solid
  Surface surface;
  std::vector<index_t> nodes; ///< of a traction
  std::vector<double> area;   ///< ∫ N_a dA of those nodes [m^(dim-1)]

  /// F ← F + the load at time t [N].
  void add(double t, std::span<const Vec<dim>> X, std::span<const Vec<dim>> u, std::span<Vec<dim>> F) const;
};

template <int dim>
std::vector<FormulaLoad<dim>> formula_loads(const Mesh<dim>& mesh, const SolidConfig& config);

/// ∫ N_a dA of a facet with 2 (dim 2), 3 or 4 nodes (dim 3): one number per facet node [m^(dim-1)]; over the
/// whole circumference if `ring` [m²].
template <int dim>
std::vector<double> facet_weights(const Mesh<dim>& mesh, std::span<const index_t> facet, bool ring = false);

} // namespace undine::solid
