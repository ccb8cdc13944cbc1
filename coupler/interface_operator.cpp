// Assembly and factorisation of the condensed interface operator.
#include "coupler/interface_operator.hpp"

#include "common/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace undine::coupler
{

namespace
{

/// Largest eigenvalue of D⁻¹C with D the row sums of C, symmetric and positive semi-definite; infinite if a
/// row with entries has no positive sum. Without negative entries it is 1 (Perron), and nothing is iterated.
double largest_over_row_sums(const SparseMatrix& C, const Vector& D)
{
  bool negative = false;
  Vector scale = Vector::Zero(D.size());
  const double small = 1e-12 * C.diagonal().maxCoeff();
  for (Eigen::Index k = 0; k < C.outerSize(); ++k)
  {
    if (C.coeff(k, k) > small && !(D[k] > small))
      return std::numeric_limits<double>::infinity();
    if (D[k] > small)
      scale[k] = 1.0 / D[k];
    for (SparseMatrix::InnerIterator it(C, k); it; ++it)
      negative = negative || it.value() < -small;
  }
  double largest = 1.0;
  Vector x(D.size());
  for (Eigen::Index k = 0; k < x.size(); ++k)
    x[k] = std::sin(static_cast<double>(k * k + 1));          // of no symmetry
  for (int k = 0; negative && k < 200 && x.norm() > 0.0; ++k) // similar to a symmetric matrix
  {
    x = (scale.array() * (C * (x / x.norm())).array()).matrix();
    largest = x.norm();
  }
  return largest;
}

constexpr const char* twice = "two interface rows constrain the same motion (do two interfaces share a "
                              "facet, or do both sides prescribe the same velocity?)";

} // namespace

Eigen::Array<bool, Eigen::Dynamic, 1> movable_rows(const Vector& diagonal)
{
  const double largest = diagonal.size() > 0 ? diagonal.maxCoeff() : 0.0;
  return diagonal.array() > 1e-12 * largest;
}

void InterfaceOperator::lump()
{
  constexpr double round_off = 1e-9;
  for (const Side s : both_sides)
  {
    lumped_[s] = condensed_[s] * Vector::Ones(condensed_[s].cols());
    const double largest = largest_over_row_sums(condensed_[s], lumped_[s]);
    if (largest > 1.0 + round_off)
      throw InputError(
          fmt::format("coupling.operator = \"lumped\": unstable here, the largest eigenvalue of the "
                      "{} side is {:.4g} of its row sums and may be 1 at most\n       put the "
                      "multipliers on the side with the finer faces (interface.multiplier = "
                      "\"finer\"), or write operator = \"exact\"",
                      s == Side::fluid ? "fluid" : "solid", largest));
  }
}

InterfaceOperator::InterfaceOperator(InterfaceSide fluid, InterfaceSide solid, Solver solver,
                                     const link::Team* team)
    : side_{std::move(fluid), std::move(solid)}
{
  require(side_[0].L.rows() == side_[1].L.rows(), "both sides of the interface have the same multipliers");
  if (solver == Solver::gradients)
    gradients_ = std::make_unique<Gradients>(side_, team);
  else
    for (const Side s : both_sides)
      condensed_[s] = side_[s].L * side_[s].inverse_mass * SparseMatrix(side_[s].L.transpose());

  const Eigen::Index n = side_[0].L.rows();
  const Vector d = gradients_ ? gradients_->diagonal() : condensed_[0].diagonal() + condensed_[1].diagonal();
  free_row_ = movable_rows(d);
  std::vector<Eigen::Triplet<double>> held;
  for (Eigen::Index i = 0; i < n; ++i)
    if (!free_row_[i])
      held.emplace_back(i, i, 1.0);
  held_rows_.resize(n, n);
  held_rows_.setFromTriplets(held.begin(), held.end());

  if (solver == Solver::row_sums)
    lump();
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

Vector InterfaceOperator::product(Side side, const Vector& x) const
{
  return constraint(side, acceleration(side, force(side, x)));
}

SparseMatrix InterfaceOperator::assemble(double alpha_fluid, double alpha_solid) const
{
  require(!gradients_, "gradients do without H");
  SparseMatrix H = alpha_fluid * condensed_[Side::fluid] + alpha_solid * condensed_[Side::solid];
  // A row without movable mass decouples and gets the identity, so that its multiplier is zero.
  for (Eigen::Index k = 0; k < H.outerSize(); ++k)
    for (SparseMatrix::InnerIterator it(H, k); it; ++it)
      if (!free_row_[it.row()] || !free_row_[it.col()])
        it.valueRef() = 0.0;
  H += held_rows_;
  return H;
}

Vector InterfaceOperator::by_gradients(const std::array<double, 2>& weights, const Vector& rhs,
                                       const Vector& start)
{
  const Vector from = start.size() == rhs.size() ? start : Vector::Zero(rhs.size());
  if (!rhs.allFinite() || !from.allFinite()) // a side has blown up, and says so
    return Vector::Constant(rhs.size(), std::numeric_limits<double>::quiet_NaN());
  Gradients::Solution solution =
      gradients_->solve(weights, free_row_.select(rhs.array(), 0.0), free_row_.select(from.array(), 0.0));
  iterations_ += solution.iterations;
  if (!solution.found)
    throw NumericalError(
        fmt::format("the interface operator H is not positive definite, or so ill-conditioned "
                    "that {} iterations do not solve it: {}",
                    solution.iterations, twice));
  return std::move(solution.lambda);
}

Vector InterfaceOperator::solve(double alpha_fluid, double alpha_solid, const Vector& rhs,
                                const Vector& start)
{
  if (rhs.size() == 0)
    return rhs;
  if (lumped_[Side::fluid].size() > 0)
  {
    const Vector H = alpha_fluid * lumped_[Side::fluid] + alpha_solid * lumped_[Side::solid];
    return (free_row_ && H.array() > 0.0).select(rhs.array() / H.array(), 0.0).matrix();
  }
  const std::array<double, 2> weights{alpha_fluid, alpha_solid};
  if (gradients_)
    return by_gradients(weights, rhs, start);
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
      throw NumericalError(fmt::format("the interface operator H is not positive definite: {}", twice));
  }
  Vector lambda = factor_->solve(free_row_.select(rhs.array(), 0.0).matrix());
  return lambda;
}

} // namespace undine::coupler
