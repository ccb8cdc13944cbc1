// Tait law, viscous stress, nodal volumes and the pressure force: pure local physics against finite
// differences.
#include "common/lanes.hpp"
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/mass_conservation.hpp"
#include "fluid_pfem/newtonian.hpp"
#include "fluid_pfem/simplex.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <random>
#include <utility>

using namespace undine;
using namespace undine::fluid;
using undine::test::box_config;

// Central difference of p(ρ) with Δρ/ρ = 1e-5: truncation γ²/6 · 1e-10 ≈ 1e-9, cancellation 2⁻⁵²·(B/Δp) ≈
// 1e-11/…; 1e-8 in c².
TEST_CASE("Tait's sound speed is the slope of its pressure, in both readings", "[fluid][unit]")
{
  const double K = 2.2e9;
  const Tait printed{.rho0 = 1000.0, .p0 = 0.0, .B = K, .gamma = 7.0};
  const Tait usual{.rho0 = 1000.0, .p0 = 0.0, .B = K / 7.0, .gamma = 7.0};
  for (const Tait& tait : {printed, usual, Tait{.rho0 = 917.0, .p0 = 1e5, .B = 3e8, .gamma = 4.3}})
    for (const double rho : {0.98 * tait.rho0, tait.rho0, 1.05 * tait.rho0})
    {
      const double d = 1e-5 * rho;
      const double slope = (tait.pressure(rho + d) - tait.pressure(rho - d)) / (2.0 * d);
      CHECK(tait.sound_speed(rho) * tait.sound_speed(rho) == Approx(slope).epsilon(1e-8));
      CHECK(tait.density(tait.pressure(rho)) == Approx(rho).epsilon(1e-12));
      // de/dρ = (p − p₀)/ρ²; the energy is of second order in ρ − ρ₀, so compare against the scale c²
      const double de = (tait.internal_energy(rho + d) - tait.internal_energy(rho - d)) / (2.0 * d);
      CHECK(de ==
            Approx((tait.pressure(rho) - tait.p0) / (rho * rho)).epsilon(1e-7).margin(1e-9 * slope / rho));
      CHECK(tait.enthalpy(rho) ==
            Approx(tait.internal_energy(rho) + (tait.pressure(rho) - tait.p0) / rho).margin(1e-13 * slope));
    }
  CHECK(printed.sound_speed(1000.0) == Approx(std::sqrt(7.0 * K / 1000.0)).epsilon(1e-14)); // 3924 m/s
  CHECK(usual.sound_speed(1000.0) == Approx(std::sqrt(K / 1000.0)).epsilon(1e-14));         // 1483 m/s
}

// Numbers are moved, not computed; the inverse root takes an estimate to 2⁻¹⁴, e < 2⁻¹³, and three terms of
// a series: the fourth, 35/128 e⁴, is below 2⁻⁵³. Then round-off of a few operations.
TEST_CASE("rows become columns and rows again, and an inverse root is one", "[fluid][unit]")
{
  alignas(64) double numbers[Lanes::size][4], pairs[Lanes::size][2];
  const double *row[Lanes::size], *pair[Lanes::size];
  for (std::size_t e = 0; e < Lanes::size; ++e)
  {
    row[e] = numbers[e];
    pair[e] = pairs[e];
    for (std::size_t k = 0; k < 4; ++k)
      numbers[e][k] = static_cast<double>(10 * e + k);
    pairs[e][0] = static_cast<double>(e);
    pairs[e][1] = -static_cast<double>(e);
  }
  Lanes column[4], first, second;
  EightRows(row).columns(column);
  load_pairs(pair, first, second);
  EightRows rows(column);
  std::array<FourNumbers, Lanes::size> again;
  const auto take = [&]<std::size_t... e>(std::index_sequence<e...>) { ((again[e] = rows.row<e>()), ...); };
  take(std::make_index_sequence<Lanes::size>{});
  for (std::size_t e = 0; e < Lanes::size; ++e)
  {
    const int l = static_cast<int>(e);
    CHECK(first[l] == pairs[e][0]);
    CHECK(second[l] == pairs[e][1]);
    for (std::size_t k = 0; k < 4; ++k)
    {
      CHECK(column[k][l] == numbers[e][k]);
      CHECK(again[e][k] == numbers[e][k]);
    }
    CHECK(rows.first_column()[l] == numbers[e][0]);
  }
  rows += EightRows(column);
  CHECK(rows.row<5>()[3] == 2.0 * numbers[5][3]);
  rows -= EightRows(row);
  CHECK(rows.row<6>()[1] == numbers[6][1]);
  for (const double a : {1e-100, 3e-9, 0.7, 1.0, 1234.5, 9e99})
    CHECK(inverse_sqrt(Lanes(a))[0] == Approx(1.0 / std::sqrt(a)).epsilon(1e-15));
}

TEMPLATE_TEST_CASE_SIG("a rigid rotation gives no viscous stress", "[fluid][unit]", ((int dim), dim), 2, 3)
{
  Mat<dim> spin;
  for (int i = 0; i < dim; ++i)
    for (int j = 0; j < dim; ++j)
      spin(i, j) = i == j ? 0.0 : (i < j ? 1.0 + i : -1.0 - j) * 3.7;
  for (const double tau : deviatoric_stress<dim, double>(spin, 0.9).c)
    CHECK(tau == 0.0); // antisymmetric: every entry cancels exactly
}

