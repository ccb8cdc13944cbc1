// The loops of the solid: alone, and coupled in one process over memory channels.
#include "common/error.hpp"
#include "solid_fe/run.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

#include <future>
#include <thread>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

/// A solid that serves a coupler from its own thread; the test is the coupler.
template <int dim>
class SolidInThread
{
public:
  SolidInThread(const SolidConfig& config, const Mesh<dim>& mesh)
      : solid(config, mesh), channels_(link::memory_channel(10.0))
  {
    result_ = std::async(std::launch::async,
                         [this]
                         {
                           link::SolverLink end(std::move(channels_.first));
                           return run_coupled<dim>(solid, end, RunTimes{}, nullptr);
                         });
    partner = std::make_unique<link::PartnerLink>(std::move(channels_.second), "solid");
  }
  RunResult finish()
  {
    partner->send_bye();
    return result_.get();
  }
  RunResult wait() { return result_.get(); }

  Solid<dim> solid;
  std::unique_ptr<link::PartnerLink> partner;

private:
  std::pair<std::unique_ptr<link::Channel>, std::unique_ptr<link::Channel>> channels_;
  std::future<RunResult> result_;
};

/// Two boxes stacked along y that share the plane y = 0.5, or the undivided one.
template <int dim>
Mesh<dim> slab(double y_begin, int cells_high, ElementType type)
{
  Vec<dim> origin, size;
  std::array<int, dim> counts{};
  for (int i = 0; i < dim; ++i)
  {
    size[i] = i == 1 ? 0.125 * cells_high : 0.25;
    counts[static_cast<std::size_t>(i)] = i == 1 ? cells_high : 2;
  }
  origin[1] = y_begin;
  return box_mesh<dim>(origin, size, counts, type);
}

} // namespace

TEST_CASE("the step falls at once and grows slowly", "[solid][unit]")
{
  CHECK(next_step(1.0, 0.5) == 0.5);
  CHECK(next_step(1.0, 1.05) == 1.0);
  CHECK(next_step(1.0, 2.0) == 1.02);
}

TEMPLATE_TEST_CASE_SIG("a run alone ends exactly at t_end and keeps mass and energy", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  auto config = soft_config(dim, "neo_hookean_ln");
  config.gravity = std::vector<double>(dim, 0.0);
  config.gravity[1] = -10.0;
  config.fix = {{"bottom", {"x", "y"}}};
  Solid<dim> solid(config, distorted_box<dim>(element_types<dim>()[1]));
  std::int64_t calls = 0;
  const auto result = run_alone<dim>(solid, {.t_end = 0.5, .frame_interval = 0.03, .history_interval = 0.0},
                                     nullptr, [&calls](double, std::int64_t, double) { return ++calls > 0; });
  CHECK(result.completed);
  CHECK(result.t_end == Approx(0.5).epsilon(1e-13));
  CHECK(result.steps == calls);
  CHECK(result.mass_drift == 0.0);
  // Δt²/8 a·M a of a column that oscillates in its first mode: (ω Δt)²/8 with ω Δt about 0.05 here, plus
  // changes of Δt.
  INFO("energy drift " << result.energy_drift);
  CHECK(result.energy_drift < 1e-2);
}

TEST_CASE("a run alone stops in order when it is asked to", "[solid][unit]")
{
  Solid<2> solid(soft_config(2, "linear"), distorted_box<2>(ElementType::triangle3));
  const auto result = run_alone<2>(solid, {.t_end = 1.0, .frame_interval = 0.0, .history_interval = 0.0},
                                   nullptr, [](double, std::int64_t step, double) { return step < 7; });
  CHECK_FALSE(result.completed);
  CHECK(result.steps == 7);
}

