// Waves in bars: step load, smooth pulse, gravity; exact solutions and orders of convergence.
#include "solid_fe/solid.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

#include <cmath>
#include <fstream>
#include <numbers>
#include <sstream>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

constexpr double pi = std::numbers::pi;

/// A bar of length 1 along axis `axis`, `cells` elements long and one element across.
template <int dim>
Mesh<dim> bar_mesh(ElementType type, int cells, int axis)
{
  Vec<dim> size;
  std::array<int, dim> counts{};
  for (int i = 0; i < dim; ++i)
  {
    size[i] = i == axis ? 1.0 : 1.0 / cells;
    counts[static_cast<std::size_t>(i)] = i == axis ? cells : 1;
  }
  return box_mesh<dim>(Vec<dim>{}, size, counts, type);
}

/// Steel without lateral strain (benchmark S1): c = 5188.7452 m/s.
SolidConfig steel_bar(int dim)
{
  SolidConfig config;
  config.dim = dim;
  config.material = {.density = 7800.0, .youngs_modulus = 210e9, .poisson_ratio = 0.0, .law = "linear"};
  return config;
}

template <int dim>
double mean_displacement(const Solid<dim>& solid, int axis, double at)
{
  double sum = 0.0;
  int count = 0;
  for (std::size_t n = 0; n < solid.nodes().X.size(); ++n)
    if (std::abs(solid.nodes().X[n][axis] - at) < 1e-9)
    {
      sum += solid.nodes().u[n][axis];
      ++count;
    }
  return sum / count;
}

/// Root mean square over the nodes of u_axis − exact(X_axis).
template <int dim>
double displacement_error(const Solid<dim>& solid, int axis, const std::function<double(double)>& exact)
{
  double sum = 0.0, mass = 0.0;
  for (std::size_t n = 0; n < solid.nodes().X.size(); ++n)
  {
    const double error = solid.nodes().u[n][axis] - exact(solid.nodes().X[n][axis]);
    sum += solid.nodes().m[n] * error * error;
    mass += solid.nodes().m[n];
  }
  return std::sqrt(sum / mass);
}

template <int dim>
void advance(Solid<dim>& solid, double t_end)
{
  const auto steps = static_cast<int>(std::ceil(t_end / solid.critical_time_step()));
  const double dt = t_end / steps;
  for (int k = 0; k < steps; ++k)
  {
    solid.predict(dt);
    solid.solve_free_motion(dt);
  }
}

/// t, u_tip, base stress of tests/solid_fe/data/s1_bar_step_load.csv.
std::vector<std::array<double, 3>> step_load_reference()
{
  std::ifstream file(SOLID_TEST_DATA "/s1_bar_step_load.csv");
  REQUIRE(file);
  std::vector<std::array<double, 3>> rows;
  for (std::string line; std::getline(file, line);)
  {
    std::array<double, 3> row{};
    if (std::sscanf(line.c_str(), "%lf,%lf,%lf", &row[0], &row[1], &row[2]) == 3)
      rows.push_back(row);
  }
  return rows;
}

/// Relative L2 error over time of the tip displacement under a step load (benchmark S1).
template <int dim>
double step_load_error(ElementType type, int cells)
{
  auto config = steel_bar(dim);
  std::vector<double> traction(dim, 0.0);
  traction[0] = 1e6;
  config.traction = {{.on = "right", .value = traction, .ramp = 0.0}};
  config.fix = {{"left", {"x"}}, {"bottom", {"y"}}};
  if (dim == 3)
    config.fix.push_back({"back", {"z"}});
  Solid<dim> solid(config, bar_mesh<dim>(type, cells, 0));

  const auto reference = step_load_reference();
  REQUIRE(reference.size() > 100);
  double error2 = 0.0, norm2 = 0.0;
  for (std::size_t k = 1; k < reference.size(); ++k)
  {
    advance(solid, reference[k][0] - reference[k - 1][0]);
    const double u = mean_displacement(solid, 0, 1.0);
    error2 += (u - reference[k][1]) * (u - reference[k][1]);
    norm2 += reference[k][1] * reference[k][1];
  }
  return std::sqrt(error2 / norm2);
}

/// Error of a Gaussian displacement pulse in a free-free bar after it has passed an end, relative to its
/// height.
template <int dim>
double pulse_error(ElementType type, int cells, int axis)
{
  auto config = steel_bar(dim);
  if (dim == 2 && type == ElementType::triangle3)
    config.fix = {{axis == 0 ? "bottom" : "left", {axis == 0 ? "y" : "x"}},
                  {axis == 0 ? "top" : "right", {axis == 0 ? "y" : "x"}}};
  Solid<dim> solid(config, bar_mesh<dim>(type, cells, axis));
  const double c = std::sqrt(210e9 / 7800.0), width = 0.1, height = 1e-6;
  const auto pulse = [=](double x) { return height * std::exp(-x * x / (width * width)); };
  solid.set_motion(
      [&](const Vec<dim>& X)
      {
        Vec<dim> u;
        u[axis] = pulse(X[axis] - 0.5);
        return u;
      },
      zero_field<dim>());
  const double t_end = 0.8 / c;
  advance(solid, t_end);
  // d'Alembert with even images at both free ends.
  const auto exact = [&](double x)
  {
    double u = 0.0;
    for (int k = -2; k <= 2; ++k)
      for (const double way : {-c * t_end, c * t_end})
        u += 0.5 * (pulse(x - 0.5 + 2 * k - way) + pulse(-x - 0.5 + 2 * k - way));
    return u;
  };
  return displacement_error<dim>(solid, axis, exact) / height;
}

