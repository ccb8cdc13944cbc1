// Regular seeds, and seeds of any outline and spacing.
#include "fluid_pfem/seeding.hpp"

#include "common/error.hpp"
#include "fluid_pfem/fill.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace undine::fluid
{

namespace
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

/// Coordinates along one axis: `cells` equal intervals, or shifted by half with the two ends kept. A periodic
/// axis has only one of the ends, and none if shifted.
std::vector<double> line_of_nodes(double origin, double length, int cells, bool shifted, bool periodic)
{
  std::vector<double> line;
  const double h = length / cells;
  if (!shifted)
    for (int i = 0; i <= cells - periodic; ++i)
      line.push_back(i == cells ? origin + length : origin + i * h);
  else
  {
    if (!periodic)
      line.push_back(origin);
    for (int i = 0; i < cells; ++i)
      line.push_back(origin + (i + 0.5) * h);
    if (!periodic)
      line.push_back(origin + length);
  }
  return line;
}

int cells_of(double length, double h) { return std::max(1, static_cast<int>(std::lround(length / h))); }

/// Set the bits of the surfaces that nodes lie on.
template <int dim>
void mark_surfaces(Seeds<dim>& seeds, const std::vector<PlaneSurface<dim>>& surfaces, double tolerance)
{
  seeds.surface.assign(seeds.x.size(), 0);
  for (std::size_t n = 0; n < seeds.x.size(); ++n)
    for (std::size_t s = 0; s < surfaces.size(); ++s)
      if (std::abs(dot(seeds.x[n] - surfaces[s].point, surfaces[s].normal)) < tolerance)
        seeds.surface[n] |= SurfaceMask{1} << s;
}

/// Nodes of spacing about `h` that fill the box, with nodes on all faces, edges and corners. The staggered
/// pattern is mirror-symmetric about each of its node columns (2-D), so that a one-dimensional motion along
/// the columns stays one-dimensional. The box as a whole is its own mirror image if there is one in its
/// middle.
/// @param period along axes where it is not 0 the nodes repeat themselves
template <int dim>
Seeds<dim> seed_box(const Vec<dim>& origin, const Vec<dim>& size, double h, const Seeding& seeding,
                    const Vec<dim>& period)
{
  const bool staggered = seeding.pattern != Pattern::lattice;
  std::vector<Vec<dim>> x;
  if constexpr (dim == 2)
  {
    const bool repeats = period[0] > 0.0;
    const bool even = seeding.pattern == Pattern::mirrored || (staggered && repeats);
    const double width = staggered ? h * std::sqrt(0.75) : h;
    const int columns = even ? 2 * cells_of(size[0], 2.0 * width) : cells_of(size[0], width);
    for (int i = 0; i <= columns - repeats; ++i)
      for (const double y :
           line_of_nodes(origin[1], size[1], cells_of(size[1], h), staggered && i % 2 == 1, period[1] > 0.0))
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
      for (const double px : line_of_nodes(origin[0], size[0], nx, shifted, period[0] > 0.0))
        for (const double pz : line_of_nodes(origin[2], size[2], nz, shifted, period[2] > 0.0))
        {
          const bool on_edge = shifted && (px == origin[0] || px == origin[0] + size[0] || pz == origin[2] ||
                                           pz == origin[2] + size[2]);
          if (on_edge)
            continue;
          for (const double py : line_of_nodes(origin[1], size[1], ny, shifted, period[1] > 0.0))
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
  seeds.x = std::move(x);
  mark_surfaces(seeds, box_surfaces<dim>(origin, size), 1e-9 * h);
  for (auto& surface : seeds.surface) // two faces per axis
    for (int i = 0; i < dim; ++i)
      if (period[i] > 0.0)
        surface &= ~(SurfaceMask{3} << 2 * i);
  for (std::size_t n = 0; n < seeds.x.size(); ++n)
    if (seeds.surface[n] == 0 && seeding.jitter > 0.0)
      for (int i = 0; i < dim; ++i)
        seeds.x[n][i] += seeding.jitter * h * uniform(random);
  return seeds;
}

/// Corners of the ellipse inscribed in the box, in equal arc lengths of about `h`, by a fine polygon.
std::vector<Vec<2>> ellipse_outline(const Vec<2>& origin, const Vec<2>& size, double h)
{
  const double pi = std::acos(-1.0);
  const Vec<2> half = 0.5 * size, centre = origin + half;
  constexpr int fine = 20000;
  std::vector<double> arc{0.0};
  const auto at = [&](double t) {
    return Vec<2>{{centre[0] + half[0] * std::cos(t), centre[1] + half[1] * std::sin(t)}};
  };
  for (int k = 1; k <= fine; ++k)
    arc.push_back(arc.back() + norm(at(2 * pi * k / fine) - at(2 * pi * (k - 1) / fine)));
  const int n = std::max(8, static_cast<int>(std::lround(arc.back() / h)));
  std::vector<Vec<2>> outline;
  for (int k = 0, f = 0; k < n; ++k)
  {
    const double s = arc.back() * k / n;
    while (arc[static_cast<std::size_t>(f) + 1] <= s)
      ++f;
    const double part = (s - arc[static_cast<std::size_t>(f)]) /
                        (arc[static_cast<std::size_t>(f) + 1] - arc[static_cast<std::size_t>(f)]);
    outline.push_back(at(2 * pi * (f + part) / fine));
  }
  return outline;
}

/// The seeds inside the ellipse (ellipsoid) inscribed in the box, with nodes on its outline at spacing `h`.
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
    for (const auto& p : ellipse_outline(origin, size, h))
      result.x.push_back(p);
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

/// A closed plane curve of corners.
using Loop = std::vector<Vec<2>>;

double signed_area(const Loop& loop)
{
  double area = 0.0;
  for (std::size_t k = 0; k < loop.size(); ++k)
    area += 0.5 * determinant(Mat<2>{{loop[k][0], loop[k][1], loop[(k + 1) % loop.size()][0],
                                      loop[(k + 1) % loop.size()][1]}});
  return area;
}

/// Distance to the loops, positive inside an odd number of them.
double depth_in(const std::vector<Loop>& loops, const Vec<2>& x)
{
  double shortest = std::numeric_limits<double>::max();
  bool inside = false;
  for (const Loop& loop : loops)
    for (std::size_t k = 0; k < loop.size(); ++k)
    {
      const Vec<2>&a = loop[k], &b = loop[(k + 1) % loop.size()];
      const Vec<2> t = b - a;
      const double s = std::clamp(dot(x - a, t) / norm_squared(t), 0.0, 1.0);
      shortest = std::min(shortest, norm(x - a - s * t));
      if ((a[1] > x[1]) != (b[1] > x[1]) && x[0] < a[0] + (x[1] - a[1]) / (b[1] - a[1]) * t[0])
        inside = !inside;
    }
  return inside ? shortest : -shortest;
}

Loop outline_of(const Body& body, double h)
{
  const Vec<2> origin = leading<2>(body.origin), size = leading<2>(body.size);
  if (body.shape == Shape::ellipse)
    return ellipse_outline(origin, size, h);
  if (body.shape == Shape::box)
    return {origin, {{origin[0] + size[0], origin[1]}}, origin + size, {{origin[0], origin[1] + size[1]}}};
  Loop loop;
  for (const auto& p : body.points)
    loop.push_back(leading<2>(p));
  if (signed_area(loop) < 0.0)
    std::reverse(loop.begin(), loop.end());
  return loop;
}

/// Closed walls with the fluid around them that stand in the body.
std::vector<Loop> obstacles_in(const Loop& outline, const Walls<2>& walls)
{
  std::vector<Loop> holes;
  for (std::size_t w = 0; w < walls.geometry().size(); ++w)
  {
    const WallGeometry& g = walls.geometry()[w];
    if (!g.closed)
      continue;
    Loop loop;
    for (const auto& piece : walls.pieces())
      if (piece.wall == static_cast<int>(w))
        loop.push_back(piece.corner[0]);
    if (signed_area(loop) > 0.0)
      continue; // a container
    const auto within = std::count_if(loop.begin(), loop.end(),
                                      [&](const Vec<2>& p) { return depth_in({outline}, p) > 0.0; });
    if (within == 0)
      continue;
    if (within < static_cast<std::ptrdiff_t>(loop.size()))
      throw InputError("wall '" + g.name +
                       "': the obstacle cuts the outline of the fluid; give the fluid "
                       "the shape of a polygon around it");
    holes.push_back(std::move(loop));
  }
  return holes;
}

/// Nodes on the loops and between them.
std::vector<Vec<2>> fill_loops(const std::vector<Loop>& loops,
                               const std::function<double(const Vec<2>&)>& spacing, std::uint64_t seed)
{
  std::vector<Vec<2>> boundary;
  for (const Loop& loop : loops)
    for (std::size_t k = 0; k < loop.size(); ++k)
    {
      const auto points = divide<2>(loop[k], loop[(k + 1) % loop.size()], spacing);
      boundary.insert(boundary.end(), points.begin(), points.end());
    }
  return fill<2>(
      boundary, [&](const Vec<2>& x) { return depth_in(loops, x); }, spacing, seed);
}

/// Edges, faces and inside of a box, one after the other.
std::vector<Vec<3>> fill_box(const Vec<3>& origin, const Vec<3>& size,
                             const std::function<double(const Vec<3>&)>& spacing, std::uint64_t seed)
{
  std::vector<Vec<3>> boundary;
  for (int i = 0; i < 3; ++i) // faces normal to i, with their edges
    for (int end = 0; end < 2; ++end)
    {
      const int j = (i + 1) % 3, k = (i + 2) % 3;
      const auto in_space = [&](const Vec<2>& p)
      {
        Vec<3> x;
        x[i] = end == 0 ? origin[i] : origin[i] + size[i];
        x[j] = p[0];
        x[k] = p[1];
        return x;
      };
      const Loop face =
          outline_of({.origin = {origin[j], origin[k], 0.0}, .size = {size[j], size[k], 0.0}}, 0.0);
      for (const auto& p : fill_loops(
               {face}, [&](const Vec<2>& q) { return spacing(in_space(q)); }, seed))
        boundary.push_back(in_space(p));
    }
  // Edges are shared by two faces, corners by three.
  std::vector<Vec<3>> once;
  const double same = 1e-9 * norm(size);
  std::sort(boundary.begin(), boundary.end(), [](const auto& a, const auto& b) { return a.c < b.c; });
  for (const auto& p : boundary)
    if (std::none_of(once.rbegin(), once.rend(), [&](const auto& q) { return norm(p - q) < same; }))
      once.push_back(p);
  return fill<3>(
      once,
      [&](const Vec<3>& x)
      {
        double depth = std::numeric_limits<double>::max();
        for (int i = 0; i < 3; ++i)
          depth = std::min({depth, x[i] - origin[i], origin[i] + size[i] - x[i]});
        return depth;
      },
      spacing, seed);
}

template <int dim>
std::function<bool(const Vec<dim>&)> region_of(const Body& body, std::vector<Loop> loops)
{
  if constexpr (dim == 2)
    return [loops = std::move(loops)](const Vec<2>& x) { return depth_in(loops, x) > 0.0; };
  else
    return [body](const Vec<3>& x)
    {
      double level = 0.0;
      for (int i = 0; i < 3; ++i)
      {
        const auto k = static_cast<std::size_t>(i);
        const double s = std::abs((x[i] - body.origin[k]) / (0.5 * body.size[k]) - 1.0);
        level = body.shape == Shape::box ? std::max(level, s) : level + s * s;
      }
      return level < 1.0;
    };
}

} // namespace

template <int dim>
std::vector<PlaneSurface<dim>> body_surfaces(const Body& body)
{
  if constexpr (dim == 2)
    if (body.shape == Shape::polygon)
    {
      std::vector<PlaneSurface<2>> surfaces;
      const Loop loop = outline_of(body, 0.0);
      for (std::size_t k = 0; k < loop.size() && k < 32; ++k)
      {
        const Vec<2> n = right_normal(loop[(k + 1) % loop.size()] - loop[k]);
        surfaces.push_back({"edge_" + std::to_string(k), loop[k], n * (1.0 / norm(n))});
      }
      return surfaces;
    }
  return box_surfaces<dim>(leading<dim>(body.origin), leading<dim>(body.size));
}

template <int dim>
Scene<dim> seed_scene(const FluidConfig& config, const SizeField<dim>& size, const Walls<dim>& walls)
{
  Scene<dim> scene;
  std::vector<std::function<bool(const Vec<dim>&)>> regions;
  bool convex = true;
  const double h = config.element_size;
  const std::function<double(const Vec<dim>&)> spacing = [&](const Vec<dim>& x) { return size(x, walls); };
  std::vector<const Body*> bodies{&config};
  for (const Body& body : config.more_bodies)
    bodies.push_back(&body);
  for (const Body* body : bodies)
  {
    if (body->shape == Shape::none)
    {
      regions.push_back([](const Vec<dim>&) { return false; });
      continue;
    }
    const Vec<dim> origin = leading<dim>(body->origin), extent = leading<dim>(body->size);
    std::vector<Loop> loops;
    if constexpr (dim == 2)
    {
      loops = {outline_of(*body, h)};
      for (auto& hole : obstacles_in(loops.front(), walls))
        loops.push_back(std::move(hole));
    }
    Seeds<dim> seeds;
    if (size.uniform() && body->shape != Shape::polygon && loops.size() <= 1)
    {
      seeds = seed_box<dim>(origin, extent, h, config.seeding,
                            body == bodies.front() ? leading<dim>(config.period) : Vec<dim>{});
      if (body->shape == Shape::ellipse)
        seeds = cut_ellipse<dim>(seeds, origin, extent, h);
    }
    else
    {
      if constexpr (dim == 2)
        seeds.x = fill_loops(loops, spacing, config.seeding.seed);
      else
      {
        if (body->shape != Shape::box)
          throw InputError("fluid.spacing: a graded body must be a box in 3-D");
        seeds.x = fill_box(origin, extent, spacing, config.seeding.seed);
      }
      convex = convex && body->shape != Shape::polygon && loops.size() <= 1;
      seeds.surface.assign(seeds.x.size(), 0);
      if (body->shape != Shape::ellipse)
        mark_surfaces(seeds, body_surfaces<dim>(*body), 1e-9 * h);
    }
    const bool first = body == bodies.front();
    for (std::size_t n = 0; n < seeds.x.size(); ++n)
    {
      scene.seeds.x.push_back(seeds.x[n]);
      scene.seeds.surface.push_back(first ? seeds.surface[n] : 0);
      scene.seeds.body.push_back(static_cast<int>(regions.size()));
    }
    regions.push_back(region_of<dim>(*body, std::move(loops)));
  }
  if (!convex || bodies.size() > 1 || !config.inlets.empty())
    scene.inside = [regions](const Vec<dim>& x)
    { return std::any_of(regions.begin(), regions.end(), [&](const auto& region) { return region(x); }); };
  return scene;
}

template std::vector<PlaneSurface<2>> body_surfaces<2>(const Body&);
template std::vector<PlaneSurface<3>> body_surfaces<3>(const Body&);
template Scene<2> seed_scene<2>(const FluidConfig&, const SizeField<2>&, const Walls<2>&);
template Scene<3> seed_scene<3>(const FluidConfig&, const SizeField<3>&, const Walls<3>&);

} // namespace undine::fluid
