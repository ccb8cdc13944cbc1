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
  if (!known)
    velocity_.assign(x.size(), {});
  if (known && t > t_)
  {
    double largest = 0.0;
    for (std::size_t n = 0; n < x.size(); ++n)
    {
      velocity_[n] = (1.0 / (t - t_)) * (x[n] - surface_.x()[n]);
      largest = std::max(largest, norm_squared(velocity_[n]));
    }
    speed_ = std::sqrt(largest);
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
double SolidSurface<dim>::depth(const Vec<dim>& x, double reach) const
{
  if (empty() || outside_box(x, 0.0))
    return 0.0;
  const auto near = surface_.nearest(x, reach);
  return near.facet < 0 || near.beside ? 0.0 : std::max(0.0, -near.gap);
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
auto SolidSurface<dim>::convex_corners() const -> std::vector<Corner>
{
  std::vector<Corner> corners;
  for (const auto& [before, after] : surface_.convex_corners(side_))
  {
    const auto n = static_cast<std::size_t>(surface_.facets()[static_cast<std::size_t>(before)].back());
    corners.push_back({surface_.x()[n], velocity_[n]});
  }
  return corners;
}

/// The edge goes in through one side of the solid and out through the opposite one, ends within `tolerance`
/// of the surface included: however thin the solid is, as long as it is thicker than that.
template <int dim>
bool SolidSurface<dim>::crossed_by(const Vec<dim>& a, const Vec<dim>& b, double tolerance) const
{
  struct Hit
  {
    double at; ///< distance from a
    Vec<dim> normal;
  };
  const Vec<dim> edge = b - a;
  const double length = norm(edge);
  std::vector<index_t> facets;
  surface_.within(0.5 * (a + b), 0.5 * length + tolerance, facets);
  std::vector<Hit> in, out;
  for (const index_t f : facets)
  {
    const std::span<const index_t> only(&f, 1);
    const Vec<dim> n = surface_.normal_of(f);
    const auto corner = static_cast<std::size_t>(surface_.facets()[static_cast<std::size_t>(f)][0]);
    const double height = dot(n, a - surface_.x()[corner]), slope = dot(n, edge) / length;
    const double at = -height / slope;
    if (std::abs(slope) < 1e-9 || at < -tolerance || at > length + tolerance)
      continue;
    if (std::abs(surface_.nearest(a + (at / length) * edge, only).gap) < 1e-6 * length)
      (slope < 0.0 ? in : out).push_back({at, n});
  }
  for (const Hit& i : in)
    for (const Hit& o : out)
      if (i.at < o.at && dot(i.normal, o.normal) < -0.5)
        return true;
  return false;
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
  const double reach = 4.0 * h, tolerance = 0.02 * h;
  if (depth(centroid, reach) > covered * h)
    return true;
  double radius = 0.0;
  for (const Vec<dim>& x : corner)
    radius = std::max(radius, norm(x - centroid));
  std::vector<index_t> facets;
  surface_.within(centroid, radius + tolerance, facets);
  if (facets.empty()) // all of it is on the centroid's side
    return false;
  for (std::size_t a = 0; a < corner.size(); ++a)
    for (std::size_t b = a + 1; b < corner.size(); ++b)
    {
      for (int k = 1; k <= 3; ++k)
        if (depth((1.0 - 0.25 * k) * corner[a] + 0.25 * k * corner[b], reach) > deep * h)
          return true;
      if (crossed_by(corner[a], corner[b], tolerance))
        return true;
    }
  return false;
}

template class SolidSurface<2>;
template class SolidSurface<3>;

} // namespace undine::fluid
