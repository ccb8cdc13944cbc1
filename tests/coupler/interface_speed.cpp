// What an interface of growing size costs the coupler: integrals, operator, factor and solutions with
// it, solutions by conjugate gradients. Run by mpirun, on one and several ranks; the numbers are in
// docs/benchmarks/scaling.md.
//
// mpirun -n 2 interface_speed DIM NODES...      wet nodes of the fluid's side; the solid's is 0.8 times as
// fine
#include "coupler/helpers.hpp"
#include "coupler/interface.hpp"

#include <mpi.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <utility>
#include <vector>

using namespace undine;
using namespace undine::coupler;

namespace
{

/// A wavy line or sheet of n cells per direction; the fluid's faces upwards, the solid's down.
link::SurfaceMesh surface(int dim, int n, bool up)
{
  link::SurfaceMesh s;
  s.dim = dim;
  s.interfaces = {"wet"};
  const double h = 1.0 / n;
  for (int j = 0; j <= (dim == 3 ? n : 0); ++j)
    for (int i = 0; i <= n; ++i)
    {
      s.node_id.push_back(s.n_nodes());
      const double z = 0.01 * std::sin(5.0 * i * h) * std::cos(4.0 * j * h);
      if (dim == 2)
        s.x.insert(s.x.end(), {i * h, z});
      else
        s.x.insert(s.x.end(), {i * h, j * h, z});
      for (int a = 0; a < dim; ++a)
        for (int b = 0; b < dim; ++b)
          s.inverse_mass.push_back(a == b ? 1.0 / (h * h) : 0.0);
    }
  const auto add = [&s](std::initializer_list<std::int32_t> nodes)
  {
    s.face_nodes.insert(s.face_nodes.end(), nodes.begin(), nodes.end());
    s.face_offset.push_back(static_cast<std::int32_t>(s.face_nodes.size()));
    s.face_interface.push_back(0);
  };
  for (int j = 0; j < (dim == 3 ? n : 1); ++j)
    for (int i = 0; i < n; ++i)
    {
      const std::int32_t a = j * (n + 1) + i, b = a + 1, c = b + n + 1, d = a + n + 1;
      if (dim == 2)
        up ? add({b, a}) : add({a, b});
      else
        up ? add({a, b, c, d}) : add({a, d, c, b});
    }
  return s;
}

/// Medians of some runs on the wall and of this process's processor time [ms].
struct Milliseconds
{
  double wall = 0.0, cpu = 0.0;

  Milliseconds(std::size_t runs, const std::function<void()>& work)
  {
    std::vector<double> walls(runs), cpus(runs);
    for (std::size_t k = 0; k < runs; ++k)
    {
      const auto begin = std::chrono::steady_clock::now();
      const auto cpu_begin = std::clock();
      work();
      walls[k] = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
      cpus[k] = static_cast<double>(std::clock() - cpu_begin) / CLOCKS_PER_SEC;
    }
    std::sort(walls.begin(), walls.end());
    std::sort(cpus.begin(), cpus.end());
    wall = 1e3 * walls[runs / 2];
    cpu = 1e3 * cpus[runs / 2];
  }
};

/// Right-hand sides that turn slowly, as from one fine step to the next.
Vector right_side(Eigen::Index n, int k)
{
  Vector b(n);
  for (Eigen::Index i = 0; i < n; ++i)
    b[i] = std::sin(20.0 * static_cast<double>(i) / static_cast<double>(n) + 0.02 * k);
  return b;
}

/// The 20 solutions of a window, each from where the last two point to.
void window(InterfaceOperator& H, double ratio)
{
  Vector last = Vector::Zero(H.n_multipliers()), before = last;
  for (int k = 0; k < 20; ++k)
    before = std::exchange(last, H.solve(1.0, ratio, right_side(last.size(), k), 2.0 * last - before));
}

void row_of(int dim, double nodes, const link::Team& team)
{
  const int n = static_cast<int>(std::lround(dim == 2 ? nodes : std::sqrt(nodes))) - 1;
  const std::size_t runs = nodes > 50000.0 ? 1 : nodes > 5000.0 ? 3 : 5;
  std::printf("| %s | %d", dim == 2 ? "curve" : "surface", team.size());
  for (const char* solver : {"factor", "gradients"})
  {
    CouplingConfig coupling;
    coupling.interfaces.push_back({.name = "wet",
                                   .fluid = "wet",
                                   .solid = "wet",
                                   .kind = "slip",
                                   .separation = false,
                                   .multiplier = "fluid"});
    coupling.solver = solver;
    Interface interface(coupling, surface(dim, n, true), surface(dim, std::max(1, 4 * n / 5), false), 0.9,
                        &team);
    InterfaceOperator H;
    const Milliseconds build(runs, [&] { H = interface.build(); });
    std::printf(" | %ld | %.3g (%.3g)", static_cast<long>(H.n_multipliers()), build.wall, build.cpu);
    double ratio = 20.0;
    if (coupling.solver == "factor")
    {
      const Milliseconds factor(runs, [&] { H.solve(1.0, ratio *= 0.99, right_side(H.n_multipliers(), 0)); });
      std::printf(" | %.3g", factor.cpu);
      const Milliseconds solve(runs, [&] { window(H, ratio); });
      std::printf(" | %.3g", solve.cpu / 20.0);
      continue;
    }
    for (const double steps : {1.0, 20.0})
    {
      const std::int64_t before = H.iterations();
      const Milliseconds solve(runs, [&] { window(H, steps); });
      std::printf(" | %.3g (%.3g), %.0f", solve.wall / 20.0, solve.cpu / 20.0,
                  static_cast<double>(H.iterations() - before) / (20.0 * static_cast<double>(runs)));
    }
  }
  std::printf(" |\n");
  std::fflush(stdout);
}

} // namespace

int main(int argc, char** argv)
{
  MPI_Init(&argc, &argv);
  {
    const link::Team team(MPI_COMM_WORLD, 0.0);
    if (team.rank() > 0)
      help(team);
    else
    {
      for (int k = 2; k < argc; ++k)
        row_of(std::atoi(argv[1]), std::atof(argv[k]), team);
      dismiss_helpers(team);
    }
  }
  MPI_Finalize();
}
