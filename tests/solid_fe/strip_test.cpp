// The beam of a case: strips of quadrilaterals, supports, loads on faces, wet faces, balances, frequencies.
#include "common/error.hpp"
#include "solid_fe/modes.hpp"
#include "solid_fe/solid.hpp"
#include "solid_fe/strip.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

#include <numbers>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

SolidConfig wall_config(const std::vector<double>& line, double thickness, double element_size)
{
  auto config = soft_config(2, "linear");
  config.formulation = Formulation::beam;
  config.material.poisson_ratio = 0.0;
  config.geometry.line = line;
  config.geometry.thickness = thickness;
  config.geometry.element_size = element_size;
  return config;
}

Solid<2> wall(const SolidConfig& config) { return Solid<2>(config, make_mesh<2>(config)); }

/// The wet surface's whole M⁻¹ times f: blocks of the nodes and of the pairs.
std::vector<Vec<2>> times_inverse_mass(const link::SurfaceMesh& m, const std::vector<Vec<2>>& f)
{
  std::vector<Vec<2>> a(f.size());
  const auto block = [](const std::vector<double>& all, std::size_t k) {
    return Mat<2>{{all[4 * k], all[4 * k + 1], all[4 * k + 2], all[4 * k + 3]}};
  };
  for (std::size_t n = 0; n < f.size(); ++n)
    a[n] += block(m.inverse_mass, n) * f[n];
  for (std::size_t p = 0; 2 * p < m.coupled_nodes.size(); ++p)
  {
    const auto i = static_cast<std::size_t>(m.coupled_nodes[2 * p]);
    const auto j = static_cast<std::size_t>(m.coupled_nodes[2 * p + 1]);
    const auto W = block(m.coupled_inverse_mass, p);
    a[i] += W * f[j];
    a[j] += transpose(W) * f[i];
  }
  return a;
}

} // namespace

TEST_CASE("a wall about a line has the line's thickness, mass and faces", "[solid][unit]")
{
  const auto config = wall_config({0.0, 0.0, 1.0, 0.0, 1.0, 1.0}, 0.1, 0.25); // an elbow
  const auto mesh = make_mesh<2>(config);
  CHECK(mesh.blocks[0].size() == 8);
  CHECK(mesh.surfaces.at("left").size() == 8);
  CHECK(mesh.surfaces.at("start").size() == 1);
  for (const index_t n : mesh.surfaces.at("left").nodes) // left of the way: inside the elbow
    CHECK((mesh.x[static_cast<std::size_t>(n)][1] == Approx(0.05) ||
           mesh.x[static_cast<std::size_t>(n)][0] == Approx(0.95)));
  const auto strip = make_strip(mesh);
  REQUIRE(strip.beam.X.size() == 9);
  for (const double h : strip.beam.element_thickness)
    CHECK(h == Approx(0.1).epsilon(1e-14));
  const auto solid = wall(config);
  CHECK(solid.mass() == Approx(1000.0 * 0.1 * 2.0).epsilon(1e-14));
  CHECK(solid.beam()->mass() == Approx(solid.mass()).epsilon(1e-14));

  // Drawn as a box, or closed to a ring, it is a strip as well; two quadrilaterals across are not.
  CHECK(make_strip(box_mesh<2>({}, {{0.1, 1.0}}, {1, 6}, ElementType::quadrilateral4)).beam.elements.size() ==
        6);
  CHECK(make_strip(box_mesh<2>({}, {{0.1, 1.0}}, {1, 1}, ElementType::quadrilateral4)).beam.X[1][1] == 1.0);
  auto ring = polyline({0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0, 0.0}, 0.5);
  for (auto& n : ring.blocks[0].nodes)
    n = n == 8 ? 0 : n;
  ring.x.pop_back();
  const auto closed = make_strip(strip_about(ring, 0.1));
  CHECK(closed.beam.X.size() == 8);
  CHECK(closed.beam.elements.size() == 8);
  CHECK_THROWS_WITH(make_strip(box_mesh<2>({}, {{0.1, 1.0}}, {2, 6}, ElementType::quadrilateral4)),
                    Catch::Contains("more than one quadrilateral across"));
  CHECK_THROWS_WITH(make_strip(box_mesh<2>({}, {{0.1, 1.0}}, {1, 6}, ElementType::triangle3)),
                    Catch::Contains("a strip of quadrilaterals"));
}

