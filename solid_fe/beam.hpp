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
  std::vector<double> element_thickness;        ///< h of each element instead, if not empty [m]
  std::vector<Vec<2>> arm;   ///< from the line to the left face at each node [m]; empty: h/2 along the normal
  MaterialConfig material;   ///< density, E, ν; linear in the strains of the line
  bool plane_stress = false; ///< E' = E; otherwise plane strain, E' = E/(1 − ν²)
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
inline constexpr std::array<BeamFace, 2> both_faces{BeamFace::left, BeamFace::right};

/// Stress resultants of an element, and the directions they act in.
struct BeamSection
{
  Vec<2> t, n;      ///< along and across the wall
  double N, Q, M;   ///< membrane and shear force [N/m], moment [N]
  double thickness; ///< [m]
  double stretch;   ///< of the middle line, 1 + ε
  Vec<2> x;         ///< middle of the element [m]
};

/// Geometrically exact beam (Simo 1985, Reissner 1972) with one point per element. With the rotation θ at the
/// point,
///     ε = t·x' − 1,  γ = n·x',  κ = θ',   W = ½ (E'h ε² + ⅚ G h γ² + E'h³/12 κ²),
/// t, n the turned tangent and normal: rigid motions of any size are free of stress, forces are the
/// derivative of W. Lumped masses; the rotary inertia is raised to what keeps the highest bending and shear
/// frequency below the membrane's 2 c/L, c = √(E'/ρ): rotations then do not limit the step. The added inertia
/// is of the order of the elements' own length squared: it vanishes with the mesh.
///
/// A force f on a face acts at the arm r(θ) of its point, so it enters as (f, r × f): the transpose of the
/// velocity v + ω × r of that point. Whatever is done to the faces is therefore work-conjugate to their
/// motion.
///
/// The steps are those of Solid: predict → solve_free_motion → add_face_force (of a coupling, to both faces).
class Beam
{
public:
  /// @throws InputError for a thickness, density or element that makes no sense
  explicit Beam(const BeamConfig& config);

  void predict(double dt);          ///< v ← v + Δt/2 a, x ← x + Δt v, and the same for rotations
  void predict_velocity(double dt); ///< its first half
  void predict_position(double dt); ///< its second half
  /// a = M⁻¹ (F_ext − F_int), v ← v + Δt/2 a; `face_force` holds the forces [N/m] on the left and right point
  /// of each node, or nothing.
  void solve_free_motion(double dt, std::span<const std::array<Vec<2>, 2>> face_force = {});
  /// a ← a + M⁻¹ f, v ← v + Δt/2 M⁻¹ f for a force at a node's point of a face [N/m]: it turns the wall too.
  void add_face_force(BeamFace face, std::size_t node, const Vec<2>& f, double dt);
  /// v ← v + M⁻¹ p for an impulse at a face [N s/m].
  void add_face_impulse(BeamFace face, std::size_t node, const Vec<2>& p);
  void drop_face_forces(); ///< a ← M⁻¹ (F_ext − F_int) of the last solve_free_motion
  /// Velocity of a component (0, 1 [m/s], 2: rotation [1/s]); only of fixed ones it lasts.
  void set_velocity(std::size_t node, int component, double v);
  /// Constant dead force [N/m] and moment [N] at a node; replaces the one before.
  void set_load(index_t node, const Vec<2>& force, double moment = 0.0);
  /// Forces −α m v and −α J ω: brings the wall to rest. [1/s]
  void set_damping(double alpha) { damping_ = alpha; }
  /// Start over at rest from displaced nodes and rotations.
  void set_motion(std::span<const Vec<2>> u, std::span<const double> theta, std::span<const Vec<2>> v,
                  std::span<const double> omega);

