// Delaunay triangulation of a torus: of the points and the images around the cell.
#include "fluid_pfem/remesh/delaunay.hpp"

#include <algorithm>
#include <cmath>

namespace undine::fluid
{

template <int dim>
std::vector<Simplex<dim>> periodic_delaunay(std::span<const Vec<dim>> x, const Period<dim>& period)
{
  // Half a cell of images on each side. Positions and periods are rounded to whole multiples of a small unit:
  // sums of them are exact, predicates are, and so an image cannot be triangulated otherwise than its point.
  const Vec<dim> length = period.length();
  double largest = 0.0;
  for (int i = 0; i < dim; ++i)
    largest = std::max(largest, std::abs(period.origin()[i]) + 2.0 * length[i]);
  for (const auto& p : x)
    for (int i = 0; i < dim; ++i)
      largest = std::max(largest, std::abs(p[i]));
  const double unit = std::ldexp(1.0, std::ilogb(largest) - 45);
  const auto round = [unit](Vec<dim> p)
  {
    for (int i = 0; i < dim; ++i)
      p[i] = std::nearbyint(p[i] / unit) * unit;
    return p;
  };
  const Vec<dim> L = round(length), lower = period.origin() - 0.5 * length,
                 upper = period.origin() + 1.5 * length;
  std::vector<Vec<dim>> points;
  points.reserve(x.size());
  std::vector<index_t> owner(x.size());
  for (std::size_t n = 0; n < x.size(); ++n)
  {
    points.push_back(round(x[n]));
    owner[n] = static_cast<index_t>(n);
  }
  const auto shifts = Period<dim>(period.origin(), L).shifts();
  for (std::size_t k = 1; k < shifts.size(); ++k)
    for (std::size_t n = 0; n < x.size(); ++n)
    {
      const Vec<dim> image = points[n] + shifts[k];
      bool near = true;
      for (int i = 0; i < dim; ++i)
        near = near && (L[i] == 0.0 || (image[i] >= lower[i] && image[i] <= upper[i]));
      if (!near)
        continue;
      points.push_back(image);
      owner.push_back(static_cast<index_t>(n));
    }

  std::vector<Simplex<dim>> simplices;
  for (Simplex<dim> e : delaunay(points))
  {
    const auto at = [&](std::size_t a) { return points[static_cast<std::size_t>(e[a])]; };
    bool small = true;
    for (std::size_t a = 1; a <= dim; ++a)
      for (int i = 0; i < dim; ++i)
        small = small && (L[i] == 0.0 || std::abs(at(a)[i] - at(0)[i]) < 0.4999 * L[i]);
    // Of the copies of a simplex the one counts whose corner of the lowest number is no image.
    index_t lowest = e[0];
    for (const index_t n : e)
      if (owner[static_cast<std::size_t>(n)] < owner[static_cast<std::size_t>(lowest)])
        lowest = n;
    if (!small || static_cast<std::size_t>(lowest) >= x.size())
      continue;
    for (index_t& n : e)
      n = owner[static_cast<std::size_t>(n)];
    simplices.push_back(e);
  }
  return simplices;
}

template std::vector<Simplex<2>> periodic_delaunay<2>(std::span<const Vec<2>>, const Period<2>&);
template std::vector<Simplex<3>> periodic_delaunay<3>(std::span<const Vec<3>>, const Period<3>&);

} // namespace undine::fluid
