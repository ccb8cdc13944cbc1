// The beam: elastica, rigid motions, conservation, frequency, stable step, faces.
#include "solid_fe/beam.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

#include <cmath>
#include <numbers>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

BeamConfig strip(int elements, double thickness, bool clamped = true)
{
  BeamConfig config;
  config.thickness = thickness;
  config.material = {.density = 1000.0, .youngs_modulus = 1e6, .poisson_ratio = 0.0};
  for (int k = 0; k <= elements; ++k)
    config.X.push_back({{static_cast<double>(k) / elements, 0.0}});
  for (index_t k = 0; k < elements; ++k)
    config.elements.push_back({k, k + 1});
  config.fixed.resize(config.X.size());
  if (clamped)
    config.fixed[0] = {true, true, true};
  return config;
}

/// Tip displacement at rest under the dead load `lambda` = P L²/(E I).
Vec<2> bend(int elements, double lambda)
{
  const double h = 0.02, EI = 1e6 * h * h * h / 12.0;
  Beam beam(strip(elements, h));
  beam.set_damping(1.3); // critical for the first mode, 0.64 rad/s
  const double dt = beam.critical_time_step();
  while (beam.time() < 24.0)
  {
    beam.set_load(elements, {{0.0, -lambda * EI * std::min(1.0, beam.time() / 4.0)}});
    beam.predict(dt);
    beam.solve_free_motion(dt);
  }
  return beam.u().back();
}

} // namespace

// Inextensible elastica (benchmark S2); stretch and shear add (h/L)² = 4e-4 of the size. Gate 1 %, order 2.
TEST_CASE("the beam bends like the elastica at four loads", "[solid][verification]")
{
  const double truth[][3] = {{1.0, 0.056433, 0.301721},
                             {2.0, 0.160642, 0.493458},
                             {5.0, 0.387628, 0.713792},
                             {10.0, 0.554996, 0.810609}};
  for (const auto& [lambda, dh, dv] : truth)
  {
    const auto u = bend(20, lambda);
    INFO("P L^2/(EI) = " << lambda << ": " << -u[0] << ", " << -u[1]);
    CHECK(std::abs(-u[0] / dh - 1.0) < 0.01);
    CHECK(std::abs(-u[1] / dv - 1.0) < 0.01);
  }
  // Order from three meshes, free of the model's own (h/L)².
  const double coarse = bend(5, 5.0)[1], medium = bend(10, 5.0)[1], fine = bend(20, 5.0)[1];
  const double order = std::log2((coarse - medium) / (medium - fine));
  INFO("order " << order);
  CHECK(order > 1.8);
  CHECK(order < 2.2);
}

TEST_CASE("a rigid motion of the beam is free of stress", "[solid][unit]")
{
  Beam beam(strip(7, 0.05, false));
  const double angle = 2.5;
  std::vector<Vec<2>> u, v(8);
  for (int k = 0; k <= 7; ++k)
  {
    const double X = k / 7.0;
    u.push_back({{0.3 + X * (std::cos(angle) - 1.0), X * std::sin(angle) - 0.1}});
  }
  beam.set_motion(u, std::vector<double>(8, angle), v, std::vector<double>(8, 0.0));
  CHECK(beam.strain_energy() < 1e-28 * 1e6); // strains of 1e-16 squared
}

// Forces are derivatives of an objective energy: angular momentum and energy as in solid_test.cpp.
TEST_CASE("a free beam keeps its angular momentum, and its energy to second order", "[solid][unit]")
{
  const auto run = [](double fraction)
  {
    Beam beam(strip(10, 0.1, false));
    std::vector<Vec<2>> u(11), v;
    std::vector<double> theta(11, 0.0), omega(11, 1.5);
    Random random(3);
    for (int k = 0; k <= 10; ++k)
      v.push_back(Vec<2>{{0.2, 1.5 * k / 10.0}} + random.vector<2>(0.3));
    beam.set_motion(u, theta, v, omega);
    const double E0 = beam.kinetic_energy() + beam.strain_energy(), L0 = beam.angular_momentum();
    const double dt = fraction * beam.critical_time_step();
    double drift = 0.0;
    for (int k = 0; k < 4000; ++k)
    {
      beam.predict(dt);
      beam.solve_free_motion(dt);
      drift = std::max(drift, std::abs((beam.kinetic_energy() + beam.strain_energy()) / E0 - 1.0));
    }
    CHECK(std::abs(beam.angular_momentum() / L0 - 1.0) < 1e-11); // 4000 steps of round-off
    return drift;
  };
  const double coarse = run(0.4), fine = run(0.2);
  INFO("energy error " << coarse << " -> " << fine);
  CHECK(coarse < 0.05);
  CHECK(coarse / fine > 3.0);
}

