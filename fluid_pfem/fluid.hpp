// The fluid: nodes, mesh and the acts of one explicit step.
#pragma once

#include "common/coupling/messages.hpp"
#include "common/io/state_archive.hpp"
#include "common/parallel/exact_sum.hpp"
#include "common/parallel/halo.hpp"
#include "fluid_pfem/critical_time_step.hpp"
#include "fluid_pfem/fluid_config.hpp"
#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/fluid_nodes.hpp"
#include "fluid_pfem/momentum.hpp"
#include "fluid_pfem/remesh/bisection.hpp"
#include "fluid_pfem/remesh/local_delaunay.hpp"
#include "fluid_pfem/remesh/refine_coarsen.hpp"
#include "fluid_pfem/remesh/rigid_motion.hpp"
#include "fluid_pfem/seeding.hpp"
#include "fluid_pfem/solid_surface.hpp"
#include "fluid_pfem/walls.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace undine::fluid
{

struct FluidEnergy
{
  double kinetic = 0.0; ///< ½ Σ M v^{n−1/2}·v^{n+1/2}: what leapfrog conserves; a node held by a wall has
                        ///< none, though half a kick into it; [J], per metre of depth in 2-D, as all below
  double internal = 0.0;       ///< Σ m e(ρ)
  double potential = 0.0;      ///< −Σ m g·x
  double dissipated = 0.0;     ///< by viscosity and bulk viscosity, cumulated
  double exchanged = 0.0;      ///< given by what moves mass between nodes (exchange and feedback), cumulated
  double remesh_gain = 0.0;    ///< rises of the sum of the three first at remeshes, cumulated, ≥ 0
  double remesh_loss = 0.0;    ///< falls of it, cumulated, ≤ 0
  double wall_work = 0.0;      ///< done by contact with rigid walls on the fluid, cumulated
  double interface_work = 0.0; ///< done by link forces on the fluid, cumulated
  double openings = 0.0; ///< carried in less carried out, and work of driven and impedance nodes, cumulated

  double total() const { return kinetic + internal + potential; }
};

/// What remeshing did so far. Volumes in m^dim.
struct RemeshLedger
{
  std::int64_t remeshes = 0, merged = 0, split = 0, deleted_nodes = 0;
  double created = 0.0;      ///< volume that became fluid (gaps closed)
  double dropped = 0.0;      ///< volume that was fluid and is not any more (holes, films)
  double deleted_mass = 0.0; ///< of isolated nodes that were deleted [kg]
};

/// Mass by state. Particle mass is conserved to round-off: meshed + flying + deleted + outflow − inflow.
struct FluidMass
{
  double meshed = 0.0; ///< Σ M of nodes in elements [kg]
  double flying = 0.0; ///< Σ M of isolated nodes
  double deleted = 0.0;
  double inflow = 0.0, outflow = 0.0; ///< through openings, cumulated
  double dynamic = 0.0;               ///< Σ m of nodes in elements
  double volume = 0.0;                ///< of the elements [m^dim]

  double total() const { return meshed + flying + deleted + outflow - inflow; }
};

/// What all nodes have in common in one step.
template <int dim>
struct Step
{
  double dt = 0.0;        ///< [s]
  double dt_before = 0.0; ///< the step before it [s]
  Vec<dim> g{};           ///< gravity at its end [m/s²]
  std::size_t number = 0; ///< in the sweep it is part of
};

/// Nodes of which a rank has the right rows during a remesh.
struct KnownNodes
{
  bool all = true;
  std::vector<index_t> list; ///< in order, unless all

  /// Of n nodes.
  template <class Act>
  void each(index_t n, Act&& act) const
  {
    if (!all)
      return static_cast<void>(std::for_each(list.begin(), list.end(), act));
    for (index_t k = 0; k < n; ++k)
      act(k);
  }
  const std::vector<index_t>* among() const { return all ? nullptr : &list; }
};

/// Particles of a rank before a remesh, from the one of number `begin` on.
template <int dim>
struct Particles
{
  index_t begin = 0;
  std::vector<double> M;   ///< [kg]
  std::vector<Vec<dim>> x; ///< [m]
  std::vector<Vec<dim>> v; ///< of the half step [m/s]
};

/// Groups of nodes.
struct Patches
{
  std::vector<index_t> of;    ///< for each node its patch, −1: none
  std::vector<index_t> first; ///< for each patch its first node
  std::vector<index_t> nodes; ///< those of a patch, ascending
};

/// Invariant: between two calls of step functions, V, rho, p and a belong to the positions x; wet nodes are
/// [0, n_wet).
///
/// On several ranks each numbers all nodes and elements, but steps only its part: a range of nodes, which in
/// the order of nodes are neighbours in space, and the elements that touch them. Rows of other nodes are
/// right at its ghosts, those of other elements nowhere; everywhere after collect(). In a remesh a rank gets
/// the rows of the nodes around its own, chooses the elements of its nodes, passes on what is now another's,
/// and goes on with its part. All ranks know identifiers, places in the order, surfaces and, where it is one,
/// the wanted spacing of all nodes. Wet nodes and their layer come first: the first ranks have them, as many
/// as their share takes. Results have the bits that they have on one rank.
template <int dim>
class Fluid
{
public:
  /// Seed the box, triangulate, set the initial density. @throws InputError for unknown surface names
  /// @param cut where the mesh is cut, at the start and in every remesh
  explicit Fluid(const FluidConfig& config, const Ranks& ranks = {}, Cut cut = even_cut);

  // --- one step, in this order; collective, as all that changes the state
  // --------------------------------------------------------------------------------------
  /// v ← v + Δt/2 a,  x ← x + Δt v.
  void predict(double dt);
  /// The same in two parts, for contact with a solid: between them v is v^{n−1/2} + Δt a^n, and the link
  /// pushes.
  void predict_velocity(double dt);
  void predict_position(double dt);
  /// v ← v + Δt M⁻¹ f on the wet nodes of this rank, between predict_velocity and predict_position. `f_link`
  /// [N], wet nodes of this rank × dim.
  void push(std::span<const double> f_link, double dt);
  /// M_ρ R = R₀ (7), p = p(ρ) (3), a = M⁻¹F (5), v ← v + Δt/2 a of the wet nodes: all that the coupler waits
  /// for.
  void solve_free_motion_of_interface(double dt);
  /// The same for all other nodes.
  void solve_free_motion_of_interior(double dt);
  void solve_free_motion(double dt);
  /// So many steps of equal length, for whoever does not look in between: predict and solve_free_motion of
  /// each, with the same bits, but where it can be in one sweep over the nodes.
  void advance(double dt, std::int64_t steps);
  /// How many of so many steps are made in one sweep, 1: none: in the plane, where nothing acts on a node but
  /// elements, weight and walls, and no rank has to compute much of what is others'. Collective.
  int in_one_sweep(std::int64_t steps);
  /// a ← a + M⁻¹f,  v ← v + Δt/2 M⁻¹f on the wet nodes of this rank. `f_link` [N], wet nodes of this rank ×
  /// dim.
  void correct_with_link(std::span<const double> f_link, double dt);

  // --- between steps
  // ------------------------------------------------------------------------------------------------
  /// Largest stable step, safety included [s]. Collective.
  double critical_time_step();
  /// An element is worse than the configured shape, the cap of steps is reached, or nodes may have come near
  /// the solid. Collective.
  bool is_distorted();
  /// The element of the worst shape, for a message: number, nodes, place, quality, height, pressure,
  /// velocity. Collective.
  std::string worst_element();
  /// New connectivity at a synchronised time: p, ρ and v of every node stay, m ← ρV, accelerations are
  /// recomputed (without link). Collective.
  void remesh();
  /// All rows of all fields are right on every rank until the next step; sums over time are on rank 0.
  /// Collective.
  void collect();
  const Ranks& ranks() const { return team_.ranks(); }
  /// First and one behind the last of the nodes, and of the elements, that this rank owns.
  std::array<index_t, 2> node_range() const { return {team_.node_begin(), team_.node_end()}; }
  std::array<index_t, 2> element_range() const { return {team_.element_begin(), team_.element_end()}; }
  double time() const { return t_; } ///< [s]
  /// The solid that the fluid may meet and leave, at the present time. From the first call on the wet nodes
  /// are those near it; the next remesh() goes by this surface.
  void meet_solid(const link::SurfaceMesh& solid);

  // --- what others ask for
  // ------------------------------------------------------------------------------------------
  const FluidNodes<dim>& nodes() const { return nodes_; }
  const FluidMesh<dim>& mesh() const { return mesh_; }
  const FluidConfig& config() const { return config_; }
  const std::vector<PlaneSurface<dim>>& surfaces() const { return surfaces_; }
  index_t n_wet() const { return n_wet_; }
  const RemeshLedger& ledger() const { return ledger_; }
  std::int64_t remeshes() const { return ledger_.remeshes; }
  const Walls<dim>& walls() const { return contact_; }
  Walls<dim>& walls() { return contact_; }
  std::int64_t steps() const { return steps_; }
  const DelaunayCount& triangulations() const { return delaunay_.count(); }

  /// Collective, unless collected; then works are right on rank 0 only.
  FluidEnergy energy() const;
  /// As in energy(), without the rest [J].
  double interface_work() const;
  /// Collective, unless collected.
  FluidMass mass_by_state() const;
  double mass() const { return mass_by_state().total(); } ///< particle mass [kg]
  Vec<dim> momentum() const;

  /// All wet nodes, on several ranks with the owner of each. Collective.
  link::SurfaceMesh wet_surface() const;
  /// First and one behind the last of the wet nodes that this rank owns: it exchanges their rows.
  std::array<index_t, 2> wet_range() const
  {
    const index_t begin = std::min(team_.node_begin(), n_wet_);
    return {begin, std::max(begin, std::min(team_.node_end(), n_wet_))};
  }
  /// Velocity of the wet nodes of this rank, so many × dim: the free velocity between
  /// solve_free_motion_of_interface and correct_with_link [m/s].
  std::span<const double> interface_velocity() const;
  link::Kinematics kinematics() const; ///< of the wet nodes of this rank
  /// v ← v + M⁻¹ impulse, a ← a_free + M⁻¹ link force, on the wet nodes of this rank.
  void apply_activation(const link::Activation& activation);

  /// All that a later step depends on; what follows from the configuration is made by the constructor.
  void for_each_state(StateArchive& archive);

  /// Overwrite velocities: initial conditions of tests and of cases.
  void set_velocity(const std::vector<Vec<dim>>& v);

private:
  /// Nodes this near to a solid are watched for contact with it, in units of the spacing.
  static constexpr double contact_reach = 2.0;
  /// So near to a wall a node is on it, in units of the spacing.
  static constexpr double on_wall_within = 0.02;
  /// So deep in the solid a node is put on its surface in a remesh, in units of the spacing.
  static constexpr double brought_out = 0.3;

  struct Move
  {
    double dt;       ///< [s]
    double speed;    ///< of the fastest node [m/s]
    double of_solid; ///< speed of its fastest node when it was shown last [m/s]
  };
  void move_on(const Move& move);

  /// Elements of spray may turn over between two looks at the mesh: their node keeps its pressure, and the
  /// next look finds them and remeshes. What is not over after so many steps is a blow-up.
  static constexpr int may_be_turned_over = 10;

  bool mesh_is_bad();
  bool any_rank(bool yes);
  void agree();
  void find_ghosts();
  void cool();
  /// This rank has wet nodes, or neighbours of some.
  bool has_interface() const { return n_wet_ > 0 && team_.node_begin() < n_layer_; }
  std::vector<index_t> wet_of_ranks() const;
  std::vector<ExactSum*> sums_over_time();
  FluidEnergy energy_of_state(bool whole, std::span<const Vec<dim>> v_half) const;
  FluidEnergy energy_of_parts(bool whole) const;
  /// Nodes over which this rank sums: its own, or all.
  std::array<std::size_t, 2> rows_to_sum(bool whole) const;
  std::vector<index_t> blocks_of_ranks() const;
  Step<dim> present_step(double dt) const;
  void push_off_walls(double dt);
  void push_off_walls(const Step<dim>& step, index_t block, typename Walls<dim>::Reaction& reaction);
  void find_half_step_velocity();
  void update_spacing(const KnownNodes& known);
  void triangulate();
  std::vector<char> slice_of_rank();
  double halo_width() const;
  KnownNodes look_around();
  void follow_changes(const SpacingReport& spacing, KnownNodes& known) const;
  void pass_rows(std::span<const index_t> held, std::vector<char>& moved);
  std::vector<Simplex<dim>> triangulation(std::span<const char> mine, const KnownNodes& known);
  void leave_room_for_solid(std::span<const char> mine, std::vector<Simplex<dim>>& simplices);
  void cling_to_solid();
  void renew_order();
  std::vector<char> part_of_rank(const SpacingReport& spacing) const;
  std::vector<Simplex<dim>> part_of_all(std::vector<Simplex<dim>> simplices) const;
  void finish_mesh();
  void connect_mesh(std::vector<Simplex<dim>> elements);
  void share_elements(std::vector<Simplex<dim>> sorted);
  void gather_state();
  void keep_own_rows();
  void gather_sums();
  std::span<const Simplex<dim>> own_elements() const;
  void keep_places();
  void measure_quality();
  void choose_slow_axis(const std::vector<index_t>* held);
  void renew_rows(const std::vector<index_t>* held);
  bool rows_are_due() const { return ledger_.remeshes % 25 == 0; } ///< all are made anew in this remesh
  std::vector<index_t> order_nodes(std::vector<Simplex<dim>>& elements, const std::vector<index_t>* held);
  bool in_boxes() const
  {
    return config_.order == NodeOrder::boxes || (dim == 3 && config_.order == NodeOrder::usual);
  }
  std::int64_t row_of(const Vec<dim>& x) const;
  std::vector<char> wet_groups(const std::vector<Simplex<dim>>& elements, const std::vector<index_t>* held);
  void flag_nodes();
  std::vector<index_t> delete_isolated_nodes(std::vector<Simplex<dim>>& elements,
                                             const std::vector<index_t>* held);
  std::vector<index_t> moved_nodes(const Particles<dim>& before, std::span<const index_t> number,
                                   const SpacingReport& spacing) const;
  std::vector<Simplex<dim>> changed_elements(std::vector<Simplex<dim>> old, std::span<const char> moved,
                                             std::span<const index_t> number) const;
  void hand_over_mass(const std::vector<Simplex<dim>>& changed, const Particles<dim>& before,
                      std::span<const index_t> number, std::span<const double> V_before,
                      std::vector<Vec<dim>>& v_half);
  std::vector<double> gather_patches(const Patches& patches, std::span<const double> V_before,
                                     std::span<Vec<dim>> v_half);
  Vec<dim> from_first(const Patches& patches, index_t patch, const Vec<dim>& x) const;
  std::vector<MassesInMotion<dim>> motion_of(const Patches& patches, std::span<const Vec<dim>> v_half) const;
  void keep_momenta(const Patches& patches, std::span<const MassesInMotion<dim>> had,
                    std::span<Vec<dim>> v_half);
  Vec<dim> as_it_may(Vec<dim> dv, std::size_t n) const;
  std::vector<index_t> erase_nodes(const std::vector<char>& gone, std::vector<Simplex<dim>>& elements,
                                   const std::vector<index_t>* held);
  void drop_fragments(ShapeChoice<dim>& choice) const;
  void pass_openings();
  bool row_is_due() const;
  void book_opening(int kind, double factor, double other);
  double openings_energy() const;
  void find_impedance();
  void let_waves_out(double dt, bool book);
  void smooth_mass_defect(std::vector<Vec<dim>>& v_half);
  struct OnPieces
  {
    index_t node;
    std::array<int, 3> pieces;
  };
  std::vector<OnPieces> nodes_on_walls() const;
  std::vector<std::array<int, 3>> wall_pieces() const;
  void constrain(Vec<dim>& w, index_t n) const;
  void kick(double dt, index_t begin, index_t end);
  template <bool kicks>
  double move_nodes(double dt, index_t begin, index_t end);
  index_t update_state(index_t begin, index_t end);
  void limit_tension(index_t begin, index_t end);
  void add_element_forces(const Step<dim>& step, const index_t* list, index_t begin, index_t end,
                          const Share& share, ShapeLook* look = nullptr);
  void accelerate(const Step<dim>& step, index_t begin, index_t end);
  void constrain_velocities();
  void constrain_accelerations(index_t begin, index_t end);
  void add_body_force(index_t begin, index_t end);
  bool forces_are_local() const;
  double time_to_book(double dt);
  void exchange_mass(const Step<dim>& step, double booked, index_t begin, index_t end);
  static constexpr int most_steps = 8; ///< of one sweep
  struct InFlight;
  struct SweepOfThread;
  struct Rung;
  void skew(double dt, int steps);
  InFlight in_flight(const Step<dim>& step, double booked, std::size_t thread, int steps) const;
  void sweep_nodes(SweepOfThread& thread, int steps);
  bool take_block(SweepOfThread& thread, InFlight& step, index_t may_move);
  void move(SweepOfThread& thread, InFlight& step, index_t end);
  void find_state(InFlight& step, index_t end);
  bool may_sweep() const;
  void find_reach();
  void find_surroundings();
  std::span<const index_t> before_elements_here() const;
  void find_far_halo();
  void find_reach_of_blocks();
  int find_ladders();
  std::vector<Rung> ladder_from(index_t begin, int steps) const;
  bool far_from_blow_up(int steps) const;
  template <class Act>
  void split_by_owner(index_t begin, index_t end, Act&& act) const;
  void check_state(index_t bad_node);
  void check_places() const;
  Vec<dim> gravity() const;
  double least_inertia(std::size_t i) const;
  double sound_speed() const { return config_.tait.sound_speed(config_.tait.rho0); }
  SurfaceMask surface_bit(const std::string& name, const std::string& what) const;

  FluidConfig config_;
  std::vector<PlaneSurface<dim>> surfaces_;
  std::vector<WallKind> wall_kind_; ///< per surface; meaningful where wall_mask_ is set
  SurfaceMask wall_mask_ = 0, wet_mask_ = 0, impedance_mask_ = 0;
  struct ImpedanceNode
  {
    std::size_t node;
    Vec<dim> area; ///< of the boundary around it, outward [m^(dim−1)]
  };
  std::vector<ImpedanceNode> impedance_; ///< of all ranks
  struct OpeningWork
  {
    std::int64_t turn;    ///< twice the step, and one more for driven nodes
    double factor, other; ///< of the work [J]
  };
  std::vector<OpeningWork> opening_works_; ///< at nodes of this rank since the ranks last agreed, if several
  Openings<dim> openings_;
  double highest_ = 0.0; ///< potential −g·x of the first body's surface at the start, where p = p₀ [m²/s²]
  Walls<dim> contact_;
  SizeField<dim> size_;
  std::function<bool(const Vec<dim>&)> inside_; ///< where fluid is at the start; empty: one convex body
  SolidSurface<dim> solid_;
  double travel_ = 0.0; ///< of the fastest fluid and solid nodes since the wet nodes were chosen [m]
  FluidNodes<dim> nodes_;
  FluidMesh<dim> mesh_;
  LocalDelaunay<dim> delaunay_{config_.threads};
  ElementSums<dim> sums_;
  Team team_;
  Halo halo_;
  /// When, in the plane, the state of a block of nodes is found: while positions of ghosts travel, when they
  /// are here (blocks with nodes that other ranks have copies of), or while records of ghosts travel.
  enum class Turn : std::uint8_t
  {
    first,
    at_cut,
    last
  };
  std::vector<Turn> turns_;            ///< of each block of nodes; on one rank none
  Halo layer_halo_;                    ///< of it the nodes that forces on wet nodes come from
  bool collected_ = true;              ///< rows of other ranks are right
  std::vector<Move> moves_;            ///< of the nodes of this rank, since the ranks last agreed
  std::vector<Simplex<dim>> own_gaps_; ///< that this rank watches, if there are several
  std::vector<double> fastest_;        ///< squared speed of the fastest node of each share [m²/s²]
  std::vector<index_t> bad_;           ///< a node of each share whose elements have turned over, or −1
  /// Of a block of elements in a sweep of several steps: nodes below these numbers have to have moved and to
  /// know their state before it, and have all their forces after it.
  struct Reach
  {
    index_t moved, known, complete;
  };
  std::vector<Reach> reach_; ///< of each block of elements here
  /// Nodes [begin, end).
  struct Range
  {
    index_t begin = 0, end = 0;
  };
  /// From the lowest to the highest number of the nodes of this rank, with their neighbours, with those of
  /// these, …: what is needed to go on with the ones before. One rank: all nodes.
  std::vector<Range> around_;
  struct Taken
  {
    Range elements; ///< what forces of a step come from
    Range inner;    ///< of them those without a corner that gets none
  };
  /// Where the nodes of two threads meet in one step of a sweep: the first ones that the upper thread moves,
  /// finds the state of, gives their forces, exchanges mass of.
  struct Rung
  {
    index_t moves = 0, knows = 0, gets = 0, exchanges = 0;
    index_t element = 0;          ///< its first, begin of a block
    index_t inner_end = 0;        ///< elements before this one touch none of its nodes
    std::vector<index_t> earlier; ///< elements of the lower thread that do, in order
  };
  std::vector<std::vector<Rung>>
      ladders_;                 ///< between thread k of this rank and the next: a rung for each step
  std::vector<Taken> taken_;    ///< of a step that so many others follow; one rank: of any
  Range elements_here_;         ///< what a sweep of several steps may take; of others, copies
  Halo far_halo_;               ///< the widest of `around_` without the nodes of this rank
  bool reach_is_found_ = false; ///< for this mesh; else `reach_`, `ladders_`, `far_halo_` are of another one
  int sweep_steps_ = 1;         ///< so many at most
  int turned_over_agreed_ = 0;  ///< most of all ranks, when they last agreed
  std::int64_t agreed_at_ = 0;  ///< step
  mutable StepWorkspace workspace_;
  UntouchedRows<double> mass_rate_; ///< stabilising mass flux into each node [kg/s]
  UntouchedRows<double>
      exchange_energy_;              ///< given to each node by what moves mass, since the last remesh [J]
  ExactSum exchange_of_all_;         ///< its sum when the rows were collected
  double unbooked_ = 0.0;            ///< time since that was last booked [s]
  double exchanged_ = 0.0;           ///< the same of all nodes before the last remesh [J]
  index_t n_wet_ = 0;                ///< nodes on an interface
  index_t n_layer_ = 0;              ///< wet nodes and their neighbours
  index_t e_wet_ = 0;                ///< elements that touch wet nodes
  index_t e_layer_ = 0;              ///< elements that touch wet nodes or their neighbours
  std::vector<index_t> constrained_; ///< nodes on walls of the box
  std::vector<double> f_link_;       ///< last link force, n_wet × dim; right at the nodes of this rank
  UntouchedRows<float> quality_;     ///< of each element at the last remesh
  UntouchedRows<Vec<dim>> x_remesh_; ///< positions at the last remesh; during one, at its begin
  double coarsest_ = 0.0;            ///< spacing wanted somewhere, at the last remesh [m]
  std::vector<Vec<dim>> v_half_;     ///< velocities of the half step, during a remesh
  std::vector<Simplex<dim>> gaps_;   ///< between boundaries of the fluid, at the last remesh
  std::int64_t good_for_ = 0;        ///< so many times remesh_every the mesh was found to be still good
  std::int64_t good_at_ = -1;        ///< after this step no element of this rank was worse than it may be
  double travelled_ = 0.0;           ///< by the fastest nodes since the last remesh [m]
  int slow_axis_ = dim - 1;          ///< along which nodes are numbered last
  Bisection<dim> boxes_; ///< if these are their order, of the nodes when all rows were renewed last
  global_index_t next_id_ = 0;
  double t_ = 0.0, dt_before_ = 0.0;
  int turned_over_ = 0; ///< steps with a node of negative volume since the last remesh
  std::int64_t steps_ = 0, steps_since_remesh_ = 0;
  std::uint32_t surface_epoch_ = 0;
  RemeshLedger ledger_;
  double dissipated_ = 0.0; ///< before the last remesh [J]
  double remesh_gain_ = 0.0, remesh_loss_ = 0.0, openings_energy_ = 0.0, inflow_ = 0.0, outflow_ = 0.0;
  ExactSum interface_work_; ///< of the link forces on the nodes of this rank [J]
};

} // namespace undine::fluid
