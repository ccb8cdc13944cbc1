// Contact with rigid walls.
#include "fluid_pfem/walls.hpp"

#include "common/error.hpp"
#include "common/mesh/mesh.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>

namespace undine::fluid
{

namespace
{

/// Unit normal of a segment (to the left of it) or a triangle (right-handed).
template <int dim>
Vec<dim> normal_of(const std::array<Vec<dim>, dim>& corner)
{
  Vec<dim> n;
  if constexpr (dim == 2)
    n = -right_normal(corner[1] - corner[0]);
  else
    n = cross(corner[1] - corner[0], corner[2] - corner[0]);
  return n * (1.0 / norm(n));
}

/// The twelve triangles of a box, seen from outside.
std::vector<std::array<Vec<3>, 3>> box_triangles(const Vec<3>& lower, const Vec<3>& upper)
{
  std::vector<std::array<Vec<3>, 3>> triangles;
  for (int i = 0; i < 3; ++i)
    for (int end = 0; end < 2; ++end)
    {
      const int j = (i + 1) % 3, k = (i + 2) % 3;
      const auto at = [&](int p, int q)
      {
        Vec<3> x;
        x[i] = end == 0 ? lower[i] : upper[i];
        x[j] = p == 0 ? lower[j] : upper[j];
        x[k] = q == 0 ? lower[k] : upper[k];
        return x;
      };
      const std::array<Vec<3>, 4> face{at(0, 0), at(1, 0), at(1, 1), at(0, 1)}; // counter-clockwise about +i
      if (end == 1)
      {
        triangles.push_back({face[0], face[1], face[2]});
        triangles.push_back({face[0], face[2], face[3]});
      }
      else
      {
        triangles.push_back({face[0], face[2], face[1]});
        triangles.push_back({face[0], face[3], face[2]});
      }
    }
  return triangles;
}

/// Reach past the ends and edges that pieces share: far past concave ones, a rounding past flat ones.
/// @returns there is a convex one
template <int dim>
bool join(std::vector<WallPiece<dim>>& pieces, const std::function<bool(int, int)>& together, double spacing)
{
  bool convex = false;
  for (auto& piece : pieces)
    piece.reach.fill(-1e-9 * spacing); // a node on the neighbour's side of a convex edge is not on this piece
  const auto has = [](const WallPiece<dim>& piece, const Vec<dim>& x)
  { return std::find(piece.corner.begin(), piece.corner.end(), x) != piece.corner.end(); };
  for (auto& p : pieces)
    for (std::size_t k = 0; k < dim; ++k)
      for (const auto& q : pieces)
      {
        if (&p == &q || p.plane || q.plane || !together(p.wall, q.wall) || !has(q, p.corner[k]) ||
            (dim == 3 && !has(q, p.corner[(k + 1) % dim])))
          continue;
        const auto other = *std::find_if(
            q.corner.begin(), q.corner.end(),
            [&](const auto& x) { return x != p.corner[k] && (dim == 2 || x != p.corner[(k + 1) % dim]); });
        const double rise = p.distance(other);
        convex = convex || rise < -1e-9 * spacing;
        p.reach[k] = rise > 1e-9 * spacing    ? 4.0 * spacing
                     : rise > -1e-9 * spacing ? 1e-9 * spacing
                                              : p.reach[k];
      }
  return convex;
}

} // namespace

template <int dim>
void WallPiece<dim>::find_ends()
{
  for (std::size_t k = 0; k < dim; ++k)
  {
    if constexpr (dim == 2)
      out[k] = corner[k] - corner[1 - k];
    else
      out[k] = cross(corner[(k + 1) % 3] - corner[k], n);
    out[k] = out[k] * (1.0 / norm(out[k]));
  }
}

template <int dim>
double WallPiece<dim>::overhang(const Vec<dim>& x, bool with_reach) const
{
  if (plane)
    return std::numeric_limits<double>::lowest();
  double furthest = std::numeric_limits<double>::lowest();
  for (std::size_t k = 0; k < dim; ++k)
    furthest = std::max(furthest, dot(x - corner[k], out[k]) - (with_reach ? reach[k] : 0.0));
  return furthest;
}

template <int dim>
double WallPiece<dim>::gap(const Vec<dim>& x) const
{
  if (overhang(x, false) <= 0.0)
    return std::abs(distance(x));
  double shortest = std::numeric_limits<double>::max();
  for (std::size_t k = 0; k < dim; ++k)
  {
    const Vec<dim> t = corner[(k + 1) % dim] - corner[k];
    shortest = std::min(
        shortest, norm(x - corner[k] - std::clamp(dot(x - corner[k], t) / norm_squared(t), 0.0, 1.0) * t));
  }
  return shortest;
}

template <int dim>
Walls<dim>::Walls(const std::vector<WallGeometry>& geometry, double spacing, double t)
    : geometry_(geometry), spacing_(spacing)
{
  for (std::size_t w = 0; w < geometry.size(); ++w)
  {
    const WallGeometry& g = geometry[w];
    const auto add = [&](const std::array<Vec<dim>, dim>& corner)
    {
      reference_.push_back({.corner = corner, .n = normal_of<dim>(corner), .wall = static_cast<int>(w)});
      reference_.back().find_ends();
    };
    if (g.plane)
    {
      WallPiece<dim> piece{.wall = static_cast<int>(w), .plane = true};
      piece.corner.fill(leading<dim>(g.points.front()));
      piece.n = leading<dim>(g.normal) * (1.0 / norm(leading<dim>(g.normal)));
      reference_.push_back(piece);
      continue;
    }
    if (!g.facets.empty())
    {
      const auto first = reference_.size();
      for (const auto& f : g.facets)
      {
        std::array<Vec<dim>, dim> corner;
        for (std::size_t k = 0; k < dim; ++k)
          corner[k] = leading<dim>(f[k]);
        add(corner);
        if constexpr (dim == 3) // triangles in one plane are one face
        {
          auto& piece = reference_.back();
          piece.face = static_cast<int>(reference_.size() - 1);
          for (std::size_t k = first; k + 1 < reference_.size(); ++k)
            if (dot(reference_[k].n, piece.n) > 1.0 - 1e-12 &&
                std::abs(reference_[k].distance(piece.corner[0])) < 1e-9 * spacing)
            {
              piece.face = reference_[k].face;
              break;
            }
        }
      }
      continue;
    }
    if constexpr (dim == 2)
    {
      const std::size_t n = g.points.size();
      if (n < 2)
        throw InputError("wall '" + g.name + "': a polyline needs at least two points");
      for (std::size_t k = 0; k < (g.closed ? n : n - 1); ++k)
      {
        if (g.points[k] == g.points[(k + 1) % n])
          throw InputError("wall '" + g.name + "': two successive points coincide");
        add({leading<2>(g.points[k]), leading<2>(g.points[(k + 1) % n])});
      }
    }
    else
    {
      if (!g.box)
        throw InputError("wall '" + g.name +
                         "': in 3-D a wall is a plane (point, normal), a box or comes from a mesh");
      std::size_t triangle = 0;
      for (auto corner : box_triangles(leading<3>(g.points[0]), leading<3>(g.points[1])))
      {
        if (g.fluid_inside)
          std::swap(corner[1], corner[2]);
        add(corner);
        reference_.back().face = static_cast<int>(reference_.size() - 1 - triangle++ % 2);
      }
    }
  }
  const auto together = [&](int v, int w)
  {
    return v == w || !(geometry[static_cast<std::size_t>(v)].motion.moves() ||
                       geometry[static_cast<std::size_t>(w)].motion.moves());
  };
  has_convex_ = join<dim>(reference_, together, spacing);
  reaction_.impulse.assign(geometry.size(), {});
  path_.assign(2, {.pieces = reference_});
  move_to(t);
  path_.assign(2, {.pieces = pieces()});
}

namespace
{

/// Facets of a plane group in the order of a walk along it; whether that is one closed walk.
bool put_in_order(std::vector<std::array<std::array<double, 3>, 3>>& facets)
{
  auto begin = facets.begin();
  int walks = 0;
  bool closed = false;
  while (begin != facets.end())
  {
    // A walk starts where no other segment ends; on a closed one anywhere.
    const auto start =
        std::find_if(begin, facets.end(),
                     [&](const auto& f) {
                       return std::none_of(begin, facets.end(), [&](const auto& g) { return g[1] == f[0]; });
                     });
    std::iter_swap(begin, start == facets.end() ? begin : start);
    const auto first = begin;
    for (auto next = begin; next != facets.end();)
    {
      std::iter_swap(begin++, next);
      next = std::find_if(begin, facets.end(), [&](const auto& f) { return f[0] == (*(begin - 1))[1]; });
    }
    closed = (*(begin - 1))[1] == (*first)[0];
    ++walks;
  }
  return walks == 1 && closed;
}

template <int dim>
std::vector<WallGeometry> walls_of(const std::string& path, const std::string& group, bool fluid_inside)
{
  const Mesh<dim> mesh = read_gmsh<dim>(path);
  std::vector<WallGeometry> walls;
  std::vector<std::string> names;
  for (const auto& [name, surface] : mesh.surfaces)
  {
    names.push_back(name);
    if (!group.empty() && name != group)
      continue;
    WallGeometry g;
    g.name = name;
    g.fluid_inside = fluid_inside;
    for (index_t f = 0; f < surface.size(); ++f)
    {
      std::vector<std::array<double, 3>> corner; // outward of what is meshed
      for (index_t k = surface.offset[static_cast<std::size_t>(f)];
           k < surface.offset[static_cast<std::size_t>(f) + 1]; ++k)
      {
        corner.push_back({});
        const auto& x = mesh.x[static_cast<std::size_t>(surface.nodes[static_cast<std::size_t>(k)])];
        std::copy(x.c.begin(), x.c.end(), corner.back().begin());
      }
      if (fluid_inside == (dim == 3)) // walls look into the fluid, and a segment has it on its left
        std::reverse(corner.begin(), corner.end());
      if (dim == 2)
        g.facets.push_back({corner[0], corner[1], {}});
      else
        for (std::size_t k = 2; k < corner.size(); ++k)
          g.facets.push_back({corner[0], corner[k - 1], corner[k]});
    }
    if (dim == 2)
      g.closed = put_in_order(g.facets);
    walls.push_back(std::move(g));
  }
  if (walls.empty())
    throw InputError(group.empty() ? path + ": no boundary group bounds an element; a wall needs one"
                                   : fmt::format("{}: there is no boundary group '{}'. Groups there: {}",
                                                 path, group, fmt::join(names, " ")));
  return walls;
}

} // namespace

std::vector<WallGeometry> walls_of_mesh(const std::string& path, int dim, const std::string& group,
                                        bool fluid_inside)
{
  return dim == 2 ? walls_of<2>(path, group, fluid_inside) : walls_of<3>(path, group, fluid_inside);
}

template <int dim>
void Walls<dim>::move_to(std::span<const double> times)
{
  if (!moves())
    return;
  std::swap(path_.front(), path_.back());
  path_.resize(times.size() + 1);
  for (std::size_t k = 0; k < times.size(); ++k)
    move(times[k], path_[k], path_[k + 1]);
}

template <int dim>
void Walls<dim>::move(double t, const Placement& from, Placement& to) const
{
  to = from;
  double fastest = 0.0; // corner, over this move [m]
  for (std::size_t k = 0; k < reference_.size(); ++k)
  {
    const WallMotion& motion = geometry_[static_cast<std::size_t>(reference_[k].wall)].motion;
    if (!motion.moves())
      continue;
    const double angle = motion.angle ? (*motion.angle)(0.0, 0.0, 0.0, t) : 0.0, c = std::cos(angle),
                 s = std::sin(angle);
    const auto turn = [&](Vec<dim> v)
    {
      const double x = v[0], y = v[1];
      v[0] = c * x - s * y;
      v[1] = s * x + c * y;
      return v;
    };
    Vec<dim> shift{};
    for (std::size_t i = 0; i < motion.displacement.size(); ++i)
      shift[static_cast<int>(i)] = motion.displacement[i](0.0, 0.0, 0.0, t);
    const Vec<dim> centre = leading<dim>(motion.centre);
    for (std::size_t c = 0; c < dim; ++c)
    {
      to.pieces[k].corner[c] = centre + turn(reference_[k].corner[c] - centre) + shift;
      fastest = std::max(fastest, norm(to.pieces[k].corner[c] - from.pieces[k].corner[c]));
    }
    to.pieces[k].n = turn(reference_[k].n);
    if (!reference_[k].plane)
      to.pieces[k].find_ends();
  }
  to.moved += fastest;
}

template <int dim>
void Walls<dim>::find_candidates(std::span<const Vec<dim>> x, index_t begin, index_t end, double margin)
{
  margin_ = margin;
  blocks_.clear();
  add_blocks(x, begin, end);
  own_blocks_ = {0, static_cast<index_t>(blocks_.size())};
}

template <int dim>
void Walls<dim>::add_blocks(std::span<const Vec<dim>> x, index_t begin, index_t end)
{
  while (begin < end)
  {
    blocks_.emplace_back().begin = begin;
    blocks_.back().end = begin = std::min(begin + block_size, end);
    find_candidates(blocks_.back(), path_.back(), x);
  }
}

template <int dim>
void Walls<dim>::surround(std::span<const Vec<dim>> x, index_t begin, index_t end)
{
  std::vector<Block> own(std::make_move_iterator(blocks_.begin() + own_blocks_[0]),
                         std::make_move_iterator(blocks_.begin() + own_blocks_[1]));
  blocks_.clear();
  const index_t own_begin = own.empty() ? begin : own.front().begin,
                own_end = own.empty() ? end : own.back().end;
  add_blocks(x, begin, own_begin);
  own_blocks_ = {static_cast<index_t>(blocks_.size()), static_cast<index_t>(blocks_.size() + own.size())};
  std::move(own.begin(), own.end(), std::back_inserter(blocks_));
  add_blocks(x, own_end, end);
}

template <int dim>
index_t Walls<dim>::block_of(index_t n) const
{
  return static_cast<index_t>(std::partition_point(blocks_.begin(), blocks_.end(),
                                                   [n](const Block& block) { return block.end <= n; }) -
                              blocks_.begin());
}

template <int dim>
void Walls<dim>::find_candidates(Block& block, const Placement& walls, std::span<const Vec<dim>> x) const
{
  block.candidates.clear();
  block.moved = 0.0;
  block.walls_moved = walls.moved;
  const double reach = 2.0 * margin_ + 0.1 * spacing_; // the node and the wall may both move by the margin
  for (auto n = static_cast<std::size_t>(block.begin); n < static_cast<std::size_t>(block.end); ++n)
    for (std::size_t k = 0; k < walls.pieces.size(); ++k)
    {
      const auto& piece = walls.pieces[k];
      const double d = piece.distance(x[n]);
      if (d > reach || d < -2.0 * spacing_)
        continue;
      if (piece.overhang(x[n], true) > reach)
        continue;
      block.candidates.push_back({static_cast<index_t>(n), static_cast<int>(k)});
    }
}

namespace
{

/// Mean velocity over a move of the point of a piece's wall that was at x.
template <int dim>
Vec<dim> velocity_of(const WallPiece<dim>& from, const WallPiece<dim>& to, const Vec<dim>& x, double dt)
{
  Vec<dim> y = to.corner[0] + from.distance(x) * to.n;
  if (from.plane)
    return (1.0 / dt) * (y - from.corner[0] - from.distance(x) * from.n);
  if constexpr (dim == 2)
    y += (dot(x - from.corner[0], from.corner[1] - from.corner[0]) /
          norm_squared(from.corner[1] - from.corner[0])) *
         (to.corner[1] - to.corner[0]);
  else
  {
    const Vec<3> s = from.corner[1] - from.corner[0], t = cross(from.n, s);
    const double length = norm_squared(s);
    const Vec<3> s_now = to.corner[1] - to.corner[0];
    y += (dot(x - from.corner[0], s) / length) * s_now +
         (dot(x - from.corner[0], t) / length) * cross(to.n, s_now);
  }
  return (1.0 / dt) * (y - x);
}

} // namespace

template <int dim>
void Walls<dim>::contact(index_t block, std::size_t move, double dt, std::span<const Vec<dim>> x,
                         std::span<Vec<dim>> v, std::span<const double> m, std::span<Vec<dim>> a,
                         double dt_before, const std::function<void(Vec<dim>&, index_t)>& constrain,
                         Reaction& reaction) const
{
  const std::vector<Candidate>& candidates = blocks_[static_cast<std::size_t>(block)].candidates;
  const auto admissible = [&](Vec<dim> w, std::size_t n)
  {
    if (constrain)
      constrain(w, static_cast<index_t>(n));
    return w;
  };
  const std::vector<WallPiece<dim>>&was = before(move).pieces, &now = after(move).pieces;
  const double dt_mean = 0.5 * (dt + dt_before); // from one half step to the next
  // In each round the piece that is crossed least is corrected: on one side of a convex corner this is the
  // wall the node is on, and it is then beside the other one; in a concave corner a few rounds settle it
  // between two or three.
  for (std::size_t begin = 0; begin < candidates.size();)
  {
    std::size_t end = begin;
    const auto n = static_cast<std::size_t>(candidates[begin].node);
    const Vec<dim> v_free = v[n];
    bool corrected = false;
    while (end < candidates.size() && candidates[end].node == candidates[begin].node)
      ++end;
    for (int round = 0; round < 12; ++round)
    {
      const Vec<dim> x_end = x[n] + dt * v[n];
      double least = std::numeric_limits<double>::lowest(), target = 0.0;
      std::size_t k = 0;
      for (std::size_t c = begin; c < end; ++c)
      {
        const auto piece = static_cast<std::size_t>(candidates[c].piece);
        const double d = now[piece].distance(x_end);
        if (d >= 0.0)
          continue;
        const double d_begin = was[piece].distance(x[n]), allowed = std::min(0.0, d_begin);
        if (d >= allowed - 1e-13 * spacing_ || d <= least || now[piece].overhang(x_end, true) > 0.0 ||
            d_begin < -0.25 * spacing_)
          continue; // before it, beside it, or a node on the other side of a thin wall
        least = d;
        target = allowed;
        k = piece;
      }
      if (least == std::numeric_limits<double>::lowest())
        break;
      const WallPiece<dim>& wall = now[k];
      // A node that is behind already (merged or split around a corner) gets no deeper; settle() takes it
      // out. A velocity that takes it out would be energy from nowhere. A node that may only move in another
      // surface yields along what that leaves of the normal, and the wall feels all of the force.
      const Vec<dim> way = admissible(wall.n, n);
      const double share = dot(wall.n, way);
      if (share < 1e-9)
        break;
      const double closing = (target - least) / (dt * share);
      Vec<dim> dv = closing * way, push = closing * wall.n;
      if (geometry_[static_cast<std::size_t>(wall.wall)].no_slip)
      {
        const Vec<dim> v_wall = velocity_of(was[k], wall, x[n], dt);
        push = dv =
            admissible(v_wall + ((target - wall.distance(x[n] + dt * v_wall)) / dt) * wall.n - v[n], n);
      }
      // Mean of the velocities before and after the step: v_prev = v − ½(Δt + Δt_before) a whatever was
      // corrected before. A node pressed against a wall at rest then gets no work, although the pressure
      // has just kicked it.
      reaction.work.add(0.5 * m[n] * dot(dv, v[n] - dt_mean * a[n] + v[n] + dv));
      for (std::size_t i = 0; i < dim; ++i)
        if (push.c[i] != 0.0)
          reaction.impulse[static_cast<std::size_t>(wall.wall)][i].add(-m[n] * push.c[i]);
      v[n] += dv;
      a[n] += (1.0 / dt_mean) * dv;
      corrected = true;
      if (end - begin == 1)
        break;
      if (round == 11) // a corner too acute for rounds: it stays where it is on the wall
        v[n] = admissible(velocity_of(was[k], wall, x[n], dt), n);
    }
    if (corrected)
      reaction.corrections.push_back({static_cast<index_t>(n), v[n] - v_free});
    begin = end;
  }
}

template <int dim>
auto Walls<dim>::Reaction::operator+=(const Reaction& other) -> Reaction&
{
  work += other.work;
  for (std::size_t wall = 0; wall < impulse.size(); ++wall)
    for (std::size_t i = 0; i < dim; ++i)
      impulse[wall][i] += other.impulse[wall][i];
  return *this;
}

template <int dim>
void Walls<dim>::settle(std::span<Vec<dim>> x) const
{
  if (!has_convex_)
    return;
  for (Vec<dim>& p : x)
    for (int round = 0; round < 3; ++round)
    {
      double least = std::numeric_limits<double>::lowest();
      const WallPiece<dim>* nearest = nullptr;
      for (const auto& piece : pieces())
      {
        const double d = piece.distance(p);
        const WallGeometry& g = geometry_[static_cast<std::size_t>(piece.wall)];
        const bool near = g.closed || g.box || d > -0.3 * spacing_; // of an open wall: or on its other side
        if (d < -1e-12 * spacing_ && d > least && near && piece.overhang(p, true) <= 0.0 &&
            is_solid(piece.wall, p))
        {
          least = d;
          nearest = &piece;
        }
      }
      if (!nearest)
        break;
      p -= least * nearest->n;
    }
}

template <int dim>
bool Walls<dim>::blocks(const std::array<Vec<dim>, dim + 1>& x, double depth) const
{
  const auto inside = [&](const Vec<dim>& p)
  {
    return std::any_of(pieces().begin(), pieces().end(),
                       [&](const WallPiece<dim>& piece)
                       {
                         const bool encloses = geometry_[static_cast<std::size_t>(piece.wall)].closed ||
                                               geometry_[static_cast<std::size_t>(piece.wall)].box;
                         const double d = piece.distance(p);
                         return d < -depth && (encloses || d > -3.0 * depth) &&
                                piece.overhang(p, true) <= 0.0 && is_solid(piece.wall, p) &&
                                (!encloses || depth_in(piece.wall, p) > depth);
                       });
  };
  Vec<dim> centroid{};
  for (const auto& p : x)
    centroid += (1.0 / (dim + 1)) * p;
  if (inside(centroid))
    return true;
  for (std::size_t a = 0; a <= dim; ++a)
    for (std::size_t b = a + 1; b <= dim; ++b)
      if (inside(0.5 * (x[a] + x[b])))
        return true;
  return false;
}

/// Distance to the nearest piece of a wall.
template <int dim>
double Walls<dim>::depth_in(int wall, const Vec<dim>& x) const
{
  double shortest = std::numeric_limits<double>::max();
  for (const auto& piece : pieces())
    if (piece.wall == wall)
      shortest = std::min(shortest, piece.gap(x));
  return shortest;
}

/// x is on the solid side of a closed wall; true for walls that enclose nothing.
template <int dim>
bool Walls<dim>::is_solid(int wall, const Vec<dim>& x) const
{
  const WallGeometry& g = geometry_[static_cast<std::size_t>(wall)];
  if (!g.closed && !g.box)
    return true;
  bool inside = false, before_all = true;
  double area = 0.0;
  for (const auto& piece : pieces())
  {
    if (piece.wall != wall)
      continue;
    before_all = before_all && piece.distance(x) <= 0.0; // of a box seen from outside
    if constexpr (dim == 2)
    {
      const Vec<2>&a = piece.corner[0], &b = piece.corner[1];
      area += a[0] * b[1] - a[1] * b[0];
      if ((a[1] > x[1]) != (b[1] > x[1]) && x[0] < a[0] + (x[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
        inside = !inside;
    }
  }
  if (dim == 3)
    return g.fluid_inside || before_all;
  return area > 0.0 ? !inside : inside;
}

template <int dim>
Vec<dim> Walls<dim>::into_walls(const Vec<dim>& x, double tolerance, const Vec<dim>& w) const
{
  Vec<dim> rest = w;
  for (const WallPiece<dim>& wall : pieces())
    if (std::abs(wall.distance(x)) <= tolerance && wall.overhang(x, false) <= tolerance)
      rest -= std::min(0.0, dot(rest, wall.n)) * wall.n;
  return w - rest;
}

template <int dim>
std::array<int, 3> Walls<dim>::pieces_at(const Vec<dim>& x, double tolerance) const
{
  std::array<int, 3> found{-1, -1, -1};
  std::size_t count = 0;
  for (std::size_t k = 0; k < pieces().size() && count < found.size(); ++k)
  {
    if (std::abs(pieces()[k].distance(x)) > tolerance || pieces()[k].overhang(x, false) > tolerance)
      continue;
    const int face = pieces()[k].face >= 0 ? pieces()[k].face : static_cast<int>(k);
    if (std::find(found.begin(), found.end(), face) != found.end())
      continue;
    found[count++] = face;
  }
  return found;
}

template <int dim>
std::vector<Vec<dim>> Walls<dim>::impulse(const Ranks& ranks) const
{
  auto of_all = reaction_.impulse;
  std::vector<ExactSum*> sums;
  for (auto& wall : of_all)
    for (ExactSum& component : wall)
      sums.push_back(&component);
  ranks.sum(sums);
  std::vector<Vec<dim>> values(of_all.size());
  for (std::size_t w = 0; w < values.size(); ++w)
    for (std::size_t i = 0; i < dim; ++i)
      values[w].c[i] = of_all[w][i].value();
  return values;
}

template <int dim>
std::vector<ExactSum*> Walls<dim>::sums()
{
  std::vector<ExactSum*> all{&reaction_.work};
  for (auto& wall : reaction_.impulse)
    for (ExactSum& component : wall)
      all.push_back(&component);
  return all;
}

template struct WallPiece<2>;
template struct WallPiece<3>;
template class Walls<2>;
template class Walls<3>;

} // namespace undine::fluid
