// The explicit total-Lagrangian solid: state, one step of central differences in its parts, balances.
#pragma once

#include "common/coupling/messages.hpp"
#include "common/io/state_archive.hpp"
#include "common/parallel/exact_sum.hpp"
#include "solid_fe/beam.hpp"
#include "solid_fe/body.hpp"
#include "solid_fe/boundary_conditions.hpp"
#include "solid_fe/contact.hpp"
#include "solid_fe/damping.hpp"
#include "solid_fe/internal_force.hpp"
#include "solid_fe/node_share.hpp"
#include "solid_fe/rigid_body.hpp"
#include "solid_fe/solid_config.hpp"
#include "solid_fe/solid_nodes.hpp"
#include "solid_fe/wet_surface.hpp"

#include <algorithm>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

namespace undine
{
struct Graph;
}

namespace undine::solid
{

/// Energies of the solid [J], per metre of thickness in 2-D. Works are cumulated by the trapezoidal rule in
/// time, ½ (F_n + F_n+1) · Δu, for which the scheme gives exactly (constant Δt, linear law; up to O(Δt²)
/// without trend otherwise)
///     Δ(kinetic − Δt²/8 a·M a) + Δ strain + Δ hourglass + Δ plastic + Δ viscous + Δ contact
///         = Δ external + Δ interface,
/// so that the balance stays within Δt²/8 a·M a of its start.
struct Energies
{
  double kinetic = 0.0;
  double strain = 0.0;
  double hourglass = 0.0; ///< stored in the hourglass stiffness
  double plastic = 0.0;   ///< plastic work since the start
  double viscous = 0.0;   ///< taken by damping and viscous hourglass control since the start
  double contact = 0.0;   ///< stored in and dissipated by contact since the start
  double external = 0.0;  ///< work of gravity, tractions and prescribed motion since the start
  double interface = 0.0; ///< work of link forces and activation impulses since the start

  double balance() const
  {
    return kinetic + strain + hourglass + plastic + viscous + contact - external - interface;
  }
};

/// Promise: nodes and elements that touch the wet surface come first; u, v, a and the balances belong to one
/// instant whenever a step is complete; prescribed components never see a force.
///
/// One step is predict → solve_free_motion (in one or two parts) → correct_with_link (coupled only):
/// Newmark's scheme with β = 0, γ = ½, in integer-time form. Positions do not depend on the link force, so it
/// only corrects a and v.
template <int dim>
class Solid
{
public:
  /// At rest in the reference state, with the initial and prescribed velocities and the acceleration of the
  /// loads at t = 0+.
  /// @throws InputError for names, values or elements that make no sense
  Solid(const SolidConfig& config, const Mesh<dim>& mesh);

  /// Share the work: from here on this rank computes the nodes that it owns, and holds only the elements that
  /// they need. Rigid bodies, what may touch and a beam, which is a line of few nodes, are
  /// all rank 0's. Each rank talks to the coupler of its own wet nodes. All ranks must have made the same
  /// solid. Results have the bits of one rank. Collective, as are from here on all steps and everything that
  /// says so.
  void distribute(const Ranks& ranks);
  /// The same where the rank of every node is given, however unevenly. @throws InternalError if what must be
  /// rank 0's is not
  void distribute(const Ranks& ranks, std::vector<int> owner);
  const Ranks& ranks() const { return share_.ranks(); }
  /// The nodes of this rank; rows of others in nodes() are out of date.
  const NodeShare& share() const { return share_; }
  /// Rows of all nodes, and all else of the state that other ranks compute. Collective.
  void collect();
  /// value(n) at each of `nodes`, from the rank that computes it. Collective.
  template <class Value>
  auto at(std::span<const index_t> nodes, Value&& value) const
  {
    std::vector<decltype(value(std::size_t{}))> rows(nodes.size());
    std::vector<int> owner;
    for (std::size_t k = 0; k < nodes.size(); ++k)
    {
      const auto n = static_cast<std::size_t>(nodes[k]);
      if (share_.owns(n))
        rows[k] = value(n);
      if (!ranks().alone())
        owner.push_back(share_.owner()[n]);
    }
    share_.collect(rows, owner);
    return rows;
  }

  /// Start over from u(X) [m] and v(X) [m/s] at time t; prescribed velocities win over v. Balances start at
  /// zero. Parts that are rigid or prescribed as a whole must keep their shape.
  void set_motion(const std::function<Vec<dim>(const Vec<dim>&)>& u,
                  const std::function<Vec<dim>(const Vec<dim>&)>& v, double t = 0.0);

