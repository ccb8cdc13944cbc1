// Plastic laws: uniaxial and shear paths, objectivity, work, rate and heat; lanes against one element.
#include "solid_fe/material.hpp"
#include "solid_fe/solid.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

// Copper of the Taylor bar.
const MaterialConfig copper = {.density = 8930.0,
                               .youngs_modulus = 117e9,
                               .poisson_ratio = 0.35,
                               .law = "j2",
                               .yield_stress = 0.4e9,
                               .hardening_modulus = 0.1e9};

template <class Law>
using History3 = typename Law::template History<3, double>;

/// Drive the axial stretch to `stretch` in `steps` with free sides; returns the axial Kirchhoff stress.
template <class Law>
double pull(const Law& law, double stretch, int steps, double dt, History3<Law>& h)
{
  double lateral = 1.0, tau = 0.0;
  Mat<3> H;
  for (int k = 1; k <= steps; ++k)
  {
    H(0, 0) = std::expm1(std::log(stretch) * k / steps);
    // Newton with a numerical slope on the lateral stress; each trial starts from the history of the step
    // before.
    const auto side = [&](double l)
    {
      auto trial = h;
      H(1, 1) = H(2, 2) = l - 1.0;
      return law.first_piola(H, trial, dt)(1, 1);
    };
    for (int iteration = 0; iteration < 30; ++iteration)
    {
      const double r = side(lateral), slope = (side(lateral + 1e-7) - r) / 1e-7;
      lateral -= r / slope;
      if (std::abs(r) < 1e-6)
        break;
    }
    H(1, 1) = H(2, 2) = lateral - 1.0;
    tau = law.first_piola(H, h, dt)(0, 0) * (1.0 + H(0, 0));
  }
  return tau;
}

} // namespace

// τ = σ_y(α), and the total strain ln λ = τ/E + α up to O(τ/μ) = 1 % of it: the flow L_v bᵉ = −2/3 γ tr bᵉ n
// is along the deviator of bᵉ, not of its logarithm.
TEST_CASE("uniaxial tension follows the hardening curve", "[solid][unit]")
{
  const auto law = J2::from(copper);
  for (const double strain : {0.01, 0.1, 0.5})
  {
    History3<J2> h{};
    const double tau = pull(law, std::exp(strain), 400, 1e-6, h);
    const double alpha = h[static_cast<std::size_t>(J2::strain_at(3))];
    CHECK(tau == Approx(0.4e9 + 0.1e9 * alpha).epsilon(1e-8));
    CHECK(alpha == Approx(strain - tau / 117e9).epsilon(0.5e-2));
  }
}

TEST_CASE("a table of points is followed and ends flat", "[solid][unit]")
{
  auto config = copper;
  config.hardening_table = {0.0, 0.3e9, 0.05, 0.4e9, 0.2, 0.5e9};
  const auto law = J2::from(config);
  CHECK(law.hardening.yield_stress(0.025, 0, 0) == Approx(0.35e9));
  CHECK(law.hardening.yield_stress(0.125, 0, 0) == Approx(0.45e9));
  CHECK(law.hardening.yield_stress(7.0, 0, 0) == 0.5e9);
  History3<J2> h{};
  const double tau = pull(law, std::exp(0.1), 200, 1e-6, h);
  const double alpha = h[static_cast<std::size_t>(J2::strain_at(3))];
  CHECK(alpha > 0.05);
  CHECK(tau == Approx(0.4e9 + 0.1e9 * (alpha - 0.05) / 0.15).epsilon(1e-8));
}

// Simple shear with perfect plasticity: τ₁₂ tends to σ_y/√3. Elastic strains of 1e-2 turn the direction of
// the stress by as much: cos(1e-2) = 1 − 5e-5.
TEST_CASE("simple shear yields at the von Mises shear stress", "[solid][unit]")
{
  auto config = copper;
  config.hardening_modulus = 0.0;
  const auto law = J2::from(config);
  History3<J2> h{};
  Mat<3> H, sigma;
  for (int k = 1; k <= 2000; ++k)
  {
    H(0, 1) = 1e-3 * k;
    law.first_piola(H, h, 1e-6);
    sigma = law.cauchy_of_state(H, h);
    if (H(0, 1) < 0.4e9 / std::sqrt(3.0) / law.elastic.shear_modulus * 0.99)
      CHECK(sigma(0, 1) == Approx(law.elastic.shear_modulus * H(0, 1)).epsilon(1e-12));
  }
  CHECK(von_mises(sigma) == Approx(0.4e9).epsilon(1e-9));
  CHECK(sigma(0, 1) == Approx(0.4e9 / std::sqrt(3.0)).epsilon(1e-3));
  CHECK(std::abs(trace(sigma)) < 1e-6 * 0.4e9);
}

