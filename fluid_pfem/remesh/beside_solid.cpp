// Holes along a thin solid, filled from their rims.
#include "fluid_pfem/remesh/beside_solid.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <queue>
#include <tuple>
#include <utility>

namespace undine::fluid
{

namespace
{

/// A piece of the rim of a hole, which lies on its left.
struct RimEdge
{
  index_t from, to;
  std::size_t before, after; ///< its neighbours on the rim
  int version = 0;           ///< counts its changes; −1: gone
};

/// Rims of the holes: edges of erased elements that no other erased element shares.
std::vector<RimEdge> rims(std::span<const Simplex<2>> erased)
{
  // (from, to) → corner `to` of the element it belongs to: 3 × element + position of `from`
  std::map<std::pair<index_t, index_t>, std::size_t> edges;
  for (std::size_t e = 0; e < erased.size(); ++e)
    for (std::size_t a = 0; a < 3; ++a)
      edges[{erased[e][a], erased[e][(a + 1) % 3]}] = 3 * e + a;
  const auto on_rim = [&](index_t from, index_t to) { return !edges.contains({to, from}); };
  std::vector<RimEdge> rim;
  std::map<std::pair<index_t, index_t>, std::size_t> number;
  for (const auto& [edge, place] : edges)
    if (on_rim(edge.first, edge.second))
    {
      number[edge] = rim.size();
      rim.push_back({edge.first, edge.second, 0, 0});
    }
  for (std::size_t k = 0; k < rim.size(); ++k)
  {
    // Around the end, through the erased elements there, to the edge by which the rim goes on: where a hole
    // touches itself in a node this keeps its sides apart.
    std::size_t place = edges[{rim[k].from, rim[k].to}];
    std::pair<index_t, index_t> next;
    for (;;)
    {
      const auto& e = erased[place / 3];
      next = {e[(place + 1) % 3], e[(place + 2) % 3]};
      if (on_rim(next.first, next.second))
        break;
      place = edges[{next.second, next.first}];
    }
    rim[k].after = number[next];
    rim[rim[k].after].before = k;
  }
  return rim;
}

double circumradius(const Vec<2>& a, const Vec<2>& b, const Vec<2>& c)
{
  const Vec<2> ab = b - a, ac = c - a;
  const double twice_area = ab[0] * ac[1] - ab[1] * ac[0];
  return norm(ab) * norm(ac) * norm(c - b) / (2.0 * twice_area); // negative if clockwise
}

bool contains(const Vec<2>& a, const Vec<2>& b, const Vec<2>& c, const Vec<2>& p)
{
  const auto left = [&p](const Vec<2>& from, const Vec<2>& to)
  { return (to[0] - from[0]) * (p[1] - from[1]) - (to[1] - from[1]) * (p[0] - from[0]) > 0.0; };
  return left(a, b) && left(b, c) && left(c, a);
}

} // namespace

template <>
std::vector<Simplex<2>> fill_beside(const SolidSurface<2>& solid, std::span<const Vec<2>> x,
                                    std::span<const double> h, std::span<const Simplex<2>> erased,
                                    double largest_radius)
{
  std::vector<Simplex<2>> filled;
  std::vector<RimEdge> rim = rims(erased);
  const auto at = [&](index_t n) { return x[static_cast<std::size_t>(n)]; };
  /// Radius of the triangle that cuts off the corner after edge k, or infinity if it may not be filled.
  const auto judge = [&](std::size_t k)
  {
    constexpr double never = std::numeric_limits<double>::infinity();
    const RimEdge& first = rim[k];
    const RimEdge& second = rim[first.after];
    if (second.to == first.from)
      return never;
    const std::array<Vec<2>, 3> corner{at(first.from), at(first.to), at(second.to)};
    const double radius = circumradius(corner[0], corner[1], corner[2]);
    if (!(radius > 0.0) || radius > largest_radius * h[static_cast<std::size_t>(first.to)])
      return never;
    for (std::size_t j = second.after; j != k; j = rim[j].after)
      if (contains(corner[0], corner[1], corner[2], at(rim[j].to)))
        return never;
    return solid.blocks(corner, h[static_cast<std::size_t>(first.to)]) ? never : radius;
  };
  // Small circles first: the triangles come out as those of a constrained Delaunay triangulation mostly.
  using Ear = std::tuple<double, std::size_t, int, int>; // radius, first edge, versions of both
  std::priority_queue<Ear, std::vector<Ear>, std::greater<>> ears;
  const auto offer = [&](std::size_t k)
  {
    if (const double radius = judge(k); std::isfinite(radius))
      ears.emplace(radius, k, rim[k].version, rim[rim[k].after].version);
  };
  for (std::size_t k = 0; k < rim.size(); ++k)
    offer(k);
  while (!ears.empty())
  {
    const auto [radius, k, version, version_after] = ears.top();
    ears.pop();
    if (rim[k].version != version || rim[rim[k].after].version != version_after)
      continue;
    const std::size_t next = rim[k].after;
    filled.push_back({rim[k].from, rim[k].to, rim[next].to});
    rim[k].to = rim[next].to;
    rim[k].after = rim[next].after;
    rim[rim[k].after].before = k;
    ++rim[k].version;
    rim[next].version = -1;
    if (rim[k].after == k || rim[rim[k].after].after == k) // nothing is left of this hole
      continue;
    offer(rim[k].before);
    offer(k);
  }
  return filled;
}

template <>
std::vector<Simplex<3>> fill_beside(const SolidSurface<3>&, std::span<const Vec<3>>, std::span<const double>,
                                    std::span<const Simplex<3>>, double)
{
  return {};
}

template <>
void cling_to_corners<2>(const SolidSurface<2>& solid, std::span<const Facet<2>> boundary, double reach,
                         FluidNodes<2>& nodes)
{
  constexpr double cut = 0.02; // of the spacing: nearer than this a node is on the surface
  const auto corners = solid.convex_corners();
  for (const auto& corner : corners)
  {
    index_t nearest = -1;
    double distance = 0.0;
    for (const auto& [a, b] : boundary)
    {
      const Vec<2> from = nodes.x[static_cast<std::size_t>(a)],
                   edge = nodes.x[static_cast<std::size_t>(b)] - from, to_corner = corner.x - from;
      const double spacing = nodes.h[static_cast<std::size_t>(a)], length = norm(edge),
                   depth = (edge[0] * to_corner[1] - edge[1] * to_corner[0]) / length,
                   along = dot(edge, to_corner) / length;
      if (depth < cut * spacing || depth > reach * spacing || along < 0.0 || along > length)
        continue;
      const index_t n = 2.0 * along < length ? a : b;
      const double d = norm(nodes.x[static_cast<std::size_t>(n)] - corner.x);
      if (d < reach * spacing && (nearest < 0 || d < distance))
      {
        nearest = n;
        distance = d;
      }
    }
    if (nearest < 0)
      continue;
    const auto n = static_cast<std::size_t>(nearest);
    const bool crowded =
        std::any_of(corners.begin(), corners.end(),
                    [&](const auto& other)
                    { return &other != &corner && norm(other.x - corner.x) < reach * nodes.h[n]; });
    if (!crowded &&
        nodes.p[n] > nodes.rho[n] * norm_squared(nodes.v[n] - corner.v)) // room for a node of each
      nodes.x[n] = corner.x;
  }
}

template <>
void cling_to_corners<3>(const SolidSurface<3>&, std::span<const Facet<3>>, double, FluidNodes<3>&)
{
}

} // namespace undine::fluid
