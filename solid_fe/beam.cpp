// Forces, inertia and faces of the geometrically exact beam.
#include "solid_fe/beam.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <cmath>

namespace undine::solid
{

Beam::Beam(const BeamConfig& config)
    : step_safety_(config.step_safety), gravity_(config.gravity), X_(config.X), arm_(config.arm)
{
  const auto& material = config.material;
  const double density = material.density, nu = material.poisson_ratio;
  if (!(density > 0.0) || !(material.youngs_modulus > 0.0))
    throw InputError("beam: density and Young's modulus must be positive");
  const double modulus =
      config.plane_stress ? material.youngs_modulus : material.youngs_modulus / (1.0 - nu * nu);
  const double shear_modulus = 0.5 * material.youngs_modulus / (1.0 + nu);
  wave_speed_ = std::sqrt(modulus / density);
  // Energy ½ L [E'h (Δu/L)² + ⅚Gh (Δw/L − θ)² + E'h³/12 (Δθ/L)²] with (a − b)² ≤ (1 + s) a² + (1 + 1/s) b²
  // and s such that deflections are no stiffer than the membrane.
  const double s = modulus / (5.0 / 6.0 * shear_modulus) - 1.0;
  if (!(s > 0.0))
    throw InputError("beam: with the Poisson ratio " + std::to_string(nu) +
                     " shear is stiffer than the membrane, which the rotary inertia is not made for");

  const auto n = X_.size();
  std::vector<Vec<2>> normal(n);
  for (auto* field : {&u_, &v_, &a_, &F_, &inverse_mass_, &load_})
    field->assign(n, Vec<2>{});
  for (auto* field : {&theta_, &omega_, &alpha_, &M_, &inverse_inertia_, &load_moment_, &m_, &J_})
    field->assign(n, 0.0);

  double physical = 0.0, total = 0.0;
  for (std::size_t k = 0; k < config.elements.size(); ++k)
  {
    const auto [a, b] = config.elements[k];
    const auto i = static_cast<std::size_t>(a), j = static_cast<std::size_t>(b);
    const auto edge = X_[j] - X_[i];
    const double L = norm(edge);
    const double h = config.element_thickness.empty() ? config.thickness : config.element_thickness[k];
    if (!(L > 0.0))
      throw InputError("beam: the element from node " + std::to_string(a) + " to " + std::to_string(b) +
                       " has no length");
    if (!(h > 0.0))
      throw InputError("beam: the thickness must be positive");
    const Element e{{i, j},
                    L,
                    std::atan2(edge[1], edge[0]),
                    h,
                    modulus * h,
                    5.0 / 6.0 * shear_modulus * h,
                    modulus * std::pow(h, 3) / 12.0};
    elements_.push_back(e);
    // What is left for each node is ½ θ² times this:
    const double stiffness = 0.5 * e.shear * L * (1.0 + 1.0 / s) + 2.0 * e.bending / L;
    const double omega2 = 4.0 * e.membrane / (density * h * L * L); // of the membrane
    const double own = 0.5 * density * L * std::pow(h, 3) / 12.0;
    const double needed = std::max(own, stiffness / omega2);
    physical += 2.0 * own;
    total += 2.0 * needed;
    for (const auto node : {i, j})
    {
      m_[node] += 0.5 * density * h * L;
      J_[node] += needed;
      normal[node] += Vec<2>{{-edge[1], edge[0]}};
    }
  }
  added_inertia_ = 1.0 - physical / total;
  for (std::size_t k = 0; k < n; ++k)
  {
    if (!(m_[k] > 0.0))
      throw InputError("beam: node " + std::to_string(k) + " belongs to no element");
    if (config.arm.empty())
      arm_.push_back((0.5 * config.thickness / norm(normal[k])) * normal[k]);
    const auto fixed = config.fixed.empty() ? std::array<bool, 3>{} : config.fixed[k];
    for (int i = 0; i < 2; ++i)
      inverse_mass_[k][i] = fixed[static_cast<std::size_t>(i)] ? 0.0 : 1.0 / m_[k];
    inverse_inertia_[k] = fixed[2] ? 0.0 : 1.0 / J_[k];
  }
  solve_free_motion(0.0);
}

Beam::Strain Beam::strain(const Element& e, std::span<const Vec<2>> u, std::span<const double> theta) const
{
  const auto [i, j] = e.node;
  const double angle = e.angle + 0.5 * (theta[i] + theta[j]);
  const Vec<2> t{{std::cos(angle), std::sin(angle)}}, n{{-t[1], t[0]}};
  // x' = X' + u': ε from t·u' and t·X' − 1 = −2 sin²(θ/2), without a difference of numbers near 1.
  const auto du = (1.0 / e.length) * (u[j] - u[i]);
  const double half = 0.25 * (theta[i] + theta[j]);
  return {t, n, dot(t, du) - 2.0 * std::sin(half) * std::sin(half), dot(n, du) - std::sin(2.0 * half),
          (theta[j] - theta[i]) / e.length};
}

void Beam::internal_force_at(std::span<const Vec<2>> u, std::span<const double> theta, std::span<Vec<2>> F,
                             std::span<double> moment) const
{
  for (const auto& e : elements_)
  {
    const auto [i, j] = e.node;
    const auto strains = strain(e, u, theta);
    const double N = e.membrane * strains.epsilon, Q = e.shear * strains.gamma, M = e.bending * strains.kappa;
    const auto f = N * strains.t + Q * strains.n; // against the end b, and along it on a
    F[i] -= f;
    F[j] += f;
    // ∂ε/∂θ = γ, ∂γ/∂θ = −(1 + ε), half of it at each node
    const double turn = 0.5 * e.length * (N * strains.gamma - Q * (1.0 + strains.epsilon));
    moment[i] += turn - M;
    moment[j] += turn + M;
  }
}

void Beam::predict(double dt)
{
  predict_velocity(dt);
  predict_position(dt);
}

void Beam::predict_velocity(double dt)
{
  const double half = 0.5 * dt;
  for (std::size_t k = 0; k < u_.size(); ++k)
  {
    v_[k] += half * a_[k];
    omega_[k] += half * alpha_[k];
  }
}

void Beam::predict_position(double dt)
{
  for (std::size_t k = 0; k < u_.size(); ++k)
  {
    u_[k] += dt * v_[k];
    theta_[k] += dt * omega_[k];
  }
  time_ += dt;
}

void Beam::solve_free_motion(double dt, std::span<const std::array<Vec<2>, 2>> face_force)
{
  std::fill(F_.begin(), F_.end(), Vec<2>{});
  std::fill(M_.begin(), M_.end(), 0.0);
  internal_force_at(u_, theta_, F_, M_);
  for (std::size_t k = 0; k < u_.size(); ++k)
  {
    F_[k] = load_[k] + m_[k] * gravity_ - (damping_ * m_[k]) * v_[k] - F_[k];
    M_[k] = load_moment_[k] - damping_ * J_[k] * omega_[k] - M_[k];
    if (!face_force.empty())
      for (const auto face : both_faces)
      {
        const auto& f = face_force[k][static_cast<std::size_t>(face)];
        const auto r = arm(face, k);
        F_[k] += f;
        M_[k] += r[0] * f[1] - r[1] * f[0];
      }
  }
  drop_face_forces();
  for (std::size_t k = 0; k < u_.size(); ++k)
  {
    v_[k] += (0.5 * dt) * a_[k];
    omega_[k] += 0.5 * dt * alpha_[k];
  }
}

void Beam::drop_face_forces()
{
  for (std::size_t k = 0; k < u_.size(); ++k)
  {
    for (int i = 0; i < 2; ++i)
      a_[k][i] = inverse_mass_[k][i] * F_[k][i];
    alpha_[k] = inverse_inertia_[k] * M_[k];
  }
}

Vec<2> Beam::arm(BeamFace face, std::size_t node) const
{
  const double c = std::cos(theta_[node]), s = std::sin(theta_[node]);
  const auto& r = arm_[node];
  const double side = face == BeamFace::left ? 1.0 : -1.0;
  return {{side * (c * r[0] - s * r[1]), side * (s * r[0] + c * r[1])}};
}

void Beam::add_face_force(BeamFace face, std::size_t k, const Vec<2>& f, double dt)
{
  add_face_impulse(face, k, (0.5 * dt) * f);
  const auto r = arm(face, k);
  for (int i = 0; i < 2; ++i)
    a_[k][i] += inverse_mass_[k][i] * f[i];
  alpha_[k] += inverse_inertia_[k] * (r[0] * f[1] - r[1] * f[0]);
}

void Beam::add_face_impulse(BeamFace face, std::size_t k, const Vec<2>& p)
{
  const auto r = arm(face, k);
  for (int i = 0; i < 2; ++i)
    v_[k][i] += inverse_mass_[k][i] * p[i];
  omega_[k] += inverse_inertia_[k] * (r[0] * p[1] - r[1] * p[0]);
}

void Beam::set_velocity(std::size_t node, int component, double v)
{
  (component == 2 ? omega_[node] : v_[node][component]) = v;
}

bool Beam::is_fixed(std::size_t node, int component) const
{
  return (component == 2 ? inverse_inertia_[node] : inverse_mass_[node][component]) == 0.0;
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

Vec<2> Beam::face_position(BeamFace face, std::size_t k) const { return X_[k] + u_[k] + arm(face, k); }

Vec<2> Beam::face_velocity(BeamFace face, std::size_t k) const
{
  const auto r = arm(face, k);
  return v_[k] + omega_[k] * Vec<2>{{-r[1], r[0]}};
}

Vec<2> Beam::face_acceleration(BeamFace face, std::size_t k) const
{
  const auto r = arm(face, k);
  return a_[k] + alpha_[k] * Vec<2>{{-r[1], r[0]}} - (omega_[k] * omega_[k]) * r;
}

Mat<2> Beam::face_inverse_mass(BeamFace moved, BeamFace pushed, std::size_t k) const
{
  const auto turned = [&](BeamFace face)
  {
    const auto r = arm(face, k);
    return Vec<2>{{-r[1], r[0]}};
  };
  auto block = inverse_inertia_[k] * outer(turned(moved), turned(pushed));
  for (int i = 0; i < 2; ++i)
    block(i, i) += inverse_mass_[k][i];
  return block;
}

double Beam::highest_frequency_squared() const
{
  double omega = 0.0;
  for (const auto& e : elements_) // stretched by 1 + ε the moments grow with it: Q acts on the arm (1 + ε) L
    omega = std::max(omega, 2.0 * std::max(1.0, 1.0 + strain(e).epsilon) * wave_speed_ / e.length);
  return omega * omega;
}

double Beam::critical_time_step() const
{
  return step_safety_ * 2.0 / std::sqrt(highest_frequency_squared());
}

BeamSection Beam::section(std::size_t element) const
{
  const auto& e = elements_[element];
  const auto s = strain(e);
  const auto [i, j] = e.node;
  return {s.t,
          s.n,
          e.membrane * s.epsilon,
          e.shear * s.gamma,
          e.bending * s.kappa,
          e.thickness,
          1.0 + s.epsilon,
          0.5 * (X_[i] + u_[i] + X_[j] + u_[j])};
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
    energy +=
        0.5 * e.length *
        (e.membrane * s.epsilon * s.epsilon + e.shear * s.gamma * s.gamma + e.bending * s.kappa * s.kappa);
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
