// Contact between the fluid's nodes and the deforming surface of a solid: it opens and closes from step to
// step.
//
// Both sides take the same step Δt. The free velocities v^{n+1/2} = v^{n−1/2} + Δt a^n are exchanged before
// the positions move. Every fluid node k near the solid has a row: the gap it would have at the end of the
// step is
//
//   g_k = n_k·(x_k − Σ_c P_kc X_c),      Σ_c P_kc = 1 .
//
// Where whole faces of the fluid lie on the solid, P = D⁻¹C is the mortar projection with the dual basis
// (mortar.hpp), so that a uniform pressure loads the solid's nodes consistently whatever the two meshes are,
// and n_k is the normal of the fluid's own boundary, so that it pushes no node sideways. For a single node P
// holds the shape functions of the solid's facet at its foot and n_k the normal of the deformed facet. The
// impulses Λ_k ≥ 0 along n_k solve
//
//   g_k + Δt n_k·(Δv_k − Σ_c P_kc ΔV_c) ≥ 0   ⊥   Λ_k ≥ 0,      Δv_k = m_k⁻¹ n_k Λ_k,   ΔV_c = −M_c⁻¹ Σ_k
//   P_kc n_k Λ_k ,
//
// the half-step form of the Gravouil-Combescure multiplier with a one-sided constraint: a node that would
// cross the surface ends the step on it, slides freely and may leave. Impulses are equal and opposite:
// momentum is conserved to round-off. Landing is inelastic and can only lose energy. A node that stays on the
// surface has n·(v − V) = 0 in every half step, so that lasting contact does no net work. One that is inside
// already (faces are chords) must not go deeper, and is pushed out slowly while contact as a whole has taken
// energy.
//
// In the plane a node that lies on a sharp corner of the solid, with water on both sides of the corner, is
// held there by both components of Λ: the facets of a node that slides around would cut the corner off, and
// the water that they cover is lost when they are replaced. It is let go when the water presses it on the
// corner with less than what turns a node of its mass around there, at the speed and distance of its
// neighbours on the boundary: such a flow separates.
//
// Where the interface does not let slide (no_slip), a node with Λ_k > 0 also goes with the surface: for each
// tangent t the same row with t·(v − V) = 0 in place of the inequality. One that is not pressed slides and
// leaves.
#pragma once

