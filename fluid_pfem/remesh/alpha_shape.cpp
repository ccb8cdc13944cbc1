// Circumradius filter, with and without memory.
#include "fluid_pfem/remesh/alpha_shape.hpp"

#include "common/parallel/in_parts.hpp"
#include "fluid_pfem/eight.hpp"
#include "fluid_pfem/remesh/old_domain.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace undine::fluid
{

namespace
{

/// What is larger by this than any threshold is not looked at further.
constexpr double possible_radius = 2.0;

/// Corners in the order of their numbers, and the smallest wanted spacing.
template <int dim>
std::pair<std::array<Vec<dim>, dim + 1>, double> corners_of(Simplex<dim> simplex, std::span<const Vec<dim>> x,
                                                            std::span<const double> h,
                                                            const Period<dim>& period)
{
  std::sort(simplex.begin(), simplex.end());
  double h_min = h[static_cast<std::size_t>(simplex[0])];
  for (const index_t n : simplex)
    h_min = std::min(h_min, h[static_cast<std::size_t>(n)]);
  return {corners<dim>(x, simplex, period), h_min};
}

template <int dim>
bool on_one_piece(const Simplex<dim>& simplex, const std::vector<std::array<int, 3>>& pieces)
{
  for (const int piece : pieces[static_cast<std::size_t>(simplex[0])])
  {
    if (piece < 0)
      break;
    const bool shared = std::all_of(simplex.begin() + 1, simplex.end(),
                                    [&](index_t n)
                                    {
                                      const auto& p = pieces[static_cast<std::size_t>(n)];
                                      return std::find(p.begin(), p.end(), piece) != p.end();
                                    });
    if (shared)
      return true;
  }
  return false;
}

/// Smallest height V·dim / facet and its rate of change from the nodal velocities: does the gap close?
template <int dim>
bool closing_gap(const Simplex<dim>& simplex, const FluidNodes<dim>& nodes, double limit)
{
  const auto x = corners<dim>(nodes.x, simplex, nodes.period);
  const auto g = volume_gradients<dim, double>(x);
  double largest = 0.0, rate = 0.0;
  for (std::size_t a = 0; a < x.size(); ++a)
  {
    largest = std::max(largest, norm(g[a]));
    rate += dot(g[a], nodes.v[static_cast<std::size_t>(simplex[a])]);
  }
  const double height = signed_volume<dim, double>(x) / largest;
  return height < limit && rate < 0.0;
}

/// The circumradius is smaller than `limit`, by more than what the order of the corners can change: without
/// roots and divisions, where it is so.
template <class Real>
auto clearly_smaller(const std::array<Vec<2, Real>, 3>& x, double limit) // R = |a| |b| |a − b| / 2|a × b|
{
  const Vec<2, Real> a = x[1] - x[0], b = x[2] - x[0];
  const Real cross = a[0] * b[1] - a[1] * b[0];
  return norm_squared(a) * norm_squared(b) * norm_squared(a - b) < Real(3.9 * limit * limit) * cross * cross;
}

/// Eight simplices of inner nodes with circumradii clearly smaller than `limit`: not in space.
template <int dim>
bool eight_are_inner(std::span<const Simplex<dim>> simplices, const FluidNodes<dim>& nodes, double limit)
{
  if constexpr (dim == 2)
  {
    unsigned flags = 0;
    for (const auto& simplex : simplices)
      for (const index_t n : simplex)
        flags |= nodes.flag[static_cast<std::size_t>(n)];
    if ((flags & on_boundary) != 0)
      return false;
    const EightElements<2> eight(simplices, nullptr, 0, Lanes::size);
    return !any(Lanes::Mask(clearly_smaller(corners<2>(nodes.x.data(), eight, nodes.period), limit) == 0));
  }
  return false;
}

/// All corners on the boundary, not all on walls, and hardly any height.
template <int dim>
bool is_flat(const Simplex<dim>& simplex, const std::array<Vec<dim>, dim + 1>& corner,
             const FluidNodes<dim>& nodes, double least_quality)
{
  const auto count = [&](NodeFlag flag)
  {
    return std::count_if(simplex.begin(), simplex.end(),
                         [&](index_t n) { return (nodes.flag[static_cast<std::size_t>(n)] & flag) != 0; });
  };
  return count(on_boundary) == dim + 1 && count(on_wall) <= dim &&
         std::abs(quality<dim>(corner)) < least_quality;
}

} // namespace

template <int dim>
bool becomes_fluid(const Simplex<dim>& simplex, const FluidNodes<dim>& nodes, const ShapeRules& rules)
{
  const auto [corner, h] = corners_of<dim>(simplex, nodes.x, nodes.h, nodes.period);
  const bool closes = rules.gap > 0.0 ? closing_gap<dim>(simplex, nodes, rules.gap * h)
                                      : circumradius<dim>(corner) <= rules.create * h;
  return closes && !is_flat<dim>(simplex, corner, nodes, rules.sliver_quality);
}

template <int dim>
std::vector<Simplex<dim>> alpha_shape(std::span<const Vec<dim>> x, std::span<const double> h, double alpha,
                                      const std::vector<Simplex<dim>>& delaunay, const Period<dim>& period)
{
  std::vector<Simplex<dim>> kept;
  kept.reserve(delaunay.size());
  for (const auto& simplex : delaunay)
  {
    const auto [corner, h_min] = corners_of<dim>(simplex, x, h, period);
    if (circumradius<dim>(corner) <= alpha * h_min) // false for the NaN and infinity of a flat simplex
      kept.push_back(simplex);
  }
  return kept;
}

double largest_radius(const ShapeRules& rules)
{
  return std::max(watched_gap, possible_radius * std::max({rules.keep, rules.create, rules.keep_inner}));
}

template <int dim>
ShapeChoice<dim> choose_fluid(const FluidNodes<dim>& nodes,
                              const std::vector<std::array<int, 3>>& wall_pieces,
                              std::vector<Simplex<dim>> delaunay, std::span<const Vec<dim>> old_x,
                              std::span<const Simplex<dim>> old_elements, double bin, const ShapeRules& rules,
                              const Ranks& ranks, int threads)
{
  // Simplices of inner nodes stay fluid unless they are huge; for those with a corner on the boundary it
  // matters whether they were. Most simplices of the convex hull are far larger than anything that can be
  // fluid.
  struct Doubtful
  {
    std::size_t simplex;
    std::array<Vec<dim>, dim + 1> corner;
    double R, h;
    int boundary;
    bool watched, possible;
  };
  UnwrittenRows<char> is_fluid(delaunay.size());
  const double finest = range_of(nodes.h)[0];
  const auto look_at = [&](std::size_t s, std::vector<Doubtful>& list)
  {
    const auto& simplex = delaunay[s];
    int boundary = 0;
    for (const index_t n : simplex)
      boundary += (nodes.flag[static_cast<std::size_t>(n)] & on_boundary) != 0;
    const auto [corner, h] = corners_of<dim>(simplex, nodes.x, nodes.h, nodes.period);
    const double R = circumradius<dim>(corner);
    const double largest =
        std::max({rules.keep, rules.create, boundary <= dim && rules.gap > 0.0 ? rules.keep_inner : 0.0});
    const bool watched = boundary > 0 && R <= watched_gap * h,
               possible =
                   R <= possible_radius * std::max(largest, boundary == 0 ? rules.keep_inner : 0.0) * h;
    if (!(watched || possible) || on_one_piece<dim>(simplex, wall_pieces))
      return void(is_fluid[s] = 0);
    is_fluid[s] = boundary == 0 && R <= rules.keep_inner * h;
    if (!is_fluid[s])
      list.push_back({s, corner, R, h, boundary, watched, possible});
  };
  auto doubtful = list_in_parts<Doubtful>(
      threads, delaunay.size(), 0,
      [&](std::vector<Doubtful>& list, std::size_t first, std::size_t last)
      {
        for (std::size_t begin = first; begin < last; begin += Lanes::size)
        {
          const auto these =
              std::span(delaunay).subspan(begin, std::min<std::size_t>(Lanes::size, last - begin));
          const bool inner =
              these.size() == Lanes::size && eight_are_inner<dim>(these, nodes, rules.keep_inner * finest);
          for (std::size_t s = begin; s < begin + these.size(); ++s)
            if (inner)
              is_fluid[s] = !on_one_piece<dim>(delaunay[s], wall_pieces);
            else
              look_at(s, list);
        }
      });
  std::vector<std::size_t> gaps; // less those that turn out to be fluid
  for (const Doubtful& d : doubtful)
    if (d.watched)
      gaps.push_back(d.simplex);
  std::erase_if(doubtful, [](const Doubtful& d) { return !d.possible; });
  std::vector<Vec<dim>> centroids;
  for (const Doubtful& d : doubtful)
  {
    Vec<dim> centroid{};
    for (const auto& p : d.corner)
      centroid += (1.0 / (dim + 1)) * p;
    centroids.push_back(nodes.period.wrapped(centroid));
  }
  const std::vector<char> was_inside =
      inside<dim>(old_x, old_elements, centroids, bin, nodes.period, ranks, threads);

  ShapeChoice<dim> choice;
  for (std::size_t d = 0; d < doubtful.size(); ++d)
  {
    const auto& [s, corner, R, h, boundary, watched, possible] = doubtful[d];
    const auto& simplex = delaunay[s];
    const bool was_fluid = boundary == 0 || was_inside[d];
    bool fluid = false;
    if (boundary == 0)
      fluid = false; // too large
    else if (was_fluid)
      fluid = R <= (boundary <= dim && rules.gap > 0.0 ? rules.keep_inner : rules.keep) * h &&
              !is_flat<dim>(simplex, corner, nodes, rules.sliver_quality);
    else
      fluid = becomes_fluid<dim>(simplex, nodes, rules);
    is_fluid[s] = fluid;
    if (fluid == was_fluid)
      continue;
    const double V = std::abs(signed_volume<dim, double>(corner));
    (fluid ? choice.created : choice.dropped).add(V);
  }
  for (const std::size_t s : gaps)
    if (!is_fluid[s])
      choice.gaps.push_back(delaunay[s]);
  std::size_t kept = 0;
  for (std::size_t s = 0; s < delaunay.size(); ++s)
    if (is_fluid[s])
      delaunay[kept++] = delaunay[s];
  delaunay.resize(kept);
  choice.elements = std::move(delaunay);
  return choice;
}

template bool becomes_fluid<2>(const Simplex<2>&, const FluidNodes<2>&, const ShapeRules&);
template bool becomes_fluid<3>(const Simplex<3>&, const FluidNodes<3>&, const ShapeRules&);
template std::vector<Simplex<2>> alpha_shape<2>(std::span<const Vec<2>>, std::span<const double>, double,
                                                const std::vector<Simplex<2>>&, const Period<2>&);
template std::vector<Simplex<3>> alpha_shape<3>(std::span<const Vec<3>>, std::span<const double>, double,
                                                const std::vector<Simplex<3>>&, const Period<3>&);
template ShapeChoice<2> choose_fluid<2>(const FluidNodes<2>&, const std::vector<std::array<int, 3>>&,
                                        std::vector<Simplex<2>>, std::span<const Vec<2>>,
                                        std::span<const Simplex<2>>, double, const ShapeRules&, const Ranks&,
                                        int);
template ShapeChoice<3> choose_fluid<3>(const FluidNodes<3>&, const std::vector<std::array<int, 3>>&,
                                        std::vector<Simplex<3>>, std::span<const Vec<3>>,
                                        std::span<const Simplex<3>>, double, const ShapeRules&, const Ranks&,
                                        int);

} // namespace undine::fluid
