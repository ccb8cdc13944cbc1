// The step of the solid: motion, supports, link forces, balances, errors.
#include "common/error.hpp"
#include "solid_fe/solid.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

/// Δt²/8 a·M a over the nodes: what the discrete energy of the scheme subtracts from the kinetic energy.
template <int dim>
double kinetic_correction(const Solid<dim>& solid, double dt)
{
  double sum = 0.0;
  for (std::size_t n = 0; n < solid.nodes().X.size(); ++n)
    sum += solid.nodes().m[n] * norm_squared(solid.nodes().a[n]);
  return 0.125 * dt * dt * sum;
}

/// Turning about the centre (0.5, 0.375, 0.25) of the test box.
template <int dim>
std::function<Vec<dim>(const Vec<dim>&)> spin(double omega)
{
  return [omega](const Vec<dim>& X)
  {
    Vec<dim> v;
    v[0] = -omega * (X[1] - 0.375);
    v[1] = omega * (X[0] - 0.5);
    if constexpr (dim == 3)
    {
      v[1] -= 0.5 * omega * (X[2] - 0.25);
      v[2] = 0.5 * omega * (X[1] - 0.375);
    }
    return v;
  };
}

} // namespace

// No strain appears, so only the sums u + dt v count: 200 additions, 1e-16 each, relative to the way of 3 m.
TEMPLATE_TEST_CASE_SIG("free flight under gravity is exact", "[solid][unit]", ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
    for (const auto& law : law_names())
    {
      auto config = soft_config(dim, law);
      config.gravity = {0.0, -10.0};
      config.initial_velocity = {3.0, 4.0};
      config.gravity.resize(dim);
      config.initial_velocity.resize(dim);
      Solid<dim> solid(config, distorted_box<dim>(type));
      const double dt = 0.5 * solid.critical_time_step();
      const int steps = 200;
      for (int k = 0; k < steps; ++k)
      {
        solid.predict(dt);
        solid.solve_free_motion(dt);
      }
      const double t = solid.time();
      CHECK(t == steps * dt);
      for (std::size_t n = 0; n < solid.nodes().X.size(); ++n)
      {
        CHECK(std::abs(solid.nodes().u[n][0] - 3.0 * t) < 1e-12);
        CHECK(std::abs(solid.nodes().u[n][1] - (4.0 * t - 5.0 * t * t)) < 1e-12);
        CHECK(std::abs(solid.nodes().v[n][1] - (4.0 - 10.0 * t)) < 1e-11);
      }
      CHECK(std::abs(solid.energies().balance() - 0.5 * solid.mass() * 25.0) <
            1e-10 * solid.energies().kinetic);
    }
}

// Linear and angular momentum: τ is symmetric to the last bit and internal forces of an element sum to zero
// to round-off; random walk of 1e4 steps with 1e-16 each, worst case 1e-12. Energy: symplectic scheme, error
// c Δt² without trend.
TEMPLATE_TEST_CASE_SIG("a rotating block keeps its angular momentum and a bounded energy error of order Δt²",
                       "[solid][verification]", ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
    for (const auto& law : {"neo_hookean_ln", "neo_hookean_j", "svk"})
    {
      const auto run = [&](double fraction, int steps)
      {
        Solid<dim> solid(soft_config(dim, law), distorted_box<dim>(type, 3));
        solid.set_motion(zero_field<dim>(), spin<dim>(6.0));
        const double dt = fraction * solid.critical_time_step();
        const auto L0 = solid.angular_momentum();
        const auto p0 = solid.linear_momentum();
        const double E0 = solid.energies().balance();
        double first_half = 0.0, second_half = 0.0;
        for (int k = 0; k < steps; ++k)
        {
          solid.predict(dt);
          solid.solve_free_motion(dt);
          double& worst = 2 * k < steps ? first_half : second_half;
          worst = std::max(worst, std::abs(solid.energies().balance() - E0) / E0);
        }
        INFO(element_name(type) << " " << law << " angular momentum error "
                                << norm(solid.angular_momentum() - L0) / norm(L0));
        CHECK(norm(solid.angular_momentum() - L0) < 1e-12 * norm(L0));
        CHECK(norm(solid.linear_momentum() - p0) < 1e-12 * solid.mass() * 6.0);
        INFO("energy error " << first_half << " " << second_half);
        CHECK(second_half < 1.3 * first_half); // the beat of a few modes moves the maximum a little
        return std::max(first_half, second_half);
      };
      const double coarse = run(0.8, 10000);
      const double fine = run(0.4, 20000);
      INFO(element_name(type) << " " << law << " energy error " << coarse << " -> " << fine);
      CHECK(coarse < 0.02);
      CHECK(coarse / fine > 3.2);
      CHECK(coarse / fine < 4.8);
    }
}

