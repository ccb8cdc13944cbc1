// A fluid on several ranks has the bits of the fluid on one. Run by mpirun; rank 0 also runs alone.
#include "tests/fluid_pfem/same_bits.hpp"

using namespace undine;
using namespace undine::fluid;
using namespace undine::test;

namespace
{

std::int64_t steps_in_sweeps = 0; ///< of this rank, of advance_by_four

/// Four steps as run_alone makes them: alone one by one, ranks in one sweep where they can.
bool advance_by_four(Fluid<2>& fluid, std::int64_t step, const StepLadder& ladder, double& dt)
{
  if (step % 4 != 0)
    return false;
  const bool remesh = look(fluid, step, ladder, dt);
  if (fluid.ranks().alone())
    for (int k = 0; k < 4; ++k)
    {
      fluid.predict(dt);
      fluid.solve_free_motion(dt);
    }
  else
  {
    const int together = fluid.in_one_sweep(4);
    steps_in_sweeps += together > 1 ? together : 0;
    fluid.advance(dt, 4);
  }
  return remesh;
}

} // namespace

TEST_CASE("a dam break has the same bits on any number of ranks", "[ranks]")
{
  check_same_bits<2>(test::dam_break_config(0.146 / 24.0), steps_wanted(400), 5);
}

// Truth: the bits of single steps. Nodes of other ranks that a rank takes into a sweep are no more than a
// tenth of its own: with three ranks those in the middle have room for three steps.
TEST_CASE("several steps in one sweep on each rank have the same bits", "[ranks]")
{
  FluidConfig config = test::dam_break_config(0.146 / 24.0);
  config.size = {0.06, 4.8};
  config.remesh.every = 20;
  config.remesh.only_if_moved = false;
  const auto column = [&]
  {
    steps_in_sweeps = 0;
    check_same_bits<2>(config, steps_wanted(200), 5, advance_by_four);
    const int size = ranks_of(MPI_COMM_WORLD, 60.0).size();
    if (size == 2 || size == 3)
      CHECK(steps_in_sweeps >= 100);
  };
  SECTION("a column that collapses") { column(); }
  SECTION("of threads that share it")
  {
    config.threads = 2;
    column();
  }
  SECTION("with viscosity and without stabilisers")
  {
    config.terms = {.mu = 1e-3};
    column();
  }
  SECTION("in a tank that rolls") // by less than a spacing in a step: so far candidates reach
  {
    config.contact_walls.front().motion.angle = Expression("0.002*sin(300*t)", "roll");
    column();
  }
  SECTION("in a ramp of gravity, without tension")
  {
    config.gravity_ramp = 0.01;
    config.surface_tension_allowed = false;
    column();
  }
}

TEST_CASE("a drop that falls into a pool, leaving the part of its rank, has the same bits", "[ranks]")
{
  FluidConfig config = drop_over_pool(1.0 / 40.0);
  config.terms.mu = 1.0;
  config.terms.bulk_quadratic = 1.0;
  config.surface_tension_allowed = false;
  check_same_bits<2>(config, steps_wanted(400), 5);
}

// The front meets the obstacle at once; nodes behind its faces are taken out, others fly and are deleted.
TEST_CASE("a spacing that varies, an obstacle and deleted nodes leave the same bits", "[ranks]")
{
  FluidConfig config = test::dam_break_config(0.146 / 14.0);
  WallGeometry obstacle;
  obstacle.name = "obstacle";
  obstacle.points = {{0.15, 0.0, 0.0}, {0.15, 0.04, 0.0}, {0.2, 0.04, 0.0}, {0.2, 0.0, 0.0}};
  obstacle.closed = true;
  config.contact_walls.push_back(obstacle);
  SizeZone zone;
  zone.lower = {0.1, 0.0, 0.0};
  zone.upper = {0.2, 0.1, 0.0};
  config.spacing = {zone};
  config.remesh.delete_isolated_after = 2;
  check_same_bits<2>(config, steps_wanted(300), 5);
}

TEST_CASE("a drop in space has the same bits on any number of ranks", "[ranks]")
{
  check_same_bits<3>(drop_in_space(1.0 / 11.0), steps_wanted(60), 1);
}

TEST_CASE("ranks and threads together have the same bits, with a force that varies", "[ranks]")
{
  FluidConfig config = test::dam_break_config(0.146 / 24.0);
  config.threads = 2;
  config.body_force = {Expression("3*sin(20*t)", ""), Expression("y", "")};
  check_same_bits<2>(config, 40, 0);
}

TEST_CASE("a periodic space has the same bits", "[ranks]")
{
  FluidConfig config = test::hydraulic(1.0 / 36.0, 30.0);
  config.size = {1.0, 1.0, 0.0};
  config.period = {1.0, 1.0, 0.0};
  config.initial_velocity = {Expression("sin(2*pi*y)", ""), Expression("-sin(2*pi*x)", "")};
  check_same_bits<2>(config, steps_wanted(200), 1);
}

