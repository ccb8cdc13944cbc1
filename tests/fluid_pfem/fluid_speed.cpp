// What one step of the fluid costs, act by act: a dam break with a clock around every act of run_alone.
//
//   fluid_speed NODES_OVER_WIDTH T_END [THREADS]
//
// prints one JSON object: nanoseconds of CPU time per node and step (`wall`: of the clock on the wall),
// memory, STREAM triad of the same process.
#include "common/large_arrays.hpp"
#include "common/program/large_arrays.hpp"
#include "common/time/step_ladder.hpp"
#include "fluid_pfem/fluid.hpp"
#include "tests/fluid_pfem/fixtures.hpp"
#include "tests/support/clocks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

using namespace undine;
using namespace undine::fluid;
using test::cpu_seconds;
using test::wall_seconds;

namespace
{

/// Of this program image; getrusage would tell the peak of whoever started it.
double peak_bytes()
{
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;)
    if (double kilobytes = 0.0; word == "VmHWM:" && status >> kilobytes)
      return 1024.0 * kilobytes;
  return 0.0;
}

/// Bandwidth of a = b + s c over three arrays of `length` doubles, best of several sweeps [GB/s].
double triad(std::size_t length, int sweeps)
{
  std::vector<double> a(length, 0.0), b(length, 1.0), c(length, 2.0);
  double best = 1e300;
  for (int sweep = 0; sweep < sweeps; ++sweep)
  {
    const double begin = cpu_seconds();
    for (int again = 0; again < std::max<int>(1, static_cast<int>(2000000 / length)); ++again)
    {
      for (std::size_t i = 0; i < length; ++i)
        a[i] = b[i] + 3.0 * c[i];
      std::swap(a, c);
    }
    best = std::min(best, (cpu_seconds() - begin) / std::max<int>(1, static_cast<int>(2000000 / length)));
  }
  return 24e-9 * static_cast<double>(length) / best;
}

struct Clock
{
  double total = 0.0;
  template <class Act>
  auto operator()(Act&& act)
  {
    const double begin = cpu_seconds();
    if constexpr (std::is_void_v<decltype(act())>)
    {
      act();
      total += cpu_seconds() - begin;
    }
    else
    {
      const auto result = act();
      total += cpu_seconds() - begin;
      return result;
    }
  }
};

} // namespace

int main(int argc, char** argv)
{
  recycle_large_arrays();
  large_arrays().all_rows_will_be_touched();
  const int n = argc > 1 ? std::atoi(argv[1]) : 22;
  const double a = 0.146, g = 9.81, T = std::sqrt(a / (2.0 * g));
  const double T_end = argc > 2 ? std::atof(argv[2]) : 4.0;
  FluidConfig config = undine::test::dam_break_config(a / n);

  if (argc > 3)
    config.threads = std::atoi(argv[3]);

  const double memory_before = peak_bytes();
  Clock solve, bound, look, remesh, output;
  const double begin = cpu_seconds();
  Fluid<2> fluid(config);
  const double set_up = cpu_seconds() - begin, wall_begin = wall_seconds();
  const double M = fluid.mass();
  const StepLadder ladder;
  double dt = 0.0, t = 0.0, node_steps = 0.0, remeshed_nodes = 0.0, volume_error = 0.0;
  std::int64_t step = 0, rows = 0;
  while (t < T_end * T)
  {
    const bool remeshes = step > 0 && step % 4 == 0 && look([&] { return fluid.is_distorted(); });
    if (remeshes)
    {
      remesh([&] { fluid.remesh(); });
      remeshed_nodes += fluid.nodes().size();
    }
    if (remeshes || step % 8 == 0)
      dt = ladder.next(dt, bound([&] { return fluid.critical_time_step(); }));
    // The ledgers of a run that goes to T = 4 and writes 100 rows.
    const auto row_is_due = [&] { return t > static_cast<double>(rows) * 0.04 * T; };
    const std::int64_t first = step;
    do
    {
      t += dt;
      ++step;
    } while (step % 4 != 0 && t < T_end * T && !row_is_due());
    solve([&] { fluid.advance(dt, step - first); });
    node_steps += static_cast<double>(step - first) * fluid.nodes().size();
    if (row_is_due())
    {
      ++rows;
      const double error = output(
          [&]
          {
            const FluidMass m = fluid.mass_by_state();
            return std::abs(config.tait.rho0 * m.volume / m.meshed - 1.0) + 0.0 * fluid.energy().total();
          });
      volume_error = std::max(volume_error, error);
    }
  }
  const double all = cpu_seconds() - begin - set_up, wall = wall_seconds() - wall_begin;
  const auto nodes = static_cast<double>(fluid.nodes().size());
  const double memory = peak_bytes() - memory_before;
  // A working set as large as the fluid's state (about 200 bytes a node), and one far larger than any cache.
  const auto same_size = static_cast<std::size_t>(nodes * 200.0 / 24.0);
  const auto ns = [&](double seconds) { return 1e9 * seconds / node_steps; };
  const FluidEnergy e = fluid.energy();
  fmt::print(
      "{{\"nodes\": {}, \"steps\": {}, \"remeshes\": {}, \"all\": {:.3f}, \"wall\": {:.3f}, "
      "\"solve\": {:.3f}, \"bound\": {:.3f}, \"look\": {:.3f}, \"remesh\": {:.3f}, \"output\": {:.3f}, "
      "\"set_up_us_per_node\": {:.3f}, \"remesh_us_per_node\": {:.4f}, \"cpu_s\": {:.3f}, "
      "\"peak_bytes_per_node\": {:.0f}, \"triad_same_size\": {:.1f}, \"triad_memory\": {:.1f}, "
      "\"volume_error\": {:.2e}, \"mass_drift\": {:.1e}, \"remesh_gain\": {:.5f}, \"remesh_loss\": {:.5f}, "
      "\"energy_scale\": {:.5f}, \"rebuilds\": {}, \"flips\": {}, \"T\": {:.3f}, "
      "\"kept_MB\": {:.1f}, \"asked_MB\": {:.1f}}}\n",
      fluid.nodes().size(), step, fluid.remeshes(), ns(all), ns(wall), ns(solve.total), ns(bound.total),
      ns(look.total), ns(remesh.total), ns(output.total), 1e6 * set_up / nodes,
      1e6 * remesh.total / std::max(1.0, remeshed_nodes), all, memory / nodes, triad(same_size, 20),
      triad(std::size_t{20000000}, 3), volume_error, fluid.mass() / M - 1.0, e.remesh_gain, e.remesh_loss,
      config.tait.rho0 * g * 2.0 * a * a * a, fluid.triangulations().rebuilds, fluid.triangulations().flips,
      T_end, 1e-6 * static_cast<double>(large_arrays().use().kept),
      1e-6 * static_cast<double>(large_arrays().use().asked));
  return 0;
}
