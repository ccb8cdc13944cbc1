// Exact tests of the Gravouil-Combescure window with two bars and with the split oscillator.
#include "tests/coupler/bars.hpp"

#include <catch2/catch.hpp>

#include <array>
#include <vector>

using namespace undine::test;
using undine::coupler::other;
using undine::coupler::WindowSteps;

namespace
{

struct Pair
{
  Bar fluid, solid;
};

/// Two held bars of `n_f` and `n_s` elements whose densities differ by `mass_ratio` (solid over fluid) and
/// whose critical steps stand in the ratio that makes `m` fine fluid steps at `cfl` fill a solid step at
/// `cfl`.
Pair bars_with_ratio(int n_f, int n_s, double mass_ratio, double m)
{
  const double h_f = 1.0 / n_f, h_s = 1.0 / n_s;
  // critical step h/c: h_s/c_s = m h_f/c_f with c_f = 1.
  const double c_s = h_s / (m * h_f);
  const double rho_s = mass_ratio * h_f / h_s;
  return {Bar(n_f, 1.0, 1.0, 1.0, true), Bar(n_s, 1.0, rho_s, rho_s * c_s * c_s, true)};
}

/// The window map on (u, v of both bars, link force), assembled column by column through the code under test.
double radius_of_window(Pair& bars, const WindowSteps& steps)
{
  const Eigen::Index n_f = bars.fluid.n_nodes(), n_s = bars.solid.n_nodes();
  return spectral_radius(2 * (n_f + n_s) + 1,
                         [&](const Vector& state)
                         {
                           GravouilCombescure gc(glue(bars.fluid, bars.solid), 1);
                           const double link = state[2 * (n_f + n_s)];
                           Bar fluid = bars.fluid, solid = bars.solid;
                           fluid.u = state.segment(0, n_f);
                           fluid.v = state.segment(n_f, n_f);
                           solid.u = state.segment(2 * n_f, n_s);
                           solid.v = state.segment(2 * n_f + n_s, n_s);
                           fluid.u[n_f - 1] = fluid.v[n_f - 1] = solid.u[n_s - 1] = solid.v[n_s - 1] = 0.0;
                           fluid.a = fluid.free_acceleration();
                           solid.a = solid.free_acceleration();
                           fluid.a[0] += link / fluid.interface_mass();
                           solid.a[0] -= link / solid.interface_mass();
                           gc.restore({{fluid.v.head(1), solid.v.head(1)},
                                       {Vector::Constant(1, link), Vector::Constant(1, -link)}});
                           advance(gc, steps, fluid, solid);
                           Vector next(state.size());
                           next << fluid.u, fluid.v, solid.u, solid.v, fluid.last_link_force;
                           return next;
                         });
}

/// The same window written out independently, with the coarse velocity interpolated from its free (right) or
/// its total (wrong) value at the begin: what the spectral test must detect.
double radius_of_written_out_window(Pair& bars, const WindowSteps& steps, bool interpolate_total)
{
  const Eigen::Index n_f = bars.fluid.n_nodes(), n_s = bars.solid.n_nodes();
  return spectral_radius(2 * (n_f + n_s) + 1,
                         [&](const Vector& state)
                         {
                           Bar q = steps.fine == Side::fluid ? bars.fluid : bars.solid,
                               c = steps.fine == Side::fluid ? bars.solid : bars.fluid;
                           const Eigen::Index n_q = q.n_nodes(), n_c = c.n_nodes();
                           const double link = state[2 * (n_q + n_c)];
                           q.u = state.segment(0, n_q);
                           q.v = state.segment(n_q, n_q);
                           c.u = state.segment(2 * n_q, n_c);
                           c.v = state.segment(2 * n_q + n_c, n_c);
                           q.u[n_q - 1] = q.v[n_q - 1] = c.u[n_c - 1] = c.v[n_c - 1] = 0.0;
                           q.a = q.free_acceleration();
                           c.a = c.free_acceleration();
                           q.a[0] += link / q.interface_mass();
                           c.a[0] -= link / c.interface_mass();
                           q.dt = steps.fine_dt();
                           c.dt = steps.coarse_dt;
                           const double begin =
                               interpolate_total ? c.v[0] : c.v[0] + 0.5 * c.dt * link / c.interface_mass();
                           const double H = 0.5 * q.dt / q.interface_mass() + 0.5 * c.dt / c.interface_mass();
                           double end = 0.0, lambda = 0.0;
                           c.receive_free_velocity({&end, 1});
                           for (int j = 1; j <= steps.m; ++j)
                           {
                             double v = 0.0;
                             q.receive_free_velocity({&v, 1});
                             const double s = double(j) / double(steps.m);
                             lambda = ((1 - s) * begin + s * end - v) / H;
                             q.send_link_force(std::array{lambda});
                           }
                           c.send_link_force(std::array{-lambda});
                           Vector next(state.size());
                           next << q.u, q.v, c.u, c.v, lambda;
                           return next;
                         });
}

} // namespace

