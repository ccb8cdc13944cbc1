// What each part of a step of the fluid costs by itself, called again and again on one state of a dam break.
//
//   fluid_parts NODES_OVER_WIDTH [REPEATS | instructions]
//
// prints one JSON object: nanoseconds of CPU time per node and call, the least of all repeats; or
// instructions that one call executes per node and, in a second number, those of them on eight numbers
// (x86-64; some microseconds each: take 22 nodes).
#include "fluid_pfem/critical_time_step.hpp"
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/mass_conservation.hpp"
#include "fluid_pfem/remesh/distortion.hpp"
#include "tests/fluid_pfem/fixtures.hpp"
#include "tests/support/clocks.hpp"
#include "tests/support/instructions.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <span>
#include <string>
#include <vector>

using namespace undine;
using namespace undine::fluid;
using test::cpu_seconds;

int main(int argc, char** argv)
{
  const int n = argc > 1 ? std::atoi(argv[1]) : 66;
  const FluidConfig config = undine::test::dam_break_config(0.146 / n);
  Fluid<2> fluid(config);
  double dt = 0.0;
  for (int step = 0; step < 40; ++step)
  {
    if (step % 8 == 0)
      dt = fluid.critical_time_step();
    fluid.predict(dt);
    fluid.solve_free_motion(dt);
  }
  FluidNodes<2> nodes = fluid.nodes();
  const FluidMesh<2>& mesh = fluid.mesh();
  const index_t N = nodes.size(), E = mesh.n_elements();
  const bool counts = argc > 2 && std::string(argv[2]) == "instructions";
  const int repeats = argc > 2 ? std::atoi(argv[2]) : std::max(5, 10000000 / N);
  const double c0 = config.tait.sound_speed(config.tait.rho0);
  const Vec<2> g = leading<2>(config.gravity);
  ElementSums<2> sums;
  sums.make_room(N);
  sums.clear(0, N);
  record_nodes<2>(nodes, config.terms, 0, N, sums);
  std::vector<double> rate(static_cast<std::size_t>(N), 0.0), energy(rate);
  const std::vector<float> quality_before(static_cast<std::size_t>(E), 0.5f);
  Team team;
  team.share_out<2>(N, mesh);
  const Share& share = team.shares().front();
  Halo halo;
  StepWorkspace workspace;
  double sink = 0.0;

  std::string row = fmt::format("{{\"nodes\": {}", N);
  const auto time = [&](const char* part, auto&& act)
  {
    if (counts)
    {
      const auto count = test::count_instructions(act);
      row += fmt::format(", \"{}\": [{:.1f}, {:.1f}]", part, static_cast<double>(count.all) / N,
                         static_cast<double>(count.of_eight) / N);
      return;
    }
    double least = 1e300;
    for (int k = 0; k < repeats; ++k)
    {
      const double begin = cpu_seconds();
      act();
      least = std::min(least, cpu_seconds() - begin);
    }
    row += fmt::format(", \"{}\": {:.2f}", part, 1e9 * least / N);
  };
  // Block by block, as in a step.
  const auto blocks = [](index_t count, index_t block, auto&& act)
  {
    for (index_t begin = 0; begin < count; begin += block)
      act(begin, std::min(begin + block, count));
  };
  const auto forces = [&](const ElementTermsConfig& terms)
  {
    blocks(E, element_block,
           [&](index_t begin, index_t end) {
             sink += add_element_forces<2>(mesh, nodes, terms, c0, g, dt, nullptr, begin, end, share, sums);
           });
  };
  const auto exchange = [&](std::span<double> booked)
  {
    exchange_mass<2>(rate, c0 / config.feedback_time, 1e-9, config.inertia_floor * config.tait.rho0,
                     config.tait, g, config.surface_tension_allowed, nodes, 0, N, 0, 5.0, booked);
  };
  ElementTermsConfig pressure_only = config.terms;
  pressure_only.bulk_linear = pressure_only.bulk_quadratic = pressure_only.residual = 0.0;

  time("volumes",
       [&]
       {
         blocks(N, element_block,
                [&](index_t begin, index_t end) { update_nodal_volumes(mesh, begin, end, nodes); });
       });
  time("state",
       [&] { update_density_and_pressure<2>(mesh, config.tait, config.inertia_floor, nodes, 0, N); });
  time("records", [&] { record_nodes<2>(nodes, config.terms, 0, N, sums); });
  time("forces", [&] { forces(config.terms); });
  time("pressure_forces", [&] { forces(pressure_only); });
  time("accelerations", [&] { take_acceleration<2>(nodes, g, 0, N, sums, rate); });
  std::fill(rate.begin(), rate.end(), 0.0);
  time("exchange", [&] { exchange({}); });
  time("exchange_booked", [&] { exchange(energy); });
  time("bound",
       [&]
       {
         sink += critical_time_step<2>(mesh, nodes, config.tait, config.terms, config.inertia_floor, team,
                                       halo, workspace);
       });
  time("worse", [&] { sink += is_worse<2>(mesh, 0, E, nodes.x, quality_before, 0.5, nodes.period); });
  time("strained",
       [&] { sink += is_strained<2>(mesh.elements, nodes.x, nodes.x, nodes.h, 0.1, nodes.period); });
  fmt::print("{}, \"sink\": {:.3g}}}\n", row, sink);
  return 0;
}