TEMPLATE_TEST_CASE_SIG(
    "interface first and interior second give the same bits as one call, and the wet nodes are final early",
    "[solid][unit]", ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
  {
    auto config = soft_config(dim, "neo_hookean_ln");
    config.wet = {{"gamma", "top"}};
    config.fix = {{"bottom", {"y"}}};
    config.gravity = std::vector<double>(dim, -10.0);
    Solid<dim> whole(config, distorted_box<dim>(type)), split(config, distorted_box<dim>(type));
    whole.set_motion(zero_field<dim>(), spin<dim>(3.0));
    split.set_motion(zero_field<dim>(), spin<dim>(3.0));
    const double dt = whole.critical_time_step();
    for (int k = 0; k < 50; ++k)
    {
      whole.predict(dt);
      whole.solve_free_motion(dt);
      split.predict(dt);
      split.solve_free_motion_of_interface(dt);
      const auto early = split.interface_velocity();
      const std::vector<double> v_free(early.begin(), early.end());
      split.solve_free_motion_of_interior(dt);
      const auto late = split.interface_velocity();
      REQUIRE(std::equal(v_free.begin(), v_free.end(), late.begin(), late.end()));
      REQUIRE(whole.nodes().v == split.nodes().v);
      REQUIRE(whole.nodes().u == split.nodes().u);
    }
  }
}

// Only the order of summation differs: round-off, grown over 100 steps of a stable linear-like motion.
TEMPLATE_TEST_CASE_SIG("putting wet nodes first does not change the motion", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
  {
    auto config = soft_config(dim, "neo_hookean_ln");
    Solid<dim> plain(config, distorted_box<dim>(type));
    config.wet = {{"gamma", "right"}};
    Solid<dim> wet(config, distorted_box<dim>(type));
    plain.set_motion(zero_field<dim>(), spin<dim>(3.0));
    wet.set_motion(zero_field<dim>(), spin<dim>(3.0));
    const double dt = plain.critical_time_step();
    for (int k = 0; k < 100; ++k)
      for (auto* solid : {&plain, &wet})
      {
        solid->predict(dt);
        solid->solve_free_motion(dt);
      }
    double worst = 0.0;
    for (std::size_t n = 0; n < wet.nodes().X.size(); ++n)
      worst = std::max(
          worst, norm(wet.nodes().u[n] - plain.nodes().u[static_cast<std::size_t>(wet.given_number()[n])]));
    CHECK(worst < 1e-13);
  }
}

// The identity of energies (solid.hpp) is exact for a linear law and constant Δt: round-off of 300 steps. The
// link force is an arbitrary function of time, one side is driven, the load is a ramp, gravity acts: every
// term takes part.
TEMPLATE_TEST_CASE_SIG(
    "the discrete energy balance closes with loads, a driven side, link forces and an activation",
    "[solid][unit]", ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
  {
    auto config = soft_config(dim, "linear");
    config.gravity = std::vector<double>(dim, -7.0);
    config.fix = {{"bottom", {"y"}}};
    std::vector<double> pull(dim, 0.0), push(dim, 0.0);
    pull[0] = 0.3;
    push[0] = 2e3;
    push[1] = -3e3;
    config.velocity = {{.on = "left", .value = pull, .components = {"x"}}};
    config.wet = {{"gamma", "top"}, {"gamma", "left"}}; // wet nodes that are driven too
    Solid<dim> probe(config, distorted_box<dim>(type));
    const double dt = probe.critical_time_step();
    config.traction = {{.on = "right", .value = push, .ramp = 40.5 * dt}};
    Solid<dim> solid(config, distorted_box<dim>(type));

    const auto n = static_cast<std::size_t>(solid.n_wet_nodes()) * dim;
    Random random(23);
    std::vector<double> direction(n), f(n);
    for (auto& x : direction)
      x = random(100.0);

    link::Activation activation{.impulse = std::vector<double>(n), .link_force = std::vector<double>(n)};
    for (auto& x : activation.impulse)
      x = random(1.0);
    for (std::size_t k = 0; k < n; ++k)
      activation.link_force[k] = direction[k];
    solid.apply_activation(activation);

    const double E0 = solid.energies().balance() - kinetic_correction(solid, dt);
    double scale = 0.0, worst = 0.0, worst_plain = 0.0, worst_correction = 0.0;
    const double plain0 = solid.energies().balance(), correction0 = kinetic_correction(solid, dt);
    for (int step = 1; step <= 300; ++step)
    {
      solid.predict(dt);
      solid.solve_free_motion(dt);
      for (std::size_t k = 0; k < n; ++k)
        f[k] = direction[k] * std::cos(0.1 * step + static_cast<double>(k));
      solid.correct_with_link(f, dt);
      const auto e = solid.energies();
      scale = std::max({scale, e.kinetic, e.strain, std::abs(e.external), std::abs(e.interface)});
      worst = std::max(worst, std::abs(e.balance() - kinetic_correction(solid, dt) - E0));
      worst_plain = std::max(worst_plain, std::abs(e.balance() - plain0));
      worst_correction = std::max(worst_correction, std::abs(kinetic_correction(solid, dt) - correction0));
    }
    INFO(element_name(type) << " identity error " << worst / scale << ", plain balance "
                            << worst_plain / scale);
    CHECK(worst < 1e-12 * scale);
    CHECK(worst_plain <= worst_correction + 1e-12 * scale);
    CHECK(std::abs(solid.energies().interface) > 1e-3 * scale); // the terms are not idle
    CHECK(std::abs(solid.energies().external) > 1e-3 * scale);
  }
}

