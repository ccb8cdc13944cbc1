// Boundaries of the fluid: impedance, inlets and outlets, no-slip, corners, viscosity between walls.
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/run.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>

#include <cmath>
#include <string>

using namespace undine;
using namespace undine::fluid;
using undine::test::hydraulic;
using undine::test::tank;

// A pulse of velocity falls apart into two waves that run to both ends. Truth: an end of the fluid's own
// impedance takes in all of a normal wave; a rigid end gives all of it back. Left over is what central
// differences disperse: less than 2 % of the amplitude, 4e-4 of the energy, at sixteen nodes per width of the
// pulse.
TEST_CASE("waves leave through an impedance boundary", "[fluid][verification]")
{
  const auto energy_left = [](WallKind ends)
  {
    FluidConfig config = undine::test::box_config<2>(0.01);
    config.size = {1.0, 0.06, 0.0};
    config.walls = {{"bottom"}, {"top"}, {"left", ends}, {"right", ends}};
    for (const char* v : {"0.1*exp(-((x-0.5)/0.08)^2)", "0"})
      config.initial_velocity.emplace_back(v, "test");
    Fluid<2> fluid(config);
    const double before = fluid.energy().kinetic, c = config.tait.sound_speed(1000.0);
    run_alone<2>(fluid, {.t_end = 1.0 / c}, 0.0, [](double, const Fluid<2>&, bool) {});
    const FluidEnergy e = fluid.energy();
    CHECK(e.kinetic + e.internal - e.openings ==
          Approx(before).epsilon(2e-3)); // what is gone is in the ledger
    return (e.kinetic + e.internal) / before;
  };
  const double open = energy_left(WallKind::impedance), closed = energy_left(WallKind::slip);
  CAPTURE(open, closed);
  CHECK(open < 4e-4);
  CHECK(closed == Approx(1.0).epsilon(2e-3));
}

// Truth: ρ U d t enters to within one row (the last is due at the end itself) and round-off; everything is
// accounted for to round-off; a free stream stays uniform.
TEST_CASE("an inlet lets in what it should, an outlet takes it out", "[fluid][unit]")
{
  FluidConfig config = hydraulic(0.02, 20.0);
  config.shape = Shape::none;
  config.inlets.push_back({.name = "inlet", .a = {0.0, 0.2, 0.0}, .b = {0.0, 0.0, 0.0}, .speed = {}});
  config.inlets[0].speed.emplace_back("2.0", "test");
  config.outlets.push_back({.lower = {0.5, -1.0, 0.0}, .upper = {2.0, 2.0, 0.0}});
  Fluid<2> fluid(config);
  const double mass = fluid.mass();
  run_alone<2>(fluid, {.t_end = 0.6}, 0.0, [](double, const Fluid<2>&, bool) {});
  const FluidMass m = fluid.mass_by_state();
  const double row = 1000.0 * 0.2 * 0.02;
  CAPTURE(m.inflow, m.outflow, m.meshed, mass);
  CHECK(m.inflow == Approx(1000.0 * 0.2 * 2.0 * 0.6).margin(row * (1.0 + 1e-12)));
  CHECK(m.outflow > 0.0);
  CHECK(std::abs(fluid.mass() - mass) < 1e-11 * m.inflow);
  CHECK(m.meshed == Approx(1000.0 * 0.2 * (0.5 + 0.06)).margin(3.0 * row));
  double uneven = 0.0; // c δρ/ρ with what remeshes do to densities, δρ/ρ below 1e-4
  for (const auto& v : fluid.nodes().v)
    uneven = std::max(uneven, norm(v - Vec<2>{{2.0, 0.0}}));
  CHECK(uneven < 2e-3);
}

