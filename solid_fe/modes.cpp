// Dense eigenvalues of M^(-1/2) K M^(-1/2).
#include "solid_fe/modes.hpp"

#include "common/error.hpp"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace undine::solid
{

namespace
{

/// One component of a motion: its step for the difference, and M^(-1/2).
struct Component
{
  double* value;
  double step, scale;
};

/// `force(k)` is the internal force on component k at the values the components have now.
template <class Evaluate, class Force>
std::vector<double> frequencies_of(const std::vector<Component>& free, int count, Evaluate&& evaluate,
                                   Force&& force)
{
  if (free.size() > 6000)
    throw InputError("--modes: the solid has " + std::to_string(free.size()) +
                     " free components: at most 6000; choose a coarser mesh");
  const auto n = static_cast<Eigen::Index>(free.size());
  Eigen::MatrixXd K(n, n);
  for (Eigen::Index c = 0; c < n; ++c)
  {
    const auto& column = free[static_cast<std::size_t>(c)];
    const double kept = *column.value;
    for (const double side : {1.0, -1.0})
    {
      *column.value = kept + side * column.step;
      evaluate();
      for (Eigen::Index r = 0; r < n; ++r)
      {
        const double change = side * free[static_cast<std::size_t>(r)].scale * column.scale *
                              force(static_cast<std::size_t>(r)) / (2.0 * column.step);
        K(r, c) = side > 0.0 ? change : K(r, c) + change;
      }
    }
    *column.value = kept;
  }
  const Eigen::MatrixXd symmetric = 0.5 * (K + K.transpose());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(symmetric, Eigen::EigenvaluesOnly);
  std::vector<double> frequencies;
  for (Eigen::Index k = 0; k < std::min<Eigen::Index>(n, count); ++k)
    frequencies.push_back(std::sqrt(std::max(solver.eigenvalues()[k], 0.0)) / (2.0 * std::numbers::pi));
  return frequencies;
}

std::vector<double> frequencies_of_beam(const Beam& beam, double step, int count)
{
  auto u = beam.u();
  auto theta = beam.theta();
  std::vector<Vec<2>> F(u.size());
  std::vector<double> M(u.size());
  std::vector<Component> free;
  std::vector<double*> force;
  for (std::size_t k = 0; k < u.size(); ++k)
  {
    for (int i = 0; i < 2; ++i)
      if (!beam.is_fixed(k, i))
      {
        free.push_back({&u[k][i], step, 1.0 / std::sqrt(beam.mass(k))});
        force.push_back(&F[k][i]);
      }
    if (!beam.is_fixed(k, 2))
    {
      free.push_back({&theta[k], 1e-6, 1.0 / std::sqrt(beam.inertia(k))});
      force.push_back(&M[k]);
    }
  }
  const auto evaluate = [&]
  {
    std::fill(F.begin(), F.end(), Vec<2>{});
    std::fill(M.begin(), M.end(), 0.0);
    beam.internal_force_at(u, theta, F, M);
  };
  return frequencies_of(free, count, evaluate, [&](std::size_t k) { return *force[k]; });
}

} // namespace

template <int dim>
std::vector<double> natural_frequencies(const Solid<dim>& solid, int count)
{
  const auto& nodes = solid.nodes();
  double size = 0.0;
  for (const auto& X : nodes.X)
    size = std::max(size, norm(X - nodes.X[0]));
  const double step = 1e-6 * size / std::pow(static_cast<double>(nodes.size()), 1.0 / dim);
  if (const Beam* beam = solid.beam())
    return frequencies_of_beam(*beam, step, count);
  auto u = nodes.u;
  std::vector<Vec<dim>> F;
  std::vector<Component> free;
  std::vector<std::pair<std::size_t, int>> place;
  for (std::size_t n = 0; n < nodes.X.size(); ++n)
    for (int i = 0; i < dim; ++i)
      if (nodes.inverse_mass[n][i] > 0.0)
      {
        free.push_back({&u[n][i], step, std::sqrt(nodes.inverse_mass[n][i])});
        place.emplace_back(n, i);
      }
  return frequencies_of(
      free, count, [&] { F = solid.internal_force_at(u); },
      [&](std::size_t k) { return F[place[k].first][place[k].second]; });
}

template std::vector<double> natural_frequencies(const Solid<2>&, int);
template std::vector<double> natural_frequencies(const Solid<3>&, int);

} // namespace undine::solid