TEMPLATE_TEST_CASE_SIG("prescribed components keep their motion and take up the forces", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  auto config = soft_config(dim, "neo_hookean_ln");
  config.gravity = std::vector<double>(dim, 0.0);
  config.gravity[1] = -10.0;
  config.fix = {{"bottom", {"x", "y"}}};
  std::vector<double> value(dim, 0.0);
  value[0] = 0.01;
  config.velocity = {{.on = "top", .value = value, .components = {}}};
  config.wet = {{"gamma", "top"}, {"gamma", "right"}};
  const auto mesh = distorted_box<dim>(element_types<dim>()[1]);
  Solid<dim> solid(config, mesh);
  const double dt = solid.critical_time_step();
  std::vector<double> f(static_cast<std::size_t>(solid.n_wet_nodes()) * dim, 5.0);
  for (int k = 0; k < 100; ++k)
  {
    solid.predict(dt);
    solid.solve_free_motion(dt);
    solid.correct_with_link(f, dt);
  }
  const auto& nodes = solid.nodes();
  for (std::size_t n = 0; n < nodes.X.size(); ++n)
  {
    if (nodes.X[n][1] == 0.0)
    {
      CHECK(nodes.u[n][0] == 0.0);
      CHECK(nodes.u[n][1] == 0.0);
    }
    if (nodes.X[n][1] == 0.75)
    {
      CHECK(nodes.v[n] == to_vec<dim>(value, ""));
      CHECK(nodes.u[n][0] == Approx(0.01 * solid.time()).epsilon(1e-13)); // 100 additions
    }
  }
  // Newton for the whole: Σ m a = weight + link forces + support forces.
  std::vector<index_t> all(static_cast<std::size_t>(nodes.size()));
  for (std::size_t n = 0; n < all.size(); ++n)
    all[n] = static_cast<index_t>(n);
  const auto support = solid.reaction(all);
  Vec<dim> inertia;
  for (std::size_t n = 0; n < all.size(); ++n)
    inertia += nodes.m[n] * nodes.a[n];
  CHECK(support[1] == Approx(inertia[1] + 10.0 * solid.mass() - 5.0 * solid.n_wet_nodes()).epsilon(1e-10));
  // Inverse masses told to the coupler vanish where the motion is prescribed.
  const auto message = solid.wet_surface();
  for (std::size_t n = 0; n < message.node_id.size(); ++n)
    for (int i = 0; i < dim; ++i)
      for (int j = 0; j < dim; ++j)
      {
        const double entry =
            message.inverse_mass[(n * dim + static_cast<std::size_t>(i)) * dim + static_cast<std::size_t>(j)];
        CHECK(entry == (i == j ? nodes.inverse_mass[n][i] : 0.0));
        if (nodes.X[n][1] == 0.75 || nodes.X[n][1] == 0.0)
          CHECK((i != j || i == 2 || entry == 0.0));
      }
}

