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

template std::vector<PlaneSurface<2>> box_surfaces<2>(const Vec<2>&, const Vec<2>&);
template std::vector<PlaneSurface<3>> box_surfaces<3>(const Vec<3>&, const Vec<3>&);
template Seeds<2> seed_box<2>(const Vec<2>&, const Vec<2>&, double, const Seeding&);
template Seeds<3> seed_box<3>(const Vec<3>&, const Vec<3>&, double, const Seeding&);

} // namespace undine::fluid
