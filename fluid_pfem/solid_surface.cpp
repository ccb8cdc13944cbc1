// Nearness, sides and crossings of the solid's surface.
#include "fluid_pfem/solid_surface.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace undine::fluid
{

namespace
{

constexpr int first_side = 1 << 20; ///< rigid walls have the numbers below

} // namespace

template <int dim>
void SolidSurface<dim>::show(const link::SurfaceMesh& solid, double t)
{
  std::vector<Vec<dim>> x(static_cast<std::size_t>(solid.n_nodes()));
  for (std::size_t n = 0; n < x.size(); ++n)
    for (int i = 0; i < dim; ++i)
      x[n][i] = solid.x[n * dim + static_cast<std::size_t>(i)];
  const bool known = !empty() && x.size() == surface_.x().size();
  speed_ = known ? speed_ : std::numeric_limits<double>::infinity();
  if (known && t > t_)
  {
    double largest = 0.0;
    for (std::size_t n = 0; n < x.size(); ++n)
      largest = std::max(largest, norm_squared(x[n] - surface_.x()[n]));
    speed_ = std::sqrt(largest) / (t - t_);
  }
  t_ = t;
  if (known)
  {
    surface_.x() = std::move(x);
    surface_.sort_bins();
  }
  else
  {
    surface_ = FacetSurface<dim>(std::move(x), solid.face_offset, solid.face_nodes);
    side_ = surface_.patches(0.7); // 40 degrees
  }
  low_ = high_ = surface_.x().front();
  for (const Vec<dim>& p : surface_.x())
    for (int i = 0; i < dim; ++i)
    {
      low_[i] = std::min(low_[i], p[i]);
      high_[i] = std::max(high_[i], p[i]);
    }
}

template <int dim>
bool SolidSurface<dim>::outside_box(const Vec<dim>& x, double margin) const
{
  for (int i = 0; i < dim; ++i)
    if (x[i] < low_[i] - margin || x[i] > high_[i] + margin)
      return true;
  return false;
}

template <int dim>
bool SolidSurface<dim>::is_near(const Vec<dim>& x, double reach) const
{
  return !empty() && !outside_box(x, reach) && surface_.nearest(x, reach).facet >= 0;
}

template <int dim>
std::array<int, 3> SolidSurface<dim>::sides_at(const Vec<dim>& x, double tolerance) const
{
  std::array<int, 3> sides{-1, -1, -1};
  if (empty() || outside_box(x, tolerance))
    return sides;
  std::vector<index_t> facets;
  surface_.within(x, tolerance, facets);
  std::size_t count = 0;
  for (const index_t f : facets)
  {
    const int side = first_side + side_[static_cast<std::size_t>(f)];
    if (count < sides.size() && std::find(sides.begin(), sides.end(), side) == sides.end())
      sides[count++] = side;
  }
  return sides;
}

template <int dim>
Vec<dim> SolidSurface<dim>::outside(const Vec<dim>& x, double allowed, double depth) const
{
  if (empty() || outside_box(x, 0.0))
    return x;
  const auto near = surface_.nearest(x, depth);
  if (near.facet < 0 || near.beside || near.gap >= -allowed)
    return x;
  Vec<dim> foot{};
  const auto& facet = surface_.facets()[static_cast<std::size_t>(near.facet)];
  for (std::size_t a = 0; a < dim; ++a)
    foot += near.weight[a] * surface_.x()[static_cast<std::size_t>(facet[a])];
  return foot;
}

template <int dim>
bool SolidSurface<dim>::blocks(std::span<const Vec<dim>> corner, double h) const
{
  if (empty())
    return false;
  Vec<dim> centroid{};
  bool apart = true;
  for (const Vec<dim>& x : corner)
  {
    centroid += (1.0 / static_cast<double>(corner.size())) * x;
    apart = apart && outside_box(x, 0.0);
  }
  // Far from the box nothing can be covered, unless the simplex is larger than the solid.
  if (apart && outside_box(centroid, 2.0 * h))
    return false;
  constexpr double deep = 0.4, covered = 0.2; // of the spacing: a simplex may cut a corner of the solid
  const auto depth = [&](const Vec<dim>& x)
  {
    if (outside_box(x, 0.0))
      return std::pair{0.0, Vec<dim>{}};
    const auto near = surface_.nearest(x, 4.0 * h);
    return std::pair{near.facet < 0 || near.beside ? 0.0 : -near.gap, near.normal};
  };
  if (depth(centroid).first > covered * h)
    return true;
  for (std::size_t a = 0; a < corner.size(); ++a)
    for (std::size_t b = a + 1; b < corner.size(); ++b)
    {
      Vec<dim> first{}, last{};
      for (int k = 1; k <= 3; ++k)
      {
        const double s = 0.25 * k;
        const auto [d, n] = depth((1.0 - s) * corner[a] + s * corner[b]);
        if (d > deep * h)
          return true;
        if (d > 1e-3 * h) // in through one side and out through the other: a thin solid
        {
          first = norm_squared(first) > 0.0 ? first : n;
          last = n;
        }
      }
      if (dot(first, last) < -0.5)
        return true;
      const Vec<dim> edge = corner[b] - corner[a];
      if (norm_squared(last) > 0.0)
      {
        const auto in = surface_.nearest(corner[a], 0.5 * h), out = surface_.nearest(corner[b], 0.5 * h);
        if (in.facet >= 0 && out.facet >= 0 && dot(in.normal, out.normal) < -0.5 &&
            dot(in.normal, edge) < 0.0)
          return true;
      }
    }
  return false;
}

template class SolidSurface<2>;
template class SolidSurface<3>;

} // namespace undine::fluid