// F → Q F from some time on: P → Q P and the same history, to round-off of E.
TEST_CASE("a rotation on the way changes nothing but the frame", "[solid][unit]")
{
  const auto law = J2::from(copper);
  History3<J2> h{}, h_turned{};
  Random random(3);
  const auto rate = random.matrix<3>(0.02);
  for (int k = 1; k <= 20; ++k)
  {
    const auto Q = rotation<3>(0.2 * k);
    const auto H = static_cast<double>(k) * rate;
    const auto P = law.first_piola(H, h, 1e-6);
    const auto turned = law.first_piola(Q * deformation_gradient(H) - Mat<3>::identity(), h_turned, 1e-6);
    const auto difference = turned - Q * P;
    CHECK(std::sqrt(contract(difference, difference)) < 1e-13 * 117e9);
  }
  CHECK(h[static_cast<std::size_t>(J2::strain_at(3))] > 0.1);
  CHECK(h_turned[static_cast<std::size_t>(J2::strain_at(3))] ==
        Approx(h[static_cast<std::size_t>(J2::strain_at(3))]).epsilon(1e-11));
}

// Work of the stress = elastic energy + plastic work, to second order in the step: the trapezoidal rule,
// kinks at yield, unloading and new yield included. Along random paths and along tension, where tr n³ is
// largest.
TEST_CASE("the work of the stress is stored or dissipated", "[solid][unit]")
{
  auto rate = Random(7).matrix<3>(1.0);
  rate -= (trace(rate) / 3.0) * Mat<3>::identity(); // nearly isochoric: the volume would hide the rest
  if (GENERATE(true, false))
    rate = Mat<3>{{1.0, 0.0, 0.0, 0.0, -0.5, 0.0, 0.0, 0.0, -0.5}};
  const auto imbalance = [&](int steps)
  {
    const auto law = J2::from(copper);
    History3<J2> h{};
    Mat<3> H, P;
    double work = 0.0;
    for (int k = 1; k <= steps; ++k)
    {
      const double s = 0.3 * k / steps;
      const auto H_new = (s < 0.2 ? s : 0.4 - s) * rate; // forth and a part back
      const auto P_new = law.first_piola(H_new, h, 1e-6);
      work += 0.5 * contract(P + P_new, H_new - H);
      H = H_new;
      P = P_new;
    }
    const double stored = law.strain_energy(H, h), plastic = law.dissipated<3>(h);
    CHECK(plastic > 0.5 * work);
    return std::abs(stored + plastic - work) / work;
  };
  const double coarse = imbalance(400), fine = imbalance(1600);
  INFO("imbalance " << coarse << " -> " << fine);
  CHECK(coarse < 2e-4); // kinks: half a step's stress times a step's strain each, 2e-4 of the work at most
  CHECK(fine < coarse / 2.0);
}

// While it flows without a pause there is no kink: order 2, whatever the path, and turning by half a radian.
TEST_CASE("the work of steady flow is stored or dissipated to second order", "[solid][unit]")
{
  const auto law = J2::from(copper);
  auto any = Random(7).matrix<3>(1.0);
  any -= (trace(any) / 3.0) * Mat<3>::identity();
  const Mat<3> tension{{1.0, 0.0, 0.0, 0.0, -0.5, 0.0, 0.0, 0.0, -0.5}};
  for (const auto& [rate, turn] : {std::pair{any, 0.0}, {any, 3.0}, {tension, 0.0}, {tension, 3.0}})
  {
    const auto H_at = [&, r = rate, turn = turn](double s)
    { return rotation<3>(turn * s) * (Mat<3>::identity() + s * r) - Mat<3>::identity(); };
    const auto imbalance = [&](int steps)
    {
      History3<J2> h{};
      const double begin = 0.05, end = 0.2;
      for (int k = 1; k <= 5000; ++k) // far into the flow
        law.first_piola(H_at(begin * k / 5000), h, 1e-6);
      auto H = H_at(begin);
      auto P = law.first_piola(H, h, 1e-6);
      const double start = law.strain_energy(H, h) + law.dissipated<3>(h);
      double work = 0.0;
      for (int k = 1; k <= steps; ++k)
      {
        const auto H_new = H_at(begin + (end - begin) * k / steps);
        const auto P_new = law.first_piola(H_new, h, 1e-6);
        work += 0.5 * contract(P + P_new, H_new - H);
        H = H_new;
        P = P_new;
      }
      return (law.strain_energy(H, h) + law.dissipated<3>(h) - start - work) / work;
    };
    const double coarse = imbalance(100), fine = imbalance(200), order = std::log2(std::abs(coarse / fine));
    INFO("turning " << turn << ": " << coarse << " -> " << fine << ", order " << order);
    CHECK(order > 1.85);
    CHECK(order < 2.15);
    CHECK(std::abs(fine) < 2e-4); // a step of 7e-4 of strain, 0.2 of that at yield, and 2e-3 rad
  }
}