  /// v ← v + Δt/2 a,  u ← u + Δt v.
  void predict(double dt);
  /// The same in two parts, for contact with the fluid: between them v is v^{n−1/2} + Δt a^n, and the link
  /// pushes.
  void predict_velocity(double dt);
  void predict_position(double dt);
  /// v ← v + Δt M⁻¹ f on the wet nodes, between predict_velocity and predict_position. f_link [N]: of this
  /// rank's.
  void push(std::span<const double> f_link, double dt);
  /// a = M⁻¹ (F_ext − F_int(u)),  v ← v + Δt/2 a: from here on v is v_free.
  /// @throws NumericalError if an element is inverted: element, position, step, time
  void solve_free_motion(double dt);
  /// The same in two parts: first what the wet nodes need (the elements that touch them), then the rest. Same
  /// bits.
  void solve_free_motion_of_interface(double dt);
  void solve_free_motion_of_interior(double dt);
  /// a ← a + M⁻¹ f,  v ← v + Δt/2 M⁻¹ f on the wet nodes. f_link [N]: of this rank's.
  void correct_with_link(std::span<const double> f_link, double dt);

  /// v ← v + M⁻¹ impulse,  a ← a_free + M⁻¹ link_force on the wet nodes: a compatible start of a constraint.
  void apply_activation(const link::Activation& activation);

  // Vectors of the wet surface have a row of dim numbers for each wet node of this rank, ascending.
  index_t n_wet_nodes() const { return reference_.n_wet; } ///< of all ranks
  link::SurfaceMesh wet_surface();                         ///< at the current position. Collective
  /// The inverse masses of the wet nodes are no longer those of the last wet_surface(): a wet fibre of a beam
  /// has turned by more than 1e-3.
  bool wet_surface_has_changed() const;
  std::span<const double>
  interface_velocity() const;          ///< of the wet nodes [m/s]; v_free between the parts of a step
  link::Kinematics kinematics() const; ///< v and a_free of the wet nodes

  /// Largest step it can take next: step_safety × the bound of critical_time_step.hpp [s]. Collective.
  double critical_time_step() const;
  Energies energies() const; ///< collective
  /// Cumulated work of the link forces, as in energies() [J]. Collective.
  double interface_work() const;
  double mass() const; ///< with what mass scaling added [kg]
  /// What mass scaling added to each body [kg]; loads per mass do not act on it. Empty without mass scaling.
  const std::vector<double>& added_mass() const { return added_mass_; }
  /// Measure the true highest frequency again if that is asked for and the solid has changed much (the bound
  /// by 5 %, or 2000 steps) since the last time. Collective.
  void measure_frequency();
  /// Force that the part of the solid in front of the plane through `point` along `normal` (in the reference
  /// state) feels from the part behind it [N], and its moment about the point where `point` is nearest to now
  /// [N m]. Collective.
  std::pair<Vec<dim>, Vec<3>> section_force(const Vec<dim>& point, const Vec<dim>& normal) const;
  Vec<dim> linear_momentum() const; ///< Σ m v [kg m/s]. Collective
  /// Σ m x × v about the origin [kg m²/s]; in 2-D only the third component. Collective.
  Vec<3> angular_momentum() const;
  /// Σ (M a − F_ext + F_int − f_link): force of the supports on `nodes` [N]. Collective.
  Vec<dim> reaction(std::span<const index_t> nodes) const;

  double time() const; ///< [s]
  /// Set the clock, which ramps and messages read; nothing else changes.
  void set_time(double t);
  std::int64_t steps() const { return step_; }
  const SolidNodes<dim>& nodes() const { return nodes_; }
  const std::vector<Body<dim>>& bodies() const { return bodies_; } ///< the elements that this rank computes
  /// Nodes and numbers of all elements of body k.
  const AnyBlock<dim>& whole_block(std::size_t k) const
  {
    return whole_.empty() ? bodies_[k].block : whole_[k].block;
  }
  /// Number in whole_block(k) of each element of bodies()[k]; −1: a copy, which another rank counts.
  std::vector<index_t> counted_elements(std::size_t k) const;
  /// Rows of all elements of body k from those that each rank has of its own bodies()[k], the copies of
  /// others left out. Collective.
  template <class T>
  std::vector<T> of_all_elements(std::size_t k, std::vector<T> mine, std::size_t width = 1) const
  {
    if (whole_.empty())
      return mine;
    const auto& whole = whole_[k];
    std::vector<T> rows(whole.owner.size() * width);
    for (std::size_t i = 0; i < whole.held.size(); ++i)
      std::copy_n(mine.begin() + static_cast<std::ptrdiff_t>(i * width), width,
                  rows.begin() +
                      static_cast<std::ptrdiff_t>(static_cast<std::size_t>(whole.held[i]) * width));
    share_.collect(rows, whole.owner, width);
    return rows;
  }
  const Mesh<dim>& mesh() const { return reference_.mesh; } ///< reference mesh in the solid's numbering
  const std::vector<index_t>& given_number() const
  {
    return reference_.number;
  } ///< of each node in the mesh it was made from
  index_t n_elements() const;
  const std::vector<RigidBody<dim>>& rigid_bodies() const { return rigid_; }
  /// The beam behind the strip of quadrilaterals of formulation = "beam"; null otherwise. Its fibre k ends at
  /// the nodes fibre_ends()[k].
  const Beam* beam() const { return beam_ ? &*beam_ : nullptr; }
  const std::vector<std::array<index_t, 2>>& fibre_ends() const { return fibre_; }
  /// Walls and contact pairs; null if the case has none.
  const Contact<dim>* contact() const { return contact_ ? &*contact_ : nullptr; }

