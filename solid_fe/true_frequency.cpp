// Lanczos' method on M^(-1/2) K M^(-1/2).
#include "solid_fe/true_frequency.hpp"

#include "solid_fe/solid.hpp"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <random>

namespace undine::solid
{

template <int dim>
double true_frequency_squared(const Solid<dim>& solid)
{
  const auto& nodes = solid.nodes();
  const auto n = static_cast<Eigen::Index>(nodes.X.size()) * dim;
  const auto scale = [&](Eigen::Index k) // M^(-1/2)
  { return std::sqrt(nodes.inverse_mass[static_cast<std::size_t>(k / dim)][static_cast<int>(k % dim)]); };
  double size = 0.0;
  for (const auto& X : nodes.X)
    size = std::max(size, norm(X - nodes.X[0]));
  const double step = 1e-6 * size / std::pow(static_cast<double>(nodes.X.size()), 1.0 / dim);

  // w = M^(-1/2) K M^(-1/2) q, the difference over a step whose largest displacement is `step`.
  const auto apply = [&](const Eigen::VectorXd& q)
  {
    Eigen::VectorXd v(n);
    for (Eigen::Index k = 0; k < n; ++k)
      v[k] = scale(k) * q[k];
    const double epsilon = step / v.cwiseAbs().maxCoeff();
    Eigen::VectorXd w = Eigen::VectorXd::Zero(n);
    for (const double side : {1.0, -1.0})
    {
      auto u = nodes.u;
      for (Eigen::Index k = 0; k < n; ++k)
        u[static_cast<std::size_t>(k / dim)][static_cast<int>(k % dim)] += side * epsilon * v[k];
      const auto F = solid.internal_force_at(u);
      for (Eigen::Index k = 0; k < n; ++k)
        w[k] +=
            side * 0.5 / epsilon * scale(k) * F[static_cast<std::size_t>(k / dim)][static_cast<int>(k % dim)];
    }
    return w;
  };

  std::mt19937 engine(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  Eigen::VectorXd q(n), before = Eigen::VectorXd::Zero(n);
  for (Eigen::Index k = 0; k < n; ++k)
    q[k] = scale(k) > 0.0 ? uniform(engine) : 0.0;
  if (!(q.norm() > 0.0))
    return 0.0;
  q.normalize();
  std::vector<double> alpha, beta;
  double highest = 0.0, residual = 0.0;
  for (int iteration = 1; iteration <= 200; ++iteration)
  {
    Eigen::VectorXd w = apply(q);
    alpha.push_back(q.dot(w));
    w -= alpha.back() * q + (beta.empty() ? 0.0 : beta.back()) * before;
    const double length = w.norm();
    if (iteration % 5 == 0 || !(length > 1e-9 * alpha[0]))
    {
      const auto size_of_T = static_cast<Eigen::Index>(alpha.size());
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> T;
      T.computeFromTridiagonal(Eigen::Map<const Eigen::VectorXd>(alpha.data(), size_of_T),
                               Eigen::Map<const Eigen::VectorXd>(beta.data(), size_of_T - 1));
      highest = T.eigenvalues()[size_of_T - 1];
      residual = length * std::abs(T.eigenvectors()(size_of_T - 1, size_of_T - 1));
      if (residual < 0.01 * highest)
        break;
    }
    beta.push_back(length);
    before = q;
    q = w / length;
  }
  return 1.01 * (highest + residual);
}

template double true_frequency_squared(const Solid<2>&);
template double true_frequency_squared(const Solid<3>&);

} // namespace undine::solid
