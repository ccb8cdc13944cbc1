// The rigid motion of a set of masses: what carries their momentum and angular momentum.
#pragma once

#include "common/tensor.hpp"

#include <cmath>

namespace undine::fluid
{

/// Components of a spin: 1 in the plane, 3 in space.
template <int dim>
constexpr int spin_size = dim == 2 ? 1 : 3;

/// r × q; in the plane its component out of it.
template <int dim>
constexpr Vec<spin_size<dim>> moment(const Vec<dim>& r, const Vec<dim>& q)
{
  if constexpr (dim == 2)
    return {{r[0] * q[1] - r[1] * q[0]}};
  else
    return cross(r, q);
}

/// u + ω × (x − centre).
template <int dim>
struct RigidMotion
{
  Vec<dim> centre{}, velocity{}; ///< [m], [m/s]
  Vec<spin_size<dim>> spin{};    ///< ω [1/s]

  Vec<dim> operator()(const Vec<dim>& x) const
  {
    const Vec<dim> r = x - centre;
    if constexpr (dim == 2)
      return velocity + spin[0] * Vec<2>{{-r[1], r[0]}};
    else
      return velocity + cross(spin, r);
  }

  /// Kinetic energy of masses that move so with momentum P and angular momentum L about the origin [J].
  double kinetic(const Vec<dim>& P, const Vec<spin_size<dim>>& L) const
  {
    return 0.5 * (dot(P, velocity) + dot(L - moment<dim>(centre, P), spin));
  }
};

/// Mass, momentum, angular momentum about the origin and kinetic energy of a set of masses, and the moments
/// of mass that a rigid motion of theirs needs.
template <int dim>
struct MassesInMotion
{
  double mass = 0.0;             ///< [kg]
  Vec<dim> first{};              ///< Σ M x [kg m]
  Mat<dim> second{};             ///< Σ M x xᵀ [kg m²]
  Vec<dim> momentum{};           ///< Σ M v [kg m/s]
  Vec<spin_size<dim>> angular{}; ///< Σ M x × v [kg m²/s]
  double kinetic = 0.0;          ///< ½ Σ M v² [J]

  void add(double M, const Vec<dim>& x, const Vec<dim>& v)
  {
    mass += M;
    first += M * x;
    second += outer(M * x, x);
    momentum += M * v;
    angular += moment<dim>(x, M * v);
    kinetic += 0.5 * M * norm_squared(v);
  }

  /// The rigid motion in which these masses have momentum P [kg m/s] and angular momentum L about the origin
  /// [kg m²/s]. Masses on a line have no spin in space, one mass has none in the plane.
  RigidMotion<dim> rigid(const Vec<dim>& P, const Vec<spin_size<dim>>& L) const
  {
    RigidMotion<dim> motion;
    if (!(mass > 0.0))
      return motion;
    motion.centre = (1.0 / mass) * first;
    motion.velocity = (1.0 / mass) * P;
    const Vec<spin_size<dim>> about_centre = L - moment<dim>(motion.centre, P);
    const Mat<dim> about = second - outer(first, motion.centre);
    const double round_off = 1e-6 * trace(second);
    if constexpr (dim == 2)
    {
      if (const double inertia = trace(about); inertia > round_off)
        motion.spin[0] = about_centre[0] / inertia;
    }
    else
    {
      const Mat<3> inertia = trace(about) * Mat<3>::identity() - about;
      const double size = trace(inertia) / 3.0, volume = determinant(inertia);
      if (size > round_off && volume > 1e-6 * size * size * size)
        motion.spin = (1.0 / volume) * (adjugate(inertia) * about_centre);
    }
    return motion;
  }
  RigidMotion<dim> rigid() const { return rigid(momentum, angular); }
};

} // namespace undine::fluid
