// Dense eigenvalues of M^(-1/2) K M^(-1/2).
#include "solid_fe/modes.hpp"

#include "common/error.hpp"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace undine::solid
{

template <int dim>
std::vector<double> natural_frequencies(const Solid<dim>& solid, int count)
{
  struct Component
  {
    std::size_t node;
    int i;
    double scale; ///< M^(-1/2)
  };
  const auto& nodes = solid.nodes();
  std::vector<Component> free;
  double size = 0.0;
  for (std::size_t n = 0; n < nodes.X.size(); ++n)
  {
    for (int i = 0; i < dim; ++i)
      if (nodes.inverse_mass[n][i] > 0.0)
        free.push_back({n, i, std::sqrt(nodes.inverse_mass[n][i])});
    size = std::max(size, norm(nodes.X[n] - nodes.X[0]));
  }
  if (free.size() > 6000)
    throw InputError("--modes: the solid has " + std::to_string(free.size()) +
                     " free components: at most 6000; choose a coarser mesh");

  const auto n = static_cast<Eigen::Index>(free.size());
  Eigen::MatrixXd K(n, n);
  auto u = nodes.u;
  const double step = 1e-6 * size / std::pow(static_cast<double>(nodes.size()), 1.0 / dim);
  for (Eigen::Index c = 0; c < n; ++c)
  {
    const auto& column = free[static_cast<std::size_t>(c)];
    double& moved = u[column.node][column.i];
    const double kept = moved;
    moved = kept + step;
    const auto forward = solid.internal_force_at(u);
    moved = kept - step;
    const auto backward = solid.internal_force_at(u);
    moved = kept;
    for (Eigen::Index r = 0; r < n; ++r)
    {
      const auto& row = free[static_cast<std::size_t>(r)];
      K(r, c) =
          row.scale * column.scale * (forward[row.node][row.i] - backward[row.node][row.i]) / (2.0 * step);
    }
  }
  const Eigen::MatrixXd symmetric = 0.5 * (K + K.transpose());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(symmetric, Eigen::EigenvaluesOnly);
  std::vector<double> frequencies;
  for (Eigen::Index k = 0; k < std::min<Eigen::Index>(n, count); ++k)
    frequencies.push_back(std::sqrt(std::max(solver.eigenvalues()[k], 0.0)) / (2.0 * std::numbers::pi));
  return frequencies;
}

template std::vector<double> natural_frequencies(const Solid<2>&, int);
template std::vector<double> natural_frequencies(const Solid<3>&, int);

} // namespace undine::solid