// Same central differences, same masses: gluing is merging the two interface nodes. 2000 steps with about 10
// roundings each accumulate like a random walk, 2000·10·2⁻⁵² ≈ 4e-12 at the very worst; a merged node is
// expected to hold 1e-12.
TEST_CASE("GC with equal steps equals the undivided bar", "[coupler][unit]")
{
  const int n = 40;
  Pair bars{Bar(n, 1.0, 1.0, 1.0, true), Bar(n, 1.0, 1.0, 1.0, true)};
  Bar whole(2 * n, 2.0, 1.0, 1.0, true); // nodes 0 … 2n; node n is the glued one
  for (int i = 0; i <= n; ++i)
  {
    const auto shape = [](double x) { return std::exp(-40.0 * x * x) * x; };
    const double x = double(i) / n;
    bars.fluid.v[i] = i < n ? shape(x - 0.4) : 0.0;
    bars.solid.v[i] = i < n ? bars.fluid.v[0] * (1 - x) : 0.0;
  }
  for (int i = 0; i <= n; ++i)
  {
    whole.v[n - i] = bars.fluid.v[i];
    whole.v[n + i] = bars.solid.v[i];
  }
  whole.v[0] = 0.0; // the far end of the fluid bar is held; node 0 of `whole` must be too: zero mass change,
                    // infinite load
  GravouilCombescure gc(glue(bars.fluid, bars.solid), 1);
  start(gc, bars.fluid, bars.solid);
  whole.a = whole.free_acceleration();
  whole.a[0] = 0.0;

  const double dt = 0.9 * bars.fluid.critical_step();
  double worst = 0.0;
  for (int step = 0; step < 2000; ++step)
  {
    advance(gc, {.fine = Side::fluid, .m = 1, .coarse_dt = dt}, bars.fluid, bars.solid);
    whole.v += 0.5 * dt * whole.a;
    whole.u += dt * whole.v;
    whole.a = whole.free_acceleration();
    whole.a[0] = 0.0;
    whole.v += 0.5 * dt * whole.a;
    for (int i = 0; i <= n; ++i)
    {
      worst = std::max(worst, std::abs(whole.u[n - i] - bars.fluid.u[i]));
      worst = std::max(worst, std::abs(whole.u[n + i] - bars.solid.u[i]));
    }
  }
  CAPTURE(worst);
  CHECK(worst < 1e-12 * whole.u.cwiseAbs().maxCoeff() + 1e-13);
}

// Energy theorem of the scheme: the window map is a contraction in a weighted norm, so its spectral radius
// is 1. Eigenvalues of modulus 1 are semi-simple; a dense eigenvalue solver finds them to about n·m·2⁻⁵² ≈
// 1e-11.
TEST_CASE("the window map never amplifies", "[coupler][verification]")
{
  const int m = GENERATE(1, 2, 5, 10, 50, 100, 250);
  const double mass_ratio = GENERATE(1e-3, 1.0, 100.0);
  const Side fine = GENERATE(Side::fluid, Side::solid);
  Pair bars = fine == Side::fluid ? bars_with_ratio(12, 30, mass_ratio, m)
                                  : bars_with_ratio(12, 30, mass_ratio, 1.0 / m);
  const Bar& coarse = fine == Side::fluid ? bars.solid : bars.fluid;
  const WindowSteps steps{.fine = fine, .m = m, .coarse_dt = 0.9 * coarse.critical_step()};
  const double radius = radius_of_window(bars, steps);
  CAPTURE(m, mass_ratio, fine, radius - 1.0);
  CHECK(radius <= 1.0 + 1e-9);
  // and the scheme written out again agrees with the code
  CHECK(radius_of_written_out_window(bars, steps, false) <= 1.0 + 1e-9);
}

