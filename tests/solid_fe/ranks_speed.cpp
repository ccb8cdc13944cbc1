// What one step of the solid costs on several ranks.
//
//   mpirun -n RANKS solid_ranks_speed plane|space neo_hookean_ln|j2 ELEMENTS STEPS [WET_SIDES]
//
// A square of Q4 or a cube of Hex8, full integration, of about so many elements, swings; 0, 1 or all (4) of
// its sides are wet. Prints one JSON object for the slowest rank: seconds per step of processor time without
// what was spent waiting for other ranks ("step_s"), and of the clock on the wall, both medians of blocks of
// 20 steps; seconds of one look at the step bound and of the set-up; messages and bytes per step and rank;
// "imbalance" is what the slowest rank computes over the mean of all, less 1.
#include "common/parallel/mpi_ranks.hpp"
#include "solid_fe/solid.hpp"

#include <fmt/format.h>
#include <mpi.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <string>

using namespace undine;
using namespace undine::solid;

namespace
{

double cpu_seconds()
{
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double wall_seconds()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double median(std::vector<double> values)
{
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

template <int dim>
void measure(const std::string& law, double elements, int steps, int wet_sides)
{
  const double begin = cpu_seconds();
  const Ranks ranks = ranks_of(MPI_COMM_WORLD, 0.0);
  SolidConfig config;
  config.dim = dim;
  config.material = {.density = 1000.0, .youngs_modulus = 1e6, .poisson_ratio = 0.3, .law = law};
  if (law == "j2")
  {
    config.material.yield_stress = 1.0; // it flows everywhere
    config.material.hardening_modulus = 1e3;
  }
  const std::vector<std::string> sides{"top", "right", "bottom", "left"};
  for (int k = 0; k < std::min(wet_sides, 4); ++k)
    config.wet.push_back({.interface = "water", .surface = sides[static_cast<std::size_t>(k)]});
  Vec<dim> size;
  for (auto& x : size.c)
    x = 1.0;
  std::array<int, dim> cells;
  cells.fill(static_cast<int>(std::lround(std::pow(elements, 1.0 / dim))));
  Solid<dim> solid(config, box_mesh<dim>({}, size, cells,
                                         dim == 2 ? ElementType::quadrilateral4 : ElementType::hexahedron8));
  solid.set_motion([](const Vec<dim>&) { return Vec<dim>{}; },
                   [](const Vec<dim>& X)
                   {
                     Vec<dim> v;
                     v[0] = X[1];
                     v[1] = -0.3 * X[0];
                     return v;
                   });
  const double made = cpu_seconds();
  solid.distribute(ranks);
  const double distributed = cpu_seconds();
  const double dt = 0.3 * solid.critical_time_step();

  std::vector<double> step, wall;
  constexpr int block = 20;
  const Ranks::Cost before = ranks.cost();
  for (int k = 0; k < steps; k += block)
  {
    const double cpu = cpu_seconds() - ranks.cost().cpu, clock = wall_seconds();
    for (int j = 0; j < block; ++j)
    {
      solid.predict(dt);
      solid.solve_free_motion(dt);
    }
    step.push_back((cpu_seconds() - ranks.cost().cpu - cpu) / block);
    wall.push_back((wall_seconds() - clock) / block);
  }
  const Ranks::Cost cost = ranks.cost();
  const double looks = cpu_seconds() - ranks.cost().cpu;
  solid.critical_time_step();
  const double look = cpu_seconds() - ranks.cost().cpu - looks;

  const double mine = median(step);
  double mean = 0.0;
  for (const double part : ranks.gather(std::vector<double>{mine}))
    mean += part / ranks.size();
  std::vector<double> worst{mine,
                            median(wall),
                            look,
                            made - begin,
                            distributed - made,
                            static_cast<double>(cost.messages - before.messages) / steps,
                            static_cast<double>(cost.bytes - before.bytes) / steps};
  ranks.max(worst);
  if (ranks.rank() == 0)
    fmt::print("{{\"ranks\": {}, \"elements\": {}, \"nodes\": {}, \"wet\": {}, \"step_s\": {:.6g}, "
               "\"wall_s\": {:.6g}, "
               "\"look_s\": {:.6g}, \"setup_s\": {:.6g}, \"share_s\": {:.6g}, \"messages\": {:.3g}, "
               "\"bytes\": {:.6g}, "
               "\"imbalance\": {:.3g}}}\n",
               ranks.size(), solid.n_elements(), solid.nodes().size(), solid.n_wet_nodes(), worst[0],
               worst[1], worst[2], worst[3], worst[4], worst[5], worst[6],
               mine > 0.0 ? worst[0] / mean - 1.0 : 0.0);
}

} // namespace

int main(int argc, char** argv)
{
  MPI_Init(&argc, &argv);
  const bool in_space = argc > 1 && std::string(argv[1]) == "space";
  const std::string law = argc > 2 ? argv[2] : "neo_hookean_ln";
  const double elements = argc > 3 ? std::atof(argv[3]) : 1e5;
  const int steps = argc > 4 ? std::atoi(argv[4]) : 200, wet_sides = argc > 5 ? std::atoi(argv[5]) : 0;
  in_space ? measure<3>(law, elements, steps, wet_sides) : measure<2>(law, elements, steps, wet_sides);
  MPI_Finalize();
  return 0;
}