// The same in space, through a square. A stream that nothing takes out stays uniform to round-off. An outlet
// drops whole tetrahedra and leaves a rough end, whose sound runs up the stream: 1 % of its speed.
TEST_CASE("an inlet in space lets in what it should, an outlet takes it out", "[fluid][unit]")
{
  for (const bool outlet : {false, true})
  {
    FluidConfig config = undine::test::box_config<3>(0.05);
    config.tait.B = 1000.0 * 20.0 * 20.0 / 7.0;
    config.terms.bulk_linear = 0.05;
    config.terms.residual = 0.1;
    config.feedback_time = 100.0;
    config.inertia_floor = 0.1;
    config.remesh.shape.gap = 0.2;
    config.shape = Shape::none;
    config.inlets.push_back( // (b − a) × (c − a) is along x
        {.name = "inlet", .a = {0.0, 0.0, 0.0}, .b = {0.0, 0.2, 0.0}, .c = {0.0, 0.0, 0.2}, .speed = {}});
    config.inlets[0].speed.emplace_back("2.0", "test");
    if (outlet)
      config.outlets.push_back({.lower = {0.5, -1.0, -1.0}, .upper = {2.0, 2.0, 2.0}});
    Fluid<3> fluid(config);
    const double mass = fluid.mass(), A = 0.2 * 0.2, t = 0.51, row = 1000.0 * A * 0.05;
    CHECK(mass == Approx(3.0 * row).epsilon(1e-12));
    run_alone<3>(fluid, {.t_end = t}, 0.0, [](double, const Fluid<3>&, bool) {});
    const FluidMass m = fluid.mass_by_state();
    CAPTURE(m.inflow, m.outflow, m.meshed, mass, fluid.remeshes());
    CHECK(m.inflow == Approx(1000.0 * A * 2.0 * t).margin(row));
    CHECK((m.outflow > 0.0) == outlet);
    CHECK(std::abs(fluid.mass() - mass) < 1e-11 * m.inflow);
    if (outlet)
      CHECK(m.meshed == Approx(1000.0 * A * (0.5 + 0.15)).margin(3.0 * row));
    double uneven = 0.0;
    for (const auto& v : fluid.nodes().v)
      uneven = std::max(uneven, norm(v - Vec<3>{{2.0, 0.0, 0.0}}));
    CHECK(uneven < (outlet ? 0.1 : 1e-9));
  }
}

// The mesh of tests/common/data: a rectangle of 2 m × 1 m, meshed clockwise, with named sides; a block in
// space.
TEST_CASE("the boundary groups of a Gmsh mesh are walls of their names", "[fluid][unit]")
{
  const std::string plane = std::string(UNDINE_TEST_DATA) + "/plane_41.msh",
                    space = std::string(UNDINE_TEST_DATA) + "/space_41.msh";
  std::vector<std::string> names;
  for (const auto& g : walls_of_mesh(plane, 2, "", true))
    names.push_back(g.name);
  CHECK(names == std::vector<std::string>{"77", "bottom", "outside of the wall", "wet"});
  const auto room = walls_of_mesh(plane, 2, "bottom", true),
             obstacle = walls_of_mesh(plane, 2, "bottom", false);
  REQUIRE(room.size() == 1);
  CHECK(room[0].facets.size() == 4); // 2 m of spacing 0.5 m
  CHECK_FALSE(room[0].closed);
  Walls<2> in({room[0]}, 0.5, 0.0), around({obstacle[0]}, 0.5, 0.0);
  for (const auto& piece : in.pieces())
    CHECK(norm(piece.n - Vec<2>{{0.0, 1.0}}) < 1e-12);
  for (const auto& piece : around.pieces())
    CHECK(norm(piece.n - Vec<2>{{0.0, -1.0}}) < 1e-12);
  std::vector<Vec<2>> x{{{0.5, 0.01}}}, v{{{3.0, -5.0}}}, a(1);
  in.find_candidates(x, 0, 1, 0.2);
  in.contact(0.01, x, v, std::vector<double>{1.0}, a, 0.01);
  CHECK((v[0] == Vec<2>{{3.0, -1.0}})); // ends the step on the floor, where two facets meet

  const auto front = walls_of_mesh(space, 3, "front", true);
  Walls<3> wall(front, 0.5, 0.0);
  for (const auto& piece : wall.pieces()) // the face z = 1 of the block: into the room, one face
  {
    CHECK(norm(piece.n - Vec<3>{{0.0, 0.0, -1.0}}) < 1e-9);
    CHECK(piece.face == 0);
  }
  CHECK_THROWS_WITH(walls_of_mesh(plane, 2, "botom", true), Catch::Contains("Groups there: 77 bottom"));
}

