// Edge flips with exact predicates.
#include "fluid_pfem/remesh/moving_delaunay.hpp"

#include "common/lanes.hpp"
#include "common/large_arrays.hpp"
#include "common/parallel/in_parts.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace undine::fluid
{

namespace
{

constexpr double half_ulp = 0x1p-53;

/// Sign of the area of (a, b, c): evaluated in floating point, exactly where that does not decide (bounds of
/// Shewchuk 1997).
int orientation(const Vec<2>& a, const Vec<2>& b, const Vec<2>& c)
{
  const double left = (a[0] - c[0]) * (b[1] - c[1]), right = (a[1] - c[1]) * (b[0] - c[0]);
  const double det = left - right,
               error = (3.0 + 16.0 * half_ulp) * half_ulp * (std::abs(left) + std::abs(right));
  if (det > error)
    return 1;
  if (det < -error)
    return -1;
  return exact_orientation(a, b, c);
}

/// Of one d and its triangle (a, b, c), or of eight: positive if d lies inside the circle, and how large it
/// is by rounding alone, at most.
template <class Real>
std::pair<Real, Real> in_circle_and_error(const Vec<2, Real>& a, const Vec<2, Real>& b, const Vec<2, Real>& c,
                                          const Vec<2, Real>& d)
{
  using std::abs;
  const Real adx = a[0] - d[0], ady = a[1] - d[1], bdx = b[0] - d[0], bdy = b[1] - d[1], cdx = c[0] - d[0],
             cdy = c[1] - d[1];
  const Real bc = bdx * cdy, cb = cdx * bdy, ca = cdx * ady, ac = adx * cdy, ab = adx * bdy, ba = bdx * ady;
  const Real a2 = adx * adx + ady * ady, b2 = bdx * bdx + bdy * bdy, c2 = cdx * cdx + cdy * cdy;
  const Real det = a2 * (bc - cb) + b2 * (ca - ac) + c2 * (ab - ba);
  const Real permanent = a2 * (abs(bc) + abs(cb)) + b2 * (abs(ca) + abs(ac)) + c2 * (abs(ab) + abs(ba));
  return {det, Real((10.0 + 96.0 * half_ulp) * half_ulp) * permanent};
}

/// +1: d lies inside the circle through the positive triangle (a, b, c). Never 0: four cocircular points are
/// decided by their coordinates like in CGAL (Devillers & Teillaud 2003).
int in_circle(const Vec<2>& a, const Vec<2>& b, const Vec<2>& c, const Vec<2>& d)
{
  const auto [det, error] = in_circle_and_error<double>(a, b, c, d);
  if (det > error)
    return 1;
  if (det < -error)
    return -1;
  return exact_in_circle(a, b, c, d);
}

} // namespace

// --------------------------------------------------------------------------------------- in space: rebuild

template <int dim>
void MovingDelaunay<dim>::update(std::span<const Vec<dim>> x, double /*extent*/)
{
  large_arrays().return_kept(); // as in the plane
  simplices_ = delaunay(x);
  for (auto& e : simplices_)
    e = canonical<dim>(e);
  ++count_.rebuilds;
}
template <int dim>
void MovingDelaunay<dim>::update_around(std::span<const Vec<dim>> x, std::span<const char> mine, double reach)
{
  large_arrays().return_kept();
  simplices_ = delaunay_around(x, mine, reach);
  for (auto& e : simplices_)
    e = canonical<dim>(e);
  ++count_.rebuilds;
}
template <int dim>
void MovingDelaunay<dim>::forget()
{
}
template <int dim>
void MovingDelaunay<dim>::merge(index_t, index_t)
{
}
template <int dim>
void MovingDelaunay<dim>::split(index_t, index_t, index_t)
{
}
template <int dim>
void MovingDelaunay<dim>::remove(index_t)
{
}
template <int dim>
void MovingDelaunay<dim>::renumber(std::span<const index_t>)
{
}
template class MovingDelaunay<3>;

// ------------------------------------------------------------------------------------ in the plane: flips

void MovingDelaunay<2>::update(std::span<const Vec<2>> x, double extent)
{
  at_vertex_ = std::vector<index_t>();
  const bool known = !triangles_.empty() && points_ == x.size();
  points_ = x.size();
  x_.resize(frame + points_);
  std::copy(corner_.begin(), corner_.end(), x_.begin());
  in_parts(threads_, points_,
           [&](int, std::size_t begin, std::size_t end)
           { std::copy(x.begin() + begin, x.begin() + end, x_.begin() + frame + begin); });
  if (known && repair())
    ++count_.repairs;
  else
  {
    rebuild(extent);
    ++count_.rebuilds;
  }
  x_ = UnwrittenRows<Vec<2>>(); // where memory is short
  positive_ = UnwrittenRows<char>();
}

std::vector<Simplex<2>> MovingDelaunay<2>::simplices() const
{
  return list_in_parts<Simplex<2>>(
      threads_, triangles_.size(), triangles_.size(),
      [this](std::vector<Simplex<2>>& list, std::size_t begin, std::size_t end)
      {
        for (std::size_t t = begin; t < end; ++t)
          if (const auto& v = triangles_[t].v; v[0] >= frame && v[1] >= frame && v[2] >= frame)
            list.push_back(canonical<2>({v[0] - frame, v[1] - frame, v[2] - frame}));
      });
}

void MovingDelaunay<2>::rebuild(double least_extent)
{
  Vec<2> lower{{1e300, 1e300}}, upper{{-1e300, -1e300}};
  for (std::size_t n = frame; n < x_.size(); ++n)
    for (int i = 0; i < 2; ++i)
    {
      lower[i] = std::min(lower[i], x_[n][i]);
      upper[i] = std::max(upper[i], x_[n][i]);
    }
  // Far enough for circles of four extents after the points have moved by several extents.
  const double extent = std::max({upper[0] - lower[0], upper[1] - lower[1], least_extent, 1e-12});
  const Vec<2> centre = 0.5 * (lower + upper);
  for (std::size_t k = 0; k < frame; ++k)
    corner_[k] = x_[k] =
        centre + Vec<2>{{k & 1 ? 32.0 * extent : -32.0 * extent, k & 2 ? 31.0 * extent : -33.0 * extent}};

  large_arrays().return_kept(); // room for the many small things of which CGAL makes a triangulation
  const std::vector<Simplex<2>> all = delaunay(x_);
  triangles_.resize(all.size());
  struct Side
  {
    index_t low, high, triangle;
    int k;
  };
  std::vector<Side> sides;
  sides.reserve(3 * all.size());
  std::vector<char> used(x_.size(), 0);
  for (std::size_t t = 0; t < all.size(); ++t)
  {
    triangles_[t] = {all[t], {-1, -1, -1}};
    for (int k = 0; k < 3; ++k)
    {
      const index_t p = all[t][static_cast<std::size_t>((k + 1) % 3)],
                    q = all[t][static_cast<std::size_t>((k + 2) % 3)];
      sides.push_back({std::min(p, q), std::max(p, q), static_cast<index_t>(t), k});
      used[static_cast<std::size_t>(p)] = 1;
    }
  }
  std::sort(sides.begin(), sides.end(),
            [](const Side& a, const Side& b) { return a.low != b.low ? a.low < b.low : a.high < b.high; });
  for (std::size_t s = 0; s + 1 < sides.size(); ++s)
    if (sides[s].low == sides[s + 1].low && sides[s].high == sides[s + 1].high)
    {
      triangles_[static_cast<std::size_t>(sides[s].triangle)].next[static_cast<std::size_t>(sides[s].k)] =
          sides[s + 1].triangle;
      triangles_[static_cast<std::size_t>(sides[s + 1].triangle)]
          .next[static_cast<std::size_t>(sides[s + 1].k)] = sides[s].triangle;
    }
  complete_ = std::all_of(used.begin(), used.end(), [](char u) { return u != 0; });
}

bool MovingDelaunay<2>::positive(const Triangle& t) const
{
  return orientation(x_[static_cast<std::size_t>(t.v[0])], x_[static_cast<std::size_t>(t.v[1])],
                     x_[static_cast<std::size_t>(t.v[2])]) > 0;
}

int MovingDelaunay<2>::edge_to(index_t t, index_t other) const
{
  const auto& next = triangles_[static_cast<std::size_t>(t)].next;
  return (next[1] == other) + 2 * (next[2] == other); // without branches that nobody can foresee
}

int MovingDelaunay<2>::corner_of(index_t t, index_t v) const
{
  const auto& corner = triangles_[static_cast<std::size_t>(t)].v;
  return corner[0] == v ? 0 : corner[1] == v ? 1 : corner[2] == v ? 2 : -1;
}

/// The edge opposite to corner k of t. Between two positive triangles the circle decides. Otherwise a flip is
/// wanted that leaves fewer inverted ones, or as many if t's corner has crossed its longest edge: it walks
/// on.
bool MovingDelaunay<2>::wants_flip(index_t t, int k, bool may_walk) const
{
  const Triangle& p = triangles_[static_cast<std::size_t>(t)];
  const index_t u = p.next[static_cast<std::size_t>(k)];
  if (u < 0)
    return false;
  const index_t d = triangles_[static_cast<std::size_t>(u)].v[static_cast<std::size_t>(edge_to(u, t))];
  const Vec<2>&a = x_[static_cast<std::size_t>(p.v[static_cast<std::size_t>(k)])],
        &b = x_[static_cast<std::size_t>(p.v[static_cast<std::size_t>((k + 1) % 3)])],
        &c = x_[static_cast<std::size_t>(p.v[static_cast<std::size_t>((k + 2) % 3)])],
        &e = x_[static_cast<std::size_t>(d)];
  const bool t_good = positive_[static_cast<std::size_t>(t)], u_good = positive_[static_cast<std::size_t>(u)];
  if (t_good && u_good)
    return in_circle(a, b, c, e) > 0;
  const int before = !t_good + !u_good, after = (orientation(a, b, e) <= 0) + (orientation(a, e, c) <= 0);
  if (after != before || !may_walk || before == 2)
    return after < before;
  // Seen from the corner that crossed.
  const Vec<2>& corner = t_good ? e : a;
  const double across = norm_squared(b - c);
  return across > norm_squared(b - corner) && across > norm_squared(c - corner);
}

/// (a, b, c) and (d, c, b) become (a, b, d) and (a, d, c).
/// After the flip an end of the edge would be in two triangles only, which then share two edges: neighbours
/// are told apart by their numbers, so this must not be. It happens only where triangles are turned over.
bool MovingDelaunay<2>::leaves_lens(index_t t, int k) const
{
  const auto k0 = static_cast<std::size_t>(k);
  const Triangle& p = triangles_[static_cast<std::size_t>(t)];
  const Triangle& q = triangles_[static_cast<std::size_t>(p.next[k0])];
  const auto l0 = static_cast<std::size_t>(edge_to(p.next[k0], t));
  return p.next[(k0 + 2) % 3] == q.next[(l0 + 1) % 3] || p.next[(k0 + 1) % 3] == q.next[(l0 + 2) % 3];
}

void MovingDelaunay<2>::flip(index_t t, int k)
{
  Triangle& p = triangles_[static_cast<std::size_t>(t)];
  const auto k0 = static_cast<std::size_t>(k), k1 = (k0 + 1) % 3, k2 = (k0 + 2) % 3;
  const index_t u = p.next[k0];
  Triangle& q = triangles_[static_cast<std::size_t>(u)];
  const auto l0 = static_cast<std::size_t>(edge_to(u, t)), l1 = (l0 + 1) % 3, l2 = (l0 + 2) % 3;
  const index_t a = p.v[k0], b = p.v[k1], c = p.v[k2], d = q.v[l0];
  const index_t over_ab = p.next[k2], over_ca = p.next[k1], over_dc = q.next[l2], over_bd = q.next[l1];
  p = {{a, b, d}, {over_bd, u, over_ab}};
  q = {{a, d, c}, {over_dc, over_ca, t}};
  const auto tell = [&](index_t neighbour, index_t before, index_t now)
  {
    if (neighbour >= 0)
      triangles_[static_cast<std::size_t>(neighbour)]
          .next[static_cast<std::size_t>(edge_to(neighbour, before))] = now;
  };
  tell(over_bd, u, t);
  tell(over_ca, t, u);
  ++count_.flips;
}

/// Of triangles begin, begin + 1, … all edges that want to be flipped: eight are looked at together, and
/// again one by one those of inverted triangles, and where rounding decides.
void MovingDelaunay<2>::find_flips(std::vector<std::array<index_t, 2>>& edges, std::size_t begin,
                                   std::size_t end) const
{
  constexpr int L = Lanes::size;
  std::array<std::pair<index_t, int>, L> edge;
  const double* point[4][L] = {};
  int count = 0;
  const auto look = [&]
  {
    std::array<Vec<2, Lanes>, 4> p;
    for (std::size_t k = 0; k < 4; ++k)
      load_pairs(point[k], p[k][0], p[k][1]);
    const auto [det, error] = in_circle_and_error<Lanes>(p[0], p[1], p[2], p[3]);
    const auto outside = det < -error; // for sure
    for (int l = 0; l < count; ++l)
    {
      const auto [t, k] = edge[static_cast<std::size_t>(l)];
      const index_t u = triangles_[static_cast<std::size_t>(t)].next[static_cast<std::size_t>(k)];
      const bool plain = positive_[static_cast<std::size_t>(t)] && positive_[static_cast<std::size_t>(u)];
      if ((!plain || !lane(outside, l)) && wants_flip(t, k, true))
        edges.push_back({t, k});
    }
    count = 0;
  };
  for (auto t = static_cast<index_t>(begin); t < static_cast<index_t>(end); ++t)
    for (int k = 0; k < 3; ++k)
    {
      const Triangle& p = triangles_[static_cast<std::size_t>(t)];
      const auto k0 = static_cast<std::size_t>(k);
      const index_t u = std::max(p.next[k0], t); // t itself: this edge counts once, from its other side
      const index_t d = triangles_[static_cast<std::size_t>(u)].v[static_cast<std::size_t>(edge_to(u, t))];
      constexpr std::array<std::size_t, 5> turn{0, 1, 2, 0, 1};
      const std::array<index_t, 4> corner{p.v[k0], p.v[turn[k0 + 1]], p.v[turn[k0 + 2]], d};
      for (std::size_t c = 0; c < 4; ++c)
        point[c][count] = x_[static_cast<std::size_t>(corner[c])].c.data();
      edge[static_cast<std::size_t>(count)] = {t, k};
      count += u > t; // no branch: half of the edges, in no order
      if (count == L)
        look();
    }
  for (std::size_t c = 0; c < 4 && count > 0; ++c)
    std::fill(point[c] + count, point[c] + L, point[c][0]);
  if (count > 0)
    look();
}

/// @returns false if triangles stay inverted; their connectivity is of no use then
bool MovingDelaunay<2>::repair()
{
  if (!complete_)
    return false;
  const auto n = static_cast<index_t>(triangles_.size());
  positive_.resize(triangles_.size());
  std::vector<std::int64_t> inverted_of(static_cast<std::size_t>(threads_), 0);
  in_parts(threads_, triangles_.size(),
           [&](int part, std::size_t begin, std::size_t end)
           {
             std::int64_t count = 0;
             for (std::size_t t = begin; t < end; ++t)
             {
               positive_[t] = positive(triangles_[t]);
               count += !positive_[t];
             }
             inverted_of[static_cast<std::size_t>(part)] = count;
           });
  std::int64_t inverted = std::accumulate(inverted_of.begin(), inverted_of.end(), std::int64_t{0});
  if (50 * inverted > n) // hopeless, or the points have left the square
    return false;
  stack_ = list_in_parts<std::array<index_t, 2>>(threads_, triangles_.size(), 0,
                                                 [this](auto& edges, std::size_t begin, std::size_t end)
                                                 { find_flips(edges, begin, end); });
  std::int64_t left = 20 * static_cast<std::int64_t>(n), walks = 16 * inverted;
  while (!stack_.empty())
  {
    const auto [t, k] = stack_.back();
    stack_.pop_back();
    if (!wants_flip(t, k, walks > 0))
      continue;
    if (--left < 0 || leaves_lens(t, k))
      return false;
    const index_t u = triangles_[static_cast<std::size_t>(t)].next[static_cast<std::size_t>(k)];
    auto &good_t = positive_[static_cast<std::size_t>(t)], &good_u = positive_[static_cast<std::size_t>(u)];
    const int bad = !good_t + !good_u;
    flip(t, k);
    if (bad > 0)
    {
      good_t = positive(triangles_[static_cast<std::size_t>(t)]);
      good_u = positive(triangles_[static_cast<std::size_t>(u)]);
      const int still_bad = !good_t + !good_u;
      inverted += still_bad - bad;
      walks -= still_bad == bad;
      stack_.push_back({t, 1}); // a–d need not be Delaunay
    }
    stack_.push_back({t, 0}); // the outer edges: b–d, a–b; d–c, c–a
    stack_.push_back({t, 2});
    stack_.push_back({u, 0});
    stack_.push_back({u, 1});
  }
  return inverted == 0;
}

// ------------------------------------------------------------------------------ points that come and go

/// One triangle of each vertex.
void MovingDelaunay<2>::find_vertices()
{
  if (!at_vertex_.empty())
    return;
  at_vertex_.assign(frame + points_, -1);
  for (std::size_t t = 0; t < triangles_.size(); ++t)
    for (const index_t v : triangles_[t].v)
      at_vertex_[static_cast<std::size_t>(v)] = static_cast<index_t>(t);
}

/// Triangles around v, counter-clockwise; false if v is a corner of the square.
bool MovingDelaunay<2>::ring(index_t v, std::vector<index_t>& triangles) const
{
  triangles.clear();
  const index_t first = at_vertex_[static_cast<std::size_t>(v)];
  for (index_t t = first; triangles.empty() || t != first;)
  {
    if (t < 0 || triangles.size() > 1000)
      return false;
    const int k = corner_of(t, v);
    if (k < 0)
      return false;
    triangles.push_back(t);
    t = triangles_[static_cast<std::size_t>(t)]
            .next[static_cast<std::size_t>((k + 1) % 3)]; // across the edge c–v
  }
  return true;
}

/// Triangle t with v[k+1] = i, v[k+2] = j.
bool MovingDelaunay<2>::find_edge(index_t i, index_t j, index_t& found, int& k) const
{
  std::vector<index_t> around;
  if (!ring(i, around))
    return false;
  for (const index_t t : around)
  {
    const int c = corner_of(t, i);
    if (triangles_[static_cast<std::size_t>(t)].v[static_cast<std::size_t>((c + 1) % 3)] == j)
    {
      found = t;
      k = (c + 2) % 3;
      return true;
    }
  }
  return false;
}

void MovingDelaunay<2>::merge(index_t kept, index_t gone)
{
  if (!triangles_.empty() && !collapse(kept + frame, gone + frame))
    forget();
}

/// Into a neighbour that shares two neighbours with it; the flips of the next update do the rest.
void MovingDelaunay<2>::remove(index_t gone)
{
  if (triangles_.empty())
    return;
  find_vertices();
  std::vector<index_t> around;
  if (!ring(gone + frame, around))
    return forget();
  for (const index_t t : around)
  {
    const int k = corner_of(t, gone + frame);
    const index_t neighbour =
        triangles_[static_cast<std::size_t>(t)].v[static_cast<std::size_t>((k + 1) % 3)];
    if (neighbour >= frame && collapse(neighbour, gone + frame))
      return;
  }
  forget();
}

/// @returns false if the result would be no triangulation: nothing has changed
bool MovingDelaunay<2>::collapse(index_t kept, index_t gone)
{
  find_vertices();
  std::vector<index_t> around, around_kept;
  if (!ring(gone, around) || !ring(kept, around_kept))
    return false;
  // The two triangles on the edge go; all common neighbours must be theirs.
  std::vector<index_t> neighbours, common, dead;
  for (const index_t t : around_kept)
    neighbours.push_back(
        triangles_[static_cast<std::size_t>(t)].v[static_cast<std::size_t>((corner_of(t, kept) + 1) % 3)]);
  for (const index_t t : around)
  {
    const index_t v =
        triangles_[static_cast<std::size_t>(t)].v[static_cast<std::size_t>((corner_of(t, gone) + 1) % 3)];
    if (std::find(neighbours.begin(), neighbours.end(), v) != neighbours.end())
      common.push_back(v);
    if (corner_of(t, kept) >= 0)
      dead.push_back(t);
  }
  if (dead.size() != 2 || common.size() != 2)
    return false;
  for (const index_t t : around)
    if (t != dead[0] && t != dead[1])
    {
      auto& v = triangles_[static_cast<std::size_t>(t)].v;
      v[static_cast<std::size_t>(corner_of(t, gone))] = kept;
      at_vertex_[static_cast<std::size_t>(kept)] = t;
    }
  for (const index_t t : dead)
  {
    Triangle& p = triangles_[static_cast<std::size_t>(t)];
    const auto k = static_cast<std::size_t>(corner_of(t, kept)),
               g = static_cast<std::size_t>(corner_of(t, gone));
    const index_t over_kept = p.next[k], over_gone = p.next[g]; // become neighbours
    const index_t third = p.v[3 - k - g];
    for (const auto& [one, other] : {std::pair{over_kept, over_gone}, std::pair{over_gone, over_kept}})
      if (one >= 0)
      {
        triangles_[static_cast<std::size_t>(one)].next[static_cast<std::size_t>(edge_to(one, t))] = other;
        at_vertex_[static_cast<std::size_t>(third)] = one;
      }
    p.v = {-1, -1, -1};
  }
  at_vertex_[static_cast<std::size_t>(gone)] = -1;
  return true;
}

void MovingDelaunay<2>::split(index_t i, index_t j, index_t added)
{
  if (triangles_.empty())
    return;
  find_vertices();
  i += frame;
  j += frame;
  const index_t m = added + frame;
  index_t t = -1;
  int k = 0;
  if (!find_edge(i, j, t, k) || triangles_[static_cast<std::size_t>(t)].next[static_cast<std::size_t>(k)] < 0)
    return forget();
  const index_t u = triangles_[static_cast<std::size_t>(t)].next[static_cast<std::size_t>(k)];
  const auto k0 = static_cast<std::size_t>(k), l0 = static_cast<std::size_t>(edge_to(u, t));
  const Triangle p = triangles_[static_cast<std::size_t>(t)], q = triangles_[static_cast<std::size_t>(u)];
  // p = (a, i, j), q = (d, j, i)
  const index_t a = p.v[k0], d = q.v[l0];
  const index_t over_ja = p.next[(k0 + 1) % 3], over_ai = p.next[(k0 + 2) % 3],
                over_id = q.next[(l0 + 1) % 3], over_dj = q.next[(l0 + 2) % 3];
  const auto s = static_cast<index_t>(triangles_.size()), w = s + 1;
  triangles_[static_cast<std::size_t>(t)] = {{a, i, m}, {u, s, over_ai}};
  triangles_[static_cast<std::size_t>(u)] = {{d, m, i}, {t, over_id, w}};
  triangles_.push_back({{a, m, j}, {w, over_ja, t}});
  triangles_.push_back({{d, j, m}, {s, u, over_dj}});
  if (over_ja >= 0)
    triangles_[static_cast<std::size_t>(over_ja)].next[static_cast<std::size_t>(edge_to(over_ja, t))] = s;
  if (over_dj >= 0)
    triangles_[static_cast<std::size_t>(over_dj)].next[static_cast<std::size_t>(edge_to(over_dj, u))] = w;
  if (static_cast<std::size_t>(m) >= at_vertex_.size())
  {
    at_vertex_.resize(static_cast<std::size_t>(m) + 1, -1);
    points_ = static_cast<std::size_t>(added) + 1;
  }
  at_vertex_[static_cast<std::size_t>(m)] = at_vertex_[static_cast<std::size_t>(i)] = t;
  at_vertex_[static_cast<std::size_t>(j)] = s;
  at_vertex_[static_cast<std::size_t>(a)] = t;
  at_vertex_[static_cast<std::size_t>(d)] = u;
}

/// Triangles that are no more, in order: the last ones take their places.
void MovingDelaunay<2>::drop(const std::vector<index_t>& gone)
{
  for (const index_t place : gone)
  {
    while (!triangles_.empty() && triangles_.back().v[0] < 0)
      triangles_.pop_back();
    const auto last = static_cast<index_t>(triangles_.size()) - 1;
    if (place > last)
      return;
    for (const index_t neighbour : triangles_.back().next)
      if (neighbour >= 0)
        std::ranges::replace(triangles_[static_cast<std::size_t>(neighbour)].next, last, place);
    triangles_[static_cast<std::size_t>(place)] = triangles_.back();
    triangles_.pop_back();
  }
}

void MovingDelaunay<2>::renumber(std::span<const index_t> new_number)
{
  if (triangles_.empty())
    return;
  at_vertex_.clear();
  drop(list_in_parts<index_t>(threads_, triangles_.size(), 0,
                              [this](std::vector<index_t>& list, std::size_t begin, std::size_t end)
                              {
                                for (std::size_t t = begin; t < end; ++t)
                                  if (triangles_[t].v[0] < 0)
                                    list.push_back(static_cast<index_t>(t));
                              }));
  in_parts(threads_, triangles_.size(),
           [&](int, std::size_t begin, std::size_t end)
           {
             for (std::size_t t = begin; t < end; ++t)
               for (index_t& v : triangles_[t].v)
                 if (v >= frame)
                   v = new_number[static_cast<std::size_t>(v - frame)] + frame;
           });
  points_ = static_cast<std::size_t>(
      std::count_if(new_number.begin(), new_number.end(), [](index_t n) { return n >= 0; }));
}

} // namespace undine::fluid
