// Forces, inertia and faces of the geometrically exact beam.
#include "solid_fe/beam.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace undine::solid
{

Beam::Beam(const BeamConfig& config)
    : thickness_(config.thickness), density_(config.material.density), step_safety_(config.step_safety),
      gravity_(config.gravity), X_(config.X)
{
  if (!(thickness_ > 0.0) || !(density_ > 0.0) || !(config.material.youngs_modulus > 0.0))
    throw InputError("beam: thickness, density and Young's modulus must be positive");
  const double nu = config.material.poisson_ratio;
  const double modulus = config.material.youngs_modulus / (1.0 - nu * nu);
  const double shear_modulus = 0.5 * config.material.youngs_modulus / (1.0 + nu);
  membrane_ = modulus * thickness_;
  shear_ = 5.0 / 6.0 * shear_modulus * thickness_;
  bending_ = modulus * std::pow(thickness_, 3) / 12.0;

  const auto n = X_.size();
  for (auto* field : {&normal_, &u_, &v_, &a_, &F_, &inverse_mass_, &load_})
    field->assign(n, Vec<2>{});
  for (auto* field : {&theta_, &omega_, &alpha_, &M_, &inverse_inertia_, &load_moment_, &m_, &J_})
    field->assign(n, 0.0);

  double physical = 0.0, total = 0.0;
  for (const auto& [a, b] : config.elements)
  {
    const auto i = static_cast<std::size_t>(a), j = static_cast<std::size_t>(b);
    const auto edge = X_[j] - X_[i];
    const double L = norm(edge);
    if (!(L > 0.0))
      throw InputError("beam: the element from node " + std::to_string(a) + " to " + std::to_string(b) +
                       " has no length");
    elements_.push_back({{i, j}, L, std::atan2(edge[1], edge[0])});
    // Energy ½ L [E'h (Δu/L)² + ⅚Gh (Δw/L − θ)² + E'h³/12 (Δθ/L)²] with (a − b)² ≤ (1 + s) a² + (1 + 1/s) b²
    // and s such that deflections are no stiffer than the membrane leaves, for each node, ½ θ² times this:
    const double s = membrane_ / shear_ - 1.0;
    const double stiffness = 0.5 * shear_ * L * (1.0 + 1.0 / s) + 2.0 * bending_ / L;
    const double omega2 = 4.0 * membrane_ / (density_ * thickness_ * L * L); // of the membrane
    const double own = 0.5 * density_ * L * std::pow(thickness_, 3) / 12.0;
    const double needed = std::max(own, stiffness / omega2);
    physical += 2.0 * own;
    total += 2.0 * needed;
    for (const auto node : {i, j})
    {
      m_[node] += 0.5 * density_ * thickness_ * L;
      J_[node] += needed;
      normal_[node] += Vec<2>{{-edge[1], edge[0]}};
    }
  }
  added_inertia_ = 1.0 - physical / total;
  for (std::size_t k = 0; k < n; ++k)
  {
    if (!(m_[k] > 0.0))
      throw InputError("beam: node " + std::to_string(k) + " belongs to no element");
    normal_[k] *= 1.0 / norm(normal_[k]);
    const auto fixed = config.fixed.empty() ? std::array<bool, 3>{} : config.fixed[k];
    for (int i = 0; i < 2; ++i)
      inverse_mass_[k][i] = fixed[static_cast<std::size_t>(i)] ? 0.0 : 1.0 / m_[k];
    inverse_inertia_[k] = fixed[2] ? 0.0 : 1.0 / J_[k];
  }
  solve_free_motion(0.0);
}

Beam::Strain Beam::strain(const Element& e) const
{
  const auto [i, j] = e.node;
  const double angle = e.angle + 0.5 * (theta_[i] + theta_[j]);
  const Vec<2> t{{std::cos(angle), std::sin(angle)}}, n{{-t[1], t[0]}};
  // x' = X' + u': ε from t·u' and t·X' − 1 = −2 sin²(θ/2), without a difference of numbers near 1.
  const auto du = (1.0 / e.length) * (u_[j] - u_[i]);
  const double half = 0.25 * (theta_[i] + theta_[j]);
  return {t, n, dot(t, du) - 2.0 * std::sin(half) * std::sin(half), dot(n, du) - std::sin(2.0 * half),
          (theta_[j] - theta_[i]) / e.length};
}

void Beam::add_internal_force()
{
  for (const auto& e : elements_)
  {
    const auto [i, j] = e.node;
    const auto strains = strain(e);
    const double N = membrane_ * strains.epsilon, Q = shear_ * strains.gamma, M = bending_ * strains.kappa;
    const auto f = N * strains.t + Q * strains.n; // on the end b, and against it on a
    F_[i] += f;
    F_[j] -= f;
    // ∂ε/∂θ = γ, ∂γ/∂θ = −(1 + ε), half of it at each node
    const double turn = 0.5 * e.length * (N * strains.gamma - Q * (1.0 + strains.epsilon));
    M_[i] -= turn - M;
    M_[j] -= turn + M;
  }
}

void Beam::predict(double dt)
{
  const double half = 0.5 * dt;
  for (std::size_t k = 0; k < u_.size(); ++k)
  {
    v_[k] += half * a_[k];
    u_[k] += dt * v_[k];
    omega_[k] += half * alpha_[k];
    theta_[k] += dt * omega_[k];
  }
  time_ += dt;
}

void Beam::solve_free_motion(double dt)
{
  for (std::size_t k = 0; k < u_.size(); ++k)
  {
    F_[k] = load_[k] + m_[k] * gravity_ - (damping_ * m_[k]) * v_[k];
    M_[k] = load_moment_[k] - damping_ * J_[k] * omega_[k];
  }
  add_internal_force();
  for (std::size_t k = 0; k < u_.size(); ++k)
  {
    for (int i = 0; i < 2; ++i)
      a_[k][i] = inverse_mass_[k][i] * F_[k][i];
    alpha_[k] = inverse_inertia_[k] * M_[k];
    v_[k] += (0.5 * dt) * a_[k];
    omega_[k] += 0.5 * dt * alpha_[k];
  }
}

Vec<2> Beam::arm(BeamFace face, std::size_t node) const
{
  const double c = std::cos(theta_[node]), s = std::sin(theta_[node]);
  const auto& n = normal_[node];
  const double side = face == BeamFace::left ? 0.5 * thickness_ : -0.5 * thickness_;
  return {{side * (c * n[0] - s * n[1]), side * (s * n[0] + c * n[1])}};
}

void Beam::add_face_force(BeamFace face, std::span<const Vec<2>> f, double dt)
{
  for (std::size_t k = 0; k < f.size(); ++k)
  {
    const auto r = arm(face, k);
    const double alpha = inverse_inertia_[k] * (r[0] * f[k][1] - r[1] * f[k][0]);
    for (int i = 0; i < 2; ++i)
    {
      const double a = inverse_mass_[k][i] * f[k][i];
      a_[k][i] += a;
      v_[k][i] += 0.5 * dt * a;
    }
    alpha_[k] += alpha;
    omega_[k] += 0.5 * dt * alpha;
  }
}

void Beam::set_load(index_t node, const Vec<2>& force, double moment)
{
  load_[static_cast<std::size_t>(node)] = force;
  load_moment_[static_cast<std::size_t>(node)] = moment;
}

void Beam::set_motion(std::span<const Vec<2>> u, std::span<const double> theta, std::span<const Vec<2>> v,
                      std::span<const double> omega)
{
  std::copy(u.begin(), u.end(), u_.begin());
  std::copy(theta.begin(), theta.end(), theta_.begin());
  std::copy(v.begin(), v.end(), v_.begin());
  std::copy(omega.begin(), omega.end(), omega_.begin());
  time_ = 0.0;
  solve_free_motion(0.0);
}

std::vector<Vec<2>> Beam::face_position(BeamFace face) const
{
  std::vector<Vec<2>> x;
  for (std::size_t k = 0; k < X_.size(); ++k)
    x.push_back(X_[k] + u_[k] + arm(face, k));
  return x;
}

std::vector<Vec<2>> Beam::face_velocity(BeamFace face) const
{
  std::vector<Vec<2>> v;
  for (std::size_t k = 0; k < X_.size(); ++k)
  {
    const auto r = arm(face, k);
    v.push_back(v_[k] + omega_[k] * Vec<2>{{-r[1], r[0]}});
  }
  return v;
}

std::vector<Mat<2>> Beam::face_inverse_mass(BeamFace face) const
{
  std::vector<Mat<2>> inverse;
  for (std::size_t k = 0; k < X_.size(); ++k)
  {
    const auto r = arm(face, k);
    const Vec<2> turned{{-r[1], r[0]}};
    auto block = inverse_inertia_[k] * outer(turned, turned);
    for (int i = 0; i < 2; ++i)
      block(i, i) += inverse_mass_[k][i];
    inverse.push_back(block);
  }
  return inverse;
}

double Beam::critical_time_step() const
{
  double dt = std::numeric_limits<double>::infinity();
  for (const auto& e : elements_)
  {
    // Stretched by 1 + ε the moments grow with it: Q acts on the arm (1 + ε) L.
    const double stretch = std::max(1.0, 1.0 + strain(e).epsilon);
    dt = std::min(dt, e.length / (stretch * std::sqrt(membrane_ / (density_ * thickness_))));
  }
  return step_safety_ * dt;
}

double Beam::kinetic_energy() const
{
  double energy = 0.0;
  for (std::size_t k = 0; k < v_.size(); ++k)
    energy += 0.5 * (m_[k] * norm_squared(v_[k]) + J_[k] * omega_[k] * omega_[k]);
  return energy;
}

double Beam::strain_energy() const
{
  double energy = 0.0;
  for (const auto& e : elements_)
  {
    const auto s = strain(e);
    energy += 0.5 * e.length *
              (membrane_ * s.epsilon * s.epsilon + shear_ * s.gamma * s.gamma + bending_ * s.kappa * s.kappa);
  }
  return energy;
}

double Beam::mass() const
{
  double mass = 0.0;
  for (const double m : m_)
    mass += m;
  return mass;
}

double Beam::angular_momentum() const
{
  double momentum = 0.0;
  for (std::size_t k = 0; k < v_.size(); ++k)
  {
    const auto x = X_[k] + u_[k];
    momentum += m_[k] * (x[0] * v_[k][1] - x[1] * v_[k][0]) + J_[k] * omega_[k];
  }
  return momentum;
}

} // namespace undine::solid
