// A plate thinner than the spacing of the fluid between two waters: nothing passes, and the water stays on
// it.
#include "tests/coupled/in_memory.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <map>

using namespace undine;
using namespace undine::test;

namespace
{

struct Tank
{
  double thickness = 0.3;         ///< of the plate, over the spacing
  double t_end = 0.1;             ///< [s]
  double left = 0.3, right = 0.3; ///< depth of the water [m]
  double modulus = 1e7;           ///< of the plate [Pa]
};

struct Leak
{
  std::int64_t windows = 0, remeshes = 0;
  double mass = 0.0;      ///< largest change of the particle mass of a side, over its first
  double void_area = 0.0; ///< largest area between plate and water, over the tank's, after the first remesh
  double bare = 0.0;      ///< largest part of the wet height without a face of the water before it
  double force = 0.0;     ///< on the plate, mean over the second half [N/m]
};

constexpr double spacing = 0.02, half_width = 0.2, height = 0.4, g = 9.81;

/// Displacement in x of a face of the plate at height y [m].
double bend(const solid::Solid<2>& plate, double face, double y)
{
  std::map<double, double> u; // by height
  for (std::size_t n = 0; n < plate.nodes().X.size(); ++n)
    if (std::abs(plate.nodes().X[n][0] - face) < 1e-9)
      u[plate.nodes().X[n][1] + plate.nodes().u[n][1]] = plate.nodes().u[n][0];
  auto above = u.lower_bound(y);
  if (above == u.begin() || above == u.end())
    return above == u.begin() ? above->second : u.rbegin()->second;
  const auto below = std::prev(above);
  return below->second + (above->second - below->second) * (y - below->first) / (above->first - below->first);
}

/// A tank parted in the middle by a plate that is held at its lower and upper end, and rises above the water.
Leak run(const Tank& tank)
{
  const double t = tank.thickness * spacing;
  fluid::FluidConfig f = hydraulic(spacing, 20.0);
  f.gravity = {0.0, -g, 0.0};
  f.seeding.jitter = 0.2; // a general mesh, made anew every 20 steps
  f.remesh.only_if_moved = false;
  f.initial_pressure = fluid::InitialPressure::hydrostatic;
  f.origin = {-half_width, 0.0, 0.0};
  f.size = {half_width - 0.5 * t, tank.left, 0.0};
  fluid::Body right;
  right.origin = {0.5 * t, 0.0, 0.0};
  right.size = {half_width - 0.5 * t, tank.right, 0.0};
  f.more_bodies = {right};
  fluid::WallGeometry walls;
  walls.name = "tank";
  walls.points = {
      {-half_width, 9.0, 0.0}, {-half_width, 0.0, 0.0}, {half_width, 0.0, 0.0}, {half_width, 9.0, 0.0}};
  f.contact_walls = {walls};
  f.interfaces = {{"plate", "boundary"}};

  solid::SolidConfig s;
  s.geometry.origin = {-0.5 * t, 0.0};
  s.geometry.size = {t, height};
  s.geometry.elements = {1, 40};
  s.material = {
      .density = 1000.0, .youngs_modulus = tank.modulus, .poisson_ratio = 0.0, .law = "neo_hookean_ln"};
  s.fix = {{"bottom", {"x", "y"}}, {"top", {"x", "y"}}};
  s.wet = {{"plate", "left"}, {"plate", "right"}};

  fluid::Fluid<2> fluid(f);
  solid::Solid<2> plate(s, solid::make_mesh<2>(s));
  coupler::CouplerConfig config;
  config.run.dim = 2;
  config.run.t_end = tank.t_end;
  config.coupling.present = true;
  config.coupling.interfaces = {{"plate", "boundary", "left, right", "slip", true, "finer"}};

  Leak leak;
  double mass_at_start[2] = {0.0, 0.0}, impulse = 0.0;
  const double floor = 0.5 * spacing;
  run_in_memory(fluid, plate, config,
                [&](const coupler::WindowRecord& r)
                {
                  const auto& nodes = fluid.nodes();
                  double mass[2] = {0.0, 0.0};
                  for (std::size_t n = 0; n < nodes.x.size(); ++n)
                    mass[nodes.x[n][0] > 0.0] += nodes.M[n];
                  for (int k = 0; k < 2; ++k)
                  {
                    if (r.plan.t_end == 0.0)
                      mass_at_start[k] = mass[k];
                    leak.mass = std::max(leak.mass, std::abs(mass[k] / mass_at_start[k] - 1.0));
                  }
                  leak.windows = r.plan.index + 1;
                  leak.remeshes = fluid.remeshes();
                  if (r.plan.t_end > 0.5 * tank.t_end)
                    for (std::size_t k = 0; k < r.solid_force.size(); k += 2)
                      impulse += r.solid_force[k] * (r.plan.t_end - r.plan.t_begin);
                  if (fluid.remeshes() == 0 || r.plan.index % 20 != 0)
                    return;
                  double area = 0.0, covered[2] = {0.0, 0.0};
                  for (const auto& edge : fluid.mesh().boundary)
                  {
                    const Vec<2> a = nodes.x[static_cast<std::size_t>(edge[0])],
                                 b = nodes.x[static_cast<std::size_t>(edge[1])];
                    const bool on_right = a[0] > 0.0;
                    const double top = (on_right ? tank.right : tank.left) - 1.5 * spacing;
                    const double low = std::clamp(std::min(a[1], b[1]), floor, top),
                                 high = std::clamp(std::max(a[1], b[1]), floor, top);
                    if (std::max(std::abs(a[0]), std::abs(b[0])) > 1.5 * spacing || high <= low)
                      continue;
                    const double side = on_right ? 1.0 : -1.0;
                    const auto gap = [&](const Vec<2>& p)
                    { return std::abs(side * p[0] - 0.5 * t - side * bend(plate, side * 0.5 * t, p[1])); };
                    area += 0.5 * (gap(a) + gap(b)) * (high - low);
                    covered[on_right] += high - low;
                  }
                  leak.void_area = std::max(leak.void_area, area / (2.0 * half_width * height));
                  for (int k = 0; k < 2; ++k)
                  {
                    const double wet = (k == 1 ? tank.right : tank.left) - 1.5 * spacing - floor;
                    leak.bare = std::max(leak.bare, std::abs(covered[k] / wet - 1.0));
                  }
                });
  leak.force = impulse / (0.5 * tank.t_end);
  return leak;
}

} // namespace

