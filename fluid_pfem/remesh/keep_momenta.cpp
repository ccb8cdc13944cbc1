// Momentum and angular momentum of what a remesh has changed.
#include "fluid_pfem/fluid.hpp"

#include <algorithm>
#include <cmath>

namespace undine::fluid
{

/// A place relative to the first node of a patch: sums lose no digits, and in a periodic space the near image
/// counts.
template <int dim>
Vec<dim> Fluid<dim>::from_first(const Patches& patches, index_t patch, const Vec<dim>& x) const
{
  const Vec<dim>& first = nodes_.x[static_cast<std::size_t>(patches.first[static_cast<std::size_t>(patch)])];
  return nodes_.period.near(first, x) - first;
}

/// Of each patch, about its first node.
template <int dim>
std::vector<MassesInMotion<dim>> Fluid<dim>::motion_of(const Patches& patches,
                                                       std::span<const Vec<dim>> v_half) const
{
  std::vector<MassesInMotion<dim>> motion(patches.first.size());
  for (const index_t node : patches.nodes)
  {
    const auto n = static_cast<std::size_t>(node);
    motion[static_cast<std::size_t>(patches.of[n])].add(
        nodes_.M[n], from_first(patches, patches.of[n], nodes_.x[n]), v_half[n]);
  }
  return motion;
}

/// Give each patch the momentum and the angular momentum that it had: what moving mass from place to place,
/// merging and splitting have changed of them is put back as a rigid motion, of all motions that carry it the
/// one of least energy. Moving mass is an inelastic exchange: if the patch came to more kinetic energy than
/// it had, velocities relative to the rigid motion shrink until it has not; and if the rigid motion alone had
/// more, for nodes have come nearer each other, its spin is what the energy allows. Nodes on walls change
/// along them, and those that have their velocity from the coupler, an opening or gravity alone keep it: what
/// is missing is for those to bear. In a periodic space there is no angular momentum to keep.
/// @param had of each patch before, about its first node
template <int dim>
void Fluid<dim>::keep_momenta(const Patches& patches, std::span<const MassesInMotion<dim>> had,
                              std::span<Vec<dim>> v_half)
{
  struct Change
  {
    RigidMotion<dim> from, to;
    double gross = 0.0;                              ///< masses without their signs [kg]
    double rigid = 0.0, mixed = 0.0, relative = 0.0; ///< kinetic energy: rigid + s mixed + s² relative [J]
    double s = 1.0; ///< velocities relative to the rigid motion shrink to that part
  };
  std::vector<Change> changes(had.size());
  const auto for_each_node = [&](auto&& visit)
  {
    for (const index_t node : patches.nodes)
    {
      const auto n = static_cast<std::size_t>(node);
      visit(n, changes[static_cast<std::size_t>(patches.of[n])],
            from_first(patches, patches.of[n], nodes_.x[n]));
    }
  };
  for_each_node([&](std::size_t n, Change& c, const Vec<dim>&) { c.gross += std::abs(nodes_.M[n]); });
  const std::vector<MassesInMotion<dim>> has = motion_of(patches, v_half);
  // Torn spray, some of whose nodes gave more than they had, has no such energy.
  const auto is_sound = [&](std::size_t k) { return has[k].mass > 0.5 * changes[k].gross; };
  for (std::size_t k = 0; k < had.size(); ++k)
    if (Change& c = changes[k]; is_sound(k))
    {
      c.from = has[k].rigid();
      c.to = has[k].rigid(had[k].momentum, had[k].angular);
      if (nodes_.period.any())
        c.to.spin = c.from.spin;
      const double translation = 0.5 * dot(had[k].momentum, c.to.velocity),
                   rotation = c.to.kinetic(had[k].momentum, had[k].angular) - translation,
                   allowed = std::max(0.0, had[k].kinetic - translation);
      if (rotation > allowed)
        c.to.spin = std::sqrt(allowed / rotation) * c.to.spin;
    }
  // The velocity of a node becomes fixed + s shrinking.
  const auto parts = [&](std::size_t n, const Change& c, const Vec<dim>& x) -> std::array<Vec<dim>, 2>
  {
    const Vec<dim>& v = v_half[n];
    return {v + as_it_may(c.to(x) - v, n), as_it_may(v - c.from(x), n)};
  };
  for_each_node(
      [&](std::size_t n, Change& c, const Vec<dim>& x)
      {
        const auto [fixed, shrinking] = parts(n, c, x);
        c.rigid += 0.5 * nodes_.M[n] * norm_squared(fixed);
        c.mixed += nodes_.M[n] * dot(fixed, shrinking);
        c.relative += 0.5 * nodes_.M[n] * norm_squared(shrinking);
      });
  for (std::size_t k = 0; k < had.size(); ++k)
    if (Change& c = changes[k];
        is_sound(k) && c.relative > 0.0 && c.rigid + c.mixed + c.relative > had[k].kinetic)
    {
      const double square = c.mixed * c.mixed - 4.0 * c.relative * (c.rigid - had[k].kinetic);
      c.s = std::clamp((std::sqrt(std::max(0.0, square)) - c.mixed) / (2.0 * c.relative), 0.0, 1.0);
    }
  for_each_node(
      [&](std::size_t n, Change& c, const Vec<dim>& x)
      {
        const auto [fixed, shrinking] = parts(n, c, x);
        const Vec<dim> dv = fixed + c.s * shrinking - v_half[n];
        nodes_.v[n] += dv;
        v_half[n] += dv;
      });
}

/// Of a change of velocity what the walls at node n, the coupler, or an opening leave to a remesh.
template <int dim>
Vec<dim> Fluid<dim>::as_it_may(Vec<dim> dv, std::size_t n) const
{
  if (static_cast<index_t>(n) < n_wet_ || (nodes_.flag[n] & isolated_node) ||
      (nodes_.surface[n] & openings_.driven_mask()))
    return {};
  if (!(nodes_.flag[n] & on_wall))
    return dv;
  constrain(dv, static_cast<index_t>(n));
  const double near = on_wall_within * nodes_.h[n];
  return dv - contact_.into_walls(nodes_.x[n], near, dv) + contact_.into_walls(nodes_.x[n], near, -1.0 * dv);
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
