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
double part_of_the_way(double rise, double linear, double square)
{
  const double discriminant = linear * linear - 4.0 * square * rise;
  return linear < 0.0 && discriminant > 0.0 ? std::min(1.0, 2.0 * rise / (std::sqrt(discriminant) - linear))
                                            : 1.0;
}

/// Mass that a node, or eight, received from others in one change, and what it carries.
template <int dim, class Real = double>
struct Received
{
  Real mass{};               ///< [kg]
  Vec<dim, Real> momentum{}; ///< [kg m/s]
  Real energy{};             ///< kinetic [J]
};

/// Of a node that received mass and now has M: as far towards the common velocity as the kinetic energy of
/// both parts asks for.
template <int dim>
Vec<dim> change_of_velocity(double M, const Vec<dim>& v, const Received<dim>& received)
{
  const double rise = 0.5 * received.mass * norm_squared(v) - received.energy;
  if (!(rise > 0.0) || !(M > received.mass))
    return {};
  const Vec<dim> dv = (1.0 / M) * (received.momentum - received.mass * v);
  return part_of_the_way(rise, M * dot(v, dv), 0.5 * M * norm_squared(dv)) * dv;
}

/// A node when a sweep that spreads the defect of mass begins, in the place of its record of the step.
struct DefectRow
{
  static constexpr int defect = 0, ///< M − m [kg]
      M = 1,                       ///< if it has any to give [kg]
      share = 2,                   ///< part that goes along an edge of an element
      v = 4;                       ///< of the half step [m/s]
};

/// The same of a node, or of eight.
template <int dim, class Real>
struct Defect
{
  Real defect, M, share;
  Vec<dim, Real> v;
};

template <int dim>
Defect<dim, double> defect_of(const NodeRecord<dim>& row)
{
  Defect<dim, double> d{.defect = row.c[DefectRow::defect],
                        .M = row.c[DefectRow::M],
                        .share = row.c[DefectRow::share],
                        .v = {}};
  std::copy_n(row.c.begin() + DefectRow::v, dim, d.v.c.begin());
  return d;
}

/// What comes to a node, or to eight, along its edges.
template <int dim, class Real>
struct Spread
{
  Real dM{};
  Received<dim, Real> received{};

  /// Along an edge of so many elements.
  void add(const Defect<dim, Real>& here, const Defect<dim, Real>& there, const Real& elements)
  {
    using std::max;
    using std::min;
    const Real none(0.0), s = elements * min(here.share, there.share), more = there.defect - here.defect,
                          in = s * min(max(more, none), there.M), out = s * min(max(-more, none), here.M);
    dM += in - out;
    received.mass += in;
    received.momentum += in * there.v;
    received.energy += Real(0.5) * in * norm_squared(there.v);
  }
};

/// Eight of them, those of nodes node[l].
template <class Nodes>
Defect<2, Lanes> load_defects(const UntouchedRows<NodeRecord<2>>& rows, Nodes&& node)
{
  const double *row[Lanes::size], *v[Lanes::size];
  for (int l = 0; l < Lanes::size; ++l)
  {
    row[l] = rows[static_cast<std::size_t>(node(l))].c.data();
    v[l] = row[l] + DefectRow::v;
  }
  Lanes column[4];
  EightRows(row).columns(column);
  Defect<2, Lanes> defects{.defect = column[DefectRow::defect],
                           .M = column[DefectRow::M],
                           .share = column[DefectRow::share],
                           .v = {}};
  load_pairs(v, defects.v[0], defects.v[1]);
  return defects;
}