// Truth: water at rest in a tank that comes from a mesh is the water at rest in a tank of points.
TEST_CASE("a tank out of a mesh holds the water that one of points holds", "[fluid][unit]")
{
  const auto after = [](std::vector<WallGeometry> walls)
  {
    FluidConfig config = hydraulic(0.125, 30.0);
    config.size = {2.0, 0.75, 0.0};
    config.gravity = {0.0, -9.81, 0.0};
    config.initial_pressure = InitialPressure::hydrostatic;
    config.contact_walls = std::move(walls);
    Fluid<2> fluid(config);
    run_alone<2>(fluid, {.t_end = 0.3}, 0.0, [](double, const Fluid<2>&, bool) {});
    double fastest = 0.0, lowest = 1.0;
    for (std::size_t n = 0; n < fluid.nodes().x.size(); ++n)
    {
      fastest = std::max(fastest, norm(fluid.nodes().v[n]));
      lowest = std::min(lowest, fluid.nodes().x[n][1]);
    }
    CHECK(lowest > -1e-12);
    return fastest;
  };
  const std::string plane = std::string(UNDINE_TEST_DATA) + "/plane_41.msh";
  WallGeometry left; // the mesh has no name for it
  left.name = "left";
  left.points = {{0.0, 2.0, 0.0}, {0.0, 0.0, 0.0}};
  auto meshed = walls_of_mesh(plane, 2, "bottom", true);
  meshed.push_back(walls_of_mesh(plane, 2, "wet", true)[0]);
  meshed.push_back(left);
  const double with_mesh = after(meshed), with_points = after({undine::test::tank(2.0)});
  CAPTURE(with_mesh, with_points);
  CHECK(with_mesh < 2.0 * with_points + 1e-6);
}

// Truth: the momentum of a plane jet, ρ U² d, and the pressure of its stagnation point, ½ ρ U².
TEST_CASE("a jet pushes a wall with its momentum", "[fluid][verification]")
{
  const double U = 2.0, d = 0.1;
  FluidConfig config = hydraulic(d / 8.0, 40.0);
  config.shape = Shape::none;
  config.inlets.push_back({.name = "nozzle", .a = {0.05, 0.25, 0.0}, .b = {-0.05, 0.25, 0.0}, .speed = {}});
  config.inlets[0].speed.emplace_back("2.0", "test");
  config.outlets = {{{-9.0, -1.0, 0.0}, {-0.3, 2.0, 0.0}}, {{0.3, -1.0, 0.0}, {9.0, 2.0, 0.0}}};
  WallGeometry plate;
  plate.name = "plate";
  plate.plane = true;
  plate.points = {{0.0, 0.0, 0.0}};
  plate.normal = {0.0, 1.0, 0.0};
  config.contact_walls = {plate};
  Fluid<2> fluid(config);
  double impulse = 0.0;
  run_alone<2>(fluid, {.t_end = 0.6}, 0.0,
               [&](double t, const Fluid<2>& f, bool)
               {
                 if (t <= 0.4)
                   impulse = f.walls().impulse()[0][1];
               });
  const double force = -(fluid.walls().impulse()[0][1] - impulse) / 0.2;
  CAPTURE(force);
  CHECK(force == Approx(1000.0 * U * U * d).epsilon(0.03)); // 0.8 % at 16 nodes over the jet
}

namespace
{

/// Relative L2 error of the velocity in a unit box whose four walls are of one kind, nodes 1/n apart, at t.
/// @param exact velocity at x and t
template <class Exact>
double velocity_error(FluidConfig config, WallKind kind, const std::vector<std::string>& v0, double t,
                      Exact&& exact)
{
  config.walls = {{"left", kind}, {"right", kind}, {"bottom", kind}, {"top", kind}};
  for (const auto& v : v0)
    config.initial_velocity.emplace_back(v, "test");
  Fluid<2> fluid(config);
  run_alone<2>(fluid, {.t_end = t}, 0.0, [](double, const Fluid<2>&, bool) {});
  double error = 0.0, scale = 0.0;
  const auto& nodes = fluid.nodes();
  for (std::size_t i = 0; i < nodes.x.size(); ++i)
  {
    const Vec<2> v = exact(nodes.x[i]);
    error += nodes.V[i] * norm_squared(nodes.v[i] - v);
    scale += nodes.V[i] * norm_squared(v);
  }
  return std::sqrt(error / scale);
}

} // namespace