TEST_CASE("a coupled solid that nobody pushes moves as it does alone, fine or macro", "[solid][unit]")
{
  auto config = soft_config(2, "neo_hookean_ln");
  config.gravity = {0.0, -10.0};
  config.fix = {{"bottom", {"x", "y"}}};
  config.wet = {{"gamma", "top"}};
  const auto mesh = distorted_box<2>(ElementType::quadrilateral4);
  SolidInThread<2> coupled(config, mesh);
  Solid<2> alone(config, mesh);
  auto& partner = *coupled.partner;
  partner.send_setup({.dim = 2, .t_begin = 0.0, .t_end = 1.0, .scheme = "gc", .interfaces = {"gamma"}});
  const auto surface = partner.receive_mesh();
  CHECK(surface.interfaces == std::vector<std::string>{"gamma"});
  partner.accept_mesh();
  std::vector<double> v(static_cast<std::size_t>(surface.n_nodes()) * 2), zero(v.size());
  double t = 0.0;
  for (int k = 0; k < 40; ++k)
  {
    const auto report = partner.receive_report();
    CHECK(report.stable_dt > 0.0);
    CHECK(report.mass == Approx(alone.mass()));
    CHECK(report.steps == alone.steps());
    const bool fine = k % 2 == 1;
    link::Window window{
        .index = k, .t_begin = t, .t_end = t + report.stable_dt, .steps = fine ? 3 : 1, .fine = fine};
    partner.send_window(window);
    for (int j = 0; j < window.steps; ++j)
    {
      alone.predict(window.dt());
      alone.solve_free_motion(window.dt());
      partner.receive_free_velocity(v);
      const auto expected = alone.interface_velocity();
      REQUIRE(std::equal(v.begin(), v.end(), expected.begin(), expected.end())); // same operations, same bits
      partner.send_link_force(zero);
    }
    t = window.t_end;
  }
  partner.receive_report();
  const auto result = coupled.finish();
  CHECK(result.windows == 40);
  CHECK(result.steps == alone.steps());
  CHECK(coupled.solid.time() == t);
  CHECK(coupled.solid.nodes().u == alone.nodes().u);
}