TEST_CASE("interpolating the total coarse velocity is unstable, and the spectral test sees it",
          "[coupler][unit]")
{
  const int m = GENERATE(2, 5, 10, 50);
  double worst = 0.0;
  for (const double mass_ratio : {1e-3, 1.0, 100.0})
  {
    Pair bars = bars_with_ratio(12, 30, mass_ratio, m);
    const WindowSteps steps{.fine = Side::fluid, .m = m, .coarse_dt = 0.9 * bars.solid.critical_step()};
    worst = std::max(worst, radius_of_written_out_window(bars, steps, true) - 1.0);
  }
  CAPTURE(m, worst);
  CHECK(worst > 1e-3); // 1.5e-3 … 1.5e-2 in theory: six orders above what the window map may show
}

// ΔE₂ = −(1/Δt) Σ_j ‖[λ]_j − [λ]_window/m‖²_{H_c} per window, H_c = ½ΔT L_c M_c⁻¹ L_cᵀ; an identity, so
// round-off decides: energies of size E₂ are subtracted, 1e-12 E₂.
TEST_CASE("the interface loses what the energy theorem says", "[coupler][unit]")
{
  const int m = GENERATE(1, 2, 7, 20);
  const double mass_ratio = GENERATE(0.01, 1.0, 50.0);
  Pair bars = bars_with_ratio(20, 30, mass_ratio, m);
  for (int i = 0; i < 20; ++i)
    bars.fluid.v[i] = std::sin(0.3 * i) * (20 - i);
  GravouilCombescure gc(glue(bars.fluid, bars.solid), 1);
  start(gc, bars.fluid, bars.solid);

  const WindowSteps steps{.fine = Side::fluid, .m = m, .coarse_dt = 0.8 * bars.solid.critical_step()};
  std::vector<double> lambda{gc.lambda()[0]};
  bars.fluid.after_step = [&] { lambda.push_back(gc.lambda()[0]); };
  const auto second_energy = [&]
  { return bars.fluid.second_energy(steps.fine_dt()) + bars.solid.second_energy(steps.coarse_dt); };
  const double H_c = 0.5 * steps.coarse_dt / bars.solid.interface_mass();

  double before = second_energy();
  const double scale = before;
  for (int window = 0; window < 50; ++window)
  {
    lambda = {lambda.back()};
    advance(gc, steps, bars.fluid, bars.solid);
    double expected = 0.0;
    for (int j = 1; j <= m; ++j)
    {
      const double d = lambda[j] - lambda[j - 1] - (lambda[m] - lambda[0]) / m;
      expected -= H_c * d * d / steps.fine_dt();
    }
    const double after = second_energy();
    CAPTURE(m, mass_ratio, window, after - before, expected);
    CHECK(std::abs(after - before - expected) < 1e-12 * scale);
    before = after;
  }
}

// Fine steps are equal whatever the ratio of the stable steps: ΔT / ceil(ΔT/Δt). Undamped bars, 4000 windows,
// no growth: the energy may oscillate by the O(Δt²) of central differences but its last value is not above
// the first by more than that.
TEST_CASE("non-integer step ratios do not grow", "[coupler][unit]")
{
  const double ratio = GENERATE(2.5, 7.3, 30.7);
  Pair bars = bars_with_ratio(12, 30, 1.0, ratio);
  const double dT = 0.9 * bars.solid.critical_step();
  const auto m = static_cast<std::int64_t>(std::ceil(dT / (0.9 * bars.fluid.critical_step()) - 1e-9));
  const double radius = radius_of_window(bars, {.fine = Side::fluid, .m = m, .coarse_dt = dT});
  CAPTURE(ratio, m, radius - 1.0);
  CHECK(m == static_cast<std::int64_t>(std::ceil(ratio)));
  CHECK(radius <= 1.0 + 1e-9);
}

