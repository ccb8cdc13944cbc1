// The Gravouil-Combescure window: velocity continuity at every fine instant, each side with a time step of
// its own.
//
// Scheme GC-F. Both sides integrate with central differences (Newmark β = 0, γ = ½), so positions do not
// depend on the multiplier of the same instant and a link force f only adds Δt/2 M⁻¹ f to the free velocity.
// With the coarse step ΔT = m Δt,
//
//   H λʲ = −( L_c [(1 − j/m) v_c,free⁰ + (j/m) v_c,free¹] + L_q v_q,freeʲ ),   H = ½ΔT L_c M_c⁻¹ L_cᵀ + ½Δt
//   L_q M_q⁻¹ L_qᵀ,
//
// the fine side q is corrected with every λʲ, the coarse side c with the last one only. It is the *free*
// coarse velocity that is interpolated, at both ends; interpolating from the total velocity is unstable for
// every m ≥ 2 (the tests show it). Gravouil & Combescure (2001); Combescure & Gravouil (2001), ref. [7] of
// Meduri et al. (2017), sec. 4.
#pragma once

#include "common/io/state_archive.hpp"
#include "coupler/interface_operator.hpp"
#include "coupler/partner.hpp"

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

namespace undine::coupler
{

/// What the interface did, cumulated since the start. Work of the link on a side over one of its steps is
/// Δt ½(f⁰ + f¹)·½(v⁰ + v¹), which is exactly its contribution to the side's kinetic energy.
struct InterfaceBalance
{
  std::array<double, 2> work{0.0, 0.0};    ///< [J] done by the link on each side
  std::array<double, 2> impulse{0.0, 0.0}; ///< [N s] norm of the cumulated impulse vector of each side
  double impulse_mismatch = 0.0;           ///< [N s] norm of the sum of both impulse vectors
  double activation_loss = 0.0;            ///< [J] lost in plastic activations, ≥ 0
  double velocity_jump = 0.0; ///< [m/s] largest |L_f v_f + L_s v_s| over its row sum, at the last window end
  double displacement_gap = 0.0; ///< [m] the same for integrated velocities
};

/// Sizes of one window: `m` equal fine steps inside one coarse step.
struct WindowSteps
{
  Side fine = Side::fluid;
  std::int64_t m = 1;
  double coarse_dt = 0.0; ///< ΔT [s]

  Side coarse() const { return other(fine); }
  double fine_dt() const { return coarse_dt / static_cast<double>(m); }
  double dt(Side side) const { return side == fine ? fine_dt() : coarse_dt; }
};

class GravouilCombescure
{
public:
  /// `dim` groups the rows of the wet-surface vectors (for the impulse ledger only).
  GravouilCombescure(InterfaceOperator H, int dim);

  /// Compatible state at a synchronised time: plastic projection of the velocities (no velocity jump) and
  /// link forces that leave no acceleration jump. Needed at the start and whenever L or M change.
  /// @param v,a_free velocity and M⁻¹F of each side [m/s, m/s²]
  /// @returns for each side the nodal impulse [N s] and link force [N] it must apply
  struct Start
  {
    std::array<Vector, 2> impulse;
    std::array<Vector, 2> link_force;
  };
  Start activate(const std::array<Vector, 2>& v, const std::array<Vector, 2>& a_free);

  /// Replace the operator after a change of the wet nodes or their masses; must be followed by activate().
  void replace_operator(InterfaceOperator H);
  /// Replace the operator after the same wet nodes have moved: normals turned, faces slid along each other.
  /// The state stays.
  void turn_operator(InterfaceOperator H);

  /// One window. The partners are asked in the order of the scheme; the coarse side is served last.
  void advance(const WindowSteps& steps, Partner& fluid, Partner& solid);

  /// One window continuous at its end only, the force linear in time inside it (Prakash & Hjelmstad 2004):
  /// no energy is lost. The force at the end is found by trials of the fine side, whose answer to it is
  /// nearly linear.
  /// @param again the fine side goes back to the window's begin and runs it once more, `trial`: not for good;
  /// the fine side comes to this function on trial already
  /// @throws NumericalError if 50 trials leave a velocity jump above 1e-8 of the largest velocity (1e-10 is
  /// tried ten times)
  void advance_macro(const WindowSteps& steps, Partner& fluid, Partner& solid,
                     const std::function<void(bool trial)>& again);