// Particle mass of a side is a sum of the same numbers as long as no node passes: round-off. The water's
// boundary lies on both faces of the plate after each of the remeshes, one every 20 steps on a general mesh:
// its whole wet height is bounded by faces of the water, and the area between them and the plate is the gap
// that contact leaves open where rows are not closed, at most 1e-6 of the tank. (At a tenth of a spacing
// nodes of both sides come nearer to each other than the merging distance, and water passes.)
TEST_CASE("a plate a third of a spacing thick parts two waters at rest", "[coupled][verification]")
{
  const Leak leak = run({.t_end = 0.05});
  INFO(leak.windows << " windows, " << leak.remeshes << " remeshes, mass " << leak.mass << ", void "
                    << leak.void_area << ", bare " << leak.bare << ", force " << leak.force << " N/m");
  CHECK(leak.remeshes > 20);
  CHECK(leak.mass < 1e-12);
  CHECK(leak.void_area < 1e-6);
  CHECK(leak.bare < 1e-6);
  CHECK(std::abs(leak.force) < 1.0); // of 441 N/m on either face
}

// 1e5 steps each. Equal depths: the plate stays straight, and nothing is between it and the water. 0.1 m more
// water on the left: ½ρg(0.3² − 0.2²) = 245 N/m, which the plate and the faces that turn with it make 1 %
// uncertain; it bends, let go at once, with a curvature of up to 2qL²/(12EI) = 0.7 /m at its ends and half of
// that in the mean, and faces of the water, up to 1.7 spacings long, are its chords: κh²/12 over 0.5 m of wet
// height are 1.1e-4 of the tank, gaps on one face and overlaps on the other.
TEST_CASE("a thin plate parts two waters over 1e5 steps", "[.][coupled][validation]")
{
  const Leak equal = run({.t_end = 0.4, .modulus = 2e9}),
             leak = run({.t_end = 0.4, .right = 0.2, .modulus = 2e9});
  for (const Leak& l : {equal, leak})
  {
    INFO(l.windows << " windows, " << l.remeshes << " remeshes, mass " << l.mass << ", void " << l.void_area
                   << ", bare " << l.bare << ", force " << l.force << " N/m");
    CHECK(l.windows > 100000);
    CHECK(l.mass < 1e-12);
    CHECK(l.bare < 1e-6);
  }
  INFO("between plate and water " << equal.void_area << ", " << leak.void_area << " of the tank; force "
                                  << equal.force << ", " << leak.force << " N/m");
  CHECK(equal.void_area < 1e-6);
  CHECK(std::abs(equal.force) < 1.0); // of 441 N/m on either face
  CHECK(leak.void_area < 1.1e-4);
  CHECK(leak.force == Approx(0.5 * 1000.0 * g * (0.09 - 0.04)).epsilon(0.02));
}
