// The condensed interface operator H = α_f L_f M_f⁻¹ L_fᵀ + α_s L_s M_s⁻¹ L_sᵀ and its factor.
#pragma once

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>

#include <array>
#include <cstdint>
#include <memory>

namespace undine::coupler
{

using SparseMatrix = Eigen::SparseMatrix<double>;
using Vector = Eigen::VectorXd;

enum Side
{
  fluid = 0,
  solid = 1
};
inline constexpr std::array<Side, 2> both_sides{Side::fluid, Side::solid};
inline Side other(Side side) { return side == Side::fluid ? Side::solid : Side::fluid; }

/// One side of the interface: the constraint L_f v_f + L_s v_s = 0 holds the opposite signs inside the two L.
struct InterfaceSide
{
  SparseMatrix L;            ///< multipliers × (nodes · dim), includes the sign
  SparseMatrix inverse_mass; ///< (nodes · dim)², nearly block diagonal [1/kg]
};

/// H with weights α = Δt/2 of each side (velocity continuity), or α = 1 (accelerations and impulses).
/// Rows that touch no movable mass on either side carry no constraint: their multiplier is zero.
///
/// Lumped: H_L = α_f D_f + α_s D_s instead, D the row sums of each condensed operator. It needs no factor;
/// the velocities then keep a jump of Δt/2 (H_L − H)λ. The scheme loses energy, and makes none, where H ≤ H_L
/// as quadratic forms, which is so for every α if it is so for both sides.
class InterfaceOperator
{
public:
  InterfaceOperator() = default;
  /// @throws InputError if `lumped` and the largest eigenvalue of D⁻¹ L M⁻¹ Lᵀ of a side exceeds 1
  InterfaceOperator(InterfaceSide fluid, InterfaceSide solid, bool lumped = false);

  Eigen::Index n_multipliers() const { return free_row_.size(); }
  Eigen::Index n_dofs(Side side) const { return side_[side].L.cols(); }

  /// L v of one side.
  Vector constraint(Side side, const Vector& v) const { return side_[side].L * v; }
  /// Nodal force Lᵀ λ of one side [N].
  Vector force(Side side, const Vector& lambda) const { return side_[side].L.transpose() * lambda; }
  /// M⁻¹ f of one side.
  Vector acceleration(Side side, const Vector& f) const { return side_[side].inverse_mass * f; }

  /// Largest |jump_i| over the row sum of |L_s| of row i: a jump L_f v_f + L_s v_s in units of v.
  double largest_jump(const Vector& jump) const;

  /// λ with H λ = rhs. Factorises only if the weights differ from those of the last call.
  /// @throws NumericalError if H is not positive definite (two rows say the same thing)
  Vector solve(double alpha_fluid, double alpha_solid, const Vector& rhs);

  SparseMatrix assemble(double alpha_fluid, double alpha_solid) const;
  std::int64_t factorisations() const { return factorisations_; }

private:
  void lump();

  std::array<InterfaceSide, 2> side_;
  std::array<Vector, 2> lumped_;          ///< row sums of each condensed operator; empty: exact
  std::array<SparseMatrix, 2> condensed_; ///< L M⁻¹ Lᵀ
  Eigen::Array<bool, Eigen::Dynamic, 1> free_row_;
  SparseMatrix held_rows_; ///< identity on the rows that are not free
  Vector row_scale_;       ///< row sums of |L_s|
  std::unique_ptr<Eigen::SimplicialLDLT<SparseMatrix>> factor_ =
      std::make_unique<Eigen::SimplicialLDLT<SparseMatrix>>();
  std::array<double, 2> factored_for_{0.0, 0.0};
  bool pattern_known_ = false;
  std::int64_t factorisations_ = 0;
};

} // namespace undine::coupler