  /// One step `dt` of both sides, in whose middle they exchange: velocities at half steps meet, so the gap
  /// of the positions stays what it was. The works are those that the sides report (set_work).
  void advance_half_step(double dt, Partner& fluid, Partner& solid);
  void set_work(Side side, double work) { balance_.work[side] = work; }

  /// For a solid that takes forces and returns velocities (level A), here as a body of infinite mass whose
  /// velocity is given: the multiplier moves the fluid along.
  /// Start: impulse and link force of the fluid; the solid's is minus it.
  Start activate_prescribed(const Vector& v_fluid, const Vector& a_free_fluid, const Vector& v_solid);
  /// One step `dt` of the fluid to the given velocity of the solid at its end. The force on the solid, for
  /// its next step, is state().f[Side::solid].
  void advance_prescribed(double dt, Partner& fluid, const Vector& v_solid);
  /// Largest eigenvalue q of (L_f M_f⁻¹ L_fᵀ)⁻¹ (L_s M_s⁻¹ L_sᵀ): mass of the fluid over mass of the solid at
  /// the interface, worst mode. Staggering is stable for q < 1 only: a wrong velocity comes back −q times.
  double added_mass_ratio();

  /// All that a later window depends on: velocities and link forces of both sides at the last synchronised
  /// time.
  struct State
  {
    std::array<Vector, 2> v; ///< total velocity [m/s]
    std::array<Vector, 2> f; ///< link force [N]
  };
  State state() const { return {v_, f_}; }
  void restore(const State& state);

  void for_each_state(StateArchive& archive);

  /// ∫v dt of the wet nodes of a side since the wet nodes were last replaced [m].
  const Vector& travel(Side side) const { return travel_[side]; }

  /// Mean link force on a side in the last window [N]: what its impulse divided by the window is.
  std::span<const double> window_force(Side side) const
  {
    return {window_force_[side].data(), static_cast<std::size_t>(window_force_[side].size())};
  }

  const InterfaceBalance& balance() const { return balance_; }
  std::int64_t factorisations() const { return factorisations_ + H_.factorisations(); }
  std::int64_t iterations() const { return iterations_ + H_.iterations(); } ///< of conjugate gradients
  const Vector& lambda() const { return lambda_; }

private:
  /// λ ← H⁻¹ rhs, sought from where the last two point to.
  void next_lambda(double alpha_fluid, double alpha_solid, const Vector& rhs);
  void record_step(Side side, double dt, const Vector& v_new, const Vector& f_new);
  void record_window();
  void start_side(Side side, const Vector& v, const Vector& Lambda, Start& start);

  InterfaceOperator H_;
  int dim_;
  /// What changes of the multiplier have made of the velocity jump at the window's end: macro continuity
  /// learns the answer of the fine side from it.
  struct Secants
  {
    std::vector<Vector> of_lambda, of_jump;
    double dT = 0.0, dt = 0.0; ///< steps they belong to [s]

    void learn(const Vector& d_lambda, const Vector& d_jump);
    /// The change of the multiplier that makes the jump, as far as changes seen so far combine to it, and the
    /// rest of the jump.
    std::pair<Vector, Vector> predict(const Vector& jump) const;
  };

  Secants secants_;
  Vector lambda_before_; ///< multiplier of the step before; macro continuity: at the begin of the last window
  Vector lambda_;
  std::array<Vector, 2> v_;      ///< total velocity of each side at the last synchronised time
  std::array<Vector, 2> f_;      ///< link force of each side at that time
  std::array<Vector, 2> travel_; ///< ∫ v dt since the start
  std::array<Vector, 2> impulse_;
  std::array<Vector, 2> window_force_; ///< ∫ f dt of the window so far, at its end divided by it
  std::array<double, 2> window_time_{0.0, 0.0};
  InterfaceBalance balance_;
  std::int64_t factorisations_ = 0, iterations_ = 0; ///< of operators that were replaced
};

} // namespace undine::coupler