// Momentum and velocity: at each window end L_f v_f + L_s v_s = 0 and both link forces are equal and
// opposite, by construction to one rounding of numbers of size v and λ.
TEST_CASE("velocities meet and forces cancel at every window end", "[coupler][unit]")
{
  Pair bars = bars_with_ratio(12, 30, 3.0, 7);
  bars.fluid.v.head(12).setConstant(1.0);
  GravouilCombescure gc(glue(bars.fluid, bars.solid), 1);
  start(gc, bars.fluid, bars.solid);
  for (int window = 0; window < 200; ++window)
  {
    advance(gc, {.fine = Side::fluid, .m = 7, .coarse_dt = 0.9 * bars.solid.critical_step()}, bars.fluid,
            bars.solid);
    CHECK(std::abs(bars.fluid.v[0] - bars.solid.v[0]) < 1e-14);
    CHECK(bars.fluid.last_link_force == -bars.solid.last_link_force);
    CHECK(gc.balance().velocity_jump < 1e-14);
  }
}

// Conventional serial staggering (solid velocity to the fluid, its reaction back) multiplies a disturbance by
// the ratio of the interface masses per step: stable below one, divergent above. Causin, Gerbeau & Nobile
// (2005). GC does not care.
TEST_CASE("conventional staggering diverges once the fluid's interface mass exceeds the solid's; GC does not",
          "[coupler][unit]")
{
  const double q = GENERATE(0.5, 2.0, 10.0); // fluid over solid interface mass
  Pair bars = bars_with_ratio(12, 30, 1.0 / q, 1);
  const double dt = 0.5 * std::min(bars.fluid.critical_step(), bars.solid.critical_step());

  Pair s = bars;
  s.solid.v[0] = 1e-3;
  double reaction = 0.0; // of the fluid on the solid, one step old
  double largest = 0.0;
  for (int step = 0; step < 200 && largest < 1e6; ++step)
  {
    double v = 0.0;
    s.solid.dt = s.fluid.dt = dt;
    s.solid.receive_free_velocity({&v, 1});
    s.solid.send_link_force(std::array{reaction});
    // the fluid's interface node follows the solid's motion; its reaction includes the inertia of the node
    s.fluid.receive_free_velocity({&v, 1});
    const double a_solid = s.solid.a[0];
    reaction = -(s.fluid.interface_mass() * (a_solid - s.fluid.free_acceleration()[0]));
    s.fluid.v[0] = s.solid.v[0];
    s.fluid.u[0] = s.solid.u[0];
    s.fluid.a[0] = a_solid;
    largest = std::max(largest, std::abs(s.solid.v[0]));
  }
  bars.solid.v[0] = 1e-3;
  GravouilCombescure gc(glue(bars.fluid, bars.solid), 1);
  start(gc, bars.fluid, bars.solid);
  const double energy = bars.fluid.energy() + bars.solid.energy();
  for (int step = 0; step < 2000; ++step)
    advance(gc, {.fine = Side::fluid, .m = 1, .coarse_dt = dt}, bars.fluid, bars.solid);

  CAPTURE(q, largest);
  if (q > 1.0)
    CHECK(largest > 1e3);
  else
    CHECK(largest < 1e-2);
  // central differences at half the critical step: the energy oscillates by (ωΔt)²/4 ≤ 1/4 of itself at the
  // highest mode
  CHECK(bars.fluid.energy() + bars.solid.energy() < 1.5 * energy);
}

namespace
{

/// A Gaussian pulse of 1e5 Pa on its way from water (Z = ρc = 1.483e6) to aluminium (Z = 1.683e7), 0.5 m
/// before it; the aluminium takes m steps where the water takes one.
struct Pulse
{
  static constexpr double rho_f = 1000.0, K = 2.2e9, rho_s = 2700.0, M = 1.049e11, width = 0.05;
  double c_f = std::sqrt(K / rho_f), c_s = std::sqrt(M / rho_s), Z_f = rho_f * c_f, Z_s = rho_s * c_s,
         R = (Z_s - Z_f) / (Z_s + Z_f), h_f;
  WindowSteps steps;
  Bar fluid, solid;
  GravouilCombescure gc;

