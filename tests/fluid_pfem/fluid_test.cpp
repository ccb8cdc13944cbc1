// The fluid as a whole: conservation, rest, stability.
#include "common/error.hpp"
#include "common/large_arrays.hpp"
#include "fluid_pfem/critical_time_step.hpp"
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/mass_conservation.hpp"
#include "fluid_pfem/simplex.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>
#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <random>
#include <string>
#include <tuple>
#include <type_traits>

using namespace undine;
using namespace undine::fluid;
using undine::test::box_config;
using undine::test::dam_break_config;

namespace
{

template <int dim>
void step(Fluid<dim>& fluid, double dt)
{
  fluid.predict(dt);
  fluid.solve_free_motion(dt);
}

template <int dim>
std::vector<Vec<dim>> smooth_velocity(const FluidNodes<dim>& nodes, double amplitude)
{
  std::vector<Vec<dim>> v;
  for (const auto& x : nodes.x)
  {
    Vec<dim> w;
    for (int i = 0; i < dim; ++i)
      w[i] = amplitude * std::sin(3.0 * x[(i + 1) % dim] + i) * std::cos(2.0 * x[i]);
    v.push_back(w);
  }
  return v;
}

} // namespace

// Between remeshes the inviscid fluid is Hamiltonian and central differences are symplectic: the energy
// oscillates by O(Δt²) and has no trend. Judge the trend by the means of the first and last tenth of 4000
// steps: the oscillation is a sum of many modes, so a mean over 400 steps differs from another by a small
// part of the peak-to-peak oscillation.
TEMPLATE_TEST_CASE_SIG("the energy of the unforced fluid has no trend between remeshes",
                       "[fluid][verification]", ((int dim), dim), 2, 3)
{
  const auto run = [](double fraction)
  {
    FluidConfig config = box_config<dim>(dim == 2 ? 0.1 : 0.25);
    config.tait.B = 1000.0 * 20.0 * 20.0 / 7.0;
    config.seeding.jitter = 0.1;
    Fluid<dim> fluid(config);
    fluid.set_velocity(smooth_velocity<dim>(fluid.nodes(), 0.02));
    const auto energy = [&fluid] // with the velocities of full steps, whose oscillation is the measure
    {
      FluidEnergy e = fluid.energy();
      e.kinetic = 0.0;
      for (std::size_t i = 0; i < fluid.nodes().x.size(); ++i)
        e.kinetic += 0.5 * fluid.nodes().M[i] * norm_squared(fluid.nodes().v[i]);
      return e.total();
    };
    const double dt = fraction * fluid.critical_time_step(), e0 = energy();
    const int steps = static_cast<int>(2000 / fraction);
    double first = 0.0, last = 0.0, highest = 0.0, lowest = 0.0;
    for (int k = 0; k < steps; ++k)
    {
      step(fluid, dt);
      const double e = energy() / e0 - 1.0;
      highest = std::max(highest, e);
      lowest = std::min(lowest, e);
      (k < steps / 10 ? first : last) += k < steps / 10 || k >= steps - steps / 10 ? e / (steps / 10) : 0.0;
    }
    return std::pair{highest - lowest, last - first};
  };
  const auto [oscillation, trend] = run(1.0);
  const auto [oscillation_half, trend_half] = run(0.5);
  CAPTURE(oscillation, trend, oscillation_half, trend_half);
  CHECK(std::abs(trend) < 0.2 * oscillation);
  CHECK(oscillation_half < 0.35 * oscillation); // O(Δt²): a quarter
  CHECK(oscillation < 0.2);
}

// Pressure is a gradient of a translation- and rotation-invariant energy: both momenta are exact; 1000 steps
// of round-off.
TEMPLATE_TEST_CASE_SIG("momentum and angular momentum of an isolated drop are exact", "[fluid][unit]",
                       ((int dim), dim), 2, 3)
{
  FluidConfig config = box_config<dim>(dim == 2 ? 0.1 : 0.25);
  config.tait.B = 1000.0 * 50.0 * 50.0 / 7.0;
  Fluid<dim> fluid(config);
  std::vector<Vec<dim>> v;
  for (const auto& x : fluid.nodes().x)
  {
    Vec<dim> w{};
    w[0] = 0.5 - (x[1] - 0.5);
    w[1] = x[0] - 0.5;
    v.push_back(w);
  }
  fluid.set_velocity(v);
  const auto spin = [&]
  {
    double L = 0.0;
    const auto& n = fluid.nodes();
    for (std::size_t i = 0; i < n.x.size(); ++i)
      L += n.m[i] * (n.x[i][0] * n.v[i][1] - n.x[i][1] * n.v[i][0]);
    return L;
  };
  const Vec<dim> momentum = fluid.momentum();
  // central differences conserve L at integer times up to Σ m (Δt v_half × …), exactly: v at integer times is
  // v_half ± Δt/2 a, and Σ m x × a = 0
  const double L = spin(), dt = fluid.critical_time_step();
  for (int k = 0; k < 1000; ++k)
    step(fluid, dt);
  CHECK(norm(fluid.momentum() - momentum) < 1e-12 * norm(momentum));
  CHECK(spin() == Approx(L).epsilon(1e-12));
}