  /// All that a later step depends on; what follows from the configuration is made by the constructor.
  void for_each_state(StateArchive& archive);

  /// F_int at any displacement [N]; for verification and statics, allocates. Collective.
  std::vector<Vec<dim>> internal_force_at(std::span<const Vec<dim>> u) const;

private:
  /// A component that moves with a non-zero prescribed velocity, and the reaction that makes it do so.
  struct DrivenComponent
  {
    std::size_t node;
    int component;
    double reaction;          ///< [N] at the last complete instant
    int function;             ///< formula of its velocity or acceleration, −1: constant velocity
    double v_step;            ///< velocity within the step [m/s]
    bool accelerates = false; ///< the formula is an acceleration
    double v_end = 0.0;       ///< velocity at the last complete instant [m/s]
  };

  /// The same of a component of a fibre (2: its rotation).
  struct DrivenFibre
  {
    std::size_t fibre;
    int component;
    double reaction; ///< [N]
    int function;
    double v, v_step;   ///< constant velocity, velocity within the step [m/s]
    double v_end = 0.0; ///< at the last complete instant [m/s]
  };

  /// A body of which this rank holds some elements.
  struct WholeBody
  {
    AnyBlock<dim> block;       ///< nodes and numbers of all elements, no geometry
    std::vector<index_t> held; ///< the elements of it that this rank computes
    std::vector<int> owner;    ///< rank that counts each element
    std::size_t row = 0;       ///< numbers that an element remembers
  };

  std::vector<char> nodes_of_first_rank() const;
  Graph graph_of_nodes() const;
  void hold_part_of(std::size_t k, std::vector<index_t> held);
  void take_state(std::size_t k, const BodyState<dim>& all);
  void archive_body(StateArchive& archive, std::size_t k, std::span<const RowRun> own);
  /// Reaction and velocities of what is driven, as numbers; those that are mine(driven) go to a file from
  /// here.
  template <class Driven, class Mine>
  static void archive_driven(StateArchive& archive, const std::string& name, std::vector<Driven>& list,
                             Mine&& mine);
  /// Sum of term(n) over all nodes, without an order. Collective.
  template <int size, class Term>
  Vec<size> sum_over_nodes(Term&& term) const;

  void make_bodies(const SolidConfig& config, const std::map<index_t, PrescribedMotion<dim>>& motion,
                   std::span<double> volume);
  void make_beam(const SolidConfig& config);
  void make_nodes(const SolidConfig& config, std::span<const double> volume);
  void prescribe(const SolidConfig& config, const std::map<index_t, PrescribedMotion<dim>>& motion);
  void make_room(const SolidConfig& config);
  void set_motion_of_beam(const std::function<Vec<dim>(const Vec<dim>&)>& u,
                          const std::function<Vec<dim>(const Vec<dim>&)>& v, double t) requires(dim == 2);
  double driven_velocity(const DrivenFibre& driven, double t) const;
  std::size_t node_of(const DrivenFibre& driven) const ///< whose work counts what drives the fibre
  {
    return static_cast<std::size_t>(fibre_[driven.fibre][0]);
  }
  double formula_of(const DrivenComponent& driven, double t) const;
  /// Velocities (and accelerations) of the driven components of `part` at the end of the step.
  void finish_driven(double dt, Part part);
  /// Rows of all wet nodes, of which those of this rank are `mine`.
  std::span<const double> rows_of_all(std::span<const double> mine, std::vector<double>& room) const;
  bool moves_beam() const { return beam_ && share_.is_first(); }
  /// What rank 0 says, whose the beam is. Collective.
  template <class T>
  T of_first(const T& x) const
  {
    return ranks().of_first(std::vector<T>{x}).front();
  }
  void solve_beam(double dt);
  void show_beam(bool moves); ///< u (if it moves), v, a of the nodes are those of the beam's faces
  void link_beam(std::size_t node, const Vec<dim>& f, double dt);
  void add_internal_force_of(Part part, double dt);
  void add_viscous_force_of(Part part);
  void add_contact_force(double dt);
  /// Everything is computed with the interface: fibres and impulse contact want all forces on their nodes at
  /// once.
  bool at_once() const { return beam_ || (contact_ && contact_->by_impulse()); }
  void count_works(double dt);
  void solve_rigid_bodies(double dt);
  double bound_of_frequency_squared() const;   ///< of the elements, without contact [1/s²]. Collective
  double opposing(std::size_t n, int i) const; ///< viscous minus contact force on a component [N]
  void update_external_force(double t);
  void move_free(double dt, index_t begin, index_t end);
  void start_balances();
  double gravity_work() const; ///< Σ m g·u [J]. Collective
  void add_works(const std::vector<double>& works, ExactSum& sum) const;
  double driven_force(const DrivenComponent&) const;
  [[noreturn]] void fail_inverted(const Body<dim>& body, index_t element) const;