  /// @param elements over the pulse's width
  Pulse(int m, int elements)
      : h_f(width / elements), steps{.fine = Side::solid, .m = m, .coarse_dt = 0.9 * h_f / c_f},
        fluid(count(1.0 / h_f), 1.0, rho_f, K, false),
        solid(count(4.0 / h_s()), count(4.0 / h_s()) * h_s(), rho_s, M, true), gc(glue(fluid, solid), 1)
  {
    // wave running towards node 0: p = g(x + c t), v = −p/Z, strain u' = −p/K
    const auto pulse = [](double x) { return 1e5 * std::exp(-std::pow((x - 0.5) / width, 2)); };
    double u = 0.0;
    const auto n = static_cast<int>(fluid.n_nodes()) - 1;
    for (int i = n; i >= 0; --i)
    {
      fluid.v[i] = -pulse(i * h_f) / Z_f;
      if (i < n)
        u += h_f * pulse((i + 0.5) * h_f) / K;
      fluid.u[i] = u;
    }
    start(gc, fluid, solid);
  }
  int windows() const { return count(1.0 / c_f / steps.coarse_dt); } ///< until it is back where it began

private:
  static int count(double x) { return static_cast<int>(std::ceil(x - 0.5)); }
  double h_s() const { return c_s * steps.fine_dt() / 0.9; }
};

} // namespace

// R = (Z_s − Z_f)/(Z_s + Z_f) and T = 1 + R for pressure. 20 elements over the pulse's width; dispersion of
// central differences at CFL 0.9 is below 1e-3.
TEST_CASE("an acoustic pulse reflects and transmits at the interface as the impedances say",
          "[coupler][verification]")
{
  const int m = GENERATE(1, 3);
  Pulse pulse(m, 20);
  double transmitted = 0.0;
  for (int k = 0; k < pulse.windows(); ++k)
  {
    advance(pulse.gc, pulse.steps, pulse.fluid, pulse.solid);
    transmitted = std::max(transmitted, std::abs(pulse.solid.last_link_force));
  }
  double reflected = 0.0;
  for (Eigen::Index i = 0; i + 1 < pulse.fluid.n_nodes(); ++i)
    reflected = std::max(reflected, -pulse.K * (pulse.fluid.u[i + 1] - pulse.fluid.u[i]) / pulse.h_f);
  CAPTURE(m, pulse.R, reflected / 1e5, transmitted / 1e5);
  CHECK(std::abs(reflected / 1e5 - pulse.R) < 0.01 * pulse.R);
  CHECK(std::abs(transmitted / 1e5 - (1.0 + pulse.R)) < 0.01 * (1.0 + pulse.R));
}

// What the ledger adds up, ½(f⁰ + f¹)·Δu of both sides, is the change of T + V − Δt²/8 a·M a of each with its
// own step, and not the theorem's E₂. Where λ and v change within a window the two sums do not cancel: each
// is a rule of second order with another step, and so is the interpolated velocity. Of a pulse exp(−(t/σ)²)
// that is at most (ΔT/σ)²/3 of the work (twice ΔT²/6 ∫λ̇v̇, ∫λ̇v̇ = ∫λv/σ²), of either sign. E₂ falls in every
// window meanwhile.
TEST_CASE("works of both sides cancel to second order, and the theorem's energy falls", "[coupler][unit]")
{
  std::array<double, 2> made{};
  for (std::size_t k = 0; k < 2; ++k)
  {
    Pulse pulse(3, k == 0 ? 20 : 40);
    const auto energy = [](const Bar& bar, double dt)
    { return bar.energy() - dt * dt / 8.0 * bar.a.dot(bar.masses().cwiseProduct(bar.a)); };
    const double dT = pulse.steps.coarse_dt, dt = pulse.steps.fine_dt();
    const double fluid = energy(pulse.fluid, dT), solid = energy(pulse.solid, dt);
    double E2 = pulse.fluid.second_energy(dT) + pulse.solid.second_energy(dt), rise = 0.0;
    const double scale = E2;
    for (int w = 0; w < pulse.windows(); ++w)
    {
      advance(pulse.gc, pulse.steps, pulse.fluid, pulse.solid);
      const double now = pulse.fluid.second_energy(dT) + pulse.solid.second_energy(dt);
      rise = std::max(rise, now - E2);
      E2 = now;
    }
    const double into_solid = energy(pulse.solid, dt) - solid;
    made[k] = (energy(pulse.fluid, dT) - fluid + into_solid) / into_solid;
    const double bound = std::pow(dT * pulse.c_f / pulse.width, 2) / 3.0;
    CAPTURE(k, made[k], bound, rise / scale, 1.0 - E2 / scale);
    CHECK(rise < 1e-12 * scale);
    CHECK(std::abs(made[k]) < bound);
  }
  CAPTURE(made[0], made[1]);
  CHECK(std::log2(made[0] / made[1]) == Approx(2.0).margin(0.1));
}

