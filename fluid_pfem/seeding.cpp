// Staggered and lattice seeds.
#include "fluid_pfem/seeding.hpp"

#include <algorithm>
#include <cmath>
#include <random>

namespace undine::fluid
{

template <int dim>
std::vector<PlaneSurface<dim>> box_surfaces(const Vec<dim>& origin, const Vec<dim>& size)
{
  static const std::array<std::array<const char*, 2>, 3> name{
      {{"left", "right"}, {"bottom", "top"}, {"back", "front"}}};
  std::vector<PlaneSurface<dim>> surfaces;
  for (int i = 0; i < dim; ++i)
    for (int end = 0; end < 2; ++end)
    {
      Vec<dim> normal{};
      normal[i] = end == 0 ? -1.0 : 1.0;
      surfaces.push_back({name[static_cast<std::size_t>(i)][static_cast<std::size_t>(end)],
                          end == 0 ? origin : origin + size, normal});
    }
  return surfaces;
}

namespace
{

/// Coordinates along one axis: `cells` equal intervals, or shifted by half with the two ends kept.
std::vector<double> line_of_nodes(double origin, double length, int cells, bool shifted)
{
  std::vector<double> line;
  const double h = length / cells;
  if (!shifted)
    for (int i = 0; i <= cells; ++i)
      line.push_back(i == cells ? origin + length : origin + i * h);
  else
  {
    line.push_back(origin);
    for (int i = 0; i < cells; ++i)
      line.push_back(origin + (i + 0.5) * h);
    line.push_back(origin + length);
  }
  return line;
}

int cells_of(double length, double h) { return std::max(1, static_cast<int>(std::lround(length / h))); }

} // namespace

template <int dim>
Seeds<dim> seed_box(const Vec<dim>& origin, const Vec<dim>& size, double h, const Seeding& seeding)
{
  const bool staggered = seeding.pattern == Pattern::staggered;
  std::vector<Vec<dim>> x;
  if constexpr (dim == 2)
  {
    const int columns = cells_of(size[0], staggered ? h * std::sqrt(0.75) : h);
    for (int i = 0; i <= columns; ++i)
      for (const double y : line_of_nodes(origin[1], size[1], cells_of(size[1], h), staggered && i % 2 == 1))
        x.push_back({{i == columns ? origin[0] + size[0] : origin[0] + i * size[0] / columns, y}});
  }
  else
  {
    // Staggered: body-centred columns, the spacing chosen for the same number of nodes per volume as the
    // lattice.
    const double spacing = staggered ? h * std::cbrt(2.0) : h;
    const int nx = cells_of(size[0], spacing), nz = cells_of(size[2], spacing),
              ny = cells_of(size[1], spacing);
    const auto add_columns = [&](bool shifted)
    {
      for (const double px : line_of_nodes(origin[0], size[0], nx, shifted))
        for (const double pz : line_of_nodes(origin[2], size[2], nz, shifted))
        {
          const bool on_edge = shifted && (px == origin[0] || px == origin[0] + size[0] || pz == origin[2] ||
                                           pz == origin[2] + size[2]);
          if (on_edge)
            continue;
          for (const double py : line_of_nodes(origin[1], size[1], ny, shifted))
            x.push_back({{px, py, pz}});
        }
    };
    add_columns(false);
    if (staggered)
      add_columns(true);
  }

  Seeds<dim> seeds;
  std::mt19937_64 random(seeding.seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto surfaces = box_surfaces<dim>(origin, size);
  for (Vec<dim> p : x)
  {
    SurfaceMask mask = 0;
    for (std::size_t s = 0; s < surfaces.size(); ++s)
      if (std::abs(dot(p - surfaces[s].point, surfaces[s].normal)) < 1e-9 * h)
        mask |= SurfaceMask{1} << s;
    if (mask == 0 && seeding.jitter > 0.0)
      for (int i = 0; i < dim; ++i)
        p[i] += seeding.jitter * h * uniform(random);
    seeds.x.push_back(p);
    seeds.surface.push_back(mask);
  }
  return seeds;
}

template <int dim>
Seeds<dim> cut_ellipse(const Seeds<dim>& seeds, const Vec<dim>& origin, const Vec<dim>& size, double h)
{
  const double pi = std::acos(-1.0);
  Vec<dim> centre, half;
  for (int i = 0; i < dim; ++i)
  {
    half[i] = 0.5 * size[i];
    centre[i] = origin[i] + half[i];
  }
  Seeds<dim> result;
  // Inner seeds keep 0.6 h from the outline: (1 − level)/|∇level| is the distance to first order.
  for (const auto& x : seeds.x)
  {
    double level = 0.0, slope = 0.0;
    for (int i = 0; i < dim; ++i)
    {
      const double s = (x[i] - centre[i]) / half[i];
      level += s * s;
      slope += s * s / (half[i] * half[i]);
    }
    if (level < 1.0 && (slope == 0.0 || 0.5 * (1.0 - level) / std::sqrt(slope) > 0.6 * h))
      result.x.push_back(x);
  }
  if constexpr (dim == 2)
  {
    // Equal arc lengths along the outline, by a fine polygon.
    constexpr int fine = 20000;
    std::vector<double> arc{0.0};
    const auto at = [&](double t) {
      return Vec<2>{{centre[0] + half[0] * std::cos(t), centre[1] + half[1] * std::sin(t)}};
    };
    for (int k = 1; k <= fine; ++k)
      arc.push_back(arc.back() + norm(at(2 * pi * k / fine) - at(2 * pi * (k - 1) / fine)));
    const int n = std::max(8, static_cast<int>(std::lround(arc.back() / h)));
    for (int k = 0, f = 0; k < n; ++k)
    {
      const double s = arc.back() * k / n;
      while (arc[static_cast<std::size_t>(f) + 1] <= s)
        ++f;
      const double part = (s - arc[static_cast<std::size_t>(f)]) /
                          (arc[static_cast<std::size_t>(f) + 1] - arc[static_cast<std::size_t>(f)]);
      result.x.push_back(at(2 * pi * (f + part) / fine));
    }
  }
  else
  {
    // Fibonacci points on the sphere, stretched.
    const double radius = std::cbrt(half[0] * half[1] * half[2]);
    const int n =
        std::max(20, static_cast<int>(std::lround(4.0 * pi * radius * radius / (std::sqrt(0.75) * h * h))));
    const double golden = pi * (3.0 - std::sqrt(5.0));
    for (int k = 0; k < n; ++k)
    {
      const double y = 1.0 - 2.0 * (k + 0.5) / n, r = std::sqrt(1.0 - y * y);
      result.x.push_back({{centre[0] + half[0] * r * std::cos(golden * k), centre[1] + half[1] * y,
                           centre[2] + half[2] * r * std::sin(golden * k)}});
    }
  }
  result.surface.assign(result.x.size(), 0);
  return result;
}

template Seeds<2> cut_ellipse<2>(const Seeds<2>&, const Vec<2>&, const Vec<2>&, double);
template Seeds<3> cut_ellipse<3>(const Seeds<3>&, const Vec<3>&, const Vec<3>&, double);
template std::vector<PlaneSurface<2>> box_surfaces<2>(const Vec<2>&, const Vec<2>&);
template std::vector<PlaneSurface<3>> box_surfaces<3>(const Vec<3>&, const Vec<3>&);
template Seeds<2> seed_box<2>(const Vec<2>&, const Vec<2>&, double, const Seeding&);
template Seeds<3> seed_box<3>(const Vec<3>&, const Vec<3>&, double, const Seeding&);

} // namespace undine::fluid
