// Steps without exchange while a solid is on its way to the water.
#include "tests/coupled/in_memory.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

using namespace undine;
using namespace undine::test;

namespace
{

struct Fall
{
  std::vector<Vec<2>> u_solid; ///< at the end
  std::vector<Vec<2>> x_fluid;
  double hit = 0.0; ///< time at which the water first pushed the solid [s]
  std::int64_t windows = 0, windows_before_hit = 0, steps_before_hit = 0;
  double impulse_mismatch = 0.0, made = 0.0;
};

/// A rubber block, 40 mm above a tank of water, is thrown at it with 1 m/s; it vibrates on its way.
Fall fall(bool flight, double t_end)
{
  constexpr double h = 0.01;
  fluid::FluidConfig f = hydraulic(h, 20.0);
  f.gravity = {0.0, -9.81, 0.0};
  f.initial_pressure = fluid::InitialPressure::hydrostatic;
  f.size = {0.3, 0.1, 0.0};
  f.contact_walls = {tank(0.3)};
  f.interfaces = {{"wet", "boundary"}};
  solid::SolidConfig s;
  s.geometry.origin = {0.1, 0.14};
  s.geometry.size = {0.1, 0.03};
  s.geometry.elements = {20, 6};
  s.material = {.density = 1100.0, .youngs_modulus = 1e5, .poisson_ratio = 0.3, .law = "neo_hookean_ln"};
  s.gravity = {0.0, -9.81};
  s.initial_velocity = {0.0, -1.0};
  s.wet = {{"wet", "bottom"}, {"wet", "left"}, {"wet", "right"}};
  fluid::Fluid<2> fluid(f);
  solid::Solid<2> solid(s, solid::make_mesh<2>(s));
  coupler::CouplerConfig config;
  config.run.dim = 2;
  config.run.t_end = t_end;
  config.coupling.present = true;
  config.coupling.interfaces = {{"wet", "boundary", "bottom, left, right", "slip", true, "finer"}};
  config.coupling.substeps = 1;
  config.flight = flight;
  Fall out;
  run_in_memory(fluid, solid, config,
                [&](const coupler::WindowRecord& r)
                {
                  if (r.plan.t_end == 0.0)
                    return;
                  ++out.windows;
                  const bool pushed = std::any_of(r.solid_force.begin(), r.solid_force.end(),
                                                  [](double x) { return x != 0.0; });
                  if (pushed && out.hit == 0.0)
                    out.hit = r.plan.t_end;
                  if (out.hit == 0.0)
                  {
                    ++out.windows_before_hit;
                    out.steps_before_hit += r.plan.flight;
                  }
                  out.impulse_mismatch = r.balance.impulse_mismatch / std::max(r.balance.impulse[0], 1e-300);
                  out.made = r.balance.work[0] + r.balance.work[1];
                });
  out.u_solid.assign(solid.nodes().u.begin(), solid.nodes().u.end());
  std::map<global_index_t, Vec<2>> by_id; // remeshes bring nodes into another order
  for (std::size_t n = 0; n < fluid.nodes().x.size(); ++n)
    by_id[fluid.nodes().id[n]] = fluid.nodes().x[n];
  for (const auto& [id, x] : by_id)
    out.x_fluid.push_back(x);
  return out;
}

double apart(const std::vector<Vec<2>>& a, const std::vector<Vec<2>>& b)
{
  double worst = a.size() == b.size() ? 0.0 : 1e9;
  for (std::size_t n = 0; n < std::min(a.size(), b.size()); ++n)
    worst = std::max(worst, norm(a[n] - b[n]));
  return worst;
}

} // namespace

// What is left out has no effect: the hit comes in the same step, and positions just before it agree to the
// round-off of their steps, 2^-52 x 0.3 m each. After the hit the fluid looks at its mesh in the same steps
// again, but remembers others.
TEST_CASE("a solid flies without exchange and meets the water where it would have", "[coupled][verification]")
{
  const Fall step_by_step = fall(false, 0.05), flight = fall(true, 0.05);
  CAPTURE(step_by_step.hit, flight.hit, step_by_step.windows_before_hit, flight.windows_before_hit,
          flight.steps_before_hit, flight.windows, step_by_step.windows);
  REQUIRE(step_by_step.hit > 0.03);
  CHECK(std::abs(flight.hit - step_by_step.hit) < 1e-9);
  CHECK(flight.steps_before_hit == step_by_step.windows_before_hit);
  CHECK(static_cast<double>(flight.windows_before_hit) <
        0.35 * static_cast<double>(step_by_step.windows_before_hit));
  CHECK(flight.impulse_mismatch < 1e-12);
  CHECK(flight.made < 0.0);
  const double before = 0.8 * flight.hit;
  const Fall slow = fall(false, before), fast = fall(true, before);
  const double noise = std::ldexp(0.3, -52) * static_cast<double>(slow.windows);
  CAPTURE(1e15 * noise, 1e15 * apart(slow.u_solid, fast.u_solid), 1e15 * apart(slow.x_fluid, fast.x_fluid));
  CHECK(slow.hit == 0.0);
  CHECK(apart(slow.u_solid, fast.u_solid) < 10.0 * noise);
  CHECK(apart(slow.x_fluid, fast.x_fluid) < 1e-10); // 1e-8 of the spacing: pressures carry 2^-52 ρc²
}