// The barotropic profile is an equilibrium of the continuous fluid; the discrete one rings with the O(h²)
// defect of the profile's curvature only. Without any damping over 2000 steps: velocities below 1e-4 of the
// free-fall scale √(gH), and the pressure within 1e-3 of ρgH, at the real sound speed.
TEMPLATE_TEST_CASE_SIG("a hydrostatic column at rest stays at rest", "[fluid][verification]",
                       ((int dim), dim), 2, 3)
{
  FluidConfig config = box_config<dim>(dim == 2 ? 0.1 : 0.25);
  config.seeding.jitter = 0.2;
  config.gravity = {0.0, -9.81, 0.0};
  config.initial_pressure = InitialPressure::hydrostatic;
  for (const char* wall : {"left", "right", "bottom"})
    config.walls.push_back({wall, WallKind::slip});
  if (dim == 3)
    for (const char* wall : {"back", "front"})
      config.walls.push_back({wall, WallKind::slip});
  Fluid<dim> fluid(config);
  const double dt = fluid.critical_time_step();
  double fastest = 0.0, error = 0.0;
  for (int k = 0; k < 2000; ++k)
  {
    step(fluid, dt);
    for (const auto& v : fluid.nodes().v)
      fastest = std::max(fastest, norm(v));
  }
  for (std::size_t i = 0; i < fluid.nodes().x.size(); ++i)
    error = std::max(error, std::abs(fluid.nodes().p[i] - 1000.0 * 9.81 * (1.0 - fluid.nodes().x[i][1])));
  CAPTURE(fastest, error);
  CHECK(fastest < 1e-4 * std::sqrt(9.81));
  CHECK(error < 1e-3 * 1000.0 * 9.81);
}

// Truth: rest of a barotropic fluid in closed form, to round-off.
TEMPLATE_TEST_CASE_SIG("each of two pools begins with the pressure of its own depth", "[fluid][unit]",
                       ((int dim), dim), 2, 3)
{
  FluidConfig config = test::hydraulic(0.1, 20.0);
  config.dim = dim;
  config.gravity = {0.0, -9.81, 0.0};
  config.size = {0.5, 1.0, dim == 3 ? 0.5 : 0.0};
  config.initial_pressure = InitialPressure::hydrostatic;
  Body& shallow = config.more_bodies.emplace_back();
  shallow.shape = config.shape;
  shallow.origin = {0.55, 0.0, 0.0}; // half a spacing beside the deep one
  shallow.size = {0.5, 0.4, config.size[2]};
  const Fluid<dim> fluid(config);
  std::array<int, 2> met{};
  for (const auto& x : fluid.nodes().x)
  {
    const bool deep = x[0] < 0.525;
    const auto n = static_cast<std::size_t>(&x - fluid.nodes().x.data());
    ++met[deep];
    CHECK(fluid.nodes().rho[n] ==
          Approx(config.tait.hydrostatic_density(9.81 * ((deep ? 1.0 : 0.4) - x[1]))).epsilon(1e-14));
  }
  CHECK(met[0] > 20);
  CHECK(met[1] > 50);
}

