// Edge lengths between two limits.
#include "fluid_pfem/remesh/refine_coarsen.hpp"

#include "common/parallel/in_parts.hpp"
#include "common/parallel/untouched_rows.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <set>
#include <tuple>
#include <utility>

namespace undine::fluid
{

namespace
{

struct Edge
{
  double length_over_h = 0.0;
  index_t i = 0, j = 0;
};

/// Wall pieces that both nodes lie on.
std::array<int, 3> common_pieces(const std::array<int, 3>& a, const std::array<int, 3>& b)
{
  std::array<int, 3> shared{-1, -1, -1};
  std::size_t count = 0;
  for (const int piece : a)
    if (piece >= 0 && std::find(b.begin(), b.end(), piece) != b.end())
      shared[count++] = piece;
  return shared;
}

/// Part of l in the particle mass of k and l. The dynamic mass of torn spray may be negative: a mean with it
/// would lie far outside.
template <int dim>
double share_of(const FluidNodes<dim>& nodes, std::size_t l, std::size_t k)
{
  const double both = nodes.M[k] + nodes.M[l];
  return both > 0.0 ? std::clamp(nodes.M[l] / both, 0.0, 1.0) : 0.5;
}

int count_pieces(const std::array<int, 3>& pieces)
{
  return static_cast<int>(std::count_if(pieces.begin(), pieces.end(), [](int p) { return p >= 0; }));
}

/// Where not all nodes are known, rows of the ends of edges come from the ranks that have them.
/// @returns the ends, in order
template <int dim>
std::vector<index_t> gather_ends(const std::vector<Edge>& close, const std::vector<Edge>& far,
                                 const ShareOfRank<dim>& share, FluidNodes<dim>& nodes)
{
  std::vector<index_t> ends;
  if (!share.known)
    return ends;
  for (const auto* edges : {&close, &far})
    for (const Edge& e : *edges)
      ends.insert(ends.end(), {e.i, e.j});
  std::sort(ends.begin(), ends.end());
  ends.erase(std::unique(ends.begin(), ends.end()), ends.end());
  struct Row
  {
    Vec<dim> x, v, a;
    double m, M, rho, p, V, h;
    std::uint8_t flag, alone;
  };
  std::vector<Row> rows;
  for (const index_t n : ends)
    if (n >= share.node_begin && n < share.node_end)
    {
      const auto i = static_cast<std::size_t>(n);
      rows.push_back({nodes.x[i], nodes.v[i], nodes.a[i], nodes.m[i], nodes.M[i], nodes.rho[i], nodes.p[i],
                      nodes.V[i], nodes.h[i], nodes.flag[i], nodes.alone[i]});
    }
  rows = share.ranks.gather(rows); // ranks have consecutive nodes
  for (std::size_t k = 0; k < rows.size(); ++k)
  {
    const auto i = static_cast<std::size_t>(ends[k]);
    std::tie(nodes.x[i], nodes.v[i], nodes.a[i], nodes.m[i], nodes.M[i], nodes.rho[i], nodes.p[i], nodes.V[i],
             nodes.h[i], nodes.flag[i], nodes.alone[i]) =
        std::tie(rows[k].x, rows[k].v, rows[k].a, rows[k].m, rows[k].M, rows[k].rho, rows[k].p, rows[k].V,
                 rows[k].h, rows[k].flag, rows[k].alone);
  }
  return ends;
}

/// Room for more nodes, of which no rows are moved that are not known.
template <int dim>
void make_room(FluidNodes<dim>& nodes, std::size_t more, const std::vector<index_t>& known)
{
  nodes.for_each_field_of_owners(
      [&](const char*, auto& field)
      {
        if (const std::size_t size = field.size() + more; size > field.capacity())
        {
          field.reserve(size + size / 8);
          give_back_others(field, ranges_of(known));
        }
      });
}

/// Boundary nodes that nearly coincide without sharing an edge: a drop that has landed, two nodes in one
/// corner. Each rank looks from its own.
template <int dim>
void add_touching(const FluidNodes<dim>& nodes, const std::vector<std::array<int, 3>>& wall_pieces,
                  const ShareOfRank<dim>& share, std::vector<Edge>& close)
{
  const auto count_of_nodes = share.known ? static_cast<index_t>(share.known->size()) : nodes.size();
  const auto number = [&](index_t k)
  { return share.known ? (*share.known)[static_cast<std::size_t>(k)] : k; };
  constexpr double touching = 0.1;                                            // of the spacing
  std::vector<double> coarsest(static_cast<std::size_t>(share.threads), 0.0); // of each part
  in_parts(share.threads, static_cast<std::size_t>(count_of_nodes),
           [&](int part, std::size_t begin, std::size_t end)
           {
             double& here = coarsest[static_cast<std::size_t>(part)];
             for (std::size_t k = begin; k < end; ++k)
               here = std::max(here, nodes.h[static_cast<std::size_t>(number(static_cast<index_t>(k)))]);
           });
  const double bin = touching * *std::max_element(coarsest.begin(), coarsest.end());
  Vec<dim> size; // of a bin: a whole number of them fills a period
  std::array<long, dim> count{};
  for (int i = 0; i < dim; ++i)
  {
    const double length = nodes.period.length()[i];
    count[static_cast<std::size_t>(i)] = std::lround(std::floor(length / bin));
    size[i] = length > 0.0 ? length / static_cast<double>(count[static_cast<std::size_t>(i)]) : bin;
  }
  using Cell = std::pair<std::array<long, dim>, index_t>;
  auto cells = list_in_parts<Cell>(share.threads, static_cast<std::size_t>(count_of_nodes), 0,
                                   [&](std::vector<Cell>& list, std::size_t begin, std::size_t end)
                                   {
                                     for (std::size_t k = begin; k < end; ++k)
                                       if (const index_t n = number(static_cast<index_t>(k));
                                           nodes.flag[static_cast<std::size_t>(n)] & on_boundary)
                                       {
                                         std::array<long, dim> cell;
                                         const Vec<dim> from_origin =
                                             nodes.x[static_cast<std::size_t>(n)] - nodes.period.origin();
                                         for (int i = 0; i < dim; ++i)
                                           cell[static_cast<std::size_t>(i)] =
                                               std::lround(std::floor(from_origin[i] / size[i]));
                                         list.emplace_back(cell, n);
                                       }
                                   });
  std::sort(cells.begin(), cells.end());
  for (const auto& [cell, n] : cells)
  {
    if (!share.ranks.alone() && (n < share.node_begin || n >= share.node_end))
      continue;
    int offsets = 1;
    for (int i = 0; i < dim; ++i)
      offsets *= 3;
    for (int offset = 0; offset < offsets; ++offset)
    {
      std::array<long, dim> near = cell;
      for (int i = 0, rest = offset; i < dim; ++i, rest /= 3)
      {
        long& c = near[static_cast<std::size_t>(i)];
        c += rest % 3 - 1;
        if (const long n_cells = count[static_cast<std::size_t>(i)]; n_cells > 0)
          c = (c + n_cells) % n_cells;
      }
      for (auto it = std::lower_bound(cells.begin(), cells.end(), std::pair{near, n + 1});
           it != cells.end() && it->first == near; ++it)
      {
        const auto p = static_cast<std::size_t>(n), q = static_cast<std::size_t>(it->second);
        const double length = nodes.distance(p, q) / std::min(nodes.h[p], nodes.h[q]);
        const bool across_a_wall = count_pieces(wall_pieces[p]) > 0 && count_pieces(wall_pieces[q]) > 0 &&
                                   common_pieces(wall_pieces[p], wall_pieces[q])[0] < 0;
        if (length < touching && !across_a_wall)
          close.push_back({length, n, it->second});
      }
    }
  }
}

} // namespace

template <int dim>
SpacingReport refine_and_coarsen(FluidNodes<dim>& nodes, const FluidMesh<dim>& mesh,
                                 std::vector<std::array<int, 3>>& wall_pieces, index_t n_wet,
                                 const SpacingRules& rules, global_index_t& next_id,
                                 const std::function<bool(const Vec<dim>&, double)>& taken,
                                 const ShareOfRank<dim>& share)
{
  const Ranks& ranks = share.ranks;
  std::vector<Edge> close, far;
  constexpr double beyond_rounding = 1.0 + 1e-12;
  const double longest = std::min(rules.split, rules.split_wall),
               surely_long = rules.merge * rules.merge * beyond_rounding,
               surely_short = longest * longest / beyond_rounding;
  const std::span<const Simplex<dim>> elements =
      ranks.alone() ? std::span<const Simplex<dim>>(mesh.elements) : share.elements;
  const auto edges = list_in_parts<Edge>(
      share.threads, elements.size(), 0,
      [&](std::vector<Edge>& list, std::size_t begin, std::size_t end)
      {
        for (const auto& e : elements.subspan(begin, end - begin))
          for (std::size_t a = 0; a <= dim; ++a)
            for (std::size_t b = a + 1; b <= dim; ++b)
            {
              const index_t i = std::min(e[a], e[b]), j = std::max(e[a], e[b]);
              const auto p = static_cast<std::size_t>(i), q = static_cast<std::size_t>(j);
              const double h = std::min(nodes.h[p], nodes.h[q]);
              if (const double square = norm_squared(nodes.period.near(nodes.x[p], nodes.x[q]) - nodes.x[p]);
                  square > surely_long * h * h && square < surely_short * h * h)
                continue; // as nearly all, without a root
              const double length = nodes.distance(p, q) / h;
              if (length < rules.merge)
                list.push_back({length, i, j});
              else if (length > longest)
                list.push_back({-length, i, j});
            }
      });
  for (const Edge& edge : edges)
    (edge.length_over_h < 0.0 ? far : close).push_back(edge);
  add_touching(nodes, wall_pieces, share, close);
  if (!ranks.alone())
  {
    close = ranks.gather(close);
    far = ranks.gather(far);
  }
  if (close.empty() && far.empty())
    return {};
  SpacingReport report;
  report.involved = gather_ends(close, far, share, nodes);
  std::set<std::pair<index_t, index_t>> boundary_edges, far_ones; // the first: of the far ones
  for (const Edge& e : far)
    far_ones.emplace(e.i, e.j);
  for (const auto& f : mesh.boundary)
    for (std::size_t a = 0; a < dim && !far_ones.empty(); ++a)
      for (std::size_t b = a + 1; b < dim; ++b)
        if (const std::pair edge{std::min(f[a], f[b]), std::max(f[a], f[b])}; far_ones.contains(edge))
          boundary_edges.insert(edge);
  const auto by_length_then_id = [&](const Edge& a, const Edge& b)
  {
    const auto key = [&](const Edge& e)
    {
      const auto p = nodes.id[static_cast<std::size_t>(e.i)], q = nodes.id[static_cast<std::size_t>(e.j)];
      return std::tuple(e.length_over_h, std::min(p, q), std::max(p, q));
    };
    return key(a) < key(b);
  };
  std::sort(close.begin(), close.end(), by_length_then_id);
  std::sort(far.begin(), far.end(), by_length_then_id);

  std::vector<char> busy(static_cast<std::size_t>(nodes.size()), 0), dead(busy.size(), 0);
  for (const Edge& edge : close)
  {
    auto k = static_cast<std::size_t>(edge.i), l = static_cast<std::size_t>(edge.j); // k stays, l goes
    if (busy[k] || busy[l])
      continue;
    const auto rank =
        [&](std::size_t n) // who stays: wet, on more walls, on more named surfaces, on the boundary
    {
      return std::tuple(static_cast<index_t>(n) < n_wet, count_pieces(wall_pieces[n]),
                        std::popcount(nodes.surface[n]), (nodes.flag[n] & on_boundary) != 0);
    };
    if (rank(k) < rank(l))
      std::swap(k, l);
    // Two nodes on different walls meet in a corner: one of them is enough there, the pressure pushes it in.
    if (static_cast<index_t>(l) < n_wet || (nodes.surface[l] & ~nodes.surface[k]) != 0)
      continue;
    busy[k] = busy[l] = dead[l] = 1;
    const double share = share_of(nodes, l, k);
    report.kinetic_lost += 0.5 * nodes.M[k] * share * norm_squared(nodes.v[k] - nodes.v[l]);
    const bool moves = rank(k) == rank(l);
    if (moves)
      nodes.x[k] += share * (nodes.period.near(nodes.x[k], nodes.x[l]) - nodes.x[k]);
    if (moves ||
        nodes.V[k] == 0.0) // density belongs to a place: under gravity the mean is that of another one
      nodes.rho[k] += share * (nodes.rho[l] - nodes.rho[k]);
    nodes.v[k] += share * (nodes.v[l] - nodes.v[k]);
    nodes.a[k] += share * (nodes.a[l] - nodes.a[k]);
    nodes.M[k] += nodes.M[l];
    nodes.m[k] += nodes.m[l];
    nodes.V[k] += nodes.V[l];
    nodes.flag[k] = static_cast<std::uint8_t>(nodes.flag[k] | nodes.flag[l]);
    ++report.merged;
    report.merges.push_back({static_cast<index_t>(k), static_cast<index_t>(l)});
  }
  std::vector<index_t> known; // rows that are right here; empty: all
  if (share.known)
    std::set_union(share.known->begin(), share.known->end(), report.involved.begin(), report.involved.end(),
                   std::back_inserter(known));
  if (share.known)
    make_room(nodes, far.size(), known);
  for (const Edge& edge : far)
  {
    const auto k = static_cast<std::size_t>(edge.i), l = static_cast<std::size_t>(edge.j);
    if (busy[k] || busy[l] || (edge.i < n_wet && edge.j < n_wet))
      continue;
    const bool on_the_boundary = boundary_edges.contains({edge.i, edge.j});
    const auto shared_pieces =
        on_the_boundary ? common_pieces(wall_pieces[k], wall_pieces[l]) : std::array<int, 3>{-1, -1, -1};
    const SurfaceMask shared_surface = on_the_boundary ? nodes.surface[k] & nodes.surface[l] : 0;
    const bool wall_edge = shared_pieces[0] >= 0 || shared_surface != 0;
    if (-edge.length_over_h < (wall_edge ? rules.split_wall : rules.split))
      continue;
    if (!wall_edge && (nodes.flag[k] & on_free_surface) && (nodes.flag[l] & on_free_surface))
      continue;
    const auto mean = [](const auto& a, const auto& b) { return 0.5 * a + 0.5 * b; };
    const Vec<dim> middle = mean(nodes.x[k], nodes.period.near(nodes.x[k], nodes.x[l]));
    if (taken && taken(middle, mean(nodes.h[k], nodes.h[l])))
      continue;
    busy[k] = busy[l] = 1;
    const double M = (nodes.M[k] + nodes.M[l]) / 3.0;
    // Momentum: M v_new = (M_k v_k + M_l v_l)/3 with M = (M_k + M_l)/3.
    const double share = share_of(nodes, l, k);
    const auto mean_by_mass = [share](const Vec<dim>& a, const Vec<dim>& b)
    { return (1.0 - share) * a + share * b; };
    nodes.x.push_back(middle);
    nodes.v.push_back(mean_by_mass(nodes.v[k], nodes.v[l]));
    nodes.a.push_back(mean_by_mass(nodes.a[k], nodes.a[l]));
    nodes.m.push_back((nodes.m[k] + nodes.m[l]) / 3.0);
    nodes.M.push_back(M);
    nodes.inertia.push_back(M);
    nodes.rho.push_back(mean(nodes.rho[k], nodes.rho[l]));
    nodes.p.push_back(mean(nodes.p[k], nodes.p[l]));
    nodes.V.push_back((nodes.V[k] + nodes.V[l]) / 3.0);
    nodes.h.push_back(mean(nodes.h[k], nodes.h[l]));
    nodes.surface.push_back(shared_surface);
    nodes.id.push_back(next_id++);
    nodes.row.push_back(no_row);
    nodes.flag.push_back(static_cast<std::uint8_t>(
        on_the_boundary ? nodes.flag[k] & nodes.flag[l] & (on_boundary | on_free_surface | on_wall) : 0));
    nodes.alone.push_back(0);
    wall_pieces.push_back(shared_pieces);
    for (const std::size_t parent : {k, l})
    {
      nodes.M[parent] *= 2.0 / 3.0;
      nodes.m[parent] *= 2.0 / 3.0;
      nodes.V[parent] *= 2.0 / 3.0;
    }
    ++report.split;
    report.splits.push_back({edge.i, edge.j, nodes.size() - 1});
  }
  if (report.merged > 0)
  {
    dead.resize(static_cast<std::size_t>(nodes.size()), 0);
    std::vector<std::ptrdiff_t> gone;
    for (const auto& [kept, lost] : report.merges)
      gone.push_back(lost);
    gone.push_back(nodes.size());
    std::sort(gone.begin(), gone.end());
    const auto compress = [&](auto& field)
    {
      auto to = field.begin() + gone[0];
      for (std::size_t k = 0; k + 1 < gone.size(); ++k) // what is between two that go
        to = std::move(field.begin() + gone[k] + 1, field.begin() + gone[k + 1], to);
      field.erase(to, field.end());
    };
    report.new_number.resize(dead.size());
    index_t next = 0;
    for (std::size_t n = 0; n < dead.size(); ++n)
      report.new_number[n] = dead[n] ? -1 : next++;
    nodes.for_each_field_of_all([&](const char*, auto& field) { compress(field); });
    compress(wall_pieces);
    for (const auto& split : report.splits)
      known.push_back(split[2]);
    nodes.for_each_field_of_owners(
        [&](const char*, auto& field)
        {
          share.known ? renumber_rows(field, known, report.new_number, static_cast<std::size_t>(next))
                      : compress(field);
        });
  }
  return report;
}

template SpacingReport refine_and_coarsen<2>(FluidNodes<2>&, const FluidMesh<2>&,
                                             std::vector<std::array<int, 3>>&, index_t, const SpacingRules&,
                                             global_index_t&,
                                             const std::function<bool(const Vec<2>&, double)>&,
                                             const ShareOfRank<2>&);
template SpacingReport refine_and_coarsen<3>(FluidNodes<3>&, const FluidMesh<3>&,
                                             std::vector<std::array<int, 3>>&, index_t, const SpacingRules&,
                                             global_index_t&,
                                             const std::function<bool(const Vec<3>&, double)>&,
                                             const ShareOfRank<3>&);

} // namespace undine::fluid
