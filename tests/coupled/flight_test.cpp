// Steps without exchange while a solid is on its way to the water.
#include "tests/coupled/in_memory.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <map>
#include <memory>
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
  std::int64_t told = 0; ///< windows before the hit after which the solid said another kinetic energy
};

/// A tank of water.
fluid::FluidConfig water_below()
{
  constexpr double h = 0.01;
  fluid::FluidConfig f = hydraulic(h, 20.0);
  f.gravity = {0.0, -9.81, 0.0};
  f.initial_pressure = fluid::InitialPressure::hydrostatic;
  f.size = {0.3, 0.1, 0.0};
  f.contact_walls = {tank(0.3)};
  f.interfaces = {{"wet", "boundary"}};
  return f;
}

/// A rubber block, 40 mm above the water, is thrown at it with 1 m/s; it vibrates on its way.
solid::SolidConfig thrown_block(std::array<int, 2> elements)
{
  solid::SolidConfig s;
  s.geometry.origin = {0.1, 0.14};
  s.geometry.size = {0.1, 0.03};
  s.geometry.elements = {elements[0], elements[1]};
  s.material = {.density = 1100.0, .youngs_modulus = 1e5, .poisson_ratio = 0.3, .law = "neo_hookean_ln"};
  s.gravity = {0.0, -9.81};
  s.initial_velocity = {0.0, -1.0};
  s.wet = {{"wet", "bottom"}, {"wet", "left"}, {"wet", "right"}};
  return s;
}

coupler::CouplerConfig thrown(bool flight, double t_end)
{
  coupler::CouplerConfig config;
  config.run.dim = 2;
  config.run.t_end = t_end;
  config.coupling.present = true;
  config.coupling.interfaces = {{"wet", "boundary", "bottom, left, right", "slip", true, "finer"}};
  config.coupling.substeps = 1;
  config.flight = flight;
  return config;
}

/// A solid whose histories have a row every `interval` seconds, 0: after every window.
Participant with_rows(solid::Solid<2>& solid, double interval)
{
  return {.role = "solid", .serve = [&solid, interval](link::SolverLink& link) {
            solid::run_coupled<2>(solid, link, {.history_interval = interval}, nullptr);
          }};
}

Fall fall(bool flight, double t_end, double interval = 0.0)
{
  fluid::Fluid<2> fluid(water_below());
  const solid::SolidConfig s = thrown_block({20, 6});
  solid::Solid<2> solid(s, solid::make_mesh<2>(s));
  const coupler::CouplerConfig config = thrown(flight, t_end);
  Fall out;
  double said = 0.0;
  run_in_memory({participant("fluid", fluid), with_rows(solid, interval)}, config,
                [&](const coupler::WindowRecord& r)
                {
                  const bool other = r.solid.kinetic_energy != said;
                  said = r.solid.kinetic_energy;
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
                    out.told += other;
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

/// Processor time of this thread [s].
double processor_seconds()
{
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Adds up the processor time that waiting takes.
class Metered : public link::Channel
{
public:
  Metered(std::unique_ptr<link::Channel> inner, double& waited) : inner_(std::move(inner)), waited_(&waited)
  {
  }
  void send(std::span<const std::byte> message) override { inner_->send(message); }
  void receive(std::vector<std::byte>& message) override
  {
    const double begin = processor_seconds();
    inner_->receive(message);
    *waited_ += processor_seconds() - begin;
  }

private:
  std::unique_ptr<link::Channel> inner_;
  double* waited_;
};

} // namespace

// Processor time, so that neither waiting nor other programs count but by what they push out of the caches.
// The least of fifteen runs of each. Between rows of the histories the solid need not know its energies (next
// test).
TEST_CASE("a solid on its way costs little more than alone", "[coupled][verification]")
{
  const solid::SolidConfig s = thrown_block({60, 18});
  constexpr double t_end = 0.02; // before the hit
  double alone = 1e9, in_flight = 1e9, step_by_step = 1e9;
  for (int k = 0; k < 15; ++k)
  {
    solid::Solid<2> by_itself(s, solid::make_mesh<2>(s));
    const double begin = processor_seconds();
    const auto result = solid::run_alone<2>(by_itself, {.t_end = t_end, .history_interval = 1.0}, nullptr);
    alone = std::min(alone, (processor_seconds() - begin) / static_cast<double>(result.steps));
    for (const bool flight : {true, false})
    {
      fluid::Fluid<2> fluid(water_below());
      solid::Solid<2> solid(s, solid::make_mesh<2>(s));
      double computing = 0.0, waited = 0.0;
      run_in_memory({participant("fluid", fluid),
                     {.role = "solid",
                      .serve =
                          [&](link::SolverLink& link)
                      {
                        const double start = processor_seconds() - waited;
                        solid::run_coupled<2>(solid, link, {.history_interval = 1.0}, nullptr);
                        computing = processor_seconds() - waited - start;
                      },
                      .wrap = [&](std::unique_ptr<link::Channel> channel)
                      { return std::make_unique<Metered>(std::move(channel), waited); }}},
                    thrown(flight, t_end), [](const coupler::WindowRecord&) {});
      double& least = flight ? in_flight : step_by_step;
      least = std::min(least, computing / static_cast<double>(solid.steps()));
    }
  }
  CAPTURE(1e6 * alone, 1e6 * in_flight, 1e6 * step_by_step, in_flight / alone, step_by_step / alone);
  CHECK(in_flight < 1.25 * alone);
}

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

// A falling block says another kinetic energy whenever it computes it.
TEST_CASE("a solid on its way computes its energies where a row is due, and moves as if it always did",
          "[coupled][verification]")
{
  const Fall always = fall(true, 0.05), rarely = fall(true, 0.05, 0.01);
  CAPTURE(always.told, rarely.told, always.windows_before_hit, rarely.hit);
  CHECK(always.told == always.windows_before_hit);
  CHECK(rarely.told < rarely.windows_before_hit / 3); // three rows, and windows of one step before the hit
  CHECK(rarely.told >= 3);
  CHECK(rarely.hit == always.hit);
  CHECK(rarely.windows == always.windows);
  CHECK(apart(rarely.u_solid, always.u_solid) == 0.0);
  CHECK(apart(rarely.x_fluid, always.x_fluid) == 0.0);
}
