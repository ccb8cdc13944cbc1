// Circumradius filter, with and without memory.
#include "fluid_pfem/remesh/alpha_shape.hpp"

#include "fluid_pfem/remesh/old_domain.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>

namespace undine::fluid
{

namespace
{

/// Corners in the order of their numbers, and the smallest wanted spacing.
template <int dim>
std::pair<std::array<Vec<dim>, dim + 1>, double> corners_of(Simplex<dim> simplex, std::span<const Vec<dim>> x,
                                                            std::span<const double> h)
{
  std::sort(simplex.begin(), simplex.end());
  std::array<Vec<dim>, dim + 1> corner;
  double h_min = h[static_cast<std::size_t>(simplex[0])];
  for (std::size_t a = 0; a < simplex.size(); ++a)
  {
    corner[a] = x[static_cast<std::size_t>(simplex[a])];
    h_min = std::min(h_min, h[static_cast<std::size_t>(simplex[a])]);
  }
  return {corner, h_min};
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
  std::array<Vec<dim>, dim + 1> x, v;
  for (std::size_t a = 0; a < x.size(); ++a)
  {
    x[a] = nodes.x[static_cast<std::size_t>(simplex[a])];
    v[a] = nodes.v[static_cast<std::size_t>(simplex[a])];
  }
  const auto g = volume_gradients<dim, double>(x);
  double largest = 0.0, rate = 0.0;
  for (std::size_t a = 0; a < x.size(); ++a)
  {
    largest = std::max(largest, norm(g[a]));
    rate += dot(g[a], v[a]);
  }
  const double height = signed_volume<dim, double>(x) / largest;
  return height < limit && rate < 0.0;
}

} // namespace

template <int dim>
double quality(const std::array<Vec<dim>, dim + 1>& x)
{
  double edges = 0.0;
  for (std::size_t a = 0; a <= dim; ++a)
    for (std::size_t b = a + 1; b <= dim; ++b)
      edges += norm_squared(x[a] - x[b]);
  const double V = signed_volume<dim, double>(x);
  if constexpr (dim == 2)
    return 4.0 * std::sqrt(3.0) * V / edges;
  else
    return std::copysign(12.0 * std::cbrt(9.0 * V * V) / edges, V);
}

template <int dim>
std::vector<Simplex<dim>> alpha_shape(std::span<const Vec<dim>> x, std::span<const double> h, double alpha,
                                      const std::vector<Simplex<dim>>& delaunay)
{
  std::vector<Simplex<dim>> kept;
  kept.reserve(delaunay.size());
  for (const auto& simplex : delaunay)
  {
    const auto [corner, h_min] = corners_of<dim>(simplex, x, h);
    if (circumradius<dim>(corner) <= alpha * h_min) // false for the NaN and infinity of a flat simplex
      kept.push_back(simplex);
  }
  return kept;
}

template <int dim>
ShapeChoice<dim> choose_fluid(const FluidNodes<dim>& nodes,
                              const std::vector<std::array<int, 3>>& wall_pieces,
                              const std::vector<Simplex<dim>>& delaunay, std::span<const Vec<dim>> old_x,
                              std::span<const Simplex<dim>> old_elements, double bin, const ShapeRules& rules)
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
  };
  std::vector<Doubtful> doubtful;
  std::vector<Vec<dim>> centroids;
  std::vector<char> is_fluid(delaunay.size(), 0);
  for (std::size_t s = 0; s < delaunay.size(); ++s)
  {
    const auto& simplex = delaunay[s];
    int boundary = 0;
    for (const index_t n : simplex)
      boundary += (nodes.flag[static_cast<std::size_t>(n)] & on_boundary) != 0;
    const auto [corner, h] = corners_of<dim>(simplex, nodes.x, nodes.h);
    const double R = circumradius<dim>(corner);
    const double largest =
        std::max({rules.keep, rules.create, boundary <= dim && rules.gap > 0.0 ? rules.keep_inner : 0.0});
    if (!(R <= 2.0 * std::max(largest, boundary == 0 ? rules.keep_inner : 0.0) * h) ||
        on_one_piece<dim>(simplex, wall_pieces))
      continue;
    if (boundary == 0 && R <= rules.keep_inner * h)
    {
      is_fluid[s] = 1;
      continue;
    }
    Vec<dim> centroid{};
    for (const auto& p : corner)
      centroid += (1.0 / (dim + 1)) * p;
    doubtful.push_back({s, corner, R, h, boundary});
    centroids.push_back(centroid);
  }
  const std::vector<char> was_inside = inside<dim>(old_x, old_elements, centroids, bin);

  ShapeChoice<dim> choice;
  choice.gained.assign(nodes.x.size(), 0.0);
  for (std::size_t d = 0; d < doubtful.size(); ++d)
  {
    const auto& [s, corner, R, h, boundary] = doubtful[d];
    const auto& simplex = delaunay[s];
    int wall = 0;
    for (const index_t n : simplex)
      wall += (nodes.flag[static_cast<std::size_t>(n)] & on_wall) != 0;
    const bool was_fluid = boundary == 0 || was_inside[d];
    const bool flat =
        boundary == dim + 1 && wall <= dim && std::abs(quality<dim>(corner)) < rules.sliver_quality;
    bool fluid = false;
    if (boundary == 0)
      fluid = false; // too large
    else if (was_fluid)
      fluid = R <= (boundary <= dim && rules.gap > 0.0 ? rules.keep_inner : rules.keep) * h;
    else if (rules.gap > 0.0)
      fluid = closing_gap<dim>(simplex, nodes, rules.gap * h);
    else
      fluid = R <= rules.create * h;
    fluid = fluid && !flat;
    is_fluid[s] = fluid;
    if (fluid == was_fluid)
      continue;
    const double V = std::abs(signed_volume<dim, double>(corner));
    (fluid ? choice.created : choice.dropped) += V;
    for (const index_t n : simplex)
      choice.gained[static_cast<std::size_t>(n)] += (fluid ? V : -V) / (dim + 1);
  }
  choice.elements.reserve(delaunay.size());
  for (std::size_t s = 0; s < delaunay.size(); ++s)
    if (is_fluid[s])
      choice.elements.push_back(delaunay[s]);
  return choice;
}

template double quality<2>(const std::array<Vec<2>, 3>&);
template double quality<3>(const std::array<Vec<3>, 4>&);
template std::vector<Simplex<2>> alpha_shape<2>(std::span<const Vec<2>>, std::span<const double>, double,
                                                const std::vector<Simplex<2>>&);
template std::vector<Simplex<3>> alpha_shape<3>(std::span<const Vec<3>>, std::span<const double>, double,
                                                const std::vector<Simplex<3>>&);
template ShapeChoice<2> choose_fluid<2>(const FluidNodes<2>&, const std::vector<std::array<int, 3>>&,
                                        const std::vector<Simplex<2>>&, std::span<const Vec<2>>,
                                        std::span<const Simplex<2>>, double, const ShapeRules&);
template ShapeChoice<3> choose_fluid<3>(const FluidNodes<3>&, const std::vector<std::array<int, 3>>&,
                                        const std::vector<Simplex<3>>&, std::span<const Vec<3>>,
                                        std::span<const Simplex<3>>, double, const ShapeRules&);

} // namespace undine::fluid
