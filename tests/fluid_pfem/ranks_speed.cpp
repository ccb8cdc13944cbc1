// What one step of the fluid costs on several ranks, act by act: the dam break of fluid_speed, or a
// cube in space, remeshed every 20 steps. The clocks start after the first remesh.
//
//   mpirun -n RANKS ranks_speed NODES_OVER_WIDTH STEPS [2|3] [rows|boxes]
//
// prints one JSON object for the slowest rank of each act: seconds per step of processor time, without what
// was spent waiting for other ranks and in moving what they gather; "all_steps_s" and "all_remesh_s" are sums
// of the acts over all ranks; messages and bytes per step and rank; "peak_MB" is the memory of the largest
// rank; "imbalance" is what the slowest rank computes in its steps over the mean of all, less 1;
// "wall_halo_s" and so on are the parts of the time on the wall, the mean of all ranks (none on one rank).
#include "common/large_arrays.hpp"
#include "common/parallel/mpi_ranks.hpp"
#include "common/parallel/time_split.hpp"
#include "common/program/large_arrays.hpp"
#include "common/time/step_ladder.hpp"
#include "fluid_pfem/fluid.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <optional>
#include <string>

using namespace undine;
using namespace undine::fluid;

namespace
{

double cpu_seconds()
{
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

template <int dim>
void measure(FluidConfig config, std::int64_t steps)
{
  config.remesh.only_if_moved = false; // a remesh every 20 steps, from the first on
  const Ranks ranks = ranks_of(MPI_COMM_WORLD, 0.0);
  Fluid<dim> fluid(config, ranks);
  const StepLadder ladder;
  constexpr std::int64_t first_steps = 24; // with one remesh, of which nothing is kept from one before
  // Step, bound and looks, remesh, waiting; all but the last without waiting.
  std::array<double, 4> seconds{};
  const auto clock = [&](std::size_t act, auto&& what)
  {
    const double begin = cpu_seconds(), waited = ranks.cost().cpu;
    what();
    const double wait = ranks.cost().cpu - waited;
    seconds[act] += cpu_seconds() - begin - wait;
    seconds[3] += wait;
  };
  double dt = 0.0;
  auto wall_begin = std::chrono::steady_clock::now();
  Ranks::Cost before = ranks.cost();
  std::optional<TimeSplit> split;
  std::int64_t remeshes_before = 0;
  for (std::int64_t step = -first_steps, together = 0; step < steps; step += together)
  {
    together = std::min((step < 0 ? 0 : steps) - step, 4 - (step % 4 + 4) % 4);

    if (step == 0)
    {
      seconds = {};
      wall_begin = std::chrono::steady_clock::now();
      before = ranks.cost();
      split.emplace(ranks);
      remeshes_before = fluid.remeshes();
    }
    bool remesh = false;
    if (step > -first_steps && step % 4 == 0)
      clock(1, [&] { remesh = fluid.is_distorted(); });
    if (remesh)
      clock(2, [&] { fluid.remesh(); });
    if (remesh || step % 8 == 0)
      clock(1, [&] { dt = ladder.next(dt, fluid.critical_time_step()); });
    clock(0, [&] { fluid.advance(dt, together); }); // up to the next look at the mesh
  }
  const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - wall_begin).count();
  RankTime part;
  for (const RankTime& rank : split->of_ranks(0.0))
    for (double RankTime::*of :
         {&RankTime::compute, &RankTime::halo, &RankTime::remesh, &RankTime::imbalance, &RankTime::wait})
      part.*of += rank.*of / ranks.size();
  const Ranks::Cost cost = ranks.cost();
  const auto per_step = [&](double x) { return x / static_cast<double>(steps); };
  double mean = 0.0;
  for (const double of_rank : ranks.gather(std::vector<double>{seconds[0] + seconds[1]}))
    mean += of_rank / ranks.size();
  std::array<double, 2> all{}; // of all ranks: steps, remeshes
  for (const auto& acts : ranks.gather(std::vector{std::array{seconds[0] + seconds[1], seconds[2]}}))
    all = {all[0] + acts[0], all[1] + acts[1]};
  rusage use{};
  getrusage(RUSAGE_SELF, &use);
  const double peak = ranks.max(static_cast<double>(use.ru_maxrss) * 1024e-6); // MB
  const double imbalance = ranks.max(seconds[0] + seconds[1]) / mean - 1.0;
  ranks.max(seconds);
  const double messages = ranks.max(static_cast<double>(cost.messages - before.messages)),
               bytes = ranks.max(static_cast<double>(cost.bytes - before.bytes)),
               waits = ranks.max(static_cast<double>(cost.waits - before.waits));
  if (ranks.rank() == 0)
    fmt::print(
        "{{\"ranks\": {}, \"nodes\": {}, \"steps\": {}, \"remeshes\": {}, \"step_s\": {:.6g}, \"bound_s\": "
        "{:.6g}, \"remesh_s\": {:.6g}, \"wait_s\": {:.6g}, \"wall_s\": {:.6g}, "
        "\"messages\": {:.3g}, \"bytes\": {:.6g}, \"waits\": {:.3g}, \"imbalance\": {:.3g}, \"all_steps_s\": "
        "{:.6g}, \"all_remesh_s\": {:.6g}, \"peak_MB\": {:.4g}, \"wall_compute_s\": {:.6g}, \"wall_halo_s\": "
        "{:.6g}, \"wall_remesh_s\": {:.6g}, \"wall_imbalance_s\": {:.6g}, \"wall_wait_s\": {:.6g}}}\n",
        ranks.size(), fluid.nodes().size(), steps, fluid.remeshes() - remeshes_before, per_step(seconds[0]),
        per_step(seconds[1]), per_step(seconds[2]), per_step(seconds[3]), per_step(wall), per_step(messages),
        per_step(bytes), per_step(waits), imbalance, per_step(all[0]), per_step(all[1]), peak,
        per_step(part.compute), per_step(part.halo), per_step(part.remesh), per_step(part.imbalance),
        per_step(part.wait));
}

} // namespace

int main(int argc, char** argv)
{
  recycle_large_arrays();
  MPI_Init(&argc, &argv);
  if (ranks_of(MPI_COMM_WORLD, 0.0).alone()) // as fluid_pfem
    large_arrays().all_rows_will_be_touched();
  const double n = argc > 1 ? std::atof(argv[1]) : 22.0;
  const std::int64_t steps = argc > 2 ? std::atoll(argv[2]) : 200;
  const NodeOrder order = argc <= 4                         ? NodeOrder::usual
                          : std::string(argv[4]) == "boxes" ? NodeOrder::boxes
                                                            : NodeOrder::rows;
  if (argc > 3 && std::atoi(argv[3]) == 3)
  {
    FluidConfig config = test::hydraulic(1.0 / n, 20.0);
    config.dim = 3;
    config.gravity = {0.0, -9.81, 0.0};
    config.size = {1.0, 1.0, 1.0};
    config.order = order;
    measure<3>(config, steps);
  }
  else
  {
    FluidConfig config = test::dam_break_config(0.146 / n);
    config.order = order;
    measure<2>(config, steps);
  }
  MPI_Finalize();
  return 0;
}
