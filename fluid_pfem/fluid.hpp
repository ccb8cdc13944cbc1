// The fluid: nodes, mesh and the acts of one explicit step.
#pragma once

#include "common/coupling/messages.hpp"
#include "fluid_pfem/fluid_config.hpp"
#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/fluid_nodes.hpp"
#include "fluid_pfem/momentum.hpp"
#include "fluid_pfem/seeding.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace undine::fluid
{

struct FluidEnergy
{
  double kinetic = 0.0;        ///< [J], per metre of depth in 2-D, like all below
  double internal = 0.0;       ///< Σ m e(ρ)
  double potential = 0.0;      ///< −Σ m g·x
  double dissipated = 0.0;     ///< by viscosity and bulk viscosity, cumulated
  double remeshing = 0.0;      ///< jumps of the three first at remeshes, cumulated
  double interface_work = 0.0; ///< done by link forces on the fluid, cumulated

  double total() const { return kinetic + internal + potential; }
};

/// Invariant: between two calls of step functions, V, rho, p and a belong to the positions x; wet nodes are
/// [0, n_wet).
template <int dim>
class Fluid
{
public:
  /// Seed the box, triangulate, set the initial density. @throws InputError for unknown surface names
  explicit Fluid(const FluidConfig& config);

  // --- one step, in this order
  // --------------------------------------------------------------------------------------
  /// v ← v + Δt/2 a,  x ← x + Δt v.
  void predict(double dt);
  /// M_ρ R = R₀ (7), p = p(ρ) (3), a = M⁻¹F (5), v ← v + Δt/2 a of the wet nodes: all that the coupler waits
  /// for.
  void solve_free_motion_of_interface(double dt);
  /// The same for all other nodes.
  void solve_free_motion_of_interior(double dt);
  void solve_free_motion(double dt);
  /// a ← a + M⁻¹f,  v ← v + Δt/2 M⁻¹f on the wet nodes. `f_link` [N], n_wet × dim.
  void correct_with_link(std::span<const double> f_link, double dt);

  // --- between steps
  // ------------------------------------------------------------------------------------------------
  /// Largest stable step, safety included [s].
  double critical_time_step() const;
  /// An element is worse than the configured shape, or the cap of steps is reached.
  bool is_distorted() const;
  /// New connectivity at a synchronised time: p, ρ and v of every node stay, m ← ρV, accelerations are
  /// recomputed (without link).
  void remesh();

  // --- what others ask for
  // ------------------------------------------------------------------------------------------
  const FluidNodes<dim>& nodes() const { return nodes_; }
  const FluidMesh<dim>& mesh() const { return mesh_; }
  const FluidConfig& config() const { return config_; }
  const std::vector<PlaneSurface<dim>>& surfaces() const { return surfaces_; }
  index_t n_wet() const { return n_wet_; }
  std::int64_t remeshes() const { return remeshes_; }
  std::int64_t steps() const { return steps_; }

  FluidEnergy energy() const;
  double mass() const;
  Vec<dim> momentum() const;

  link::SurfaceMesh wet_surface() const;
  /// Velocity of the wet nodes, n_wet × dim: the free velocity between solve_free_motion_of_interface and
  /// correct_with_link [m/s].
  std::span<const double> interface_velocity() const;
  link::Kinematics kinematics() const;
  /// v ← v + M⁻¹ impulse, a ← a_free + M⁻¹ link force.
  void apply_activation(const link::Activation& activation);

  /// Overwrite velocities: initial conditions of tests and of cases.
  void set_velocity(const std::vector<Vec<dim>>& v);

private:
  void triangulate();
  void order_nodes();
  void constrain(Vec<dim>& w, index_t n) const;
  void update_state(index_t begin, index_t end);
  void check_state(index_t bad_node) const;
  Vec<dim> body_force() const;
  SurfaceMask surface_bit(const std::string& name, const std::string& what) const;
  double smallest_quality() const;

  FluidConfig config_;
  std::vector<PlaneSurface<dim>> surfaces_;
  std::vector<WallKind> wall_kind_; ///< per surface; meaningful where wall_mask_ is set
  SurfaceMask wall_mask_ = 0, wet_mask_ = 0;
  FluidNodes<dim> nodes_;
  FluidMesh<dim> mesh_;
  ElementStress<dim> stress_;
  index_t n_wet_ = 0;                ///< nodes on an interface
  index_t n_layer_ = 0;              ///< wet nodes and their neighbours
  std::vector<index_t> constrained_; ///< nodes on walls
  std::vector<double> f_link_;       ///< last link force, n_wet × dim
  double quality_at_remesh_ = 1.0;
  std::int64_t steps_ = 0, steps_since_remesh_ = 0, remeshes_ = 0;
  std::uint32_t surface_epoch_ = 0;
  double dissipated_ = 0.0, remeshing_energy_ = 0.0, interface_work_ = 0.0;
};

} // namespace undine::fluid
