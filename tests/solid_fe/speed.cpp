// Time per element and step of the solid, and the memory bandwidth of the same machine in the same run.
//
//   build/release/tests/solid_speed [elements]            (default 100000)
//   build/release/tests/solid_speed --skips [elements]    what work that is left out would cost
#include "common/mesh/mesh.hpp"
#include "solid_fe/solid.hpp"
#include "tests/support/clocks.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

namespace
{

using namespace undine;
using namespace undine::solid;
using undine::test::wall_seconds;

/// Bytes per second of a ← b + s c over arrays that fit no cache, best of five (STREAM's triad).
double triad_bandwidth()
{
  const std::size_t n = 20'000'000;
  std::vector<double> a(n, 1.0), b(n, 2.0), c(n, 3.0);
  double best = std::numeric_limits<double>::infinity();
  for (int repeat = 0; repeat < 5; ++repeat)
  {
    const double begin = wall_seconds();
    for (std::size_t k = 0; k < n; ++k)
      a[k] = b[k] + 3.0 * c[k];
    best = std::min(best, wall_seconds() - begin);
    b[static_cast<std::size_t>(repeat)] = a[n / 2];
  }
  return 24.0 * static_cast<double>(n) / best;
}

/// Bytes that one step has to read and write at least, per element: geometry, node numbers, history (twice).
template <int dim>
double bytes_per_element(const Solid<dim>& solid)
{
  double bytes = 0.0;
  for (const auto& body : solid.bodies())
    std::visit(
        [&]<class Element>(const ReferenceBlock<Element>& block)
        {
          bytes += static_cast<double>(block.pack.size() * sizeof(block.pack[0]) +
                                       block.nodes.size() * sizeof(block.nodes[0]) +
                                       2 * body.state.history.size() * sizeof(Lanes));
        },
        body.block);
  // u, v, a, F_int, F_ext, inverse mass: about ten passes over vectors of the nodes
  bytes += 10.0 * static_cast<double>(solid.nodes().size() * sizeof(Vec<dim>));
  return bytes / solid.n_elements();
}

/// ns per element and step of whole steps, best of five; `strain_rate` makes a plastic body yield everywhere.
template <int dim>
void measure(const char* name, ElementType type, Formulation formulation, const char* law, bool flows,
             double elements, double bandwidth)
{
  SolidConfig config;
  config.dim = dim;
  config.formulation = formulation;
  config.material = {.density = 1000.0, .youngs_modulus = 1e6, .poisson_ratio = 0.3, .law = law};
  if (std::string_view(law) == "j2")
  {
    config.material.yield_stress = flows ? 1.0 : 1e9;
    config.material.hardening_modulus = 1e3;
  }
  const double per_cell = type == ElementType::triangle3      ? 2.0
                          : type == ElementType::tetrahedron4 ? 6.0
                                                              : 1.0;
  const int n = static_cast<int>(std::lround(std::pow(elements / per_cell, 1.0 / dim)));
  std::array<int, dim> cells;
  cells.fill(n);
  Vec<dim> size;
  for (auto& x : size.c)
    x = 1.0;
  Solid<dim> solid(config, box_mesh<dim>({}, size, cells, type));
  solid.set_motion([](const Vec<dim>&) { return Vec<dim>{}; },
                   [](const Vec<dim>& X)
                   {
                     Vec<dim> v;
                     v[0] = X[1];
                     v[1] = -0.3 * X[0];
                     return v;
                   });
  const double dt = 0.3 * solid.critical_time_step();
  const int steps = 20;
  double best = std::numeric_limits<double>::infinity();
  for (int repeat = 0; repeat < 5; ++repeat)
  {
    const double begin = wall_seconds();
    for (int k = 0; k < steps; ++k)
    {
      solid.predict(dt);
      solid.solve_free_motion(dt);
    }
    best = std::min(best, wall_seconds() - begin);
  }
  const double begin = wall_seconds();
  const double bound = solid.critical_time_step();
  const double look = wall_seconds() - begin;
  const double count = static_cast<double>(solid.n_elements());
  const double ns = 1e9 * best / steps / count, bytes = bytes_per_element(solid);
  std::printf("| %-16s | %-22s | %8d | %8.1f | %6.0f | %6.2f | %8.1f |\n", name, flows ? "j2, flowing" : law,
              solid.n_elements(), ns, bytes, bytes / ns * 1e9 / bandwidth,
              bound > 0.0 ? 1e9 * look / count : 0.0);
}

/// ns per element and step of two solids in turn, median of nine.
template <int dim>
std::pair<double, double> beside(Solid<dim>& a, Solid<dim>& b)
{
  const double dt = 0.3 * std::min(a.critical_time_step(), b.critical_time_step());
  std::vector<double> of_a, of_b;
  for (int repeat = 0; repeat < 9; ++repeat)
    for (auto* solid : {&a, &b})
    {
      const double begin = wall_seconds();
      for (int k = 0; k < 10; ++k)
      {
        solid->predict(dt);
        solid->solve_free_motion(dt);
      }
      (solid == &a ? of_a : of_b).push_back(1e8 * (wall_seconds() - begin) / solid->n_elements());
    }
  std::sort(of_a.begin(), of_a.end());
  std::sort(of_b.begin(), of_b.end());
  return {of_a[4], of_b[4]};
}

/// What skipping saves: the same answers, see skips_test.cpp and plasticity_test.cpp.
template <int dim>
void measure_skips(double elements)
{
  const int n = static_cast<int>(std::lround(std::pow(elements, 1.0 / dim)));
  std::array<int, dim> cells;
  cells.fill(n);
  Vec<dim> size;
  for (auto& x : size.c)
    x = 1.0;
  auto mesh =
      box_mesh<dim>({}, size, cells, dim == 2 ? ElementType::quadrilateral4 : ElementType::hexahedron8);
  for (index_t k = 0; k < mesh.n_nodes(); ++k)
    if (mesh.x[static_cast<std::size_t>(k)][0] < 0.5 + 1e-9)
      mesh.node_sets["half"].push_back(k);
  SolidConfig plain;
  plain.dim = dim;
  plain.formulation = Formulation::one_point;
  plain.material = {.density = 1000.0, .youngs_modulus = 1e6, .poisson_ratio = 0.3, .law = "neo_hookean_ln"};
  const auto report = [&](const char* what, const SolidConfig& with_skip, const SolidConfig& without)
  {
    Solid<dim> a(with_skip, mesh), b(without, mesh);
    const auto [skipped, worked] = beside(a, b);
    std::printf("| %s | %s | %.1f | %.1f | %.2f |\n", dim == 2 ? "Q4" : "Hex8", what, skipped, worked,
                worked / skipped);
    std::fflush(stdout);
  };
  auto a = plain, b = plain;
  a.rigid = b.rigid = {"half"};
  b.skips_idle_elements = false;
  report("one half is a rigid body: not integrated, or integrated", a, b);
  a = b = plain;
  a.fix = b.fix = {
      {"half", dim == 2 ? std::vector<std::string>{"x", "y"} : std::vector<std::string>{"x", "y", "z"}}};
  b.skips_idle_elements = false;
  report("one half is fixed: not integrated, or integrated", a, b);
  a = b = plain;
  b.contact = {{"left", "right", 0.0}};
  report("no contact pair, or one that never meets", a, b);
  a = b = plain;
  a.material.law = b.material.law = "j2";
  a.material.yield_stress = 1e9;
  b.material.yield_stress = 1.0;
  a.material.hardening_modulus = b.material.hardening_modulus = 1e3;
  a.initial_velocity_function = b.initial_velocity_function =
      dim == 2 ? std::vector<std::string>{"y", "-0.3*x"} : std::vector<std::string>{"y", "-0.3*x", "0"};
  report("j2 below yield, or flowing everywhere", a, b);
}

} // namespace

