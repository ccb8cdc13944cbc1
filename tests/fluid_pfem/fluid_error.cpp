// Error and CPU time of four flows with a known answer: one line of JSON per flow and resolution.
//
//   fluid_error            standing wave, drop, tank and dam break at four resolutions each
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/run.hpp"
#include "tests/fluid_pfem/fixtures.hpp"
#include "tests/support/clocks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

using namespace undine;
using namespace undine::fluid;
using test::cpu_seconds;

namespace
{

void print(const char* flow, int resolution, const Fluid<2>& fluid, double cpu, double error)
{
  fmt::print("{{\"flow\": \"{}\", \"resolution\": {}, \"nodes\": {}, \"steps\": {}, \"cpu_s\": {:.4f}, "
             "\"error\": {:.3e}}}\n",
             flow, resolution, fluid.nodes().size(), fluid.steps(), cpu, error);
  std::fflush(stdout);
}

/// Mean distance of successive upward crossings of `level`.
double period(const std::vector<double>& t, const std::vector<double>& y, double level)
{
  std::vector<double> crossing;
  for (std::size_t k = 1; k < t.size(); ++k)
    if (y[k - 1] < level && y[k] >= level)
      crossing.push_back(t[k - 1] + (level - y[k - 1]) / (y[k] - y[k - 1]) * (t[k] - t[k - 1]));
  return (crossing.back() - crossing.front()) / static_cast<double>(crossing.size() - 1);
}

/// Period of the first mode, amplitude 0.01 H, against linear theory with its two small corrections.
void standing_wave(int n)
{
  FluidConfig config = test::hydraulic(1.0 / n, 31.32);
  config.gravity = {0.0, -9.81, 0.0};
  config.initial_pressure = InitialPressure::hydrostatic;
  config.walls = {{"left"}, {"right"}, {"bottom"}};
  const double begin = cpu_seconds();
  Fluid<2> fluid(config);
  const double pi = std::acos(-1.0), omega = std::sqrt(9.81 * pi * std::tanh(pi)), a = 0.01;
  std::vector<Vec<2>> v;
  for (const auto& x : fluid.nodes().x)
    v.push_back({{-a * omega * std::cosh(pi * x[1]) / std::sinh(pi) * std::sin(pi * x[0]),
                  a * omega * std::sinh(pi * x[1]) / std::sinh(pi) * std::cos(pi * x[0])}});
  fluid.set_velocity(v);
  global_index_t corner = 0;
  for (std::size_t k = 0; k < fluid.nodes().x.size(); ++k)
    if (fluid.nodes().x[k][0] == 0.0 && fluid.nodes().x[k][1] == 1.0)
      corner = fluid.nodes().id[k];
  std::vector<double> t, y;
  run_alone<2>(fluid, {.t_end = 3.6}, 0.0,
               [&](double time, const Fluid<2>& f, bool)
               {
                 const auto it = std::find(f.nodes().id.begin(), f.nodes().id.end(), corner);
                 t.push_back(time);
                 y.push_back(f.nodes().x[static_cast<std::size_t>(it - f.nodes().id.begin())][1] - 1.0);
               });
  const double error = std::abs(period(t, y, 0.0) / (2.0 * pi / omega * (1.0 + 1.4e-4)) - 1.0);
  print("standing wave", n, fluid, cpu_seconds() - begin, error);
}

/// Period of the drop in the force −r, 4.82734.
void drop(int n)
{
  FluidConfig config = test::hydraulic(1.0 / n, 15.0);
  config.shape = Shape::ellipse;
  config.origin = {-1.0, -1.0, 0.0};
  config.size = {2.0, 2.0, 0.0};
  for (const char* f : {"x", "-y"})
    config.initial_velocity.emplace_back(f, "benchmark");
  for (const char* f : {"-x", "-y"})
    config.body_force.emplace_back(f, "benchmark");
  const double begin = cpu_seconds();
  Fluid<2> fluid(config);
  std::vector<double> t, y;
  run_alone<2>(fluid, {.t_end = 11.0}, 0.0,
               [&](double time, const Fluid<2>& f, bool)
               {
                 t.push_back(time);
                 y.push_back(test::front_of(f));
               });
  print("drop", n, fluid, cpu_seconds() - begin, std::abs(period(t, y, 1.2) / 4.82734 - 1.0));
}

/// Relative L2 error of the pressure of a tank whose inner nodes are displaced by up to a fifth of the
/// spacing, triangulated again every 20 steps, after 2 s.
void hydrostatic_tank(int n)
{
  FluidConfig config = test::hydraulic(1.0 / n, 31.32);
  config.gravity = {0.0, -9.81, 0.0};
  config.initial_pressure = InitialPressure::hydrostatic;
  config.seeding.jitter = 0.2;
  config.contact_walls = {test::tank(1.0)};
  config.remesh.only_if_moved = false;
  const double begin = cpu_seconds();
  Fluid<2> fluid(config);
  run_alone<2>(fluid, {.t_end = 2.0}, 0.0, [](double, const Fluid<2>&, bool) {});
  double error = 0.0, scale = 0.0;
  for (std::size_t k = 0; k < fluid.nodes().x.size(); ++k)
  {
    const double p = config.tait.pressure(
        config.tait.hydrostatic_density(9.81 * std::max(0.0, 1.0 - fluid.nodes().x[k][1])));
    error += fluid.nodes().V[k] * std::pow(fluid.nodes().p[k] - p, 2);
    scale += fluid.nodes().V[k] * p * p;
  }
  print("hydrostatic tank", n, fluid, cpu_seconds() - begin, std::sqrt(error / scale));
}

/// Front of the dam break at T = 1.98 against its own converged value, 2.65 ± 0.03.
void dam_break(int n)
{
  const double a = 0.146, T = std::sqrt(a / (2.0 * 9.81));
  const double begin = cpu_seconds();
  Fluid<2> fluid(test::dam_break_config(a / n));
  run_alone<2>(fluid, {.t_end = 1.98 * T}, 0.0, [](double, const Fluid<2>&, bool) {});
  print("dam-break front", n, fluid, cpu_seconds() - begin, std::abs(test::front_of(fluid) / a / 2.65 - 1.0));
}

} // namespace

int main()
{
  for (const int n : {10, 14, 20, 28})
    standing_wave(n);
  for (const int n : {6, 10, 14, 20})
    drop(n);
  for (const int n : {10, 20, 28, 40})
    hydrostatic_tank(n);
  for (const int n : {10, 16, 24, 36})
    dam_break(n);
  return 0;
}
