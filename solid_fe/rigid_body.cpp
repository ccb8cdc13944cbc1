// Six (in a plane three) degrees of freedom by central differences in velocity and angular momentum.
#include "solid_fe/rigid_body.hpp"

#include "common/error.hpp"

#include <cmath>

namespace undine::solid
{

namespace
{

/// Rotation by the vector `w`: Rodrigues' formula.
Mat<3> exponential(const Vec<3>& w)
{
  const double angle = norm(w);
  const Mat<3> W{{0.0, -w[2], w[1], w[2], 0.0, -w[0], -w[1], w[0], 0.0}};
  const double a = angle > 1e-8 ? std::sin(angle) / angle : 1.0;
  const double half = 0.5 * angle, b = half > 1e-8 ? 0.5 * std::pow(std::sin(half) / half, 2) : 0.5;
  return Mat<3>::identity() + a * W + b * (W * W);
}

} // namespace

template <int dim>
RigidBody<dim>::RigidBody(std::span<const index_t> members, index_t n_wet, const std::string& key,
                          SolidNodes<dim>& nodes)
{
  if (members.size() < 2)
    throw InputError(key + ": a rigid body needs at least two nodes");
  for (const index_t member : members)
  {
    const auto n = static_cast<std::size_t>(member);
    for (int i = 0; i < dim; ++i)
      if (nodes.inverse_mass[n][i] == 0.0)
        throw InputError(
            key + ": a node of it has a prescribed motion, or belongs to another rigid body; take it out "
                  "of one of them");
    if (member < n_wet)
      throw InputError(key + ": a node of it belongs to an interface; a rigid body may not be wet");
    members_.push_back(n);
    mass_ += nodes.m[n];
    centre_ += nodes.m[n] * nodes.X[n];
  }
  centre_ *= 1.0 / mass_;
  for (const auto n : members_)
  {
    const auto r = nodes.X[n] - centre_;
    arm_reference_.push_back(r);
    const auto r3 = in_3d(r);
    inertia_reference_ += nodes.m[n] * (norm_squared(r3) * Mat<3>::identity() - outer(r3, r3));
    nodes.inverse_mass[n] = {};
  }
  arm_ = arm_reference_;
}

template <int dim>
void RigidBody<dim>::start(SolidNodes<dim>& nodes)
{
  // The nodes are where the reference state has them: a rigid body starts undeformed.
  centre_ = {};
  velocity_ = {};
  spin_ = {};
  rotation_ = Mat<3>::identity();
  arm_ = arm_reference_;
  u_.assign(members_.size(), Vec<dim>{});
  for (std::size_t k = 0; k < members_.size(); ++k)
  {
    const auto n = members_[k];
    nodes.u[n] = {};
    centre_ += (nodes.m[n] / mass_) * nodes.X[n];
    velocity_ += (nodes.m[n] / mass_) * nodes.v[n];
    spin_ += nodes.m[n] * cross(in_3d(arm_[k]), in_3d(nodes.v[n]));
  }
  turn_velocity();
  set_node_velocities(nodes);
}

template <int dim>
void RigidBody<dim>::turn_velocity()
{
  const auto inertia = rotation_ * inertia_reference_ * transpose(rotation_);
  if constexpr (dim == 2)
    omega_ = {{0.0, 0.0, spin_[2] / inertia(2, 2)}};
  else
    omega_ = inverse(inertia) * spin_;
}

template <int dim>
void RigidBody<dim>::set_node_velocities(SolidNodes<dim>& nodes) const
{
  for (std::size_t k = 0; k < members_.size(); ++k)
    nodes.v[members_[k]] = velocity_ + in_plane(cross(omega_, in_3d(arm_[k])));
}

template <int dim>
void RigidBody<dim>::predict(double dt, SolidNodes<dim>& nodes)
{
  velocity_ += (0.5 * dt / mass_) * force_;
  centre_ += dt * velocity_;
  spin_ += (0.5 * dt) * moment_;
  // Midpoint rule: ω with the inertia of the half-turned body, by two fixed-point passes.
  const auto before = rotation_;
  turn_velocity();
  for (int pass = 0; pass < 2; ++pass)
  {
    rotation_ = exponential((0.5 * dt) * omega_) * before;
    turn_velocity();
  }
  rotation_ = exponential(dt * omega_) * before;
  for (std::size_t k = 0; k < members_.size(); ++k)
  {
    const auto n = members_[k];
    arm_[k] = in_plane(rotation_ * in_3d(arm_reference_[k]));
    const auto u = centre_ + arm_[k] - nodes.X[n];
    nodes.v[n] = (1.0 / dt) * (u - u_[k]);
    nodes.u[n] = u_[k] = u;
  }
}

template <int dim>
void RigidBody<dim>::finish_step(double dt, const Vec<dim>& F, const Vec<3>& M, SolidNodes<dim>& nodes)
{
  force_ = F;
  moment_ = M;
  velocity_ += (0.5 * dt / mass_) * F;
  spin_ += (0.5 * dt) * M;
  turn_velocity();
  set_node_velocities(nodes);
  const auto alpha = [&]
  {
    const auto inertia = rotation_ * inertia_reference_ * transpose(rotation_);
    if constexpr (dim == 2)
      return Vec<3>{{0.0, 0.0, M[2] / inertia(2, 2)}};
    else
      return inverse(inertia) * (M - cross(omega_, spin_));
  }();
  for (std::size_t k = 0; k < members_.size(); ++k)
  {
    const auto r = in_3d(arm_[k]);
    nodes.a[members_[k]] = (1.0 / mass_) * F + in_plane(cross(alpha, r) + cross(omega_, cross(omega_, r)));
  }
}

template class RigidBody<2>;
template class RigidBody<3>;

} // namespace undine::solid
