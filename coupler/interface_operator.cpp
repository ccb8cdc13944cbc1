// Assembly and factorisation of the condensed interface operator.
#include "coupler/interface_operator.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace undine::coupler
{

InterfaceOperator::InterfaceOperator(InterfaceSide fluid, InterfaceSide solid)
    : side_{std::move(fluid), std::move(solid)}
{
  require(side_[0].L.rows() == side_[1].L.rows(), "both sides of the interface have the same multipliers");
  for (const Side s : both_sides)
    condensed_[s] = side_[s].L * side_[s].inverse_mass * SparseMatrix(side_[s].L.transpose());

  const Eigen::Index n = side_[0].L.rows();
  free_row_.resize(n);
  const Vector d = condensed_[0].diagonal() + condensed_[1].diagonal();
  const double largest = n > 0 ? d.maxCoeff() : 0.0;
  for (Eigen::Index i = 0; i < n; ++i)
    free_row_[i] = d[i] > 1e-12 * largest;

  std::vector<Eigen::Triplet<double>> held;
  for (Eigen::Index i = 0; i < n; ++i)
    if (!free_row_[i])
      held.emplace_back(i, i, 1.0);
  held_rows_.resize(n, n);
  held_rows_.setFromTriplets(held.begin(), held.end());

  row_scale_ = side_[Side::solid].L.cwiseAbs() * Vector::Ones(side_[Side::solid].L.cols());
}

double InterfaceOperator::largest_jump(const Vector& jump) const
{
  double largest = 0.0;
  for (Eigen::Index i = 0; i < jump.size(); ++i)
    if (free_row_[i] && row_scale_[i] > 0.0)
      largest = std::max(largest, std::abs(jump[i]) / row_scale_[i]);
  return largest;
}

SparseMatrix InterfaceOperator::assemble(double alpha_fluid, double alpha_solid) const
{
  SparseMatrix H = alpha_fluid * condensed_[Side::fluid] + alpha_solid * condensed_[Side::solid];
  // A row without movable mass decouples and gets the identity, so that its multiplier is zero.
  for (Eigen::Index k = 0; k < H.outerSize(); ++k)
    for (SparseMatrix::InnerIterator it(H, k); it; ++it)
      if (!free_row_[it.row()] || !free_row_[it.col()])
        it.valueRef() = 0.0;
  H += held_rows_;
  return H;
}

Vector InterfaceOperator::solve(double alpha_fluid, double alpha_solid, const Vector& rhs)
{
  if (rhs.size() == 0)
    return rhs;
  const std::array<double, 2> weights{alpha_fluid, alpha_solid};
  if (!pattern_known_ || weights != factored_for_)
  {
    const SparseMatrix H = assemble(alpha_fluid, alpha_solid);
    if (!pattern_known_)
      factor_->analyzePattern(H);
    factor_->factorize(H);
    ++factorisations_;
    pattern_known_ = true;
    factored_for_ = weights;
    if (factor_->info() != Eigen::Success || !(factor_->vectorD().minCoeff() > 0.0))
      throw NumericalError(
          "the interface operator H is not positive definite: two interface rows constrain the same "
          "motion (do two interfaces share a facet, or do both sides prescribe the same velocity?)");
  }
  Vector lambda = factor_->solve(free_row_.select(rhs.array(), 0.0).matrix());
  return lambda;
}

} // namespace undine::coupler