  WetFirstMesh<dim> reference_;
  std::vector<WetConfig> wet_;
  double step_safety_;
  Vec<dim> gravity_;
  std::vector<Body<dim>> bodies_;
  std::vector<NodalLoad<dim>> loads_;
  SolidNodes<dim> nodes_;
  std::vector<Vec<dim>> F_int_, F_ext_; ///< [N]
  std::vector<DrivenComponent> driven_;
  bool loads_are_full_ = false;
  Damping damping_;
  std::vector<Vec<dim>> F_viscous_, F_viscous_old_; ///< [N]; empty without damping
  std::vector<RigidBody<dim>> rigid_;
  std::optional<Beam> beam_; ///< 2-D only; then there are no bodies, and all nodes are ends of fibres
  std::vector<std::array<index_t, 2>> fibre_;
  std::vector<std::pair<std::size_t, BeamFace>> place_; ///< fibre and face of each node
  std::vector<std::array<Vec<2>, 2>> face_force_;       ///< [N]
  std::vector<DrivenFibre> driven_fibres_;
  std::vector<double> theta_sent_; ///< rotations of the last wet_surface()
  std::uint32_t surface_epoch_ = 0;
  std::optional<Contact<dim>> contact_;
  std::vector<Vec<dim>> F_contact_, F_contact_old_; ///< [N]; empty without contact
  std::vector<Vec<dim>> F_free_;                    ///< all other forces [N]; impulse contact only
  std::vector<FormulaLoad<dim>> formula_loads_;
  FieldFunction body_force_;                        ///< per mass
  std::vector<FieldFunction> driving_;              ///< formulas of prescribed velocities
  std::vector<Vec<dim>> F_formula_, F_formula_old_; ///< [N]; empty without formulas of loads

  std::vector<Vec<dim>> a_free_wet_; ///< M⁻¹ (F_ext − F_int) of the wet nodes at the last instant [m/s²]
  std::vector<Vec<dim>> f_link_;     ///< last link force [N]
  std::vector<Vec<dim>> step_of_wet_; ///< Δu of the wet nodes (of a beam: all nodes) in this step [m]

  std::vector<double> given_mass_;  ///< of the nodes, without mass scaling [kg]
  std::vector<double> added_mass_;  ///< by mass scaling, of each body [kg]
  bool measures_frequency_ = false; ///< the bound is multiplied by the ratio that was measured last
  double frequency_ratio_ = 1.0;    ///< true highest frequency squared over the bound
  double measured_bound_ = 0.0;     ///< the bound then [1/s²]
  std::int64_t measured_step_ = 0;

  double dt_before_ = 0.0;           ///< of the step before this one
  double t_origin_ = 0.0, dt_ = 0.0; ///< time = t_origin + steps_of_dt × dt, counted anew when dt changes
  std::int64_t steps_of_dt_ = 0, step_ = 0;
  double gravity_reference_ = 0.0; ///< Σ m g·u at the start [J]
  // Works at each node [J]; their sums have no order, so that they do not depend on who holds which.
  std::vector<double> external_work_;  ///< of loads, except gravity, and of prescribed motion
  std::vector<double> interface_work_; ///< wet nodes
  std::vector<double> viscous_work_;   ///< empty without damping
  std::vector<double> contact_work_;   ///< empty without contact

  NodeShare share_;
  mutable std::vector<double> wet_rows_; ///< interface_velocity() of several ranks
  std::vector<WholeBody> whole_;         ///< of each body; empty on one rank
};

} // namespace undine::solid