// The beam of a case is the beam of beam_test.cpp, whose elastica is there: the load over the end arrives as
// a force at the line. Same arithmetic but for the sum of two halves.
TEST_CASE("a case's beam bends as the beam does", "[solid][unit]")
{
  auto config = wall_config({0.0, 0.0, 1.0, 0.0}, 0.02, 0.05);
  config.fix = {{"start", {}}};
  config.traction = {{.on = "end", .value = {0.0, -20.0}, .ramp = 0.0, .function = {}}};
  config.gravity = {0.0, -0.01};
  auto solid = wall(config);
  auto line = make_strip(make_mesh<2>(config)).beam;
  line.material = config.material;
  line.gravity = {{0.0, -0.01}};
  line.fixed.assign(line.X.size(), {false, false, false});
  line.fixed[0] = {true, true, true};
  Beam beam(line);
  beam.set_load(20, {{0.0, -20.0 * 0.02}});
  std::vector<Vec<2>> zero(21);
  beam.set_motion(zero, std::vector<double>(21), zero, std::vector<double>(21));
  const double dt = solid.critical_time_step();
  CHECK(dt == Approx(beam.critical_time_step()).epsilon(1e-14));
  const auto correction = [&] // Δt²/8 a·M a of the scheme, rotations included
  {
    double sum = 0.0;
    for (std::size_t k = 0; k < 21; ++k)
      sum += beam.mass(k) * norm_squared(beam.acceleration(k));
    return 0.125 * dt * dt * sum;
  };
  const double start = solid.energies().balance() - correction();
  double worst = 0.0, largest = 0.0;
  for (int k = 0; k < 3000; ++k)
  {
    solid.predict(dt);
    solid.solve_free_motion(dt);
    beam.predict(dt);
    beam.solve_free_motion(dt);
    worst = std::max(worst, std::abs(solid.energies().balance() - correction() - start));
    largest = std::max(largest, solid.energies().external);
  }
  CHECK(beam.u()[20][1] < -0.05);
  for (std::size_t k = 0; k < 21; ++k)
    CHECK(norm(solid.beam()->u()[k] - beam.u()[k]) < 1e-9);
  CHECK(worst < 1e-3 * largest); // second order in the step, large rotations
  // The ends of the tip's fibre are where the beam has its faces.
  for (const auto face : both_faces)
  {
    const auto n = static_cast<std::size_t>(solid.fibre_ends()[20][static_cast<std::size_t>(face)]);
    CHECK(norm(solid.nodes().X[n] + solid.nodes().u[n] - solid.beam()->face_position(face, 20)) < 1e-15);
  }
}

// Clamped-free, pinned-pinned and free-free: β L = 1.875104, π, 4.730041. Shear, rotary inertia (the added
// too) and the mesh take O((h/L)²) and O(1/n²): 1 %.
TEST_CASE("clamped, pinned and free ends ring as the textbook says", "[solid][unit]")
{
  const double h = 0.02;
  const auto frequency = [&](const std::vector<FixConfig>& fix, int mode)
  {
    auto config = wall_config({0.0, 0.0, 1.0, 0.0}, h, 0.025);
    config.fix = fix;
    return natural_frequencies(wall(config), mode + 1)[static_cast<std::size_t>(mode)];
  };
  const auto exact = [&](double beta)
  { return beta * beta * std::sqrt(1e6 * h * h / 12.0 / 1000.0) / (2.0 * std::numbers::pi); };
  CHECK(frequency({{"start", {}}}, 0) == Approx(exact(1.875104)).epsilon(0.01));
  CHECK(frequency({{"start", {"x", "y"}}, {"end", {"x", "y"}}}, 0) ==
        Approx(exact(std::numbers::pi)).epsilon(0.01));
  CHECK(frequency({}, 3) == Approx(exact(4.730041)).epsilon(0.01)); // after three rigid motions
}

