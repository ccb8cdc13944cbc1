// Where particle mass goes when a remesh moves volume from node to node.
#include "fluid_pfem/fluid.hpp"

#include "common/lanes.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace undine::fluid
{

namespace
{

/// The part θ ≤ 1 of a change of velocity that takes a rise of kinetic energy away: rise + θ linear + θ²
/// square = 0.
template <class Real>
Real part_of_the_way(const Real& rise, const Real& linear, const Real& square)
{
  using std::min;
  using std::sqrt;
  const Real none(0.0), all(1.0), discriminant = linear * linear - Real(4.0) * square * rise;
  return select((linear < none) & (discriminant > none),
                min(all, Real(2.0) * rise / (sqrt(discriminant) - linear)), all);
}

/// Mass that a node, or eight, received from others in one change, and what it carries.
template <int dim, class Real = double>
struct Received
{
  Real mass{};               ///< [kg]
  Vec<dim, Real> momentum{}; ///< [kg m/s]
  Real energy{};             ///< kinetic [J]
};

/// Of a node, or of eight, that received mass and now has M: as far towards the common velocity as the
/// kinetic energy of both parts asks for.
template <int dim, class Real>
Vec<dim, Real> change_of_velocity(const Real& M, const Vec<dim, Real>& v, const Received<dim, Real>& received)
{
  const Real none(0.0), rise = Real(0.5) * received.mass * norm_squared(v) - received.energy;
  const auto changes = (rise > none) & (M > received.mass);
  if (!any(changes))
    return {};
  const Vec<dim, Real> dv = (Real(1.0) / M) * (received.momentum - received.mass * v);
  const Real part = part_of_the_way<Real>(rise, M * dot(v, dv), Real(0.5) * M * norm_squared(dv));
  Vec<dim, Real> change;
  for (int i = 0; i < dim; ++i)
    change[i] = select(changes, part * dv[i], none);
  return change;
}

/// A node when a sweep that spreads the defect of mass begins, in one half of its record of the step; the
/// other half is for the next sweep.
struct DefectRow
{
  static constexpr int defect = 0, ///< M − m [kg]
      M = 1,                       ///< if it has any to give [kg]
      v = 2;                       ///< of the half step [m/s]
  template <int dim>
  static constexpr int half = NodeRecord<dim>::size / 2;
  template <int dim>
  static constexpr int share = v + dim; ///< part that goes along an edge of an element; in the plane lost in
                                        ///< the first sweep
};

/// The same of a node, or of eight.
template <int dim, class Real>
struct Defect
{
  Real defect, M;
  Vec<dim, Real> v;
};

template <int dim>
Defect<dim, double> defect_of(const double* row)
{
  Defect<dim, double> d{.defect = row[DefectRow::defect], .M = row[DefectRow::M], .v = {}};
  std::copy_n(row + DefectRow::v, dim, d.v.c.begin());
  return d;
}

/// What comes to a node, or to eight, along its edges.
template <int dim, class Real>
struct Spread
{
  Real dM{};
  Received<dim, Real> received{};

  /// @param s part of the smaller mass, or difference, that goes along the edge
  void add(const Defect<dim, Real>& here, const Defect<dim, Real>& there, const Real& s)
  {
    using std::max;
    using std::min;
    const Real more = s * max(min(there.defect - here.defect, there.M), -here.M), in = max(more, Real(0.0));
    dM += more;
    received.mass += in;
    received.momentum += in * there.v;
    received.energy += Real(0.5) * in * norm_squared(there.v);
  }
};

using DefectRows = UntouchedRows<NodeRecord<2>>;

/// Eight of them, in the half that begins with number `half`: those of the nodes half of whose numbers
/// twice(l) tells.
template <class Twice>
Defect<2, Lanes> load_defects(const DefectRows& rows, int half, Twice&& twice)
{
  constexpr std::size_t size = NodeRecord<2>::size / 2;
  const double *const first = rows.data()->c.data() + half, *row[Lanes::size];
  for (int l = 0; l < Lanes::size; ++l)
    row[l] = first + size * static_cast<std::size_t>(twice(l));
  Lanes column[4];
  EightRows(row).columns(column);
  return {.defect = column[DefectRow::defect],
          .M = column[DefectRow::M],
          .v = {{column[DefectRow::v], column[DefectRow::v + 1]}}};
}

/// What goes along the edges of nodes first, first + 1, … of a group, up to `last`, row by row of their ring:
/// the smaller share of both ends, of each element. A node has one element on the edge to a neighbour beside
/// which its ring is open, else two.
void find_edge_shares(std::span<const Rings::Row> ring, index_t first, index_t last, const DefectRows& rows,
                      Lanes* shares)
{
  constexpr std::size_t L = Lanes::size;
  std::array<int, L> open{}; // somewhere, hence before the first neighbour
  const auto is_self = [first](const Rings::Row& row, std::size_t l)
  { return row[l] == 2 * (first + static_cast<index_t>(l)) ? 1 : 0; };
  const auto share = [&rows](index_t n) { return rows[static_cast<std::size_t>(n)].c[DefectRow::share<2>]; };
  for (const Rings::Row& row : ring)
    for (std::size_t l = 0; l < L; ++l)
      open[l] |= is_self(row, l);
  for (std::size_t k = 0; k < ring.size(); ++k)
  {
    const Rings::Row &row = ring[k], &next = ring[k + 1 < ring.size() ? k + 1 : 0];
    for (std::size_t l = 0; l < L; ++l)
    {
      const int before = k == 0 ? open[l] : is_self(ring[k - 1], l),
                elements = k > 0 && row[l] == ring[0][l] ? 0 // has come round
                                                         : 2 - before - is_self(next, l);
      const index_t n = std::min(first + static_cast<index_t>(l), last);
      shares[k].set(static_cast<int>(l), elements * std::min(share(n), share(row[l] / 2)));
    }
  }
}

/// Patches of elements: nodes that share an element belong together.
template <int dim>
Patches patches_of(std::size_t n_nodes, const std::vector<Simplex<dim>>& elements)
{
  std::vector<index_t> leader(n_nodes, -1);
  const auto leader_of = [&](index_t n)
  {
    for (index_t up; (up = leader[static_cast<std::size_t>(n)]) != n; n = up)
      leader[static_cast<std::size_t>(n)] = leader[static_cast<std::size_t>(up)];
    return n;
  };
  for (const auto& e : elements)
  {
    index_t first = -1;
    for (const index_t n : e)
      if (n >= 0)
      {
        if (leader[static_cast<std::size_t>(n)] < 0)
          leader[static_cast<std::size_t>(n)] = n;
        const index_t root = leader_of(n);
        if (first >= 0) // the smaller number leads, so that the order does not matter
          leader[static_cast<std::size_t>(std::max(first, root))] = std::min(first, root);
        first = first < 0 ? root : std::min(first, root);
      }
  }
  Patches patches{.of = std::vector<index_t>(n_nodes, -1), .first = {}, .nodes = {}};
  for (std::size_t n = 0; n < n_nodes; ++n)
    if (leader[n] >= 0)
    {
      patches.nodes.push_back(static_cast<index_t>(n));
      const auto root = static_cast<std::size_t>(leader_of(static_cast<index_t>(n)));
      if (root == n)
      {
        patches.of[n] = static_cast<index_t>(patches.first.size());
        patches.first.push_back(static_cast<index_t>(n));
      }
      else
        patches.of[n] = patches.of[root];
    }
  return patches;
}

} // namespace

/// Elements that the old or the new mesh has alone, or that have been deformed by the remesh. Each rank looks
/// at those of which it has the lowest node. Collective.
/// @param old of this rank before the remesh, in the old numbers
/// @param moved by the remesh: of this rank's nodes and ghosts
/// @param number present number of each old node, −1: deleted
template <int dim>
std::vector<Simplex<dim>> Fluid<dim>::changed_elements(std::vector<Simplex<dim>> old,
                                                       std::span<const char> moved,
                                                       std::span<const index_t> number) const
{
  bool same_numbers = openings_.empty(); // elements of an inlet are in no order
  for (std::size_t n = 0; n < number.size(); ++n)
    same_numbers = same_numbers && number[n] == static_cast<index_t>(n);
  if (!same_numbers)
    for (auto& e : old)
      for (index_t& n : e)
        n = number[static_cast<std::size_t>(n)];
  std::span<const Simplex<dim>> now = mesh_.elements;
  std::vector<Simplex<dim>> earlier; // and before them
  if (!ranks().alone())
  {
    std::vector<std::vector<Simplex<dim>>> to(static_cast<std::size_t>(ranks().size()));
    const auto first = team_.nodes_of_ranks();
    std::size_t kept = 0;
    for (const auto& e : old)
    {
      const index_t lowest = std::max(0, *std::min_element(e.begin(), e.end())); // what is gone is rank 0's
      if (team_.owns(lowest))
        old[kept++] = e;
      else
        to[static_cast<std::size_t>(owner(first, lowest))].push_back(e);
    }
    old.resize(kept);
    const auto me = static_cast<std::ptrdiff_t>(ranks().rank());
    const auto parts = ranks().exchange(std::move(to));
    for (auto part = parts.begin(); part != parts.end(); ++part) // in the order of the ranks
      old.insert(part < parts.begin() + me ? old.end() - static_cast<std::ptrdiff_t>(kept) : old.end(),
                 part->begin(), part->end());
    for (const index_t e : team_.earlier())
      if (mesh_.elements[static_cast<std::size_t>(e)][0] >= team_.node_begin())
        earlier.push_back(mesh_.elements[static_cast<std::size_t>(e)]);
    now = own_elements();
    now = now.first(static_cast<std::size_t>(first_element_from<dim>(now, team_.node_end())));
  }
  if (!same_numbers)
    old = sorted_elements<dim>(std::move(old));
  std::vector<Simplex<dim>> changed;
  const auto has_moved = [&](index_t n) { return moved[static_cast<std::size_t>(n)] != 0; };
  auto o = old.begin();
  for (const auto& part : {std::span<const Simplex<dim>>(earlier), now})
    for (const auto& e : part)
    {
      while (o != old.end() && *o < e)
        changed.push_back(*o++);
      const bool new_here = o == old.end() || e < *o;
      if (new_here || std::any_of(e.begin(), e.end(), has_moved))
        changed.push_back(e);
      o += !new_here;
    }
  changed.insert(changed.end(), o, old.end());
  return ranks().gather(changed);
}

/// Present nodes that are not where the remesh found them, among those that this rank had; with a node that
/// was merged, all ranks know. Collective.
/// @param number present number of each old node
template <int dim>
std::vector<index_t> Fluid<dim>::moved_nodes(const Particles<dim>& before, std::span<const index_t> number,
                                             const SpacingReport& spacing) const
{
  std::vector<index_t> moved;
  const auto has_moved = [&](index_t old)
  {
    const auto k = static_cast<std::size_t>(old - before.begin);
    return nodes_.x[static_cast<std::size_t>(number[static_cast<std::size_t>(old)])] != before.x[k];
  };
  const index_t end = before.begin + static_cast<index_t>(before.x.size());
  for (index_t old = before.begin; old < end; ++old)
    if (has_moved(old))
      moved.push_back(number[static_cast<std::size_t>(old)]);
  if (spacing.merges.empty())
    return moved;
  std::vector<index_t> merged;
  for (const auto& [kept, gone] : spacing.merges)
    if (gone >= before.begin && gone < end && has_moved(gone))
      merged.push_back(number[static_cast<std::size_t>(gone)]);
  merged = ranks().gather(merged);
  moved.insert(moved.end(), merged.begin(), merged.end());
  return moved;
}

/// New connectivity hands volume from node to node; particle mass goes with it, so that a remesh of quiet
/// fluid leaves no defect M − m. Nodes that share changed elements form a patch; what its losers lose goes to
/// its gainers. Only volume that the patch as a whole gained or lost is a defect: that was created or dropped
/// by decision. A node that flies or flew keeps its mass. Patches keep their momenta.
/// @param changed elements of the old or the new mesh that the other does not have, in the present numbers
/// @param before the remesh, those of this rank
/// @param number present number of each old node, −1: deleted
/// @param V_before of each node of this rank before new connectivity [m^dim]
/// @param v_half velocity of the half step, whose momenta and energy count [m/s]
template <int dim>
void Fluid<dim>::hand_over_mass(const std::vector<Simplex<dim>>& changed, const Particles<dim>& before,
                                std::span<const index_t> number, std::span<const double> V_before,
                                std::vector<Vec<dim>>& v_half)
{
  const auto n_nodes = static_cast<std::size_t>(nodes_.size());
  const Patches patches = patches_of<dim>(n_nodes, changed);
  const std::vector<double> V_was = gather_patches(patches, V_before, v_half);
  struct Volumes
  {
    double gain = 0.0, loss = 0.0; ///< [m^dim]
    double mass = 0.0;             ///< that changes hands [kg]
  };
  std::vector<Volumes> volumes(patches.first.size());
  const auto volumes_at = [&](std::size_t n) -> Volumes&
  { return volumes[static_cast<std::size_t>(patches.of[n])]; };
  const auto for_each_gain = [&](auto&& visit)
  {
    for (std::size_t k = 0; k < V_was.size(); ++k)
    {
      const auto n = static_cast<std::size_t>(patches.nodes[k]);
      const bool flies = V_was[k] == 0.0 || (nodes_.flag[n] & isolated_node);
      if (const double gain = flies ? 0.0 : nodes_.V[n] - V_was[k]; gain != 0.0)
        visit(n, gain, volumes_at(n));
    }
  };
  for_each_gain([](std::size_t, double gain, Volumes& p)
                { (gain > 0.0 ? p.gain : p.loss) += std::abs(gain); });
  for_each_gain(
      [&](std::size_t n, double gain, Volumes& p)
      {
        if (gain > 0.0)
          return;
        const double given = nodes_.rho[n] * -gain * std::min(1.0, p.gain / p.loss);
        nodes_.M[n] -= given;
        p.mass += given;
      });
  for_each_gain(
      [&](std::size_t n, double gain, Volumes& p)
      {
        if (gain > 0.0)
          nodes_.M[n] += p.mass * gain / p.gain;
      });

  struct Particle
  {
    index_t patch;
    double M;
    Vec<dim> x, v;
  };
  std::vector<Particle> particles; // those that are now nodes of patches
  for (std::size_t k = 0; k < before.x.size(); ++k)
    if (const index_t n = number[static_cast<std::size_t>(before.begin) + k]; n >= 0)
      if (const index_t patch = patches.of[static_cast<std::size_t>(n)]; patch >= 0)
        particles.push_back({patch, before.M[k], before.x[k], before.v[k]});
  std::vector<MassesInMotion<dim>> had(patches.first.size());
  for (const auto& [patch, M, x, v] : ranks().gather(particles))
    had[static_cast<std::size_t>(patch)].add(M, from_first(patches, patch, x), v);
  keep_momenta(patches, had, v_half);
}

/// The rows of the nodes of patches come from the ranks that have them. Collective.
/// @returns of each of these nodes its volume before new connectivity [m^dim]
template <int dim>
std::vector<double> Fluid<dim>::gather_patches(const Patches& patches, std::span<const double> V_before,
                                               std::span<Vec<dim>> v_half)
{
  struct Row
  {
    double V_before, V, M, rho, h;
    Vec<dim> x, v_half;
    std::uint8_t flag;
  };
  std::vector<double> V_was;
  std::vector<Row> rows;
  for (const index_t n : patches.nodes)
    if (team_.owns(n))
    {
      const auto i = static_cast<std::size_t>(n);
      V_was.push_back(V_before[static_cast<std::size_t>(n - team_.node_begin())]);
      if (!ranks().alone())
        rows.push_back({V_was.back(), nodes_.V[i], nodes_.M[i], nodes_.rho[i], nodes_.h[i], nodes_.x[i],
                        v_half[i], nodes_.flag[i]});
    }
  if (ranks().alone())
    return V_was;
  V_was.clear();
  rows = ranks().gather(rows); // ranks have consecutive nodes
  for (std::size_t k = 0; k < rows.size(); ++k)
  {
    const auto i = static_cast<std::size_t>(patches.nodes[k]);
    V_was.push_back(rows[k].V_before);
    std::tie(nodes_.V[i], nodes_.M[i], nodes_.rho[i], nodes_.h[i], nodes_.x[i], v_half[i], nodes_.flag[i]) =
        std::tie(rows[k].V, rows[k].M, rows[k].rho, rows[k].h, rows[k].x, rows[k].v_half, rows[k].flag);
  }
  return V_was;
}

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

/// Spread M − m over neighbours, conserving ΣM: the feedback then acts on the smooth part and makes no noise.
/// In a sweep all fluxes go by the state at its begin; a node gives at most 0.6 of its mass. Nodes keep their
/// velocities, which conserves momentum of a linear field, unless that would raise the kinetic energy: then a
/// receiver takes over as much of the velocity it received as keeps it. The coupler knows the velocity of wet
/// nodes; they keep it. Collective: each rank sweeps over its nodes, and takes as many sweeps in one pass as
/// they need nothing of its neighbours; these follow near the cuts, sweep by sweep.
template <int dim>
void Fluid<dim>::smooth_mass_defect(std::vector<Vec<dim>>& v_half)
{
  constexpr int sweeps = dim == 2 ? 7 : 14;
  auto& rows = sums_.record;
  std::vector<Lanes> edge_share; // in the plane, beside the rows of the rings
  const auto group_of = [this](index_t n)
  { return static_cast<std::size_t>((n - mesh_.first_with_fan) / Lanes::size); };
  const auto first_of = [this](std::size_t group)
  { return mesh_.first_with_fan + static_cast<index_t>(group) * Lanes::size; };
  const auto ring_of = [this](std::size_t group) -> std::span<const Rings::Row>
  {
    const auto* row = mesh_.rings.row.data();
    return {row + mesh_.rings.begin[group], row + mesh_.rings.begin[group + 1]};
  };
  const auto half_of = [](int sweep) { return sweep % 2 * DefectRow::half<dim>; }; // that it begins with
  const auto write_row = [&](index_t n, int to)
  {
    const auto i = static_cast<std::size_t>(n);
    double* row = rows[i].c.data() + to;
    row[DefectRow::defect] = nodes_.M[i] - nodes_.m[i];
    row[DefectRow::M] = std::max(nodes_.M[i], 0.0);
    std::copy(v_half[i].c.begin(), v_half[i].c.end(), row + DefectRow::v);
  };
  const auto change = [&](index_t n, int sweep, const Vec<dim>& dv)
  {
    if (n >= n_wet_)
    {
      v_half[static_cast<std::size_t>(n)] += dv;
      nodes_.v[static_cast<std::size_t>(n)] += dv;
    }
    write_row(n, half_of(sweep + 1));
  };
  const auto exchange = [&](index_t begin, index_t end_of_all, int sweep)
  {
    const int half = half_of(sweep);
    if constexpr (dim == 2)
      for (index_t n = begin, end; n < end_of_all; n = end)
      {
        const std::size_t group = group_of(n);
        const index_t first = first_of(group);
        end = std::min({first + Lanes::size, end_of_all, mesh_.end_with_fan()});
        const Defect<2, Lanes> here =
            load_defects(rows, half, [&](int l) { return 2 * std::min(first + l, end - 1); });
        Spread<2, Lanes> spread;
        const Lanes* s = edge_share.data() + mesh_.rings.begin[group];
        for (const Rings::Row& row : ring_of(group))
          spread.add(here,
                     load_defects(rows, half, [&row](int l) { return row[static_cast<std::size_t>(l)]; }),
                     *s++);
        Lanes M;
        for (index_t i = n; i < end; ++i)
          M.set(i - first, nodes_.M[static_cast<std::size_t>(i)] += spread.dM[i - first]);
        const Vec<2, Lanes> dv = change_of_velocity<2, Lanes>(M, here.v, spread.received);
        for (index_t i = n; i < end; ++i)
          change(i, sweep, {{dv[0][i - first], dv[1][i - first]}});
      }
    else
      for (index_t n = begin; n < end_of_all; ++n)
      {
        const auto row = [&](index_t j) { return rows[static_cast<std::size_t>(j)].c.data() + half; };
        const auto share_of = [&](index_t j)
        { return rows[static_cast<std::size_t>(j)].c[DefectRow::share<dim>]; };
        const auto here = defect_of<dim>(row(n));
        Spread<dim, double> spread;
        for (const auto& entry : mesh_.fan(n))
          for (const index_t j : entry.opposite)
            spread.add(here, defect_of<dim>(row(j)), std::min(share_of(n), share_of(j)));
        double& M = nodes_.M[static_cast<std::size_t>(n)];
        M += spread.dM;
        change(n, sweep, change_of_velocity<dim, double>(M, here.v, spread.received));
      }
  };
  const auto share_out_edges = [&](const Share& share)
  {
    if constexpr (dim == 2)
    {
      const index_t end = std::min(share.node_end, mesh_.end_with_fan());
      const bool first = team_.number(share) == 0; // else a group in two shares is of the one before
      for (std::size_t group = group_of(share.node_begin + (first ? 0 : Lanes::size - 1));
           first_of(group) < end; ++group)
        find_edge_shares(ring_of(group), first_of(group), mesh_.end_with_fan() - 1, rows,
                         edge_share.data() + mesh_.rings.begin[group]);
    }
  };
  for (index_t n = team_.node_begin(); n < team_.node_end(); ++n)
  {
    rows[static_cast<std::size_t>(n)].c[DefectRow::share<dim>] =
        mesh_.isolated(n) ? 0.0 : 0.6 / static_cast<double>(dim * mesh_.n_elements_at(n));
    write_row(n, half_of(0));
  }
  halo_.update(rows);
  if (dim == 2)
  {
    edge_share.resize(mesh_.rings.row.size());
    team_.each(share_out_edges);
  }
  index_t reach = widest<dim>(own_elements()); // what a node gets in a sweep is of nodes so far off
  for (const index_t e : team_.earlier())
    reach = std::max(reach, widest<dim>({&mesh_.elements[static_cast<std::size_t>(e)], 1}));
  reach = (reach + Lanes::size - 1) / Lanes::size * Lanes::size;
  const auto inner = [&](const Share& share, int sweep) -> std::array<index_t, 2> // what needs no neighbour
  {
    const auto layers = static_cast<index_t>(std::min<std::int64_t>(
        std::int64_t{sweep} * reach, share.node_end - share.node_begin)); // of the sweeps before
    const index_t begin = share.node_begin + (share.node_begin > 0 ? layers : 0);
    return {begin, std::max(begin, share.node_end - (share.node_end < nodes_.size() ? layers : 0))};
  };
  team_.each(
      [&](const Share& share)
      {
        constexpr index_t block = 256;
        std::array<index_t, sweeps> next;
        for (int sweep = 0; sweep < sweeps; ++sweep)
          next[static_cast<std::size_t>(sweep)] = inner(share, sweep)[0];
        for (bool more = true; more;)
        {
          more = false;
          index_t may = next[0] + block; // before it all neighbours have done the sweep before
          for (int sweep = 0; sweep < sweeps; ++sweep)
          {
            index_t& at = next[static_cast<std::size_t>(sweep)];
            const index_t all = inner(share, sweep)[1], end = std::min(may, all);
            if (at < end)
            {
              exchange(at, end, sweep);
              at = end;
            }
            more = more || at < all;
            may = at == all ? share.node_end : at - reach;
          }
        }
      });
  for (int sweep = 1; sweep < sweeps && (!ranks().alone() || team_.threads() > 1); ++sweep)
  {
    halo_.update(rows);
    team_.each(
        [&](const Share& share)
        {
          const auto [begin, end] = inner(share, sweep);
          exchange(share.node_begin, begin, sweep);
          exchange(end, share.node_end, sweep);
        });
  }
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