#include "common/coupling/messages.hpp"
#include "common/mesh/facet_surface.hpp"
#include "common/tensor.hpp"
#include "coupler/gravouil_combescure.hpp"
#include "coupler/mortar.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace undine::coupler
{

struct ContactReport
{
  int rows = 0;                ///< nodes near enough to be constrained in the last step
  int touching = 0;            ///< of these, with Λ > 0
  int sweeps = 0;              ///< of the projected Gauss-Seidel iteration
  double residual_gap = 0.0;   ///< largest remaining violation [m]
  double deepest = 0.0;        ///< deepest penetration before the step [m]
  std::int64_t searches = 0;   ///< for facets near nodes, since the start
  std::int64_t integrated = 0; ///< faces of the fluid for the mortar rows, since the start
  std::int64_t solves = 0;     ///< steps with at least one row, since the start
};

template <int dim>
class UnilateralContact
{
public:
  /// @param no_slip names of the solid's interfaces along which the fluid does not slide
  UnilateralContact(const link::SurfaceMesh& fluid, const link::SurfaceMesh& solid,
                    std::vector<std::string> no_slip = {});

  /// The fluid's nodes near the solid were replaced (remesh).
  void replace_fluid(const link::SurfaceMesh& fluid);
  void replace_solid(const link::SurfaceMesh& solid);
  /// The solid's surface as it is now.
  const link::SurfaceMesh& solid() const { return solid_mesh_; }

  /// Link forces f = impulse/Δt that keep every node out of the solid [N], n × dim of each side.
  /// @param v free velocities of (fluid, solid) in the middle of the step [m/s]
  void advance(double dt, const std::array<std::vector<double>, 2>& v, std::array<std::vector<double>, 2>& f);

  /// Steps that may go by without an exchange, 1 if contact is near: those in which nothing comes close at
  /// four times the speed of the last step. At most 4: so often does a fluid alone look at its mesh.
  std::int64_t flight() const;
  /// Such steps have gone by.
  /// @param v mean velocities of (fluid, solid) over `time` [m/s]
  void fly(double time, std::int64_t steps, const std::array<std::vector<double>, 2>& v);

  /// Numbers in a vector of one side.
  std::size_t size(Side side) const { return dim * (side == Side::fluid ? x_.size() : before_.x().size()); }
  const ContactReport& report() const { return report_; }
  const InterfaceBalance& balance() const { return balance_; }
  InterfaceBalance& balance() { return balance_; }
  void for_each_state(StateArchive& archive);

private:
  struct Row
  {
    index_t node = -1; ///< of the fluid
    Vec<dim> n{};
    std::size_t begin = 0, end = 0; ///< its part of weights_
    double gap = 0.0;               ///< the gap must grow by at least −gap in this step [m]
    double compliance = 0.0;        ///< n·(m⁻¹ + Σ P² M_c⁻¹) n [1/kg]
    double impulse = 0.0;
    bool held = false;   ///< the gap is closed from both sides
    index_t normal = -1; ///< row along the surface: closed from both sides while this row has an impulse
  };
  struct Weight
  {
    index_t node; ///< of the solid
    double P;
  };
  using Near = typename FacetSurface<dim>::Near;
  void find_candidates(double travel);
  double fastest_travel(double time, const std::array<std::vector<double>, 2>& v) const;
  void find_near();
  void look_around();
  void measure_clearance();
  void find_rows(double dt, const std::array<std::vector<double>, 2>& v);
  void find_active();
  std::vector<char> nodes_of_active(const std::vector<char>& touched) const;
  bool touches(std::size_t face, const std::vector<char>& nodes) const;
  std::vector<char> find_changed(double dt, const std::array<std::vector<double>, 2>& v);
  void integrate_rows(const std::vector<char>& changed);
  void find_normals();
  void add_row(index_t node, const Vec<dim>& n, std::size_t first_weight, bool held = false);
  void add_rows_along(const Row& row);
  /// A push is work on both sides. It may spend what contact took, never more.
  bool may_push() const { return balance_.work[Side::fluid] + balance_.work[Side::solid] <= 0.0; }
  void find_held();
  void let_go(double dt, const std::array<std::vector<double>, 2>& v);
  void solve(double dt);
  void give_forces(double dt, std::array<std::vector<double>, 2>& f);
  void show_solid();
  static std::vector<Vec<dim>> as_points(std::span<const double> values);
  static Vec<dim> row_of(std::span<const double> values, index_t n);
  static Vec<dim> product(const std::vector<double>& inverse_mass, index_t n, const Vec<dim>& w);

  link::SurfaceMesh solid_mesh_;
  std::vector<Vec<dim>> x_; ///< of the fluid's nodes
  std::array<std::vector<double>, 2> inverse_mass_;
  /// The node on the other face of a thin solid that a force on this one moves too, −1: none; and its
  /// acceleration per force on this one [1/kg].
  std::vector<index_t> partner_;
  std::vector<double> partner_inverse_mass_;
  FacetSurface<dim> before_, after_; ///< the solid's surface at the step's begin and its trial end
  std::vector<index_t> candidates_, candidate_offset_; ///< facets near each fluid node, CSR
  double reach_ = 0.0, travelled_ = 0.0;
  bool search_due_ = true;
  std::vector<std::vector<int>> faces_;     ///< of the fluid's boundary near the solid
  std::vector<std::string> no_slip_;        ///< names of interfaces
  std::vector<char> sticks_;                ///< per facet of the solid: it is of one of them
  std::vector<int> side_;                   ///< smooth side of each facet of the solid
  std::vector<Vec<dim>> x_end_;             ///< trial positions of the fluid's nodes at the step's end
  std::vector<Near> near_;                  ///< where they meet the solid
  std::vector<char> active_;                ///< per fluid face: it lies on the solid
  std::vector<char> active_built_;          ///< the same at the last step
  std::vector<std::vector<Weight>> mortar_; ///< per fluid node: its row of P; empty: none
  std::vector<Vec<dim>> normal_;            ///< of the fluid's active faces, at nodes
  double travel_of_step_ = 0.0;             ///< of the fastest nodes of both sides [m]
  double clearance_ = 0.0;                  ///< no node of the fluid is nearer to the solid [m]
  std::vector<double> slid_;                ///< each fluid node since its row was integrated [m]
  std::vector<Row> rows_;
  std::vector<Weight> weights_;
  std::vector<double> last_impulse_; ///< of each fluid node: the iteration starts from it
  struct Held
  {
    std::array<index_t, 2> facet{-1, -1}; ///< of the solid, before and after the corner; −1: not held
    std::array<index_t, 2> neighbour{};   ///< on the fluid's boundary
  };
  std::vector<Held> held_; ///< per fluid node
  std::vector<Vec<dim>> dv_fluid_, dv_solid_;
  std::array<Vec<dim>, 2> impulse_{};
  ContactReport report_;
  InterfaceBalance balance_;
};

} // namespace undine::coupler
