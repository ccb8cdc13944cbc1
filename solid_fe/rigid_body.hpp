// A named set of nodes that moves as one rigid body.
#pragma once

#include "common/tensor.hpp"
#include "common/types.hpp"
#include "solid_fe/solid_nodes.hpp"

#include <span>
#include <string>
#include <vector>

namespace undine::solid
{

/// Mass, centre and inertia are those of the nodes' lumped masses. The nodes keep inverse mass 0: nothing but
/// the body moves them. Steps as in Solid: predict turns and shifts the nodes with the velocities of the
/// middle of the step (whose displacement v then gives exactly, so that works are counted exactly), solve
/// takes the forces on the nodes.
template <int dim>
class RigidBody
{
public:
  /// Takes over `members` of `nodes`. @throws InputError with `key` for less than two nodes, or nodes whose
  /// motion is prescribed or wet (below n_wet)
  RigidBody(std::span<const index_t> members, index_t n_wet, const std::string& key, SolidNodes<dim>& nodes);

  /// Start from the nodes' velocities: the rigid motion with their momentum and angular momentum.
  void start(SolidNodes<dim>& nodes);
  /// Moves the nodes: u, and v = Δu/Δt.
  void predict(double dt, SolidNodes<dim>& nodes);
  /// Accelerations by the total `force` on each node of the solid [N]; then v of the nodes at the end of the
  /// step.
  template <class Force>
  void solve(double dt, Force&& force, SolidNodes<dim>& nodes)
  {
    Vec<dim> F;
    Vec<3> M;
    for (std::size_t k = 0; k < members_.size(); ++k)
    {
      const Vec<dim> f = force(members_[k]);
      F += f;
      M += cross(in_3d(arm_[k]), in_3d(f));
    }
    finish_step(dt, F, M, nodes);
  }

  template <class Archive>
  void for_each_state(Archive& archive)
  {
    archive("arm", arm_);
    archive("u", u_);
    archive("centre", centre_);
    archive("velocity", velocity_);
    archive("force", force_);
    archive("rotation", rotation_);
    archive("spin", spin_);
    archive("omega", omega_);
    archive("moment", moment_);
  }

  const std::vector<std::size_t>& members() const { return members_; }
  double mass() const { return mass_; }
  const Vec<dim>& centre() const { return centre_; }     ///< now [m]
  const Vec<dim>& velocity() const { return velocity_; } ///< of the centre [m/s]
  const Vec<3>& angular_velocity() const { return omega_; }

private:
  static Vec<3> in_3d(const Vec<dim>& a)
  {
    Vec<3> b;
    for (int i = 0; i < dim; ++i)
      b[i] = a[i];
    return b;
  }
  static Vec<dim> in_plane(const Vec<3>& a)
  {
    Vec<dim> b;
    for (int i = 0; i < dim; ++i)
      b[i] = a[i];
    return b;
  }
  void finish_step(double dt, const Vec<dim>& F, const Vec<3>& M, SolidNodes<dim>& nodes);
  void turn_velocity(); ///< ω from the angular momentum and the inertia as it lies now
  void set_node_velocities(SolidNodes<dim>& nodes) const;

  std::vector<std::size_t> members_;
  std::vector<Vec<dim>> arm_reference_, arm_; ///< from the centre to the nodes, at the start and now [m]
  std::vector<Vec<dim>> u_;                   ///< of the nodes at the last complete step [m]
  double mass_ = 0.0;
  Vec<dim> centre_, velocity_, force_;
  Mat<3> inertia_reference_, rotation_ = Mat<3>::identity();
  Vec<3> spin_, omega_, moment_; ///< angular momentum [kg m²/s], angular velocity [1/s], moment [N m]
};

} // namespace undine::solid