  std::size_t n_nodes() const { return X_.size(); }
  std::size_t n_elements() const { return elements_.size(); }
  /// Point of a face that belongs to a node, x + r(θ) [m], its velocity v + ω × r [m/s] and acceleration
  /// a + α × r − ω² r [m/s²].
  Vec<2> face_position(BeamFace face, std::size_t node) const;
  Vec<2> face_velocity(BeamFace face, std::size_t node) const;
  Vec<2> face_acceleration(BeamFace face, std::size_t node) const;
  /// Acceleration of one face point per force on another of the same node: I/m + (k × r_a) ⊗ (k × r_b)/J,
  /// without fixed components [1/kg]. The block of two faces is not zero: the wall carries what one feels to
  /// the other.
  Mat<2> face_inverse_mass(BeamFace moved, BeamFace pushed, std::size_t node) const;
  /// Arm from the line to a face at the present rotation [m].
  Vec<2> arm(BeamFace face, std::size_t node) const;

  double highest_frequency_squared() const; ///< (2 c/L)² of the stiffest element at its stretch [1/s²]
  double critical_time_step() const;        ///< step_safety × min L/c at the current stretch [s]
  double kinetic_energy() const;            ///< [J/m]
  double strain_energy() const;             ///< [J/m]
  double added_inertia() const { return added_inertia_; } ///< share of the rotary inertia that is added
  double mass() const;
  double mass(std::size_t node) const { return m_[node]; }
  double inertia(std::size_t node) const { return J_[node]; } ///< [kg m]
  double angular_momentum() const; ///< Σ m x × v + J ω about the origin [kg m/s]
  BeamSection section(std::size_t element) const;
  std::array<std::size_t, 2> element_nodes(std::size_t element) const { return elements_[element].node; }

  const std::vector<Vec<2>>& X() const { return X_; }
  const std::vector<Vec<2>>& u() const { return u_; }
  const std::vector<Vec<2>>& v() const { return v_; }
  const std::vector<double>& theta() const { return theta_; }
  const std::vector<double>& omega() const { return omega_; }
  bool is_fixed(std::size_t node, int component) const;
  /// F_ext − F_int on a node [N/m] without link forces: what a support of a fixed component takes up.
  const Vec<2>& force(std::size_t node) const { return F_[node]; }
  const Vec<2>& acceleration(std::size_t node) const { return a_[node]; }
  /// F_int and its moment at any displacement and rotation; allocates nothing.
  void internal_force_at(std::span<const Vec<2>> u, std::span<const double> theta, std::span<Vec<2>> F,
                         std::span<double> M) const;
  double time() const { return time_; }

  /// Visit every field of the state once, with its name.
  template <class Visitor>
  void for_each_field(Visitor&& visit)
  {
    visit("beam_u", u_);
    visit("beam_v", v_);
    visit("beam_a", a_);
    visit("beam_force", F_);
    visit("beam_theta", theta_);
    visit("beam_omega", omega_);
    visit("beam_alpha", alpha_);
    visit("beam_moment", M_);
  }

  template <class Archive>
  void for_each_state(Archive& archive)
  {
    archive("time", time_);
    archive("arm", arm_);
    archive("u", u_);
    archive("v", v_);
    archive("a", a_);
    archive("F", F_);
    archive("load", load_);
    archive("theta", theta_);
    archive("omega", omega_);
    archive("alpha", alpha_);
    archive("M", M_);
    archive("load_moment", load_moment_);
  }

private:
  struct Element
  {
    std::array<std::size_t, 2> node;
    double length, angle, thickness; ///< in the reference state
    double membrane, shear, bending; ///< E'h, ⅚Gh, E'h³/12
  };
  /// Strains of an element and the frame they are measured in.
  struct Strain
  {
    Vec<2> t, n;
    double epsilon, gamma, kappa;
  };
  Strain strain(const Element& e, std::span<const Vec<2>> u, std::span<const double> theta) const;
  Strain strain(const Element& e) const { return strain(e, u_, theta_); }

  double wave_speed_ = 0.0; ///< √(E'/ρ)
  double step_safety_, damping_ = 0.0, time_ = 0.0, added_inertia_ = 0.0;
  Vec<2> gravity_;
  std::vector<Element> elements_;
  std::vector<Vec<2>> X_, arm_, u_, v_, a_, F_, inverse_mass_, load_;
  std::vector<double> theta_, omega_, alpha_, M_, inverse_inertia_, load_moment_;
  std::vector<double> m_, J_;
};

} // namespace undine::solid