// For any motion and any forces on both faces: the velocities change by what M⁻¹ of the message says, and the
// kinetic energy by the forces' power: f enters through the transpose of what makes the velocities.
TEST_CASE("what is done to the wet faces of a beam does its work on the beam", "[solid][unit]")
{
  auto config = wall_config({0.0, 0.0, 0.7, 0.0, 1.0, 0.4}, 0.08, 0.2);
  config.fix = {{"start", {"x", "y"}}};
  config.velocity = {{.on = "end", .value = {0.0, 0.3}, .components = {"y"}, .function = {}}};
  config.wet = {{"upper", "left"}, {"lower", "right"}};
  auto solid = wall(config);
  const double angle = 0.8; // turned as a whole and moving at random
  Random random(4);
  std::vector<Vec<2>> v0;
  for (std::size_t n = 0; n < solid.nodes().X.size(); ++n)
    v0.push_back(random.vector<2>(1.0));
  solid.set_motion([&](const Vec<2>& X) { return rotation<2>(angle) * X - X; },
                   [&](const Vec<2>& X)
                   {
                     std::size_t n = 0;
                     while (norm(solid.nodes().X[n] - X) > 0.0)
                       ++n;
                     return v0[n];
                   });
  CHECK(solid.energies().strain < 1e-26 * 1e6); // a rotation is free of stress
  for (std::size_t n = 0; n < solid.nodes().X.size(); ++n)
    CHECK(norm(solid.nodes().X[n] + solid.nodes().u[n] - rotation<2>(angle) * solid.nodes().X[n]) < 1e-15);

  const double dt = 0.5 * solid.critical_time_step();
  solid.predict(dt);
  solid.solve_free_motion(dt);
  const auto message = solid.wet_surface();
  const auto n_wet = static_cast<std::size_t>(message.n_nodes());
  REQUIRE(n_wet == solid.nodes().X.size()); // both faces are wet
  REQUIRE(message.coupled_nodes.size() == n_wet);
  std::vector<Vec<2>> f;
  std::vector<double> flat;
  for (std::size_t n = 0; n < n_wet; ++n)
  {
    f.push_back(random.vector<2>(500.0));
    flat.insert(flat.end(), f[n].c.begin(), f[n].c.end());
  }
  const auto before = solid.nodes().v;
  const double kinetic = solid.energies().kinetic;
  solid.correct_with_link(flat, dt);
  const auto expected = times_inverse_mass(message, f);
  double power = 0.0;
  for (std::size_t n = 0; n < n_wet; ++n)
  {
    const auto& after = solid.nodes().v[n];
    CHECK(norm(after - before[n] - (0.5 * dt) * expected[n]) < 1e-13 * norm(after));
    power += 0.25 * dt * dot(f[n], before[n] + after);
  }
  // Less what the support of the driven component takes up: its velocity is given.
  const auto k = solid.fibre_ends().size() - 1;
  for (const index_t n : solid.fibre_ends()[k])
    power -= 0.5 * dt * f[static_cast<std::size_t>(n)][1] * 0.3;
  CHECK(solid.energies().kinetic - kinetic == Approx(power).epsilon(1e-9));

  // An impulse moves it by M⁻¹ p too; then the acceleration holds the new link force.
  const auto free = solid.kinematics();
  solid.apply_activation({.impulse = flat, .link_force = flat});
  for (std::size_t n = 0; n < n_wet; ++n)
    CHECK(norm(solid.nodes().v[n] - Vec<2>{{free.v[2 * n], free.v[2 * n + 1]}} - expected[n]) <
          1e-12 * norm(solid.nodes().v[n]));
}

