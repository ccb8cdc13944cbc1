// Conjugate gradients for the multipliers of large interfaces, shared by the ranks of the coupler.
//
// H λ = rhs with H = Σ_s α_s L_s M_s⁻¹ L_sᵀ, never assembled: a product is λ → M_s⁻¹L_sᵀ λ → L_s M_s⁻¹L_sᵀ λ.
// Preconditioned by the diagonal D of H; it ends when ‖r‖ ≤ tolerance ‖rhs‖, r = rhs − Hλ, ‖r‖² = rᵀD⁻¹r.
// r is the velocity jump that is left of the free motion's jump rhs, and the error of λ in the norm of H,
// whose square is twice the energy of the motion that λ makes, is at most √κ tolerance of it, κ the condition
// of D⁻¹H. Action is reaction whatever λ is.
//
// The same bits on any number of ranks: a number is the sum of a row in the order of the row, whoever adds
// it, and a scalar product that of blocks of fixed length, added in their order by everyone.
#pragma once

#include "common/coupling/team.hpp"
#include "common/coupling/wire.hpp"

#include <Eigen/SparseCore>

#include <array>
#include <cstddef>
#include <vector>

namespace undine::coupler
{

struct InterfaceSide;

using Rows = Eigen::SparseMatrix<double, Eigen::RowMajor>;

/// Rows of H in stretches, one for each rank. All members are collective; what rank 0 gives them it tells the
/// others, which are in help() and repeat the call.
class Gradients
{
public:
  using Vector = Eigen::VectorXd;
  static constexpr double tolerance = 1e-12;
  static constexpr int most = 5000; ///< iterations

  /// team: ranks that share the work, all of them in this call, or nullptr: alone. It must live as long.
  /// side: on rank 0 whole, on others what rank 0 hands them.
  Gradients(const std::array<InterfaceSide, 2>& side, const link::Team* team);

  /// Diagonal of both sides' L M⁻¹ Lᵀ together, of all rows.
  const Vector& diagonal() const { return diagonal_; }

  struct Solution
  {
    Vector lambda; ///< on rank 0
    int iterations = 0;
    bool found = false; ///< no: H is not positive definite, or `most` iterations were not enough
  };
  /// λ with H λ = rhs for the weights α of both sides, and 0 in rows whose diagonal is. All finite.
  /// @param start  a guess; a bad one is dropped
  Solution solve(const std::array<double, 2>& weights, const Vector& rhs, const Vector& start);

  /// What a helper does when rank 0 calls the constructor, or solve().
  static Gradients receive(const link::Team& team);
  void help(link::wire::Reader in);

private:
  /// What the stretch of this rank needs of one side.
  struct Part
  {
    Rows response;   ///< M⁻¹Lᵀ: the velocities that L asks for × multipliers
    Rows constraint; ///< L: the stretch × these velocities
    Vector diagonal; ///< of their product, in the stretch
    Vector velocity;
  };
  static Part part_of(const InterfaceSide& side, Eigen::Index begin, Eigen::Index end);

  /// To each helper what its stretch needs of both sides.
  void hand_out(const std::array<InterfaceSide, 2>& side) const;
  bool leads() const { return team_ != nullptr && team_->size() > 1 && team_->rank() == 0; }
  void share(double* all, const link::Stretches& stretches) const;
  /// The stretch of H x.
  void apply(const std::array<double, 2>& weights, const Vector& x, Vector& Hx);
  /// aᵀb of all ranks' stretches.
  double dot(const double* a, const double* b);

  const link::Team* team_;
  Eigen::Index n_, begin_ = 0, size_ = 0; ///< all rows; the stretch
  link::Stretches rows_;                  ///< wanted: the multipliers that `response` asks for
  link::Stretches blocks_;
  std::array<Part, 2> part_;
  Vector diagonal_;
  Eigen::Array<bool, Eigen::Dynamic, 1> movable_; ///< rows of the stretch
  std::vector<double> block_sum_;
};

} // namespace undine::coupler