int main(int argc, char** argv)
{
  if (argc > 1 && std::string_view(argv[1]) == "--skips")
  {
    const double elements = argc > 2 ? std::atof(argv[2]) : 1e5;
    std::printf("| element | what | left out [ns] | done [ns] | ratio |\n| --- | --- | --- | --- | --- |\n");
    measure_skips<2>(elements);
    measure_skips<3>(elements);
    return 0;
  }
  const double elements = argc > 1 ? std::atof(argv[1]) : 1e5;
  const double bandwidth = triad_bandwidth();
  std::printf("triad: %.1f GB/s\n", 1e-9 * bandwidth);
  std::printf("| element | law | elements | ns per element and step | bytes | of the triad's bandwidth | ns "
              "per element of "
              "the step bound |\n| --- | --- | --- | --- | --- | --- | --- |\n");
  struct Law
  {
    const char* name;
    bool flows;
  };
  for (const auto& [law, flows] : {Law{"neo_hookean_ln", false}, Law{"j2", false}, Law{"j2", true}})
  {
    measure<2>("T3", ElementType::triangle3, Formulation::full, law, flows, elements, bandwidth);
    measure<2>("Q4 one point", ElementType::quadrilateral4, Formulation::one_point, law, flows, elements,
               bandwidth);
    measure<2>("Q4", ElementType::quadrilateral4, Formulation::full, law, flows, elements, bandwidth);
    measure<2>("Q4 locking free", ElementType::quadrilateral4, Formulation::locking_free, law, flows,
               elements, bandwidth);
    measure<3>("Tet4", ElementType::tetrahedron4, Formulation::full, law, flows, elements, bandwidth);
    measure<3>("Tet4 locking free", ElementType::tetrahedron4, Formulation::locking_free, law, flows,
               elements, bandwidth);
    measure<3>("Hex8 one point", ElementType::hexahedron8, Formulation::one_point, law, flows, elements,
               bandwidth);
    measure<3>("Hex8", ElementType::hexahedron8, Formulation::full, law, flows, elements, bandwidth);
  }
  return 0;
}
