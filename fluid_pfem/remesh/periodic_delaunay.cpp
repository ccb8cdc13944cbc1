// Delaunay triangulation of a torus: of the points and the images around the cell.
#include "fluid_pfem/remesh/delaunay.hpp"
#include "fluid_pfem/remesh/local_delaunay.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace undine::fluid
{

template <int dim>
std::vector<Simplex<dim>> periodic_delaunay(std::span<const Vec<dim>> x, const Period<dim>& period,
                                            const PartOfCell& part)
{
  // Half a cell of images on each side at most. Positions and periods are rounded to whole multiples of a
  // small unit: sums of them are exact, predicates are, and so an image cannot be triangulated otherwise than
  // its point.
  std::vector<index_t> owner; // the point of which each is an image; the points themselves come first
  if (part.among)
    owner = *part.among;
  else
  {
    owner.resize(x.size());
    std::iota(owner.begin(), owner.end(), 0);
  }
  const std::size_t in_cell = owner.size();
  const Vec<dim> length = period.length();
  double largest = part.extent;
  for (int i = 0; i < dim; ++i)
    largest = std::max(largest, std::abs(period.origin()[i]) + 2.0 * length[i]);
  for (const index_t n : owner)
    for (int i = 0; i < dim; ++i)
      largest = std::max(largest, std::abs(x[static_cast<std::size_t>(n)][i]));
  const double unit = std::ldexp(1.0, std::ilogb(largest) - 45);
  const auto round = [unit](Vec<dim> p)
  {
    for (int i = 0; i < dim; ++i)
      p[i] = std::nearbyint(p[i] / unit) * unit;
    return p;
  };
  const Vec<dim> L = round(length);
  Vec<dim> lower = period.origin(), upper = period.origin() + length;
  for (int i = 0; i < dim; ++i)
  {
    const double margin = std::min(0.5 * length[i], 1.25 * part.reach); // some nodes are a little outside
    lower[i] -= margin;
    upper[i] += margin;
  }
  std::vector<Vec<dim>> points;
  points.reserve(in_cell);
  for (const index_t n : owner)
    points.push_back(round(x[static_cast<std::size_t>(n)]));
  const auto shifts = Period<dim>(period.origin(), L).shifts();
  for (std::size_t k = 1; k < shifts.size(); ++k)
    for (std::size_t n = 0; n < in_cell; ++n)
    {
      const Vec<dim> image = points[n] + shifts[k];
      bool near = true;
      for (int i = 0; i < dim; ++i)
        near = near && (L[i] == 0.0 || (image[i] >= lower[i] && image[i] <= upper[i]));
      if (!near)
        continue;
      points.push_back(image);
      owner.push_back(owner[n]);
    }
  std::vector<char> is_wanted(points.size(), 0); // of the lowest corner
  for (std::size_t n = 0; n < in_cell; ++n)
    is_wanted[n] = part.mine.empty() || part.mine[static_cast<std::size_t>(owner[n])];
  if (!part.mine.empty())
  {
    std::size_t kept = 0;
    for (const index_t n : points_near<dim>(points, is_wanted, part.reach))
    {
      const auto from = static_cast<std::size_t>(n);
      points[kept] = points[from];
      owner[kept] = owner[from];
      is_wanted[kept++] = is_wanted[from];
    }
    points.resize(kept);
    is_wanted.resize(kept);
  }

  std::vector<Simplex<dim>> simplices;
  for (Simplex<dim> e : part.mine.empty() ? delaunay(points) : delaunay_around(points, is_wanted, part.reach))
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
    if (!small || !is_wanted[static_cast<std::size_t>(lowest)])
      continue;
    for (index_t& n : e)
      n = owner[static_cast<std::size_t>(n)];
    simplices.push_back(e);
  }
  return simplices;
}

template std::vector<Simplex<2>> periodic_delaunay<2>(std::span<const Vec<2>>, const Period<2>&,
                                                      const PartOfCell&);
template std::vector<Simplex<3>> periodic_delaunay<3>(std::span<const Vec<3>>, const Period<3>&,
                                                      const PartOfCell&);

} // namespace undine::fluid