TEST_CASE("plane strain plasticity is 3-D plasticity with F33 = 1", "[solid][unit]")
{
  const auto law = J2::from(copper);
  J2::History<2, double> h2{};
  History3<J2> h3{};
  const auto rate = Random(9).matrix<2>(0.02);
  for (int k = 1; k <= 20; ++k)
  {
    const auto H = static_cast<double>(k) * rate;
    const auto P2 = law.first_piola(H, h2, 1e-6);
    const auto P3 = law.first_piola(embed_in_3d(H), h3, 1e-6);
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < 2; ++j)
        CHECK(std::abs(P2(i, j) - P3(i, j)) < 1e-12 * 117e9);
  }
  CHECK(h3[static_cast<std::size_t>(J2::strain_at(3))] > 0.1);
}

// σ = (A + B αⁿ)(1 + C ln(rate/rate₀)) at constant rate: each of 300 steps has the strain rate 0.3/300/Δt.
TEST_CASE("Johnson-Cook follows strain, rate and temperature", "[solid][unit]")
{
  MaterialConfig config = copper;
  config.law = "johnson_cook";
  config.yield_stress = 90e6;
  config.hardening_coefficient = 292e6;
  config.hardening_exponent = 0.31;
  config.rate_coefficient = 0.025;
  const double dt = 1e-6;
  const auto law = JohnsonCook::from(config);
  History3<JohnsonCook> h{};
  const double tau = pull(law, std::exp(0.3), 300, dt, h);
  const double alpha = h[static_cast<std::size_t>(JohnsonCook::strain_at(3))];
  const double hardened = 90e6 + 292e6 * std::pow(alpha, 0.31);
  // the elastic part of the rate is H_t/E < 1e-2 of it: 1e-2 C of the stress
  CHECK(tau > hardened * (1.0 + 0.025 * std::log(0.99 * 1e-3 / dt)) * 0.999);
  CHECK(tau < hardened * (1.0 + 0.025 * std::log(1e-3 / dt)) * 1.001);

  config.melting_rise = 1000.0;
  config.heat_capacity = 385.0;
  config.thermal_exponent = 1.09;
  const auto hot = JohnsonCook::from(config);
  History3<JohnsonCook> heated{};
  const double softer = pull(hot, std::exp(0.3), 300, dt, heated);
  const double rise = heated[static_cast<std::size_t>(JohnsonCook::heat_at(3))];
  CHECK(rise == Approx(0.9 * heated[static_cast<std::size_t>(JohnsonCook::work_at(3))] / (8930.0 * 385.0))
                    .epsilon(1e-12));
  CHECK(rise > 20.0);
  CHECK(softer < tau);
  CHECK(softer ==
        Approx(tau * (1.0 - std::pow(rise / 1000.0, 1.09))).epsilon(5e-3)); // the strains differ a little
}

// Eight different points at once and one after the other: the formulas are the same, the functions log1p and
// expm1 of the lanes differ from the library's in the last digit.
TEMPLATE_TEST_CASE_SIG("lanes compute what single numbers compute, yielding or not", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  const auto law = J2::from(copper);
  using Packed = J2::History<dim, Lanes>;
  using Single = J2::History<dim, double>;
  Random random(11);
  Packed packed{};
  std::array<Single, Lanes::size> single{};
  std::array<Mat<dim>, Lanes::size> rate;
  for (int k = 0; k < Lanes::size; ++k)
    rate[static_cast<std::size_t>(k)] =
        random.matrix<dim>(k % 2 == 0 ? 1e-4 : 0.02); // half of them stay elastic
  for (int step = 1; step <= 10; ++step)
  {
    Mat<dim, Lanes> H;
    for (std::size_t i = 0; i < H.c.size(); ++i)
      for (int k = 0; k < Lanes::size; ++k)
        H.c[i].set(k, step * rate[static_cast<std::size_t>(k)].c[i]);
    const auto P = law.first_piola(H, packed, 1e-6);
    for (int k = 0; k < Lanes::size; ++k)
    {
      const auto expected = law.first_piola(static_cast<double>(step) * rate[static_cast<std::size_t>(k)],
                                            single[static_cast<std::size_t>(k)], 1e-6);
      for (std::size_t i = 0; i < expected.c.size(); ++i)
        CHECK(std::abs(P.c[i][k] - expected.c[i]) < 1e-13 * 117e9);
      const auto alpha = static_cast<std::size_t>(J2::strain_at(dim));
      CHECK(packed[alpha][k] ==
            Approx(single[static_cast<std::size_t>(k)][alpha]).epsilon(1e-10).margin(1e-15));
      if (k % 2 == 0)
        CHECK(packed[alpha][k] == 0.0);
    }
  }
}