/// Of the nodes [first, first + 8) of a group, from their rings: a node has one element on the edge to a
/// neighbour beside which its ring is open, else two.
Spread<2, Lanes> spread_to_group(const Rings& rings, std::size_t group, index_t first,
                                 const UntouchedRows<NodeRecord<2>>& rows, const Defect<2, Lanes>& here)
{
  constexpr std::size_t L = Lanes::size;
  const std::span<const Rings::Row> ring{rings.row.data() + rings.begin[group],
                                         rings.row.data() + rings.begin[group + 1]};
  std::array<int, L> open{}; // somewhere, hence before the first neighbour
  const auto is_self = [first](const Rings::Row& row, std::size_t l)
  { return row[l] == 2 * (first + static_cast<index_t>(l)) ? 1 : 0; };
  for (const Rings::Row& row : ring)
    for (std::size_t l = 0; l < L; ++l)
      open[l] |= is_self(row, l);
  Spread<2, Lanes> spread;
  for (std::size_t k = 0; k < ring.size(); ++k)
  {
    typedef int Ints __attribute__((vector_size(L * sizeof(int))));
    const Rings::Row &row = ring[k], &next = ring[k + 1 < ring.size() ? k + 1 : 0];
    Ints elements;
    for (std::size_t l = 0; l < L; ++l)
    {
      const int before = k == 0 ? open[l] : is_self(ring[k - 1], l);
      elements[l] = k > 0 && row[l] == ring[0][l] ? 0 : 2 - before - is_self(next, l); // 0: has come round
    }
    const Defect<2, Lanes> there =
        load_defects(rows, [&row](int l) { return row[static_cast<std::size_t>(l)] / 2; });
    spread.add(here, there, Lanes(__builtin_convertvector(elements, Lanes::Numbers)));
  }
  return spread;
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
  std::vector<Simplex<dim>> own;
  if (!ranks().alone())
  {
    std::vector<std::vector<Simplex<dim>>> to(static_cast<std::size_t>(ranks().size()));
    const auto first = team_.nodes_of_ranks();
    auto r = to.begin();
    for (const auto& e : old)
    {
      const index_t lowest = std::max(0, *std::min_element(e.begin(), e.end())); // what is gone is rank 0's
      const auto k = r - to.begin(); // mostly that of the one before
      if (lowest < first[static_cast<std::size_t>(k)] || lowest >= first[static_cast<std::size_t>(k) + 1])
        r = to.begin() + (std::upper_bound(first.begin() + 1, first.end(), lowest) - first.begin() - 1);
      r->push_back(e);
    }
    old.clear();
    for (const auto& part : ranks().exchange(to))
      old.insert(old.end(), part.begin(), part.end());
    for (const index_t e : team_.earlier())
      if (mesh_.elements[static_cast<std::size_t>(e)][0] >= team_.node_begin())
        own.push_back(mesh_.elements[static_cast<std::size_t>(e)]);
    for (const auto& e : own_elements())
      if (e[0] < team_.node_end())
        own.push_back(e);
    now = own;
  }
  if (!same_numbers)
    old = sorted_elements<dim>(std::move(old));
  std::vector<Simplex<dim>> changed;
  for (std::size_t o = 0, k = 0; o < old.size() || k < now.size();)
    if (k == now.size() || (o < old.size() && old[o] < now[k]))
      changed.push_back(old[o++]);
    else if (o == old.size() || now[k] < old[o])
      changed.push_back(now[k++]);
    else
    {
      if (std::any_of(now[k].begin(), now[k].end(),
                      [&](index_t n) { return moved[static_cast<std::size_t>(n)]; }))
        changed.push_back(now[k]);
      ++o;
      ++k;
    }
  return ranks().gather(changed);
}