// The window planner hands the fine role over when the stable steps are inverted. A window needs velocities
// and link forces of both sides at its begin only, so the roles may change at any window end. Each change of
// step is also one of central differences on their own, whose energy takes a step of O(Δt² ω²) with either
// sign: 24 handovers in 1200 windows may not add up to more than that of one, (0.85)²/4 of the highest modes,
// and the velocities meet at every window end.
TEST_CASE("the fine side may change from window to window", "[coupler][unit]")
{
  for (const double density : {0.05, 1.0, 20.0})
  {
    Pair bars{Bar(12, 1.0, density, 1.0, true), Bar(9, 1.0, 1.0, 2.0, true)};
    for (Eigen::Index k = 0; k < bars.fluid.n_nodes() - 1; ++k)
      bars.fluid.v[k] = std::cos(0.5 * M_PI * static_cast<double>(k) / 12.0);
    for (Eigen::Index k = 0; k < bars.solid.n_nodes() - 1; ++k)
      bars.solid.v[k] = std::cos(0.5 * M_PI * static_cast<double>(k) / 9.0);
    GravouilCombescure gc(glue(bars.fluid, bars.solid), 1);
    start(gc, bars.fluid, bars.solid);
    const double energy = bars.fluid.energy() + bars.solid.energy();
    double largest = 0.0, jump = 0.0;
    for (int k = 0; k < 1200; ++k)
    {
      const Side fine = (k / 50) % 2 == 0 ? Side::fluid : Side::solid;
      const Bar &q = fine == Side::fluid ? bars.fluid : bars.solid,
                &c = fine == Side::fluid ? bars.solid : bars.fluid;
      const double dT = 0.85 * std::min(c.critical_step(), 4.0 * q.critical_step());
      advance(gc, {.fine = fine, .m = 4, .coarse_dt = dT}, bars.fluid, bars.solid);
      largest = std::max(largest, bars.fluid.energy() + bars.solid.energy());
      jump = std::max(jump, gc.balance().velocity_jump);
    }
    INFO("density " << density << ": largest energy " << largest / energy << " of the first, jump " << jump);
    CHECK(largest < 1.1 * energy);
    CHECK(jump < 1e-12);
  }
}

// Two equal bars meet at relative speed 1: plateau of the contact force Z/2 until the waves return. Without
// the plastic activation the force would alternate around the plateau for ever (eigenvalue −1).
TEST_CASE("an impact gives a plateau, not a saw-tooth", "[coupler][unit]")
{
  const int n = 60;
  Pair bars{Bar(n, 1.0, 1.0, 1.0, false), Bar(n, 1.0, 1.0, 1.0, false)};
  bars.fluid.v.setConstant(1.0);
  GravouilCombescure gc(glue(bars.fluid, bars.solid), 1);
  start(gc, bars.fluid, bars.solid);
  // ½ (1/m + 1/m)⁻¹ · 1² with m = h/2: the energy of the inelastic impact of the two interface nodes
  CHECK(gc.balance().activation_loss == Approx(0.25 * bars.fluid.interface_mass()).epsilon(1e-12));
  const double dt = bars.fluid.critical_step(); // at CFL 1 the chain has no dispersion: the plateau is exact
  double sum = 0.0, sum_2 = 0.0;
  const int windows = n;
  for (int k = 0; k < windows; ++k)
  {
    advance(gc, {.fine = Side::fluid, .m = 1, .coarse_dt = dt}, bars.fluid, bars.solid);
    sum += bars.solid.last_link_force;
    sum_2 += bars.solid.last_link_force * bars.solid.last_link_force;
  }
  const double mean = sum / windows, deviation = std::sqrt(std::max(0.0, sum_2 / windows - mean * mean));
  CAPTURE(mean, deviation);
  CHECK(mean == Approx(0.5).epsilon(0.01));
  CHECK(deviation < 0.01 * mean);
}