/// Relative error of a clamped column between rollers under gravity after `periods` of the first mode.
/// u = u_s(y) + Σ B_n sin(k_n y) cos(c k_n t), u_s = −g/c² (L y − y²/2), k_n = (2n−1) π / 2L.
/// From rest, B_n = 2 g / (L c² k_n³); or from the statics plus the first and third mode, B_1 = −|u_s(L)|,
/// B_3 = −B_1/3.
template <int dim>
double gravity_error(ElementType type, int cells, double periods, bool from_rest)
{
  auto config = soft_config(dim, "linear");
  config.material.poisson_ratio = 0.4;
  config.gravity = std::vector<double>(dim, 0.0);
  config.gravity[1] = -10.0;
  config.fix = {{"bottom", {"x", "y"}}, {"left", {"x"}}, {"right", {"x"}}};
  if (dim == 3)
  {
    config.fix.push_back({"back", {"z"}});
    config.fix.push_back({"front", {"z"}});
  }
  Solid<dim> solid(config, bar_mesh<dim>(type, cells, 1));
  const auto elastic = elastic_constants(1e6, 0.4);
  const double c = std::sqrt((elastic.lame_lambda + 2.0 * elastic.shear_modulus) / 1000.0), g = 10.0;
  const double tip = 0.5 * g / (c * c);
  const auto exact = [&](double y, double t)
  {
    double u = -g / (c * c) * (y - 0.5 * y * y);
    const auto add_mode = [&](int n, double amplitude)
    {
      const double k = (2 * n - 1) * 0.5 * pi;
      u += amplitude * std::sin(k * y) * std::cos(c * k * t);
    };
    if (from_rest)
      for (int n = 1; n <= 2000; ++n)
        add_mode(n, 2.0 * g / (c * c * std::pow((2 * n - 1) * 0.5 * pi, 3)));
    else
    {
      add_mode(1, -tip);
      add_mode(3, tip / 3.0);
    }
    return u;
  };
  if (!from_rest)
    solid.set_motion(
        [&](const Vec<dim>& X)
        {
          Vec<dim> u;
          u[1] = exact(X[1], 0.0);
          return u;
        },
        zero_field<dim>());
  const double t_end = periods * 4.0 / c;
  advance(solid, t_end);
  return displacement_error<dim>(solid, 1, [&](double y) { return exact(y, t_end); }) / tip;
}

} // namespace

TEMPLATE_TEST_CASE_SIG("a bar under a step load follows the exact saw-tooth (S1)", "[solid][verification]",
                       ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
  {
    const double error = step_load_error<dim>(type, 100);
    INFO(element_name(type) << ": S1 u_tip L2 error at 100 elements " << error);
    CHECK(error < 0.01); // gate of benchmark S1
  }
}

TEMPLATE_TEST_CASE_SIG("a smooth pulse converges with order 2", "[solid][verification]", ((int dim), dim), 2,
                       3)
{
  for (const auto type : element_types<dim>())
  {
    const double e50 = pulse_error<dim>(type, 50, 0), e100 = pulse_error<dim>(type, 100, 0),
                 e200 = pulse_error<dim>(type, 200, 0);
    INFO(element_name(type) << ": pulse errors " << e50 << " " << e100 << " " << e200 << ", orders "
                            << std::log2(e50 / e100) << " " << std::log2(e100 / e200));
    CHECK(std::log2(e50 / e100) > 1.9);
    CHECK(std::log2(e100 / e200) > 1.9); // 2, less what the coarsest mesh still misses
  }
}

TEMPLATE_TEST_CASE_SIG("a column that swings about its statics under gravity converges with order 2",
                       "[solid][verification]", ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
  {
    const double e20 = gravity_error<dim>(type, 20, 1.37, false),
                 e40 = gravity_error<dim>(type, 40, 1.37, false),
                 e80 = gravity_error<dim>(type, 80, 1.37, false);
    INFO(element_name(type) << ": errors " << e20 << " " << e40 << " " << e80 << ", orders "
                            << std::log2(e20 / e40) << " " << std::log2(e40 / e80));
    CHECK(std::log2(e20 / e40) > 1.8);
    CHECK(std::log2(e40 / e80) > 1.9);
  }
}

// Gravity switched on at t = 0 sends a front across which the strain rate jumps: u lies in H^s, s < 5/2,
// where a second-order scheme with linear elements converges with order 2 s / 3 < 5/3.
TEMPLATE_TEST_CASE_SIG("a column released under gravity follows the modal series", "[solid][verification]",
                       ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
  {
    const double e20 = gravity_error<dim>(type, 20, 1.37, true),
                 e80 = gravity_error<dim>(type, 80, 1.37, true);
    INFO(element_name(type) << ": errors " << e20 << " " << e80 << ", order " << 0.5 * std::log2(e20 / e80));
    CHECK(e80 < 5e-4);
    CHECK(0.5 * std::log2(e20 / e80) > 1.4);
  }
}