// Truth: Taylor's vortices (sin πx cos πy, −cos πx sin πy) between free-slip walls decay as exp(−2 ν π² t);
// slow enough (U/c = 2e-3) that compressibility, O(M²), is no part of the error. Linear triangles: order 2.
TEST_CASE("viscous vortices decay at the rate of theory, with order 2", "[fluid][verification]")
{
  const double pi = std::acos(-1.0), U = 0.02, t = 0.4;
  const auto error = [&](int n)
  {
    FluidConfig config = hydraulic(1.0 / n, 10.0);
    config.terms.mu = 50.0;
    const double u = U * std::exp(-2.0 * 0.05 * pi * pi * t);
    return velocity_error(config, WallKind::slip,
                          {"0.02*sin(3.14159265358979*x)*cos(3.14159265358979*y)",
                           "-0.02*cos(3.14159265358979*x)*sin(3.14159265358979*y)"},
                          t,
                          [&](const Vec<2>& x)
                          {
                            return Vec<2>{{u * std::sin(pi * x[0]) * std::cos(pi * x[1]),
                                           -u * std::cos(pi * x[0]) * std::sin(pi * x[1])}};
                          });
  };
  const double coarse = error(8), middle = error(16), fine = error(32);
  CAPTURE(coarse, middle, fine);
  CHECK(std::log2(coarse / middle) > 1.8); // seen 5.96e-3, 1.40e-3, 3.56e-4: 2.09, 1.97
  CHECK(std::log2(middle / fine) > 1.8);
  CHECK(fine < 1e-3);
}

// Truth by construction: the body force that keeps the vortices u = sin² πx sin 2πy, v = −sin 2πx sin² πy,
// which rest on all four no-slip walls, steady without pressure at Re = 1/ν = 20. The nodes turn with the
// flow and are triangulated again all the time; u/c = 1/30.
TEST_CASE("vortices between no-slip walls are held by their force, with order 2", "[fluid][verification]")
{
  const double pi = std::acos(-1.0);
  const auto error = [&](int n)
  {
    FluidConfig config = hydraulic(1.0 / n, 30.0);
    config.terms.mu = 50.0;
    config.body_force.emplace_back(
        "_pi*sin(_pi*x)^2*sin(2*_pi*x)*(sin(2*_pi*y)^2-2*sin(_pi*y)^2*cos(2*_pi*y))"
        "-0.05*(2*_pi^2*cos(2*_pi*x)-4*_pi^2*sin(_pi*x)^2)*sin(2*_pi*y)",
        "test");
    config.body_force.emplace_back(
        "_pi*sin(_pi*y)^2*sin(2*_pi*y)*(sin(2*_pi*x)^2-2*sin(_pi*x)^2*cos(2*_pi*x))"
        "+0.05*(2*_pi^2*cos(2*_pi*y)-4*_pi^2*sin(_pi*y)^2)*sin(2*_pi*x)",
        "test");
    return velocity_error(
        config, WallKind::no_slip, {"sin(_pi*x)^2*sin(2*_pi*y)", "-sin(2*_pi*x)*sin(_pi*y)^2"}, 1.0,
        [&](const Vec<2>& x)
        {
          const double sx = std::sin(pi * x[0]), sy = std::sin(pi * x[1]);
          return Vec<2>{{sx * sx * std::sin(2.0 * pi * x[1]), -std::sin(2.0 * pi * x[0]) * sy * sy}};
        });
  };
  const double coarse = error(8), middle = error(16), fine = error(32);
  CAPTURE(coarse, middle, fine);
  CHECK(std::log2(coarse / middle) > 1.8); // seen 0.107, 0.0201, 0.0041: 2.4, 2.3
  CHECK(std::log2(middle / fine) > 1.8);
  CHECK(fine < 0.01);
}

// A node pressed onto a moving no-slip wall goes with it; one that is not pressed does not.
TEST_CASE("a no-slip wall takes the node along that touches it", "[fluid][unit]")
{
  WallGeometry floor;
  floor.name = "floor";
  floor.points = {{0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}};
  floor.no_slip = true;
  for (const char* d : {"0.5*t", "0"})
    floor.motion.displacement.emplace_back(d, "test");
  Walls<2> walls({floor}, 0.1, 0.0);
  std::vector<Vec<2>> x{{{0.5, 0.0}}, {{0.6, 0.02}}}, v{{{3.0, -1.0}}, {{3.0, -1.0}}}, a(2);
  const std::vector<double> m{1.0, 1.0};
  walls.find_candidates(x, 0, static_cast<index_t>(x.size()), 0.2);
  walls.move_to(0.01);
  walls.contact(0.01, x, v, m, a, 0.01);
  CHECK(v[0][0] == Approx(0.5).epsilon(1e-12));
  CHECK(v[0][1] == Approx(0.0).margin(1e-12));
  CHECK((v[1] == Vec<2>{{3.0, -1.0}}));
}