TEST_CASE("log1p and expm1 of lanes are those of the library", "[common][unit]")
{
  Random random(1);
  for (int k = 0; k < 2000; ++k)
  {
    const double scale = std::pow(10.0, -12.0 + 0.006 * k);
    const double x = std::max(random(scale), -0.999);
    CHECK(log1p(Lanes(x))[3] == Approx(std::log1p(x)).epsilon(4e-16));
    CHECK(expm1(Lanes(std::max(-20.0, std::min(20.0, x))))[5] ==
          Approx(std::expm1(std::max(-20.0, std::min(20.0, x)))).epsilon(2e-15));
  }
  CHECK(std::isnan(log1p(Lanes(-2.0))[0]));
  CHECK(std::isnan(log1p(Lanes(std::nan("")))[0]));
}

// A body that nowhere yields moves exactly like one that cannot: the same bits, because nothing else is
// computed.
TEST_CASE("no plasticity happens below yield, and the answer is that of the elastic law", "[solid][unit]")
{
  auto config = soft_config(2, "j2");
  Solid<2> elastic(config, distorted_box<2>(ElementType::quadrilateral4));
  config.material.yield_stress = 1e6;
  config.material.hardening_modulus = 1e3;
  Solid<2> plastic(config, distorted_box<2>(ElementType::quadrilateral4));
  const auto start = [](const Vec<2>& X) { return Vec<2>{{-X[1], X[0]}}; };
  elastic.set_motion(zero_field<2>(), start);
  plastic.set_motion(zero_field<2>(), start);
  const double dt = elastic.critical_time_step();
  for (int k = 0; k < 200; ++k)
    for (auto* solid : {&elastic, &plastic})
    {
      solid->predict(dt);
      solid->solve_free_motion(dt);
    }
  CHECK(elastic.nodes().u == plastic.nodes().u);
  CHECK(plastic.energies().plastic == 0.0);
  for (const auto& lanes : plastic.bodies()[0].state.history)
    for (int k = 0; k < Lanes::size; ++k)
      REQUIRE(lanes[k] == 0.0);
}

// Second order in the strain per step, here up to a third of the yield strain, with a kink per element at
// each yield.
TEMPLATE_TEST_CASE_SIG("the energy balance closes with plastic work", "[solid][unit]", ((int dim), dim), 2, 3)
{
  for (const auto formulation : {Formulation::full, Formulation::one_point, Formulation::locking_free})
  {
    const auto imbalance = [&](double safety)
    {
      auto config = soft_config(dim, "j2");
      config.formulation = formulation;
      config.material.yield_stress = 2e4;
      config.material.hardening_modulus = 5e4;
      config.fix = {{"bottom", {"y"}}};
      config.step_safety = safety;
      Solid<dim> solid(config, distorted_box<dim>(element_types<dim>()[1]));
      solid.set_motion(zero_field<dim>(),
                       [](const Vec<dim>& X)
                       {
                         Vec<dim> v;
                         v[1] = -6.0 * X[1];
                         return v;
                       });
      const double E0 = solid.energies().kinetic;
      double worst = 0.0, start = 0.0;
      for (const double t_end = 0.3; solid.time() < t_end;)
      {
        const double dt = solid.critical_time_step();
        solid.predict(dt);
        solid.solve_free_motion(dt);
        double balance = solid.energies().balance(); // less the scheme's own Δt²/8 a·M a
        for (std::size_t n = 0; n < solid.nodes().X.size(); ++n)
          balance -= 0.125 * dt * dt * solid.nodes().m[n] * norm_squared(solid.nodes().a[n]);
        if (start == 0.0)
          start = balance;
        worst = std::max(worst, std::abs(balance - start) / E0);
      }
      CHECK(solid.energies().plastic > 0.3 * E0);
      return worst;
    };
    const double coarse = imbalance(0.5), fine = imbalance(0.25);
    INFO("form " << static_cast<int>(formulation) << ": imbalance " << coarse << " -> " << fine);
    CHECK(coarse < 0.02);
    CHECK(fine < coarse / 2.5);
  }
}
