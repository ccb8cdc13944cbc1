// Steps between two remeshes allocate nothing. In its own program: it counts every `new`.
#include "fluid_pfem/fluid.hpp"
#include "tests/fluid_pfem/fixtures.hpp"
#include "tests/support/counted_new.hpp"

#include <catch2/catch.hpp>

using namespace undine::fluid;

// A falling column in its tank: the first step and the first bound may still size arrays, no later one.
TEST_CASE("a step, its bound and the look at the mesh allocate nothing", "[fluid][unit]")
{
  Fluid<2> fluid(undine::test::dam_break_config(0.146 / 10.0));
  const double dt = fluid.critical_time_step();
  const auto step = [&]
  {
    fluid.predict(dt);
    fluid.solve_free_motion(dt);
  };
  for (int k = 0; k < 3; ++k)
    step();
  const long before = allocations;
  bool distorted = false;
  double bound = 0.0;
  for (int k = 0; k < 15; ++k)
  {
    step();
    bound += fluid.critical_time_step();
    distorted = fluid.is_distorted() || distorted;
  }
  CHECK(bound > 0.0);
  CHECK(!distorted);
  CHECK(allocations - before == 0);
}
