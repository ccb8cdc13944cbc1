// Pieces of planes, polylines, boxes and meshed walls.
#include "fluid_pfem/wall_piece.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

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

/// The twelve triangles of a box, seen from outside, two by two.
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

template <int dim>
WallPiece<dim> piece_of(const std::array<Vec<dim>, dim>& corner, int wall)
{
  WallPiece<dim> piece{.corner = corner, .n = normal_of<dim>(corner), .wall = wall};
  piece.find_ends();
  return piece;
}

template <int dim>
WallPiece<dim> plane_of(const WallGeometry& g, int wall)
{
  WallPiece<dim> piece{.wall = wall, .plane = true};
  piece.corner.fill(leading<dim>(g.points.front()));
  piece.n = leading<dim>(g.normal) * (1.0 / norm(leading<dim>(g.normal)));
  return piece;
}

/// Of a mesh; triangles in one plane are one face.
template <int dim>
void add_facets(const WallGeometry& g, int wall, double spacing, std::vector<WallPiece<dim>>& pieces)
{
  const auto first = pieces.size();
  for (const auto& f : g.facets)
  {
    std::array<Vec<dim>, dim> corner;
    for (std::size_t k = 0; k < dim; ++k)
      corner[k] = leading<dim>(f[k]);
    pieces.push_back(piece_of<dim>(corner, wall));
    if constexpr (dim == 3)
    {
      auto& piece = pieces.back();
      piece.face = static_cast<int>(pieces.size() - 1);
      for (std::size_t k = first; k + 1 < pieces.size(); ++k)
        if (dot(pieces[k].n, piece.n) > 1.0 - 1e-12 &&
            std::abs(pieces[k].distance(piece.corner[0])) < 1e-9 * spacing)
        {
          piece.face = pieces[k].face;
          break;
        }
    }
  }
}

void add_polyline(const WallGeometry& g, int wall, std::vector<WallPiece<2>>& pieces)
{
  const std::size_t n = g.points.size();
  if (n < 2)
    throw InputError("wall '" + g.name + "': a polyline needs at least two points");
  for (std::size_t k = 0; k < (g.closed ? n : n - 1); ++k)
  {
    if (g.points[k] == g.points[(k + 1) % n])
      throw InputError("wall '" + g.name + "': two successive points coincide");
    pieces.push_back(piece_of<2>({leading<2>(g.points[k]), leading<2>(g.points[(k + 1) % n])}, wall));
  }
}

void add_box(const WallGeometry& g, int wall, std::vector<WallPiece<3>>& pieces)
{
  if (!g.box)
    throw InputError("wall '" + g.name +
                     "': in 3-D a wall is a plane (point, normal), a box or comes from a mesh");
  const auto first = pieces.size();
  for (auto corner : box_triangles(leading<3>(g.points[0]), leading<3>(g.points[1])))
  {
    if (g.fluid_inside)
      std::swap(corner[1], corner[2]);
    const auto triangle = pieces.size() - first;
    pieces.push_back(piece_of<3>(corner, wall));
    pieces.back().face = static_cast<int>(first + triangle - triangle % 2);
  }
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
std::vector<WallPiece<dim>> pieces_of(const std::vector<WallGeometry>& geometry, double spacing)
{
  std::vector<WallPiece<dim>> pieces;
  for (std::size_t w = 0; w < geometry.size(); ++w)
  {
    const WallGeometry& g = geometry[w];
    const auto wall = static_cast<int>(w);
    if (g.plane)
      pieces.push_back(plane_of<dim>(g, wall));
    else if (!g.facets.empty())
      add_facets(g, wall, spacing, pieces);
    else if constexpr (dim == 2)
      add_polyline(g, wall, pieces);
    else
      add_box(g, wall, pieces);
  }
  return pieces;
}

template <int dim>
bool join(std::vector<WallPiece<dim>>& pieces, const std::vector<WallGeometry>& geometry, double spacing)
{
  bool convex = false;
  for (auto& piece : pieces)
    piece.reach.fill(-1e-9 * spacing); // a node on the neighbour's side of a convex edge is not on this piece
  const auto moves = [&geometry](int wall)
  { return geometry[static_cast<std::size_t>(wall)].motion.moves(); };
  const auto together = [&moves](int v, int w) { return v == w || !(moves(v) || moves(w)); };
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

template struct WallPiece<2>;
template struct WallPiece<3>;
template std::vector<WallPiece<2>> pieces_of(const std::vector<WallGeometry>&, double);
template std::vector<WallPiece<3>> pieces_of(const std::vector<WallGeometry>&, double);
template bool join(std::vector<WallPiece<2>>&, const std::vector<WallGeometry>&, double);
template bool join(std::vector<WallPiece<3>>&, const std::vector<WallGeometry>&, double);

} // namespace undine::fluid