TEST_CASE("a plane flow has the stress of the same flow in space: plane strain", "[fluid][unit]")
{
  const Mat<2> plane{{0.3, -1.2, 0.7, 0.5}};
  const Mat<3> space{{0.3, -1.2, 0.0, 0.7, 0.5, 0.0, 0.0, 0.0, 0.0}};
  const auto tau_2 = deviatoric_stress<2, double>(plane, 1.3);
  const auto tau_3 = deviatoric_stress<3, double>(space, 1.3);
  for (int i = 0; i < 2; ++i)
    for (int j = 0; j < 2; ++j)
      CHECK(tau_2(i, j) == Approx(tau_3(i, j)).epsilon(4e-16)); // two roundings
}

// V_e∇N is exact for linear elements: finite differences of a polynomial of degree dim in the coordinates;
// step 1e-4 h gives truncation 0 (multilinear) and round-off 2⁻⁵²/1e-4 ≈ 2e-12 relative.
TEMPLATE_TEST_CASE_SIG("the gradient of an element's volume is V grad N", "[fluid][unit]", ((int dim), dim),
                       2, 3)
{
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(-0.2, 0.2);
  std::array<Vec<dim>, dim + 1> x{};
  for (int a = 0; a <= dim; ++a)
    for (int i = 0; i < dim; ++i)
      x[a][i] = (a == i + 1 ? 1.0 : 0.0) + u(random);
  const auto gradient = volume_gradients<dim, double>(x);
  for (int a = 0; a <= dim; ++a)
    for (int i = 0; i < dim; ++i)
    {
      auto plus = x, minus = x;
      plus[a][i] += 1e-4;
      minus[a][i] -= 1e-4;
      const double slope = (signed_volume<dim, double>(plus) - signed_volume<dim, double>(minus)) / 2e-4;
      CHECK(gradient[a][i] == Approx(slope).epsilon(1e-10).margin(1e-11));
    }
}

// F = −∂U/∂x with U = Σ m_i e(m_i/V_i). Central differences of U with 1e-5 h: truncation 1e-10 relative to
// the stiffness, cancellation U·2⁻⁵²/(1e-5 h): bounded by 1e-6 of the largest force.
TEMPLATE_TEST_CASE_SIG("the pressure force is minus the gradient of the internal energy", "[fluid][unit]",
                       ((int dim), dim), 2, 3)
{
  FluidConfig config = box_config<dim>(0.25);
  config.seeding.jitter = 0.2;
  config.tait.B = 2.2e5 / 7.0;
  Fluid<dim> fluid(config);
  FluidNodes<dim> nodes = fluid.nodes();
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(-0.02, 0.02);
  for (auto& x : nodes.x) // compress and stretch unevenly, so that every pressure differs
    for (int i = 0; i < dim; ++i)
      x[i] *= 0.99 + 0.05 * u(random);

  const auto energy = [&](const FluidNodes<dim>& at)
  {
    FluidNodes<dim> n = at;
    update_nodal_volumes<dim>(fluid.mesh(), n);
    double U = 0.0;
    for (std::size_t i = 0; i < n.x.size(); ++i)
      U += n.m[i] * config.tait.internal_energy(n.m[i] / n.V[i]);
    return U;
  };
  FluidNodes<dim> state = nodes;
  update_nodal_volumes<dim>(fluid.mesh(), state);
  REQUIRE(update_density_and_pressure<dim>(fluid.mesh(), config.tait, 0.0, state, 0, state.size()) == -1);
  undine::test::pressure_acceleration<dim>(fluid.mesh(), state);
  double largest = 0.0;
  for (std::size_t i = 0; i < state.x.size(); ++i)
    largest = std::max(largest, state.m[i] * norm(state.a[i]));
  for (std::size_t i = 0; i < state.x.size(); i += 3)
    for (int k = 0; k < dim; ++k)
    {
      FluidNodes<dim> plus = nodes, minus = nodes;
      plus.x[i][k] += 2.5e-6;
      minus.x[i][k] -= 2.5e-6;
      const double slope = (energy(plus) - energy(minus)) / 5e-6;
      CHECK(state.m[i] * state.a[i][k] == Approx(-slope).margin(1e-6 * largest));
    }
}

TEMPLATE_TEST_CASE_SIG("uniform pressure leaves inner nodes alone and acts normally on the boundary",
                       "[fluid][unit]", ((int dim), dim), 2, 3)
{
  FluidConfig config = box_config<dim>(0.2);
  config.seeding.jitter = 0.25;
  Fluid<dim> fluid(config);
  FluidNodes<dim> nodes = fluid.nodes();
  const double p = 3.0e4;
  nodes.p.assign(nodes.p.size(), p);
  undine::test::pressure_acceleration<dim>(fluid.mesh(), nodes);
  Vec<dim> sum{};
  double inner = 0.0;
  for (std::size_t i = 0; i < nodes.x.size(); ++i)
  {
    const Vec<dim> F = nodes.m[i] * nodes.a[i];
    sum += F;
    if (nodes.surface[i] == 0)
      inner = std::max(inner, norm(F));
  }
  // about 24 terms of size p h^(dim−1) cancel at a node: 24 · 2⁻⁵² relative
  const double scale = p * std::pow(0.2, dim - 1);
  CHECK(inner < 1e-14 * 24 * scale);
  CHECK(norm(sum) < 1e-12 * p);
}