TEST_CASE("a free beam of a case keeps momentum and angular momentum, rotating far", "[solid][unit]")
{
  auto config = wall_config({0.0, 0.0, 1.0, 0.0}, 0.1, 0.1);
  config.wet = {{"upper", "left"}, {"lower", "right"}};
  auto solid = wall(config);
  solid.set_motion(zero_field<2>(), [](const Vec<2>& X) { return Vec<2>{{-1.5 * X[1], 1.5 * X[0] + 0.2}}; });
  solid.wet_surface();
  const auto p0 = solid.linear_momentum();
  const double L0 = solid.angular_momentum()[2], dt = solid.critical_time_step();
  CHECK(!solid.wet_surface_has_changed());
  int messages = 0;
  while (solid.time() < 2.0)
  {
    solid.predict(dt);
    solid.solve_free_motion(dt);
    if (solid.wet_surface_has_changed()) // the inverse masses turn with the wall
    {
      solid.wet_surface();
      ++messages;
    }
  }
  CHECK(solid.beam()->theta()[3] == Approx(3.0).epsilon(0.05));
  CHECK(messages > 100);
  CHECK(norm(solid.linear_momentum() - p0) < 1e-12 * norm(p0));
  CHECK(std::abs(solid.angular_momentum()[2] / L0 - 1.0) < 1e-12);
}

TEST_CASE("a beam bounces off a wall and a driven end moves as told", "[solid][unit]")
{
  auto config = wall_config({0.0, 0.1, 1.0, 0.1}, 0.05, 0.05);
  config.wall.push_back({.point = {0.0, 0.0}, .normal = {0.1, 1.0}, .friction = 0.2, .on = ""});
  auto solid = wall(config);
  solid.set_motion(zero_field<2>(), [](const Vec<2>&) { return Vec<2>{{0.0, -1.0}}; });
  const double E0 = solid.energies().kinetic, dt = 0.4 * solid.critical_time_step();
  double drift = 0.0;
  while (solid.time() < 0.4)
  {
    solid.predict(dt);
    solid.solve_free_motion(dt);
    drift = std::max(drift, std::abs(solid.energies().balance() / E0 - 1.0));
  }
  CHECK(solid.linear_momentum()[1] > 0.0);
  INFO("drift " << drift);
  CHECK(drift < 0.01);

  config.wall.clear();
  config.fix = {{"start", {"rotation"}}};
  config.velocity = {{.on = "start", .value = {}, .components = {}, .function = {"0", "0.2*sin(8*t)"}}};
  auto driven = wall(config);
  double scale = 0.0, worst = 0.0;
  const double dt_driven = driven.critical_time_step();
  while (driven.time() < 0.5)
  {
    driven.predict(dt_driven);
    driven.solve_free_motion(dt_driven);
    const auto e = driven.energies();
    scale = std::max(scale, e.kinetic);
    worst = std::max(worst, std::abs(e.balance()));
  }
  CHECK(driven.beam()->u()[0][1] == Approx(0.025 * (1.0 - std::cos(8.0 * driven.time()))).epsilon(1e-3));
  CHECK(worst < 0.01 * scale);
}

TEST_CASE("a beam says what it cannot be", "[solid][unit]")
{
  auto config = wall_config({0.0, 0.0, 1.0, 0.0}, 0.1, 0.1);
  config.material.law = "neo_hookean_ln";
  CHECK_THROWS_WITH(wall(config), Catch::Contains("linear in the strains of its middle line"));
  config.material.law = "svk";
  config.fix = {{"start", {"z"}}};
  CHECK_THROWS_WITH(wall(config), Catch::Contains("must be of x, y, rotation"));
  config.fix = {{"left", {"x"}}};
  config.plane = PlaneKind::axisymmetric;
  CHECK_THROWS_AS(wall(config), InputError);
}