// Reference errors of an independent program for the split oscillator m₁ = 1, k₁ = (2π)²; m₂ = 3, k₂ = ½(2π)²
// of this scheme: 2.0690e-3 and order 2.00 at equal steps with 100 steps per period, and the energy losses
// below.
TEST_CASE(
    "the split oscillator converges with order two at equal steps and only loses energy when sub-cycled",
    "[coupler][verification]")
{
  struct Oscillator : undine::coupler::Partner
  {
    Oscillator(double m, double k) : m(m), k(k) {}
    void receive_free_velocity(std::span<double> v_free) override
    {
      v += 0.5 * dt * a;
      u += dt * v;
      a = -k * u / m;
      v += 0.5 * dt * a;
      v_free[0] = v;
    }
    void send_link_force(std::span<const double> f) override
    {
      a += f[0] / m;
      v += 0.5 * dt * f[0] / m;
    }
    double energy() const { return 0.5 * m * v * v + 0.5 * k * u * u; }
    double m, k, dt = 0.0, u = 0.0, v = 1.0, a = 0.0;
  };
  const auto run = [](int substeps, int steps_per_period)
  {
    const double pi = std::acos(-1.0), omega = std::sqrt(1.5 * 4.0 * pi * pi / 4.0);
    Oscillator one(1.0, 4.0 * pi * pi), two(3.0, 2.0 * pi * pi);
    const auto side = [](double sign, double mass)
    {
      InterfaceSide s{SparseMatrix(1, 1), SparseMatrix(1, 1)};
      s.L.insert(0, 0) = sign;
      s.inverse_mass.insert(0, 0) = 1.0 / mass;
      return s;
    };
    GravouilCombescure gc(InterfaceOperator(side(1.0, two.m), side(-1.0, one.m)), 1);
    gc.activate({Vector::Constant(1, 1.0), Vector::Constant(1, 1.0)}, {Vector::Zero(1), Vector::Zero(1)});
    const double period = 2.0 * pi / omega, dT = period / steps_per_period;
    one.dt = dT;
    two.dt = dT / substeps;
    double error = 0.0;
    const double energy = one.energy() + two.energy();
    for (int k = 1; k <= 2 * steps_per_period; ++k)
    {
      gc.advance({.fine = Side::fluid, .m = substeps, .coarse_dt = dT}, two, one);
      error = std::max(error, std::abs(one.u - std::sin(omega * k * dT) / omega) * omega);
    }
    return std::pair{error, (one.energy() + two.energy()) / energy - 1.0};
  };
  const auto [e_100, drift_100] = run(1, 100);
  const auto [e_200, drift_200] = run(1, 200);
  CAPTURE(e_100, e_200, drift_100, drift_200);
  CHECK(e_100 == Approx(2.0690e-3).epsilon(1e-3));
  CHECK(std::log2(e_100 / e_200) == Approx(2.0).margin(0.02));
  for (const auto& [substeps, reference] : {std::pair{2, -0.02438711474}, std::pair{10, -0.03183937506}})
  {
    const auto [a, loss_a] = run(substeps, 100);
    const auto [b, loss_b] = run(substeps, 200);
    CAPTURE(substeps, a, b, loss_a, loss_b);
    CHECK(loss_a == Approx(reference).epsilon(1e-6)); // the same independent program
    CHECK(std::log2(a / b) > 0.95);
    CHECK(loss_a < 0.0);
    CHECK(loss_b < 0.0);
  }
}
