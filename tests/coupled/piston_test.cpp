// A piston on a spring moves a column of water: two frequencies with the far end closed and open, and the
// decay where waves leave, against closed forms.
#include "tests/coupled/in_memory.hpp"

#include <catch2/catch.hpp>

#include <cmath>
#include <vector>

using namespace undine;
using undine::test::run_in_memory;

namespace
{

// Per unit area: mass and spring of the piston; water.
constexpr double m = 1000.0, k = 1e9, length = 1.0, rho = 1000.0, modulus = 2.2e9, v0 = 0.01;

struct Motion
{
  std::vector<double> t, x;  ///< of the piston [s], [m]
  std::int64_t substeps = 0; ///< of the water in a window
};

/// The solid is one linear element across, held at its left side: exactly a lumped mass ½ρ_s d on a spring
/// E/d.
/// @param end of the column: "slip" (closed), "free" or "impedance"
/// @param shape formula of the water's velocity at the start, of x [m/s]
Motion run(int elements, const std::string& end, const std::string& shape, double t_end)
{
  constexpr double d = 0.1, height = 0.1;
  fluid::FluidConfig f;
  f.tait = {.rho0 = rho, .p0 = 0.0, .B = modulus / 7.0, .gamma = 7.0};
  f.size = {length, height, 0.0};
  f.element_size = length / elements;
  f.seeding.pattern = fluid::Pattern::lattice;
  f.terms = {};
  f.remesh.every = 0;
  f.interfaces = {{"piston", "left"}};
  f.walls = {{"bottom"}, {"top"}};
  if (end != "free")
    f.walls.push_back({"right", end == "slip" ? fluid::WallKind::slip : fluid::WallKind::impedance});
  f.initial_velocity = {Expression(shape, "shape"), Expression("0", "shape")};
  solid::SolidConfig s;
  s.geometry.origin = {-d, 0.0};
  s.geometry.size = {d, height};
  s.geometry.elements = {1, elements / 10};
  s.material = {.density = 2.0 * m / d, .youngs_modulus = k * d, .poisson_ratio = 0.0, .law = "linear"};
  s.gravity = {0.0, 0.0};
  s.initial_velocity = {v0, 0.0};
  s.fix = {{"left", {"x", "y"}}, {"bottom", {"y"}}, {"top", {"y"}}};
  s.wet = {{"piston", "right"}};
  fluid::Fluid<2> fluid(f);
  solid::Solid<2> solid(s, solid::make_mesh<2>(s));
  coupler::CouplerConfig config;
  config.run.dim = 2;
  config.run.t_end = t_end;
  config.coupling.present = true;
  config.coupling.interfaces = {{"piston", "left", "right", "slip", false, "finer"}};
  config.coupling.dt_max = 0.001 / elements;
  std::size_t face = 0;
  while (solid.nodes().X[face][0] < -0.5 * d)
    ++face;
  Motion motion;
  run_in_memory(fluid, solid, config,
                [&](const coupler::WindowRecord& r)
                {
                  motion.t.push_back(r.plan.t_end);
                  motion.x.push_back(solid.nodes().u[face][0]);
                  motion.substeps = std::max(motion.substeps, r.plan.steps.m);
                });
  return motion;
}

/// Mean over whole half periods, from the times at which x passes zero [Hz].
double frequency(const Motion& motion)
{
  std::vector<double> zero;
  for (std::size_t n = 1; n < motion.t.size(); ++n)
    if (motion.x[n - 1] * motion.x[n] < 0.0)
      zero.push_back(motion.t[n - 1] +
                     (motion.t[n] - motion.t[n - 1]) * motion.x[n - 1] / (motion.x[n - 1] - motion.x[n]));
  return 0.5 * static_cast<double>(zero.size() - 1) / (zero.back() - zero.front());
}

/// Root of the characteristic equation next to `guess` [Hz].
template <class Function>
double root(const Function& characteristic, double guess)
{
  double a = 0.95 * guess, b = 1.05 * guess;
  for (int i = 0; i < 60; ++i)
    (characteristic(a) * characteristic(0.5 * (a + b)) <= 0.0 ? b : a) = 0.5 * (a + b);
  return 0.5 * (a + b);
}

} // namespace