// The bound is rigorous: the true highest frequency, found by power iteration on A = M⁻¹ B diag(ρc²/V) Bᵀ, is
// below it. The ratio says how much time step it gives away.
TEMPLATE_TEST_CASE_SIG("the critical step is below the true limit, and not by much", "[fluid][unit]",
                       ((int dim), dim), 2, 3)
{
  const double jitter = GENERATE(0.0, 0.1, 0.3);
  FluidConfig config = box_config<dim>(dim == 2 ? 0.05 : 0.2);
  config.seeding.jitter = jitter;
  Fluid<dim> fluid(config);
  StepWorkspace workspace;
  Team team;
  Halo halo;
  team.share_out(fluid.nodes().size(), fluid.mesh());
  const double claimed =
      critical_time_step<dim>(fluid.mesh(), fluid.nodes(), config.tait, {}, 0.0, team, halo, workspace);

  // No row that counts was left out: the largest of all, from the definition.
  std::map<std::pair<index_t, index_t>, Vec<dim>> B; // ∂V_j/∂x_i
  for (const auto& e : fluid.mesh().elements)
  {
    const auto V_grad_N =
        volume_gradients<dim, double>(corners<dim>(fluid.nodes().x, e, fluid.nodes().period));
    for (std::size_t a = 0; a <= dim; ++a)
      for (const index_t j : e)
        B[{e[a], j}] += (1.0 / (dim + 1)) * V_grad_N[a];
  }
  std::vector<double> column(fluid.nodes().x.size(), 0.0), row(column);
  for (const auto& [ij, B_ij] : B)
    column[static_cast<std::size_t>(ij.second)] += norm(B_ij);
  for (const auto& [ij, B_ij] : B)
  {
    const auto i = static_cast<std::size_t>(ij.first), j = static_cast<std::size_t>(ij.second);
    row[i] += norm(B_ij) * config.tait.tangent_modulus(fluid.nodes().p[j]) / fluid.nodes().V[j] * column[j] /
              fluid.nodes().inertia[i];
  }
  CHECK(claimed == Approx(2.0 / std::sqrt(*std::max_element(row.begin(), row.end()))).epsilon(1e-12));

  // a(ε w) is linear in small displacements: acceleration of x + ε w at fixed masses
  FluidNodes<dim> nodes = fluid.nodes();
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  std::vector<Vec<dim>> w(nodes.x.size());
  for (auto& d : w)
    for (int i = 0; i < dim; ++i)
      d[i] = normal(random);
  double omega_squared = 0.0;
  const double epsilon = 1e-7 * config.element_size;
  for (int iteration = 0; iteration < 400; ++iteration)
  {
    double length = 0.0;
    for (const auto& d : w)
      length += norm_squared(d);
    length = std::sqrt(length / double(w.size()));
    for (std::size_t i = 0; i < w.size(); ++i)
    {
      w[i] *= 1.0 / length;
      nodes.x[i] = fluid.nodes().x[i] + epsilon * w[i];
    }
    update_nodal_volumes<dim>(fluid.mesh(), nodes);
    update_density_and_pressure<dim>(fluid.mesh(), config.tait, 0.0, nodes, 0, nodes.size());
    undine::test::pressure_acceleration<dim>(fluid.mesh(), nodes);
    double grown = 0.0;
    for (std::size_t i = 0; i < w.size(); ++i)
    {
      w[i] = (-1.0 / epsilon) * nodes.a[i];
      grown += norm_squared(w[i]);
    }
    omega_squared = std::sqrt(grown / double(w.size()));
  }
  const double limit = 2.0 / std::sqrt(omega_squared), c = config.tait.sound_speed(1000.0);
  CAPTURE(jitter, claimed * c / config.element_size, limit * c / config.element_size, limit / claimed);
  CHECK(claimed < limit);
  CHECK(claimed > limit / 2.5);
}

// Each node is summed by one thread in the order of its elements, and sums over elements are taken by blocks:
// equality of the bits, remeshes included. A falling column is 3100 elements in 4 blocks, so that each of up
// to four threads has nodes of its own; the box in space has more.
TEST_CASE("results do not depend on the number of threads", "[fluid][unit]")
{
  const auto run = [](FluidConfig config, auto dimension, int threads)
  {
    constexpr int dim = decltype(dimension)::value;
    config.threads = threads;
    Fluid<dim> fluid(config);
    for (int step = 0; step < 150; ++step)
    {
      if (step % 4 == 0 && fluid.is_distorted())
        fluid.remesh();
      const double dt = 0.9 * fluid.critical_time_step();
      fluid.predict(dt);
      fluid.solve_free_motion(dt);
    }
    return fluid;
  };
  const auto same = [](const auto& a, const auto& b)
  {
    return a.nodes().x == b.nodes().x && a.nodes().v == b.nodes().v && a.nodes().p == b.nodes().p &&
           a.nodes().M == b.nodes().M && a.energy().total() == b.energy().total() &&
           a.energy().dissipated == b.energy().dissipated;
  };
  FluidConfig column = dam_break_config(0.146 / 27.0);
  column.remesh.only_if_moved = false; // every 20 steps
  FluidConfig box = box_config<3>(1.0 / 9.0);
  box.terms.bulk_linear = 0.05;
  box.terms.residual = 0.1;
  box.gravity = {0.0, 0.0, -9.81};
  box.walls = {{"bottom", WallKind::slip}};
  const auto one = run(column, std::integral_constant<int, 2>{}, 1);
  const auto one_in_space = run(box, std::integral_constant<int, 3>{}, 1);
  REQUIRE(one.remeshes() >= 5);
  REQUIRE(one.mesh().n_elements() > 3 * element_block);
  REQUIRE(one_in_space.mesh().n_elements() > 3 * element_block);
  for (int threads = 2; threads <= 4; ++threads)
  {
    INFO(threads << " threads");
    CHECK(same(one, run(column, std::integral_constant<int, 2>{}, threads)));
    CHECK(same(one_in_space, run(box, std::integral_constant<int, 3>{}, threads)));
  }
}