// A wall of slope 0.75 comes down on a node of a plane of symmetry: the node yields downwards only and ends
// on the wall; the wall feels the force J along its normal whose part along the plane is m Δv, the plane the
// rest.
TEST_CASE("a node of a plane of symmetry stays in it when a wall comes", "[fluid][unit]")
{
  WallGeometry wedge;
  wedge.name = "wedge";
  wedge.points = {{0.4, 0.3, 0.0}, {0.0, 0.0, 0.0}}; // the fluid below
  for (const char* d : {"0", "-t"})
    wedge.motion.displacement.emplace_back(d, "test");
  Walls<2> walls({wedge}, 0.1, 0.0);
  const std::vector<Vec<2>> x{{{0.0, 0.0}}};
  std::vector<Vec<2>> v{{{0.0, 0.0}}}, a(1);
  walls.find_candidates(x, 0, 1, 0.2);
  walls.move_to(0.01);
  walls.contact(0.01, x, v, std::vector<double>{2.0}, a, 0.01, [](Vec<2>& w, index_t) { w[0] = 0.0; });
  CHECK(v[0][0] == 0.0);
  CHECK(v[0][1] == Approx(-1.0));
  const Vec<2> J = walls.impulse()[0];
  CHECK(J[1] == Approx(2.0));
  CHECK(J[0] == Approx(-2.0 * 0.75));
}

// Convex corners: a node on one face is not drawn to the other; a concave corner between two walls of
// different names holds.
TEST_CASE("nodes pass convex corners and stop in corners that two walls make", "[fluid][unit]")
{
  WallGeometry obstacle;
  obstacle.name = "obstacle";
  obstacle.closed = true;
  obstacle.points = {{0.4, 0.0, 0.0}, {0.4, 0.2, 0.0}, {0.6, 0.2, 0.0}, {0.6, 0.0, 0.0}}; // clockwise
  WallGeometry floor;
  floor.name = "floor";
  floor.points = {{0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}};
  WallGeometry end;
  end.name = "end";
  end.points = {{1.0, 0.0, 0.0}, {1.0, 1.0, 0.0}};
  Walls<2> walls({obstacle, floor, end}, 0.1, 0.0);
  std::vector<Vec<2>> x{{{0.59, 0.2}}, {{0.99, 0.01}}, {{0.61, 0.21}}},
      v{{{0.5, -1.0}}, {{5.0, -5.0}}, {{-0.5, -1.5}}}, a(3);
  const std::vector<double> m{1.0, 1.0, 1.0};
  walls.find_candidates(x, 0, static_cast<index_t>(x.size()), 0.2);
  walls.contact(0.01, x, v, m, a, 0.01);
  CHECK(v[0][0] == 0.5); // slides on the top, one hundredth of a metre from the corner
  CHECK(v[0][1] == Approx(0.0).margin(1e-12));
  CHECK(x[1][0] + 0.01 * v[1][0] == Approx(1.0));
  CHECK(x[1][1] + 0.01 * v[1][1] == Approx(0.0).margin(1e-12));
  const Vec<2> end_2 = x[2] + 0.01 * v[2];
  CHECK((end_2[0] >= 0.6 - 1e-12 || end_2[1] >= 0.2 - 1e-12));
}

TEST_CASE("nodes stay in a box in space and out of one", "[fluid][unit]")
{
  WallGeometry tank, block;
  tank.name = "tank";
  tank.box = true;
  tank.points = {{0.0, 0.0, 0.0}, {1.0, 1.0, 1.0}};
  block = tank;
  block.name = "block";
  block.points = {{0.4, 0.0, 0.4}, {0.6, 0.3, 0.6}};
  block.fluid_inside = false;
  Walls<3> walls({tank, block}, 0.1, 0.0);
  std::vector<Vec<3>> x{{{0.01, 0.01, 0.01}}, {{0.5, 0.305, 0.5}}, {{0.395, 0.1, 0.5}}, {{0.98, 0.5, 0.3}}},
      v{{{-5.0, -5.0, -5.0}}, {{1.0, -2.0, 0.5}}, {{3.0, 0.2, 0.0}}, {{4.0, 1.0, 0.0}}}, a(4);
  const std::vector<double> m(4, 1.0);
  walls.find_candidates(x, 0, static_cast<index_t>(x.size()), 0.2);
  walls.contact(0.01, x, v, m, a, 0.01);
  for (int i = 0; i < 3; ++i)
    CHECK(x[0][i] + 0.01 * v[0][i] == Approx(0.0).margin(1e-12));
  CHECK(x[1][1] + 0.01 * v[1][1] == Approx(0.3));
  CHECK(v[1][0] == 1.0);
  CHECK(x[2][0] + 0.01 * v[2][0] == Approx(0.4));
  CHECK(x[3][0] + 0.01 * v[3][0] == Approx(1.0));
}
