// The limit of staggering: stable while the fluid's interface mass is the smaller one, and not beyond.
#include "tests/coupler/bars.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>

using namespace undine::test;

namespace
{

/// Velocity of a free mass after `steps` windows over that at the start, when it carries a lump of fluid `q`
/// times as heavy. (A fluid with sound in it adds what its waves do under a force that comes late: they grow
/// slowly unless the fluid damps them, as ours does by default.)
double growth(double q, int steps)
{
  Bar fluid(1, 1.0, 1.0, 0.0, false);
  const double mass = fluid.interface_mass() / q;
  Bar solid(1, 1.0, 2.0 * mass, 0.0, false); // gives the operator its mass; its motion is computed below
  GravouilCombescure gc(glue(fluid, solid), 1);

  fluid.dt = 0.1;
  double v = 1.0;
  fluid.v[0] = 1.0;
  fluid.a = fluid.free_acceleration();
  gc.activate_prescribed(Vector::Constant(1, fluid.v[0]), Vector::Zero(1), Vector::Constant(1, v));
  v += 1e-6; // something is wrong
  for (int k = 0; k < steps; ++k)
  {
    v += fluid.dt * gc.state().f[Side::solid][0] / mass;
    gc.advance_prescribed(fluid.dt, fluid, Vector::Constant(1, v));
  }
  return std::abs(v - 1.0) / 1e-6;
}

} // namespace

TEST_CASE("the added mass ratio is the fluid's interface mass over the solid's", "[coupler][unit]")
{
  Bar fluid(20, 1.0, 3.0, 1.0, true), solid(10, 1.0, 5.0, 1.0, true);
  GravouilCombescure gc(glue(fluid, solid), 1);
  CHECK(gc.added_mass_ratio() == Approx(fluid.interface_mass() / solid.interface_mass()).epsilon(1e-12));
}

// The error e of the velocity starts at 1 and obeys e ← e + d, d ← −q d: it tends to 1/(1 + q) for q < 1, and
// its n-th change is qⁿ for q > 1.
TEST_CASE("staggering is stable below an added mass ratio of one and grows above", "[coupler][unit]")
{
  CHECK(growth(0.05, 200) == Approx(1.0 / 1.05).epsilon(1e-6));
  CHECK(growth(0.5, 200) == Approx(1.0 / 1.5).epsilon(1e-6));
  CHECK(growth(0.9, 400) == Approx(1.0 / 1.9).epsilon(1e-6));
  CHECK(growth(1.1, 200) > 1e7);
  CHECK(growth(2.0, 50) > 1e12);
}

TEST_CASE("the fluid follows the prescribed velocity, and both impulses are equal but for the last half step",
          "[coupler][unit]")
{
  Bar fluid(10, 1.0, 1.0, 1.0, true), solid(1, 1.0, 1.0, 0.0, false);
  GravouilCombescure gc(glue(fluid, solid), 1);
  fluid.dt = 0.5 * fluid.critical_step();
  fluid.a = fluid.free_acceleration();
  gc.activate_prescribed(Vector::Zero(1), Vector::Zero(1), Vector::Zero(1));
  double on_solid = 0.0, on_fluid = 0.0, before = 0.0;
  for (int k = 1; k <= 50; ++k)
  {
    on_solid += fluid.dt * gc.state().f[Side::solid][0];
    const double v = std::sin(0.1 * k);
    gc.advance_prescribed(fluid.dt, fluid, Vector::Constant(1, v));
    CHECK(fluid.v[0] == Approx(v).epsilon(1e-12));
    on_fluid += fluid.dt * 0.5 * (before + fluid.last_link_force);
    before = fluid.last_link_force;
  }
  on_solid += fluid.dt * gc.state().f[Side::solid][0]; // what the next window would bring
  CHECK(on_solid == Approx(-on_fluid).epsilon(1e-12));
}
