// What an interface of growing size costs the coupler: integrals, operator, factor, solution; and what the
// solution would cost by conjugate gradients. Run by mpirun,
// on one and several ranks; the numbers are in docs/benchmarks/scaling.md.
//
// mpirun -n 2 interface_speed DIM NODES...      wet nodes of the fluid's side; the solid's is 0.8 times as
// fine
#include "coupler/interface.hpp"
#include "coupler/mortar.hpp"

#include <Eigen/IterativeLinearSolvers>
#include <mpi.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>

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

/// Medians of five on the wall and of this process's processor time [ms].
struct Milliseconds
{
  double wall = 0.0, cpu = 0.0;

  explicit Milliseconds(const std::function<void()>& work)
  {
    std::array<double, 5> walls{}, cpus{};
    for (std::size_t k = 0; k < 5; ++k)
    {
      const auto begin = std::chrono::steady_clock::now();
      const auto cpu_begin = std::clock();
      work();
      walls[k] = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
      cpus[k] = static_cast<double>(std::clock() - cpu_begin) / CLOCKS_PER_SEC;
    }
    std::sort(walls.begin(), walls.end());
    std::sort(cpus.begin(), cpus.end());
    wall = 1e3 * walls[2];
    cpu = 1e3 * cpus[2];
  }
};

} // namespace

int main(int argc, char** argv)
{
  MPI_Init(&argc, &argv);
  {
    const link::Team team(MPI_COMM_WORLD, 0.0);
    if (team.rank() > 0)
      help_with_mortars(team);
    else
    {
      const int dim = std::atoi(argv[1]);
      for (int k = 2; k < argc; ++k)
      {
        const double nodes = std::atof(argv[k]);
        const int n = static_cast<int>(std::lround(dim == 2 ? nodes : std::sqrt(nodes))) - 1;
        CouplingConfig coupling;
        coupling.interfaces.push_back({.name = "wet",
                                       .fluid = "wet",
                                       .solid = "wet",
                                       .kind = "slip",
                                       .separation = false,
                                       .multiplier = "fluid"});
        Interface interface(coupling, surface(dim, n, true), surface(dim, std::max(1, 4 * n / 5), false), 0.9,
                            &team);
        InterfaceOperator H;
        const Milliseconds build([&] { H = interface.build(); });
        const Vector rhs = Vector::LinSpaced(H.n_multipliers(), 1.0, 2.0);
        double dt = 1e-3;
        const Milliseconds factor(
            [&]
            {
              dt *= 0.99; // other weights: a new factor
              H.solve(dt, dt, rhs);
            });
        const Milliseconds solve([&] { H.solve(dt, dt, rhs); });
        // From zero, as a restart needs it; steps of 1 : 1 and 20 : 1.
        std::array<double, 2> gradients{}, iterations{};
        for (const int ratio : {1, 20})
        {
          const SparseMatrix A = H.assemble(1.0, ratio);
          Eigen::ConjugateGradient<SparseMatrix, Eigen::Lower | Eigen::Upper> solver(A);
          solver.setTolerance(1e-8);
          Vector x;
          gradients[ratio > 1] = Milliseconds([&] { x = solver.solve(rhs); }).cpu;
          iterations[ratio > 1] = static_cast<double>(solver.iterations());
        }
        std::printf("| %d | %ld | %d | %.3g | %.3g | %.3g | %.3g | %.3g (%.0f) | %.3g (%.0f) |\n", dim,
                    static_cast<long>(H.n_multipliers()), team.size(), build.wall, build.cpu, factor.cpu,
                    solve.cpu, gradients[0], iterations[0], gradients[1], iterations[1]);
        std::fflush(stdout);
      }
      dismiss_helpers(team);
    }
  }
  MPI_Finalize();
}
