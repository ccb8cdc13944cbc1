// The negotiation of windows.
#include "coupler/window_planner.hpp"

#include <catch2/catch.hpp>

#include <cmath>

using namespace undine;
using namespace undine::coupler;

TEST_CASE("constant limits give equal windows that end exactly at t_end", "[coupler][unit]")
{
  WindowPlanner planner({}, 0.0, 0.5);
  double dT = 0.0;
  std::int64_t windows = 0;
  while (!planner.finished())
  {
    const auto plan = planner.next(2.26e-6, 3.1e-4);
    if (windows++ == 0)
      dT = plan.steps.coarse_dt;
    REQUIRE(plan.steps.coarse_dt == dT);
    REQUIRE(plan.steps.fine == Side::fluid);
    REQUIRE(plan.steps.m == static_cast<std::int64_t>(std::ceil(dT / 2.26e-6)));
    if (planner.finished())
    {
      CHECK(plan.last);
      CHECK(plan.t_end == 0.5);
    }
  }
  CHECK(windows == static_cast<std::int64_t>(std::ceil(0.5 / 3.1e-4)));
}

TEST_CASE("the window falls at once with its limit and grows slowly", "[coupler][unit]")
{
  WindowPlanner planner({}, 0.0, 1.0);
  const double first = planner.next(1e-5, 1e-3).steps.coarse_dt;
  const double fallen = planner.next(1e-5, 0.5e-3).steps.coarse_dt;
  CHECK(fallen <= 0.5e-3);
  CHECK(fallen > 0.48e-3);
  double last = fallen;
  for (int k = 0; k < 100; ++k)
  {
    const double dT = planner.next(1e-5, 1e-3).steps.coarse_dt;
    CHECK(dT <= 1.0200001 * last);
    CHECK(dT <= 1e-3);
    last = dT;
  }
  CHECK(last > 0.85 * first);
}

TEST_CASE("small changes of the limits change nothing", "[coupler][unit]")
{
  WindowPlanner planner({}, 0.0, 10.0);
  planner.next(1e-5, 1e-3);
  const auto held = planner.next(1e-5, 0.98e-3); // falls once, then holds with a reserve
  for (int k = 0; k < 200; ++k)
  {
    const auto plan =
        planner.next(1e-5 * (1.0 + 0.01 * std::sin(k)), 0.98e-3 * (1.015 + 0.015 * std::sin(0.3 * k)));
    CHECK(plan.steps.coarse_dt == held.steps.coarse_dt);
    CHECK(plan.steps.m <= held.steps.m + 2);
    CHECK(plan.steps.m >= held.steps.m);
  }
}

TEST_CASE("the fine side swaps only when the ratio is clearly inverted", "[coupler][unit]")
{
  WindowPlanner planner({}, 0.0, 10.0);
  CHECK(planner.next(1e-3, 2e-3).steps.fine == Side::fluid);
  CHECK(planner.next(1e-3, 0.9e-3).steps.fine == Side::fluid);
  CHECK(planner.next(1e-3, 0.5e-3).steps.fine == Side::solid);
  CHECK(planner.next(1e-3, 1.1e-3).steps.fine == Side::solid);
}

TEST_CASE("the number of sub-steps is bounded, or as the case says", "[coupler][unit]")
{
  WindowPlanner bounded({.substeps_max = 50}, 0.0, 1.0);
  const auto plan = bounded.next(1e-6, 1e-3);
  CHECK(plan.steps.m == 50);
  CHECK(plan.steps.coarse_dt <= 50e-6);
  CHECK(plan.steps.coarse_dt > 49e-6);
  WindowPlanner fixed({.substeps = 7}, 0.0, 1.0);
  const auto seven = fixed.next(1e-4, 1.0);
  CHECK(seven.steps.m == 7);
  CHECK(seven.steps.coarse_dt <= 7e-4);
  CHECK(seven.steps.fine_dt() <= 1e-4);
}