// Water that moves through a periodic channel on a floor: the ends of the channel are on different ranks, and
// what is beyond an end belongs to the halo of the other.
TEST_CASE("a periodic channel whose ends are on different ranks has the same bits", "[ranks]")
{
  FluidConfig config = test::hydraulic(1.0 / 40.0, 30.0);
  config.size = {4.0, 0.3, 0.0};
  config.period = {4.0, 0.0, 0.0};
  config.gravity = {0.0, -9.81, 0.0};
  config.initial_velocity = {Expression("1.5+0.5*sin(pi*x)", ""), Expression("0.5*cos(pi*x)", "")};
  WallGeometry floor;
  floor.name = "floor";
  floor.plane = true;
  floor.points = {{0.0, 0.0, 0.0}};
  floor.normal = {0.0, 1.0, 0.0};
  config.contact_walls = {floor};
  config.remesh.only_if_moved = false;
  check_same_bits<2>(config, steps_wanted(200), 5);
}

TEST_CASE("a periodic space that is larger than what a rank sees of it, in the plane and in space", "[ranks]")
{
  FluidConfig config = test::hydraulic(1.0 / 72.0, 30.0);
  config.size = {1.0, 1.0, 0.0};
  config.period = {1.0, 1.0, 0.0};
  config.initial_velocity = {Expression("2*sin(2*pi*y)", ""), Expression("-sin(2*pi*x)", "")};
  config.remesh.only_if_moved = false;
  check_same_bits<2>(config, steps_wanted(60), 2);
  FluidConfig rod = test::hydraulic(0.1, 20.0);
  rod.dim = 3;
  rod.size = {3.0, 0.3, 0.3};
  rod.period = {3.0, 0.0, 0.0};
  rod.initial_velocity = {Expression("1+0.2*sin(2*pi*x/3)", ""), Expression("0", ""), Expression("0", "")};
  rod.remesh.only_if_moved = false;
  check_same_bits<3>(rod, 24, 1);
}

// New nodes have their numbers from one count, whoever has the opening; the ledger of openings has the order
// of one rank.
TEST_CASE("inlets, outlets and impedance boundaries have the same bits on any number of ranks", "[ranks]")
{
  SECTION("a jet into an outlet, over a plate that it meets")
  {
    FluidConfig config = test::hydraulic(0.02, 20.0);
    config.gravity = {0.0, -9.81, 0.0};
    config.shape = Shape::none;
    config.inlets.push_back({.name = "inlet", .a = {0.0, 0.3, 0.0}, .b = {0.0, 0.0, 0.0}, .speed = {}});
    config.inlets[0].speed.emplace_back("2.0+sin(10*t)", "test");
    config.inlets.push_back({.name = "other", .a = {1.5, 0.0, 0.0}, .b = {1.5, 0.2, 0.0}, .speed = {}});
    config.inlets[1].speed.emplace_back("1.5", "test");
    config.outlets.push_back({.lower = {0.5, -2.0, 0.0}, .upper = {1.0, 2.0, 0.0}});
    check_same_bits<2>(config, steps_wanted(1000), 10);
    for (const Uneven& uneven : uneven_cuts(ranks_of(MPI_COMM_WORLD, 60.0).size()))
      check_same_bits<2>(config, steps_wanted(300), 3, advance<2>, uneven.cut);
  }
  SECTION("a tank with a hole")
  {
    FluidConfig config = test::dam_break_config(0.146 / 24.0);
    config.outlets.push_back({.lower = {0.2, 0.0, 0.0}, .upper = {0.3, 0.1, 0.0}});
    config.threads = 2;
    check_same_bits<2>(config, steps_wanted(400), 5);
  }
  SECTION("in space")
  {
    FluidConfig config = test::hydraulic(0.1, 20.0);
    config.dim = 3;
    config.shape = Shape::none;
    config.inlets.push_back(
        {.name = "inlet", .a = {}, .b = {0.5, 0.0, 0.0}, .c = {0.0, 0.4, 0.0}, .speed = {}});
    config.inlets[0].speed.emplace_back("2.0", "test");
    config.outlets.push_back({.lower = {-1.0, -1.0, 0.5}, .upper = {2.0, 2.0, 2.0}});
    check_same_bits<3>(config, 120, 3);
  }
  SECTION("waves that leave through the ends of a tank under gravity, in plane and space")
  {
    const auto channel = [](FluidConfig config)
    {
      config.gravity = {0.0, -9.81, 0.0};
      config.initial_pressure = InitialPressure::hydrostatic;
      config.walls = {{"bottom"}, {"left", WallKind::impedance}, {"right", WallKind::impedance}};
      config.initial_velocity = {Expression("0.5*sin(3*x)", ""), Expression("0", "")};
      config.remesh.only_if_moved = false;
      return config;
    };
    FluidConfig config = channel(test::hydraulic(0.02, 20.0));
    config.size = {2.0, 0.4, 0.0};
    check_same_bits<2>(config, steps_wanted(100), 3);
    FluidConfig slab = test::hydraulic(0.1, 20.0);
    slab.dim = 3;
    slab.size = {1.2, 0.3, 0.8};
    slab = channel(slab);
    slab.initial_velocity.emplace_back("0", "");
    check_same_bits<3>(slab, 40, 1);
  }
}
