// Contact between the fluid's nodes and the deforming surface of a solid: it opens and closes from step to
// step.
//
// Both sides take the same step Δt. The free velocities v^{n+1/2} = v^{n−1/2} + Δt a^n are exchanged before
// the positions move. For every fluid node k near a facet of the solid let g_k be the gap it would have at
// the end of the step, n the normal of the deformed facet there, and N_c the shape functions of the facet at
// the foot of the node. The impulses Λ_k ≥ 0 along n solve
//
//   g_k + Δt n·(Δv_k − Σ_c N_c ΔV_c) ≥ 0   ⊥   Λ_k ≥ 0,      Δv_k = m_k⁻¹ n Λ_k,   ΔV_c = −M_c⁻¹ Σ_k N_c n
//   Λ_k ,
//
// the half-step form of the Gravouil-Combescure multiplier with a one-sided constraint: a node that would
// cross the surface ends the step exactly on it, slides freely and may leave. Impulses are equal and
// opposite, and act at one point, so that momentum and angular momentum are conserved; landing is inelastic
// and can only lose energy. A node that stays on the surface has n·(v − V) = 0 in every half step, so that
// lasting contact does no net work.
#pragma once

#include "common/coupling/messages.hpp"
#include "common/mesh/facet_surface.hpp"
#include "common/tensor.hpp"
#include "coupler/gravouil_combescure.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace undine::coupler
{

struct ContactReport
{
  int rows = 0;              ///< nodes near enough to be constrained in the last step
  int touching = 0;          ///< of these, with Λ > 0
  int sweeps = 0;            ///< of the projected Gauss-Seidel iteration
  double residual_gap = 0.0; ///< largest remaining violation [m]
  double deepest = 0.0;      ///< deepest penetration before the step [m]
  std::int64_t searches = 0; ///< for facets near nodes, since the start
  std::int64_t solves = 0;   ///< steps with at least one row, since the start
};

template <int dim>
class UnilateralContact
{
public:
  UnilateralContact(const link::SurfaceMesh& fluid, const link::SurfaceMesh& solid);

  /// The fluid's nodes near the solid were replaced (remesh).
  void replace_fluid(const link::SurfaceMesh& fluid);
  void replace_solid(const link::SurfaceMesh& solid);
  /// The solid's surface as it is now.
  link::SurfaceMesh solid_now() const;

  /// Link forces f = impulse/Δt that keep every node out of the solid [N], n × dim of each side.
  /// @param v free velocities of (fluid, solid) in the middle of the step [m/s]
  void advance(double dt, const std::array<std::vector<double>, 2>& v, std::array<std::vector<double>, 2>& f);

  /// Numbers in a vector of one side.
  std::size_t size(Side side) const { return dim * (side == Side::fluid ? x_.size() : before_.x().size()); }
  const ContactReport& report() const { return report_; }
  const InterfaceBalance& balance() const { return balance_; }
  InterfaceBalance& balance() { return balance_; }
  void for_each_state(StateArchive& archive);

private:
  struct Row
  {
    index_t node;                   ///< of the fluid
    std::array<index_t, dim> facet; ///< nodes of the solid
    std::array<double, dim> weight;
    Vec<dim> n;
    double gap;        ///< wanted change of the gap is −gap or more [m]
    double compliance; ///< n·(m⁻¹ + Σ N_c² M_c⁻¹) n [1/kg]
    double impulse;
  };
  void find_candidates(double travel);
  void find_rows(double dt, const std::array<std::vector<double>, 2>& v);
  void solve(double dt);
  static std::vector<Vec<dim>> as_points(std::span<const double> values);
  static Vec<dim> product(const std::vector<double>& inverse_mass, index_t n, const Vec<dim>& w);

  link::SurfaceMesh solid_mesh_;
  std::vector<Vec<dim>> x_; ///< of the fluid's nodes
  std::array<std::vector<double>, 2> inverse_mass_;
  FacetSurface<dim> before_, after_; ///< the solid's surface at the step's begin and its trial end
  std::vector<index_t> candidates_, candidate_offset_; ///< facets near each fluid node, CSR
  double reach_ = 0.0, travelled_ = 0.0;
  bool search_due_ = true;
  std::vector<Row> rows_;
  std::vector<double> last_impulse_; ///< of each fluid node: the iteration starts from it
  std::vector<Vec<dim>> dv_solid_;
  std::array<Vec<dim>, 2> impulse_{};
  ContactReport report_;
  InterfaceBalance balance_;
};

} // namespace undine::coupler