TEST_CASE("an activation sets velocity and acceleration of the wet nodes", "[solid][unit]")
{
  auto config = soft_config(2, "neo_hookean_ln");
  config.gravity = {0.0, -10.0};
  config.wet = {{"gamma", "top"}};
  Solid<2> solid(config, distorted_box<2>(ElementType::quadrilateral4));
  const auto kinematics = solid.kinematics();
  const auto n = kinematics.v.size();
  REQUIRE(n == static_cast<std::size_t>(solid.n_wet_nodes()) * 2);
  for (std::size_t k = 1; k < n; k += 2)
    CHECK(kinematics.a_free[k] == Approx(-10.0).epsilon(1e-14));
  solid.apply_activation({.impulse = std::vector<double>(n, 3.0), .link_force = std::vector<double>(n, 7.0)});
  for (std::size_t k = 0; k < n / 2; ++k)
  {
    CHECK(solid.nodes().v[k][1] == 3.0 * solid.nodes().inverse_mass[k][1]);
    CHECK(solid.nodes().a[k][1] == Approx(-10.0 + 7.0 * solid.nodes().inverse_mass[k][1]).epsilon(1e-14));
  }
}

TEMPLATE_TEST_CASE_SIG("an inverted element stops the run and says which, where and when", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
  {
    auto config = soft_config(dim, "svk"); // softens in compression: can be crushed
    Solid<dim> solid(config, distorted_box<dim>(type));
    const double dt = solid.critical_time_step();
    solid.set_motion(zero_field<dim>(),
                     [dt](const Vec<dim>& X) { return X[0] > 0.9 ? Vec<dim>{{-0.4 / dt}} : Vec<dim>{}; });
    solid.predict(dt);
    REQUIRE_THROWS_AS(solid.solve_free_motion(dt), NumericalError);
    REQUIRE_THROWS_WITH(solid.solve_free_motion(dt),
                        Catch::Contains(element_name(type)) && Catch::Contains("near (0.") &&
                            Catch::Contains("step 1, t = ") && Catch::Contains("inverted"));
  }
}

TEST_CASE("a state that is not a number stops the run", "[solid][unit]")
{
  Solid<2> solid(soft_config(2, "linear"), distorted_box<2>(ElementType::quadrilateral4));
  CHECK_THROWS_AS(solid.set_motion(
                      [](const Vec<2>&) {
                        return Vec<2>{{std::nan(""), 0.0}};
                      },
                      zero_field<2>()),
                  NumericalError);
}

TEST_CASE("unknown names are told with the names there are", "[solid][unit]")
{
  const auto mesh = distorted_box<2>(ElementType::quadrilateral4);
  auto config = soft_config(2, "linear");
  config.fix = {{"botom", {"y"}}};
  CHECK_THROWS_WITH((Solid<2>(config, mesh)), Catch::Contains("solid.fix[0].on = \"botom\"") &&
                                                  Catch::Contains("bottom, left, right, top") &&
                                                  Catch::Contains("did you mean \"bottom\""));
  config = soft_config(2, "linear");
  config.fix = {{"bottom", {"z"}}};
  CHECK_THROWS_WITH((Solid<2>(config, mesh)), Catch::Contains("contains \"z\": must be of x, y in 2-D"));
  config = soft_config(2, "linear");
  config.traction = {{.on = "lid", .value = {1.0, 0.0}}};
  CHECK_THROWS_WITH((Solid<2>(config, mesh)), Catch::Contains("solid.traction[0].on = \"lid\""));
  config = soft_config(2, "linear");
  config.wet = {{"gamma", "lid"}};
  CHECK_THROWS_WITH((Solid<2>(config, mesh)),
                    Catch::Contains("interface \"gamma\"") && Catch::Contains("\"lid\""));
  config = soft_config(2, "linear");
  config.fix = {{"bottom", {"x"}}};
  config.velocity = {{.on = "left", .value = {1.0, 0.0}, .components = {}}};
  CHECK_THROWS_WITH((Solid<2>(config, mesh)),
                    Catch::Contains("solid.velocity[0]") && Catch::Contains("component x"));
  config = soft_config(2, "linear");
  config.gravity = {0.0, 0.0, -9.81};
  CHECK_THROWS_WITH((Solid<2>(config, mesh)), Catch::Contains("solid.gravity has 3 numbers: must have 2"));
}

TEST_CASE("an element turned inside out in the mesh is refused", "[solid][unit]")
{
  auto mesh = distorted_box<2>(ElementType::quadrilateral4);
  std::swap(mesh.blocks[0].nodes[4], mesh.blocks[0].nodes[6]);
  CHECK_THROWS_WITH((Solid<2>(soft_config(2, "linear"), mesh)),
                    Catch::Contains("quadrilateral4 number 1") && Catch::Contains("inverted or flat"));
}