// Step at 1.0 times the claim (L/c): random motion stays bounded for 2e4 steps, thick and thin.
TEST_CASE("rotations do not limit the step of the beam", "[solid][unit]")
{
  for (const double h : {0.001, 0.02, 0.3})
    for (const double nu : {0.0, 0.45})
    {
      auto config = strip(10, h);
      config.step_safety = 1.0;
      config.material.poisson_ratio = nu;
      Beam beam(config);
      Random random(5);
      std::vector<Vec<2>> u(11), v;
      std::vector<double> omega;
      for (int k = 0; k <= 10; ++k)
      {
        v.push_back(k == 0 ? Vec<2>{} : random.vector<2>(1e-3));
        omega.push_back(k == 0 ? 0.0 : random(1e-2));
      }
      beam.set_motion(u, std::vector<double>(11, 0.0), v, omega);
      const double E0 = beam.kinetic_energy(), dt = 0.999 * beam.critical_time_step();
      CHECK(dt == Approx(0.999 * 0.1 / std::sqrt(1e6 / (1.0 - nu * nu) / 1000.0)));
      double highest = 0.0;
      for (int k = 0; k < 20000; ++k)
      {
        beam.predict(dt);
        beam.solve_free_motion(dt);
        highest = std::max(highest, beam.kinetic_energy() + beam.strain_energy());
      }
      INFO("h " << h << " nu " << nu << ": highest energy " << highest / E0);
      // bounded by 1 / (1 − 0.999²) = 500 in the worst mode; growth at 1e-3 above the limit would be e^1000.
      CHECK(highest < 500.0 * E0);
    }
}

// First frequency of a cantilever, 0.5596 √(E/12ρ) h/L² [Hz] (3.5160 √(EI/ρA)/L²); shear and rotary inertia,
// the added too, lower it by O((h/L)²) and O(1/n²): 20 elements, 1 %.
TEST_CASE("the cantilever swings with the frequency of the textbook", "[solid][unit]")
{
  const double h = 0.02;
  Beam beam(strip(20, h));
  std::vector<Vec<2>> u(21), v;
  for (int k = 0; k <= 20; ++k) // near the first mode
    v.push_back({{0.0, 1e-4 * std::pow(k / 20.0, 2) * (1.0 - k / 60.0)}});
  beam.set_motion(u, std::vector<double>(21, 0.0), v, std::vector<double>(21, 0.0));
  const double dt = beam.critical_time_step();
  std::vector<double> crossings; // of the tip, downwards through zero
  double before = 0.0;
  while (crossings.size() < 4)
  {
    beam.predict(dt);
    beam.solve_free_motion(dt);
    const double tip = beam.u().back()[1];
    if (before > 0.0 && tip <= 0.0)
      crossings.push_back(beam.time() - dt * tip / (tip - before));
    before = tip;
  }
  const double frequency = 3.0 / (crossings[3] - crossings[0]);
  const double expected = 3.51602 * std::sqrt(1e6 * h * h / 12.0 / 1000.0) / (2.0 * std::numbers::pi);
  CHECK(frequency == Approx(expected).epsilon(0.01));
}

TEST_CASE("faces follow the wall's rotation, and forces on them do the same work", "[solid][unit]")
{
  const double h = 0.1;
  Beam beam(strip(3, h, false));
  Random random(9);
  std::vector<Vec<2>> u, v, f;
  std::vector<double> theta, omega;
  for (int k = 0; k < 4; ++k)
  {
    u.push_back(random.vector<2>(0.1));
    v.push_back(random.vector<2>(1.0));
    f.push_back(random.vector<2>(5.0));
    theta.push_back(random(1.0));
    omega.push_back(random(3.0));
  }
  beam.set_motion(u, theta, v, omega);
  for (const auto face : both_faces)
  {
    const double side = face == BeamFace::left ? 0.5 * h : -0.5 * h;
    // A force changes the face velocity by Δt/2 × inverse mass × force, on both faces, and the kinetic energy
    // by the force's power.
    const double dt = 1e-3;
    auto pushed = beam;
    double power = 0.0;
    for (std::size_t k = 0; k < 4; ++k)
    {
      const Vec<2> expected = Vec<2>{{static_cast<double>(k) / 3.0, 0.0}} + u[k] +
                              side * Vec<2>{{-std::sin(theta[k]), std::cos(theta[k])}};
      CHECK(norm(beam.face_position(face, k) - expected) < 1e-15);
      const Vec<2> turning = (side * omega[k]) * Vec<2>{{-std::cos(theta[k]), -std::sin(theta[k])}};
      CHECK(norm(beam.face_velocity(face, k) - v[k] - turning) < 1e-15);
      pushed.add_face_force(face, k, f[k], dt);
      for (const auto seen : both_faces)
      {
        const auto before = beam.face_velocity(seen, k), after = pushed.face_velocity(seen, k);
        CHECK(norm(after - before - (0.5 * dt) * (beam.face_inverse_mass(seen, face, k) * f[k])) <
              1e-13 * norm(after));
        if (seen == face)
          power += 0.5 * dt * dot(f[k], 0.5 * (after + before));
      }
    }
    CHECK(pushed.kinetic_energy() - beam.kinetic_energy() == Approx(power).epsilon(1e-10));
  }
}