/// Present nodes that are not where the remesh found them, among those that this rank had; with a node that
/// was merged, all ranks know. Collective.
/// @param number present number of each old node, −1: deleted
template <int dim>
std::vector<char> Fluid<dim>::moved_nodes(const Particles<dim>& before, std::span<const index_t> number,
                                          const SpacingReport& spacing) const
{
  std::vector<char> moved(nodes_.x.size(), 0);
  for (std::size_t k = 0; k < before.x.size(); ++k)
    if (const index_t n = number[static_cast<std::size_t>(before.begin) + k];
        n >= 0 && nodes_.x[static_cast<std::size_t>(n)] != before.x[k])
      moved[static_cast<std::size_t>(n)] = 1;
  if (spacing.merges.empty())
    return moved;
  std::vector<index_t> merged;
  for (const auto& [kept, gone] : spacing.merges)
    if (const index_t n = number[static_cast<std::size_t>(gone)];
        n >= 0 && moved[static_cast<std::size_t>(n)] && gone >= before.begin &&
        gone < before.begin + static_cast<index_t>(before.x.size()))
      merged.push_back(n);
  merged = ranks().gather(merged);
  for (const index_t n : merged)
    moved[static_cast<std::size_t>(n)] = 1;
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
/// nodes; they keep it. Collective: each rank sweeps over its nodes.
template <int dim>
void Fluid<dim>::smooth_mass_defect(std::vector<Vec<dim>>& v_half)
{
  constexpr int sweeps = dim == 2 ? 7 : 14;
  auto& rows = sums_.record;
  const auto begin_sweep = [&](const Share& share)
  {
    for (index_t n = share.node_begin; n < share.node_end; ++n)
    {
      const auto i = static_cast<std::size_t>(n);
      auto& row = rows[i].c;
      row[DefectRow::defect] = nodes_.M[i] - nodes_.m[i];
      row[DefectRow::M] = std::max(nodes_.M[i], 0.0);
      std::copy(v_half[i].c.begin(), v_half[i].c.end(), row.begin() + DefectRow::v);
    }
  };
  const auto take = [&](std::size_t i, double dM, const Received<dim>& received)
  {
    nodes_.M[i] += dM;
    if (static_cast<index_t>(i) < n_wet_)
      return;
    const Vec<dim> dv = change_of_velocity<dim>(nodes_.M[i], defect_of<dim>(rows[i]).v, received);
    v_half[i] += dv;
    nodes_.v[i] += dv;
  };
  const auto exchange = [&](const Share& share)
  {
    if constexpr (dim == 2)
      for (index_t n = share.node_begin; n < share.node_end;)
      {
        const auto group = static_cast<std::size_t>((n - mesh_.first_with_fan) / Lanes::size);
        const index_t first = mesh_.first_with_fan + static_cast<index_t>(group) * Lanes::size,
                      end = std::min({first + Lanes::size, share.node_end, mesh_.end_with_fan()});
        const Spread<2, Lanes> spread =
            spread_to_group(mesh_.rings, group, first, rows,
                            load_defects(rows, [&](int l) { return std::min(first + l, end - 1); }));
        for (; n < end; ++n)
        {
          const int l = n - first;
          take(static_cast<std::size_t>(n), spread.dM[l],
               {spread.received.mass[l],
                {{spread.received.momentum[0][l], spread.received.momentum[1][l]}},
                spread.received.energy[l]});
        }
      }
    else
      for (index_t n = share.node_begin; n < share.node_end; ++n)
      {
        const auto defect = [&rows](index_t j) { return defect_of<dim>(rows[static_cast<std::size_t>(j)]); };
        Spread<dim, double> spread;
        for (const auto& entry : mesh_.fan(n))
          for (const index_t j : entry.opposite)
            spread.add(defect(n), defect(j), 1.0);
        take(static_cast<std::size_t>(n), spread.dM, spread.received);
      }
  };
  for (index_t n = team_.node_begin(); n < team_.node_end(); ++n)
    rows[static_cast<std::size_t>(n)].c[DefectRow::share] =
        mesh_.isolated(n) ? 0.0 : 0.6 / static_cast<double>(dim * mesh_.n_elements_at(n));
  for (int sweep = 0; sweep < sweeps; ++sweep)
  {
    team_.each(begin_sweep);
    halo_.update(rows);
    team_.each(exchange);
  }
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
