// What walls are at a place: whether it is in them, on which of them, and the way out. For seeds and
// remeshes.
#include "fluid_pfem/walls.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace undine::fluid
{

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

template void Walls<2>::settle(std::span<Vec<2>>) const;
template void Walls<3>::settle(std::span<Vec<3>>) const;
template bool Walls<2>::blocks(const std::array<Vec<2>, 3>&, double) const;
template bool Walls<3>::blocks(const std::array<Vec<3>, 4>&, double) const;
template Vec<2> Walls<2>::into_walls(const Vec<2>&, double, const Vec<2>&) const;
template Vec<3> Walls<3>::into_walls(const Vec<3>&, double, const Vec<3>&) const;
template std::array<int, 3> Walls<2>::pieces_at(const Vec<2>&, double) const;
template std::array<int, 3> Walls<3>::pieces_at(const Vec<3>&, double) const;

} // namespace undine::fluid