// m ω² = k + Z ω cot(ωL/c) with the far end closed, k − Z ω tan(ωL/c) with it open (p = 0). The run starts in
// the mode, with Mach number 7e-6. Linear elements: (kh)²/24 = 5e-4 for the highest of these modes, 5000
// rad/s, at h = 1/40 m, and the window of 25 us takes (ωΔt)²/24 = 7e-4; together below 0.2 %, where 0.5 % is
// asked for; at twice the resolution, windows halved too, a quarter.
TEST_CASE("a piston on a spring with a column of water has its frequencies", "[coupled][verification]")
{
  const double c = std::sqrt(modulus / rho), Z = rho * c, pi = std::acos(-1.0);
  const auto closed = [&](double f)
  { return m * 4 * pi * pi * f * f - k - Z * 2 * pi * f / std::tan(2 * pi * f * length / c); };
  const auto open = [&](double f)
  { return m * 4 * pi * pi * f * f - k + Z * 2 * pi * f * std::tan(2 * pi * f * length / c); };
  for (const auto& [end, guess] :
       {std::pair{"slip", 244.0}, {"slip", 811.0}, {"free", 110.0}, {"free", 488.0}})
  {
    const bool is_closed = end == std::string("slip");
    const double f = is_closed ? root(closed, guess) : root(open, guess), q = 2 * pi * f / c;
    const std::string g = is_closed ? "sin" : "cos";
    const std::string shape = std::to_string(v0 / (is_closed ? std::sin(q * length) : std::cos(q * length))) +
                              "*" + g + "(" + std::to_string(q) + "*(" + std::to_string(length) + "-x))";
    double error[2];
    std::int64_t substeps = 0;
    for (int n = 0; n < 2; ++n)
    {
      const Motion motion = run(n == 0 ? 20 : 40, end, shape, 8.3 / f);
      error[n] = frequency(motion) / f - 1.0;
      substeps = motion.substeps;
    }
    INFO(end << " end: " << f << " Hz, off by " << error[0] << ", " << error[1] << " at 20, 40 elements; "
             << substeps << " steps of the water in a window");
    CHECK(substeps > 1);
    CHECK(std::abs(error[1]) < 0.002);
    CHECK(std::abs(error[1]) < 0.35 * std::abs(error[0]) + 1e-4);
  }
}

// Waves that leave damp: x = v₀/ω_d e^{−at} sin ω_d t, a = Z/2m, as long as no wave comes back. 1 % is asked
// for; the pressure jumps to Z v₀ at the start, which linear elements smear over a few h.
TEST_CASE("a piston is damped by the waves it sends off", "[coupled][verification]")
{
  const double Z = std::sqrt(modulus * rho), a = 0.5 * Z / m, wd = std::sqrt(k / m - a * a);
  double error[2];
  for (int n = 0; n < 2; ++n)
  {
    const Motion motion = run(n == 0 ? 20 : 40, "impedance", "0", 0.006742);
    double worst = 0.0, largest = 0.0;
    for (std::size_t i = 0; i < motion.t.size(); ++i)
    {
      const double x = v0 / wd * std::exp(-a * motion.t[i]) * std::sin(wd * motion.t[i]);
      worst = std::max(worst, std::abs(motion.x[i] - x));
      largest = std::max(largest, std::abs(x));
    }
    error[n] = worst / largest;
  }
  INFO("off by " << error[0] << ", " << error[1] << " of the largest displacement at 20, 40 elements");
  CHECK(error[1] < 0.01);
  CHECK(error[1] < 0.6 * error[0]);
}
