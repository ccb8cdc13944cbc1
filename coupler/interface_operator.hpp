// The condensed interface operator H = α_f L_f M_f⁻¹ L_fᵀ + α_s L_s M_s⁻¹ L_sᵀ and the solution for the
// multipliers.
#pragma once

#include "coupler/gradients.hpp"

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>

#include <array>
#include <cstdint>
#include <memory>
#include <span>

namespace undine::coupler
{

using SparseMatrix = Eigen::SparseMatrix<double>;
using Vector = Eigen::VectorXd;

inline std::span<double> as_span(Vector& v) { return {v.data(), static_cast<std::size_t>(v.size())}; }
inline std::span<const double> as_span(const Vector& v)
{
  return {v.data(), static_cast<std::size_t>(v.size())};
}

enum Side
{
  fluid = 0,
  solid = 1
};
inline constexpr std::array<Side, 2> both_sides{Side::fluid, Side::solid};
inline Side other(Side side) { return side == Side::fluid ? Side::solid : Side::fluid; }

/// Rows of H that touch movable mass; `diagonal`: of H for any weights, or of its parts.
Eigen::Array<bool, Eigen::Dynamic, 1> movable_rows(const Vector& diagonal);

/// One side of the interface: the constraint L_f v_f + L_s v_s = 0 holds the opposite signs inside the two L.
struct InterfaceSide
{
  SparseMatrix L;            ///< multipliers × (nodes · dim), includes the sign
  SparseMatrix inverse_mass; ///< (nodes · dim)², nearly block diagonal [1/kg]
};

/// How H λ = rhs is solved.
enum class Solver
{
  factor,    ///< LDLᵀ, once for each pair of weights
  gradients, ///< conjugate gradients, on all ranks of the coupler
  row_sums   ///< not: by the row sums of H instead of H ("lumped")
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
  /// team: other ranks of the coupler, which are in help(), for the gradients; nullptr: alone.
  /// @throws InputError for row sums if the largest eigenvalue of D⁻¹ L M⁻¹ Lᵀ of a side exceeds 1
  InterfaceOperator(InterfaceSide fluid, InterfaceSide solid, Solver solver = Solver::factor,
                    const link::Team* team = nullptr);

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
  /// @param start  where gradients start from, for example the last λ; nothing: from zero
  /// @throws NumericalError if H is not positive definite (two rows say the same thing)
  Vector solve(double alpha_fluid, double alpha_solid, const Vector& rhs, const Vector& start = {});

  /// L M⁻¹ Lᵀ x of one side.
  Vector product(Side side, const Vector& x) const;
  /// H; not for gradients, which do without.
  SparseMatrix assemble(double alpha_fluid, double alpha_solid) const;
  std::int64_t factorisations() const { return factorisations_; }
  std::int64_t iterations() const { return iterations_; } ///< of conjugate gradients

private:
  void lump();
  Vector by_gradients(const std::array<double, 2>& weights, const Vector& rhs, const Vector& start);

  std::array<InterfaceSide, 2> side_;
  std::array<Vector, 2> lumped_;          ///< row sums of each condensed operator; empty: exact
  std::array<SparseMatrix, 2> condensed_; ///< L M⁻¹ Lᵀ; empty: gradients
  Eigen::Array<bool, Eigen::Dynamic, 1> free_row_;
  SparseMatrix held_rows_; ///< identity on the rows that are not free
  Vector row_scale_;       ///< row sums of |L_s|
  std::unique_ptr<Eigen::SimplicialLDLT<SparseMatrix>> factor_ =
      std::make_unique<Eigen::SimplicialLDLT<SparseMatrix>>();
  std::array<double, 2> factored_for_{0.0, 0.0};
  bool pattern_known_ = false;
  std::int64_t factorisations_ = 0;
  std::unique_ptr<Gradients> gradients_;
  std::int64_t iterations_ = 0;
};

} // namespace undine::coupler
