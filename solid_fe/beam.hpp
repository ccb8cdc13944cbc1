// Thin walls in 2-D: a shell of unit width made of two-node shear-flexible beams that may turn as far as they
// like.
#pragma once

#include "common/tensor.hpp"
#include "common/types.hpp"
#include "solid_fe/material_config.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace undine::solid
{

/// The wall: its middle line and what it is made of.
struct BeamConfig
{
  std::vector<Vec<2>> X;                        ///< nodes of the middle line [m]
  std::vector<std::array<index_t, 2>> elements; ///< node numbers
  double thickness = 0.0;                       ///< h [m]
  MaterialConfig material;                ///< density, E, ν; linear in the strains of the line, plane strain
  std::vector<std::array<bool, 3>> fixed; ///< x, y, rotation of each node; empty: all free
  Vec<2> gravity{};                       ///< [m/s²]
  double step_safety = 0.9;
};

/// A face of the wall: the middle line moved by h/2 along its normal, which lies to the left of a → b, or
/// against it.
enum class BeamFace
{
  left,
  right
};

/// Geometrically exact beam (Simo 1985, Reissner 1972) with one point per element. With the rotation θ at the
/// point,
///     ε = t·x' − 1,  γ = n·x',  κ = θ',   W = ½ (E'h ε² + ⅚ G h γ² + E'h³/12 κ²),  E' = E/(1 − ν²),
/// t, n the turned tangent and normal: rigid motions of any size are free of stress, forces are the
/// derivative of W. Lumped masses; the rotary inertia is raised to what keeps the highest bending and shear
/// frequency below the membrane's 2 c/L, c = √(E'/ρ): rotations then do not limit the step. The added inertia
/// is of the order of the elements' own length squared: it vanishes with the mesh.
///
/// The steps are those of Solid: predict → solve_free_motion → add_face_force (with the forces of both
/// faces).
class Beam
{
public:
  /// @throws InputError for a thickness, density or element that makes no sense
  explicit Beam(const BeamConfig& config);

  void predict(double dt);           ///< v ← v + Δt/2 a, x ← x + Δt v, and the same for rotations
  void solve_free_motion(double dt); ///< a = M⁻¹ (F_ext − F_int), v ← v + Δt/2 a
  /// a ← a + M⁻¹ f, v ← v + Δt/2 M⁻¹ f for forces at the nodes' points of a face [N/m], which turn the wall
  /// too.
  void add_face_force(BeamFace face, std::span<const Vec<2>> f, double dt);
  /// Constant dead force [N/m] and moment [N] at a node; replaces the one before.
  void set_load(index_t node, const Vec<2>& force, double moment = 0.0);
  /// Forces −α m v and −α J ω: brings the wall to rest. [1/s]
  void set_damping(double alpha) { damping_ = alpha; }
  /// Start over at rest from displaced nodes and rotations.
  void set_motion(std::span<const Vec<2>> u, std::span<const double> theta, std::span<const Vec<2>> v,
                  std::span<const double> omega);

  /// Points of a face that belong to the nodes, x ± h/2 n(θ) [m], and their velocities v + ω × (± h/2 n)
  /// [m/s].
  std::vector<Vec<2>> face_position(BeamFace face) const;
  std::vector<Vec<2>> face_velocity(BeamFace face) const;
  /// Inverse mass that a force at a face point meets there, I/m + (h/2)²/J t⊗t, without fixed components
  /// [1/kg].
  std::vector<Mat<2>> face_inverse_mass(BeamFace face) const;

  double critical_time_step() const; ///< step_safety × min L/c at the current stretch [s]
  double kinetic_energy() const;     ///< [J/m]
  double strain_energy() const;      ///< [J/m]
  double added_inertia() const { return added_inertia_; } ///< share of the rotary inertia that is added
  double mass() const;
  double angular_momentum() const; ///< Σ m x × v + J ω about the origin [kg m/s]

  const std::vector<Vec<2>>& u() const { return u_; }
  const std::vector<double>& theta() const { return theta_; }
  double time() const { return time_; }

private:
  struct Element
  {
    std::array<std::size_t, 2> node;
    double length, angle; ///< in the reference state
  };
  /// Strains of an element and the frame they are measured in.
  struct Strain
  {
    Vec<2> t, n;
    double epsilon, gamma, kappa;
  };
  Strain strain(const Element& e) const;
  Vec<2> arm(BeamFace face, std::size_t node) const; ///< from the middle line to the face [m]
  void add_internal_force();

  double thickness_, density_, membrane_, shear_, bending_; ///< E'h, ⅚Gh, E'h³/12
  double step_safety_, damping_ = 0.0, time_ = 0.0, added_inertia_ = 0.0;
  Vec<2> gravity_;
  std::vector<Element> elements_;
  std::vector<Vec<2>> X_, normal_, u_, v_, a_, F_, inverse_mass_, load_;
  std::vector<double> theta_, omega_, alpha_, M_, inverse_inertia_, load_moment_;
  std::vector<double> m_, J_;
};

} // namespace undine::solid
