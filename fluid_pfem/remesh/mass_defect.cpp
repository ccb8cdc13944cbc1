// The defect of mass that a remesh leaves is spread over neighbours.
#include "fluid_pfem/fluid.hpp"

#include "common/lanes.hpp"

#include <algorithm>
#include <cmath>
#include <span>

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

/// The sweeps: what they read and write of nodes.
template <int dim>
class DefectSweeps
{
public:
  using Rows = UntouchedRows<NodeRecord<dim>>;

  DefectSweeps(FluidNodes<dim>& nodes, const FluidMesh<dim>& mesh, index_t n_wet, Rows& rows,
               std::span<Vec<dim>> v_half)
      : nodes_(nodes), mesh_(mesh), n_wet_(n_wet), rows_(rows), v_half_(v_half)
  {
    if (dim == 2)
      edge_share_.resize(mesh.rings.row.size());
  }

  /// A node before the first sweep.
  void begin(index_t n)
  {
    rows_[static_cast<std::size_t>(n)].c[DefectRow::share<dim>] =
        mesh_.isolated(n) ? 0.0 : 0.6 / static_cast<double>(dim * mesh_.n_elements_at(n));
    write_row(n, half_of(0));
  }

  /// In the plane, before the first sweep: what goes along the edges of these nodes. A group in two shares is
  /// of the one before.
  void share_out_edges(index_t begin, index_t end, bool first_share)
  {
    if constexpr (dim == 2)
      for (std::size_t group = group_of(begin + (first_share ? 0 : Lanes::size - 1));
           first_of(group) < std::min(end, mesh_.end_with_fan()); ++group)
        find_edge_shares(ring_of(group), first_of(group), mesh_.end_with_fan() - 1, rows_,
                         edge_share_.data() + mesh_.rings.begin[group]);
  }

  /// One sweep over these nodes.
  void exchange(index_t begin, index_t end_of_all, int sweep)
  {
    const int half = half_of(sweep);
    if constexpr (dim == 2)
      for (index_t n = begin, end; n < end_of_all; n = end)
      {
        const std::size_t group = group_of(n);
        const index_t first = first_of(group);
        end = std::min({first + Lanes::size, end_of_all, mesh_.end_with_fan()});
        const Defect<2, Lanes> here =
            load_defects(rows_, half, [&](int l) { return 2 * std::min(first + l, end - 1); });
        Spread<2, Lanes> spread;
        const Lanes* s = edge_share_.data() + mesh_.rings.begin[group];
        for (const Rings::Row& row : ring_of(group))
          spread.add(here,
                     load_defects(rows_, half, [&row](int l) { return row[static_cast<std::size_t>(l)]; }),
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
        const auto row = [&](index_t j) { return rows_[static_cast<std::size_t>(j)].c.data() + half; };
        const auto share_of = [&](index_t j)
        { return rows_[static_cast<std::size_t>(j)].c[DefectRow::share<dim>]; };
        const auto here = defect_of<dim>(row(n));
        Spread<dim, double> spread;
        for (const auto& entry : mesh_.fan(n))
          for (const index_t j : entry.opposite)
            spread.add(here, defect_of<dim>(row(j)), std::min(share_of(n), share_of(j)));
        double& M = nodes_.M[static_cast<std::size_t>(n)];
        M += spread.dM;
        change(n, sweep, change_of_velocity<dim, double>(M, here.v, spread.received));
      }
  }

private:
  std::size_t group_of(index_t n) const
  {
    return static_cast<std::size_t>((n - mesh_.first_with_fan) / Lanes::size);
  }
  index_t first_of(std::size_t group) const
  {
    return mesh_.first_with_fan + static_cast<index_t>(group) * Lanes::size;
  }
  std::span<const Rings::Row> ring_of(std::size_t group) const
  {
    const auto* row = mesh_.rings.row.data();
    return {row + mesh_.rings.begin[group], row + mesh_.rings.begin[group + 1]};
  }
  /// Of the record, that a sweep begins with.
  static constexpr int half_of(int sweep) { return sweep % 2 * DefectRow::half<dim>; }

  void write_row(index_t n, int to)
  {
    const auto i = static_cast<std::size_t>(n);
    double* row = rows_[i].c.data() + to;
    row[DefectRow::defect] = nodes_.M[i] - nodes_.m[i];
    row[DefectRow::M] = std::max(nodes_.M[i], 0.0);
    std::copy(v_half_[i].c.begin(), v_half_[i].c.end(), row + DefectRow::v);
  }

  void change(index_t n, int sweep, const Vec<dim>& dv)
  {
    if (n >= n_wet_)
    {
      v_half_[static_cast<std::size_t>(n)] += dv;
      nodes_.v[static_cast<std::size_t>(n)] += dv;
    }
    write_row(n, half_of(sweep + 1));
  }

  FluidNodes<dim>& nodes_;
  const FluidMesh<dim>& mesh_;
  index_t n_wet_;
  Rows& rows_;
  std::span<Vec<dim>> v_half_;
  UnwrittenRows<Lanes> edge_share_; ///< in the plane, beside the rows of the rings
};

/// All sweeps over what needs nothing of the neighbours of a share, block by block: each follows the one
/// before at the distance that it reads, while the rows are near.
/// @param inner(sweep): the nodes that a sweep may take
template <int sweeps, class Inner, class Exchange>
void sweep_by_blocks(index_t node_end, index_t reach, Inner&& inner, Exchange&& exchange)
{
  constexpr index_t block = 256;
  std::array<index_t, sweeps> next;
  for (int sweep = 0; sweep < sweeps; ++sweep)
    next[static_cast<std::size_t>(sweep)] = inner(sweep)[0];
  for (bool more = true; more;)
  {
    more = false;
    index_t may = next[0] + block; // before it all neighbours have done the sweep before
    for (int sweep = 0; sweep < sweeps; ++sweep)
    {
      index_t& at = next[static_cast<std::size_t>(sweep)];
      const index_t all = inner(sweep)[1], end = std::min(may, all);
      if (at < end)
      {
        exchange(at, end, sweep);
        at = end;
      }
      more = more || at < all;
      may = at == all ? node_end : at - reach;
    }
  }
}

} // namespace

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
  DefectSweeps<dim> defects(nodes_, mesh_, n_wet_, sums_.record, v_half);
  for (index_t n = team_.node_begin(); n < team_.node_end(); ++n)
    defects.begin(n);
  halo_.update(sums_.record);
  if (dim == 2)
    team_.each([&](const Share& share)
               { defects.share_out_edges(share.node_begin, share.node_end, team_.number(share) == 0); });
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
        sweep_by_blocks<sweeps>(
            share.node_end, reach, [&](int sweep) { return inner(share, sweep); },
            [&](index_t begin, index_t end, int sweep) { defects.exchange(begin, end, sweep); });
      });
  for (int sweep = 1; sweep < sweeps && (!ranks().alone() || team_.threads() > 1); ++sweep)
  {
    halo_.update(sums_.record);
    team_.each(
        [&](const Share& share)
        {
          const auto [begin, end] = inner(share, sweep);
          defects.exchange(share.node_begin, begin, sweep);
          defects.exchange(end, share.node_end, sweep);
        });
  }
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
