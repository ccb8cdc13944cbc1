// Random scenes of fluid: containers, obstacles, bodies, speeds, gravity; one seed is one scene.
#pragma once

#include "fluid_pfem/fluid.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

namespace undine::test
{

using Loop = std::vector<Vec<2>>;

/// Distance to the loop, positive inside.
inline double depth(const Loop& loop, const Vec<2>& x)
{
  double shortest = 1e300;
  bool inside = false;
  for (std::size_t k = 0; k < loop.size(); ++k)
  {
    const Vec<2>&a = loop[k], &b = loop[(k + 1) % loop.size()];
    const Vec<2> t = b - a;
    shortest = std::min(shortest, norm(x - a - std::clamp(dot(x - a, t) / norm_squared(t), 0.0, 1.0) * t));
    if ((a[1] > x[1]) != (b[1] > x[1]) && x[0] < a[0] + (x[1] - a[1]) / (b[1] - a[1]) * t[0])
      inside = !inside;
  }
  return inside ? shortest : -shortest;
}

/// A plane scene: closed container, obstacles in it, bodies of fluid between them.
struct RandomScene
{
  fluid::FluidConfig config;
  Loop container;
  std::vector<Loop> obstacles;

  /// How far x is behind a wall [m].
  double behind(const Vec<2>& x) const
  {
    double out = -depth(container, x);
    for (const Loop& obstacle : obstacles)
      out = std::max(out, depth(obstacle, x));
    return out;
  }
};

/// Container: box or star-shaped polygon of radius 0.6 to 1.3 m; 0 to 2 obstacles; 1 to 3 boxes, ellipses or
/// polygons of fluid with speeds up to 0.3 c; c = 10 to 40 m/s; gravity of any direction up to c²/100 per
/// metre; 12 to 30 nodes per metre; both presets; viscous or not; uniform or graded.
inline RandomScene random_scene(std::uint64_t seed)
{
  std::mt19937_64 random(seed);
  const auto uniform = [&](double a, double b)
  { return std::uniform_real_distribution<double>(a, b)(random); };
  const auto integer = [&](int a, int b) { return std::uniform_int_distribution<int>(a, b)(random); };
  const double pi = std::acos(-1.0);
  const auto star = [&](const Vec<2>& centre, int corners, double r_min, double r_max)
  {
    Loop loop;
    const double turn = uniform(0.0, 2.0 * pi);
    for (int k = 0; k < corners; ++k)
    {
      const double r = uniform(r_min, r_max), angle = turn + 2.0 * pi * (k + uniform(-0.25, 0.25)) / corners;
      loop.push_back(centre + Vec<2>{{r * std::cos(angle), r * std::sin(angle)}});
    }
    return loop;
  };
  RandomScene scene;
  fluid::FluidConfig& config = scene.config;
  const double c = uniform(10.0, 40.0), h = 1.0 / uniform(12.0, 30.0);
  const bool impact = integer(0, 3) == 0;
  config.element_size = h;
  config.tait = {.rho0 = 1000.0, .p0 = 0.0, .B = 1000.0 * c * c / 7.0, .gamma = 7.0};
  config.terms.bulk_linear = impact ? 0.06 : 0.05;
  config.terms.bulk_quadratic = impact ? 1.2 : 0.0;
  config.terms.residual = 0.1;
  config.terms.residual_with_acceleration = !impact;
  config.terms.mu = integer(0, 2) == 0 ? uniform(0.0, 20.0) : 0.0;
  config.feedback_time = impact ? 0.0 : 100.0;
  config.surface_tension_allowed = !impact;
  config.inertia_floor = 0.1;
  config.remesh.shape.gap = 0.2;
  config.remesh.spacing.merge = impact ? 0.30 : 0.45;
  config.remesh.quality = impact ? 0.3 : 0.5;
  config.remesh.every = impact ? 10 : 20;
  config.remesh.delete_isolated_after = impact ? 2 : 0;
  const double g = integer(0, 4) == 0 ? 0.0 : uniform(0.0, 0.01 * c * c), down = uniform(0.0, 2.0 * pi);
  config.gravity = {g * std::cos(down), g * std::sin(down), 0.0};

  scene.container = integer(0, 1) == 0 ? Loop{{{-1.0, -1.0}}, {{1.0, -1.0}}, {{1.0, 1.0}}, {{-1.0, 1.0}}}
                                       : star({}, integer(3, 8), 0.6, 1.3);
  const auto wall = [&](const std::string& name, const Loop& loop, bool clockwise)
  {
    fluid::WallGeometry w;
    w.name = name;
    w.closed = true;
    for (const auto& p : loop)
      w.points.push_back({p[0], p[1], 0.0});
    if (clockwise)
      std::reverse(w.points.begin(), w.points.end());
    w.no_slip = integer(0, 5) == 0;
    config.contact_walls.push_back(w);
  };
  wall("container", scene.container, false);

  struct Disc
  {
    Vec<2> x;
    double r;
  };
  std::vector<Disc> taken;
  const auto place = [&](double r_min, double r_max)
  {
    for (int attempt = 0; attempt < 200; ++attempt)
    {
      const Disc disc{{{uniform(-1.2, 1.2), uniform(-1.2, 1.2)}}, uniform(r_min, r_max)};
      const bool free =
          depth(scene.container, disc.x) > disc.r + h &&
          std::none_of(taken.begin(), taken.end(),
                       [&](const Disc& d) { return norm(d.x - disc.x) < d.r + disc.r + 2.0 * h; });
      if (!free)
        continue;
      taken.push_back(disc);
      return true;
    }
    return false;
  };
  const int n_bodies = integer(1, 3), n_obstacles = integer(0, 2);
  bool first = true;
  for (int k = 0; k < n_bodies; ++k)
  {
    if (!place(0.12, k == 0 ? 0.5 : 0.3) && !place(0.06, 0.12))
      continue;
    const Disc disc = taken.back();
    fluid::Body body;
    const int kind = integer(0, 2);
    if (kind == 2)
    {
      body.shape = fluid::Shape::polygon;
      for (const auto& p : star(disc.x, integer(3, 6), 0.6 * disc.r, disc.r))
        body.points.push_back({p[0], p[1], 0.0});
    }
    else
    {
      body.shape = kind == 0 ? fluid::Shape::box : fluid::Shape::ellipse;
      const double angle = uniform(0.2, 0.5 * pi - 0.2), a = disc.r * std::cos(angle),
                   b = disc.r * std::sin(angle);
      body.origin = {disc.x[0] - a, disc.x[1] - b, 0.0};
      body.size = {2.0 * a, 2.0 * b, 0.0};
    }
    const double speed = uniform(0.0, 0.3) * c, towards = uniform(0.0, 2.0 * pi);
    for (const double v : {speed * std::cos(towards), speed * std::sin(towards)})
      body.initial_velocity.emplace_back(std::to_string(v), "stress");
    if (first)
      static_cast<fluid::Body&>(config) = body;
    else
      config.more_bodies.push_back(body);
    first = false;
  }
  if (first)
    config.shape = fluid::Shape::none;
  for (int k = 0; k < n_obstacles; ++k)
    if (place(0.1, 0.3))
    {
      scene.obstacles.push_back(star(taken.back().x, integer(3, 5), 0.5 * taken.back().r, taken.back().r));
      wall("obstacle_" + std::to_string(k), scene.obstacles.back(), true);
    }
  if (integer(0, 4) == 0)
  {
    fluid::SizeZone zone;
    zone.lower = {-0.5, -0.5, 0.0};
    zone.upper = {0.5, 0.5, 0.0};
    zone.growth = uniform(0.05, 0.25);
    config.spacing.push_back(zone);
    config.coarsest = 3.0;
  }
  return scene;
}

/// What a run of a scene showed.
struct StressResult
{
  std::string failure;      ///< empty: none
  std::int64_t steps = 0;   ///< done
  double slowest = 1.0;     ///< smallest step over the first one
  double behind_wall = 0.0; ///< furthest any node was behind a wall, over the spacing
  double mass = 0.0;        ///< largest relative change of the particle mass
  double energy = 0.0;      ///< largest rise over the start, over the energy that moves: K + m |g| 1 m
  index_t nodes = 0;
  std::int64_t remeshes = 0;
};

} // namespace undine::test
