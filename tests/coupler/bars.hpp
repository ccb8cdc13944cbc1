// Linear elastic bars with lumped mass behind the Partner interface: the smallest honest participants.
#pragma once

#include "coupler/gravouil_combescure.hpp"

#include <Eigen/Dense>

#include <cmath>
#include <functional>

namespace undine::test
{

using coupler::GravouilCombescure;
using coupler::InterfaceOperator;
using coupler::InterfaceSide;
using coupler::Side;
using coupler::SparseMatrix;
using coupler::Vector;

/// A chain of n + 1 nodes. Node 0 is the interface, the far end is held or free. Integer-time central
/// differences.
class Bar : public coupler::Partner
{
public:
  Bar(int n, double length, double rho, double modulus, bool far_end_held)
      : held_(far_end_held), k_(modulus * n / length), m_(Vector::Constant(n + 1, rho * length / n)),
        u(Vector::Zero(n + 1)), v(Vector::Zero(n + 1)), a(Vector::Zero(n + 1)), load(Vector::Zero(n + 1))
  {
    m_[0] *= 0.5;
    m_[n] *= 0.5;
  }

  /// Highest frequency of a uniform lumped chain is below 2 sqrt(k/m) of an interior node: Δt ≤ h/c.
  double critical_step() const { return std::sqrt(m_[1] / k_); }
  double interface_mass() const { return m_[0]; }
  Eigen::Index n_nodes() const { return m_.size(); }
  const Vector& masses() const { return m_; }

  Vector free_acceleration() const
  {
    Vector f = load;
    for (Eigen::Index e = 0; e + 1 < m_.size(); ++e)
    {
      const double tension = k_ * (u[e + 1] - u[e]);
      f[e] += tension;
      f[e + 1] -= tension;
    }
    Vector acceleration = f.cwiseQuotient(m_);
    if (held_)
      acceleration[m_.size() - 1] = 0.0;
    return acceleration;
  }
  Vector stiffness_times(const Vector& w) const
  {
    Vector f = Vector::Zero(w.size());
    for (Eigen::Index e = 0; e + 1 < w.size(); ++e)
    {
      const double tension = k_ * (w[e + 1] - w[e]);
      f[e] -= tension;
      f[e + 1] += tension;
    }
    return f;
  }
  double energy() const { return 0.5 * v.dot(m_.cwiseProduct(v)) + 0.5 * u.dot(stiffness_times(u)); }
  /// ½ aᵀ(M − Δt²/4 K)a + ½ vᵀKv: the quantity of the Gravouil-Combescure energy theorem.
  double second_energy(double step) const
  {
    return 0.5 * a.dot(m_.cwiseProduct(a) - 0.25 * step * step * stiffness_times(a)) +
           0.5 * v.dot(stiffness_times(v));
  }

  void receive_free_velocity(std::span<double> v_free) override
  {
    v += 0.5 * dt * a;
    u += dt * v;
    a = free_acceleration();
    v += 0.5 * dt * a;
    v_free[0] = v[0];
  }
  void send_link_force(std::span<const double> f) override
  {
    last_link_force = f[0];
    a[0] += f[0] / m_[0];
    v[0] += 0.5 * dt * f[0] / m_[0];
    if (after_step)
      after_step();
  }

  double dt = 0.0;
  double last_link_force = 0.0;
  std::function<void()> after_step;

private:
  bool held_;
  double k_;
  Vector m_;

public:
  Vector u, v, a, load;
};

/// Operator of two bars glued at their nodes 0.
inline InterfaceOperator glue(const Bar& fluid, const Bar& solid)
{
  const auto side = [](double sign, double mass)
  {
    InterfaceSide s{SparseMatrix(1, 1), SparseMatrix(1, 1)};
    s.L.insert(0, 0) = sign;
    s.inverse_mass.insert(0, 0) = 1.0 / mass;
    return s;
  };
  return {side(1.0, fluid.interface_mass()), side(-1.0, solid.interface_mass())};
}

/// Start both bars compatibly from their present u and v.
inline void start(GravouilCombescure& gc, Bar& fluid, Bar& solid)
{
  fluid.a = fluid.free_acceleration();
  solid.a = solid.free_acceleration();
  const auto entry = [](double x) { return Vector::Constant(1, x); };
  const auto begin =
      gc.activate({entry(fluid.v[0]), entry(solid.v[0])}, {entry(fluid.a[0]), entry(solid.a[0])});
  for (auto [bar, s] : {std::pair{&fluid, Side::fluid}, std::pair{&solid, Side::solid}})
  {
    bar->v[0] += begin.impulse[s][0] / bar->interface_mass();
    bar->a[0] += begin.link_force[s][0] / bar->interface_mass();
  }
}

inline void advance(GravouilCombescure& gc, const coupler::WindowSteps& steps, Bar& fluid, Bar& solid)
{
  fluid.dt = steps.dt(Side::fluid);
  solid.dt = steps.dt(Side::solid);
  gc.advance(steps, fluid, solid);
}

/// Spectral radius of a linear map given by its action.
inline double spectral_radius(Eigen::Index n, const std::function<Vector(const Vector&)>& map)
{
  Eigen::MatrixXd A(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    A.col(i) = map(Vector::Unit(n, i));
  return A.eigenvalues().cwiseAbs().maxCoeff();
}

} // namespace undine::test