// What memory held before cannot matter: the bits of a run in fresh memory, which is zero, and in memory full
// of what is no number before every remesh. Arrays of a page and more are recycled here, in programs those of
// 256 kB. A complete rebuild, as every one in space, gives back what is kept: then the rest is fresh.
TEST_CASE("results do not depend on what recycled memory held", "[fluid][unit]")
{
  LargeArrays& arrays = large_arrays();
  const auto fill_memory = [&arrays]
  {
    constexpr std::size_t plenty = 64 << 20;
    if (void* const memory = arrays.allocate(plenty))
    {
      std::memset(memory, 0xff, plenty);
      arrays.release(memory);
    }
  };
  const auto run = [&](FluidConfig config, auto dimension)
  {
    config.remesh.only_if_moved = false;
    Fluid<decltype(dimension)::value> fluid(config);
    for (int step = 0; step < 90; ++step)
    {
      if (step % 30 == 29)
      {
        fill_memory();
        fluid.remesh();
      }
      fluid.advance(0.9 * fluid.critical_time_step(), 1);
    }
    return std::tuple(fluid.nodes().x, fluid.nodes().v, fluid.nodes().p, fluid.nodes().M,
                      fluid.energy().total(), fluid.energy().dissipated);
  };
  FluidConfig box = box_config<3>(1.0 / 9.0);
  box.terms.bulk_linear = 0.05;
  box.terms.residual = 0.1;
  box.gravity = {0.0, 0.0, -9.81};
  const FluidConfig column = dam_break_config(0.146 / 27.0);
  const auto of_plane = run(column, std::integral_constant<int, 2>{});
  const auto of_space = run(box, std::integral_constant<int, 3>{});
  REQUIRE(arrays.use().asked == 0);
  arrays.start(4096);
  arrays.all_rows_will_be_touched();
  CHECK((run(column, std::integral_constant<int, 2>{}) == of_plane));
  CHECK((run(box, std::integral_constant<int, 3>{}) == of_space));
  CHECK(arrays.use().asked > 0);
  arrays.stop();
}

// A node is thrown through its neighbours, and nobody remeshes: ten steps with a negative volume are waited
// for (the next look at the mesh may heal them), the eleventh ends the run.
TEST_CASE("a node that is nowhere ends the run at the next remesh and is named", "[fluid][unit]")
{
  Fluid<2> fluid(box_config<2>(0.25));
  std::vector<Vec<2>> v(fluid.nodes().x.size());
  v[3][0] = std::numeric_limits<double>::infinity();
  fluid.set_velocity(v);
  fluid.predict(1e-6);
  CHECK_THROWS_WITH(fluid.remesh(), Catch::Contains(fmt::format("node {} is at (inf", fluid.nodes().id[3])));
}

TEMPLATE_TEST_CASE_SIG("elements that stay turned over end the run and are named", "[fluid][unit]",
                       ((int dim), dim), 2, 3)
{
  Fluid<dim> fluid(box_config<dim>(0.25));
  const auto& nodes = fluid.nodes();
  std::size_t inner = 0;
  for (std::size_t n = 0; n < nodes.x.size(); ++n)
    if (nodes.flag[n] == 0)
      inner = n;
  std::vector<Vec<dim>> v(nodes.x.size());
  v[inner][0] = 20000.0;
  fluid.set_velocity(v);
  int steps = 0, negative = 0;
  std::string message;
  while (message.empty() && steps < 1000)
    try
    {
      step(fluid, 5e-6);
      ++steps;
      negative += *std::min_element(nodes.V.begin(), nodes.V.end()) < 0.0;
    }
    catch (const NumericalError& error)
    {
      CHECK(error.code() == ExitCode::numerical_failure);
      message = error.what();
    }
  CAPTURE(message);
  CHECK(negative == 10);
  for (const std::string& part : {fmt::format("fluid step {}, t = ", steps + 1), std::string("element "),
                                  std::string(" m has the volume -"), std::string("turned over for 11 steps"),
                                  std::string("velocity"), std::string("pressure")})
    CHECK_THAT(message, Catch::Contains(part));
}