// Equal steps and matching nodes: the link forces that make both sides' velocities equal are those the
// undivided body has inside. Only the order of sums differs: round-off grown over 300 steps.
TEMPLATE_TEST_CASE_SIG("two solids linked with equal steps move as the undivided solid",
                       "[solid][verification]", ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
  {
    auto config = soft_config(dim, "neo_hookean_ln");
    config.gravity = std::vector<double>(dim, 0.0);
    config.gravity[0] = 2.0;
    config.gravity[1] = -10.0;
    auto lower_config = config, upper_config = config;
    config.fix = lower_config.fix = {{"bottom", {"x", "y"}}};
    lower_config.wet = {{"gamma", "top"}};
    upper_config.wet = {{"gamma", "bottom"}};
    Solid<dim> undivided(config, slab<dim>(0.0, 8, type));
    SolidInThread<dim> lower(lower_config, slab<dim>(0.0, 4, type)),
        upper(upper_config, slab<dim>(0.5, 4, type));

    const link::Setup setup{
        .dim = dim, .t_begin = 0.0, .t_end = 1.0, .scheme = "gc", .interfaces = {"gamma"}};
    link::SurfaceMesh surface[2];
    SolidInThread<dim>* sides[2] = {&lower, &upper};
    for (int s = 0; s < 2; ++s)
    {
      sides[s]->partner->send_setup(setup);
      surface[s] = sides[s]->partner->receive_mesh();
      sides[s]->partner->accept_mesh();
    }
    // Both number the wet nodes of the plane in the same order (rows of a box).
    REQUIRE(surface[0].x.size() == surface[1].x.size());
    for (std::size_t k = 0; k < surface[0].x.size(); ++k)
      REQUIRE(std::abs(surface[0].x[k] - surface[1].x[k]) < 1e-12);

    const auto n = surface[0].x.size();
    const auto inverse_mass = [&](int s, std::size_t k)
    { return surface[s].inverse_mass[k * dim + k % dim]; }; // diagonal entry of component k % dim
    /// Force on the lower side (the upper gets the opposite) that makes `values` equal after + weight M⁻¹ f.
    const auto link_force = [&](const std::vector<double>* values, double weight)
    {
      std::vector<double> f(n);
      for (std::size_t k = 0; k < n; ++k)
        f[k] = (values[1][k] - values[0][k]) / (weight * (inverse_mass(0, k) + inverse_mass(1, k)));
      return f;
    };
    const auto negative = [](std::vector<double> f)
    {
      for (auto& x : f)
        x = -x;
      return f;
    };

    const double dt = 0.9 * undivided.critical_time_step();
    for (int k = 0; k < 300; ++k)
    {
      link::Window window{
          .index = k, .t_begin = k * dt, .t_end = (k + 1) * dt, .steps = 1, .fine = k % 2 == 0};
      window.activate = k == 0;
      for (auto* side : sides)
      {
        side->partner->receive_report();
        side->partner->send_window(window);
      }
      if (window.activate)
      {
        std::vector<double> v[2], a[2];
        for (int s = 0; s < 2; ++s)
        {
          const auto kinematics = sides[s]->partner->receive_kinematics();
          v[s] = kinematics.v;
          a[s] = kinematics.a_free;
        }
        const auto impulse = link_force(v, 1.0), f = link_force(a, 1.0);
        sides[0]->partner->send_activation({impulse, f});
        sides[1]->partner->send_activation({negative(impulse), negative(f)});
      }
      std::vector<double> v[2] = {std::vector<double>(n), std::vector<double>(n)};
      for (int s = 0; s < 2; ++s)
        sides[s]->partner->receive_free_velocity(v[s]);
      const auto f = link_force(v, 0.5 * dt);
      sides[0]->partner->send_link_force(f);
      sides[1]->partner->send_link_force(negative(f));

      undivided.predict(dt);
      undivided.solve_free_motion(dt);
    }
    for (auto* side : sides)
      side->partner->receive_report();
    lower.finish();
    upper.finish();

    double worst = 0.0, largest = 0.0;
    for (const auto* side : sides)
      for (std::size_t a = 0; a < side->solid.nodes().X.size(); ++a)
      {
        const auto b = static_cast<std::size_t>(nearest_node(undivided, side->solid.nodes().X[a]));
        worst = std::max(worst, norm(side->solid.nodes().u[a] - undivided.nodes().u[b]));
        largest = std::max(largest, norm(undivided.nodes().u[b]));
      }
    INFO(element_name(type) << " largest difference " << worst << " of " << largest);
    CHECK(largest > 1e-3);
    CHECK(worst < 1e-11 * largest);

    // Balances: the works of the link on both sides cancel, the sums equal the undivided energies.
    const auto e_lower = lower.solid.energies(), e_upper = upper.solid.energies(), e = undivided.energies();
    CHECK(std::abs(e_lower.interface + e_upper.interface) < 1e-10 * std::abs(e_lower.interface));
    CHECK(e_lower.strain + e_upper.strain == Approx(e.strain).epsilon(1e-9));
    CHECK(e_lower.kinetic + e_upper.kinetic == Approx(e.kinetic).epsilon(1e-9));
    CHECK(e_lower.external + e_upper.external == Approx(e.external).epsilon(1e-9));
  }
}

TEST_CASE("a coupler that asks for an interface the solid does not have is told so", "[solid][unit]")
{
  auto config = soft_config(2, "linear");
  config.wet = {{"gamma", "top"}};
  SolidInThread<2> coupled(config, distorted_box<2>(ElementType::quadrilateral4));
  coupled.partner->send_setup(
      {.dim = 2, .t_begin = 0.0, .t_end = 1.0, .scheme = "gc", .interfaces = {"delta"}});
  CHECK_THROWS_WITH(coupled.wait(), Catch::Contains("interface \"delta\"") && Catch::Contains("solid = "));
}
