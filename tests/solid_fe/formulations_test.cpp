// Element formulations: patch test, rotation, conservation, stable step, locking (Cook's membrane).
#include "solid_fe/critical_time_step.hpp"
#include "solid_fe/solid.hpp"
#include "tests/solid_fe/fixtures.hpp"
#include "tests/solid_fe/power_iteration.hpp"

#include <catch2/catch.hpp>

#include <cstdlib>
#include <numbers>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

/// All forms beyond plain full integration in plane strain and 3-D, which the older tests cover.
template <int dim>
std::vector<Kind> kinds()
{
  if constexpr (dim == 2)
    return {{ElementType::triangle3, Formulation::locking_free},
            {ElementType::quadrilateral4, Formulation::one_point},
            {ElementType::quadrilateral4, Formulation::locking_free},
            {ElementType::triangle3, Formulation::full, PlaneKind::stress},
            {ElementType::quadrilateral4, Formulation::full, PlaneKind::stress},
            {ElementType::quadrilateral4, Formulation::one_point, PlaneKind::stress}};
  else
    return {{ElementType::tetrahedron4, Formulation::locking_free},
            {ElementType::hexahedron8, Formulation::one_point},
            {ElementType::hexahedron8, Formulation::locking_free}};
}

/// Forms of a ring; their x is a radius, so the tests of the plane do not apply as they are.
const std::vector<Kind> ring_kinds = {
    {ElementType::triangle3, Formulation::full, PlaneKind::axisymmetric},
    {ElementType::quadrilateral4, Formulation::one_point, PlaneKind::axisymmetric},
    {ElementType::quadrilateral4, Formulation::locking_free, PlaneKind::axisymmetric}};

SolidConfig config_of(int dim, const std::string& law, const Kind& kind)
{
  auto config = soft_config(dim, law);
  config.formulation = kind.formulation;
  config.plane = kind.plane;
  return config;
}

std::string name_of(const Kind& kind)
{
  return std::string(element_name(kind.type)) +
         (kind.formulation == Formulation::one_point      ? " one point"
          : kind.formulation == Formulation::locking_free ? " locking free"
                                                          : "") +
         (kind.plane == PlaneKind::stress         ? " plane stress"
          : kind.plane == PlaneKind::axisymmetric ? " ring"
                                                  : "");
}

} // namespace

// Linear displacement on a distorted mesh: the forces of inner nodes vanish. About 30 terms of size P A each:
// 30 · 1e-16 relative to the boundary's; the plane stress iteration stops at 1e-12 of the modulus.
TEMPLATE_TEST_CASE_SIG("every form passes the patch test on distorted elements", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  for (const auto& kind : kinds<dim>())
    for (const auto& law : law_names())
    {
      const Solid<dim> solid(config_of(dim, law, kind), distorted_box<dim>(kind.type));
      const auto H = Random(17).matrix<dim>(0.1);
      std::vector<Vec<dim>> u;
      for (const auto& X : solid.nodes().X)
        u.push_back(H * X);
      const auto F_int = solid.internal_force_at(u);
      std::vector<bool> outer(u.size(), false);
      for (const index_t n : boundary_of(solid.mesh()).nodes)
        outer[static_cast<std::size_t>(n)] = true;
      double inner_force = 0.0, outer_force = 0.0;
      for (std::size_t n = 0; n < u.size(); ++n)
        (outer[n] ? outer_force : inner_force) =
            std::max(outer[n] ? outer_force : inner_force, norm(F_int[n]));
      INFO(name_of(kind) << " " << law << ": inner " << inner_force << ", outer " << outer_force);
      CHECK(outer_force > 1e3);
      CHECK(inner_force < (kind.plane == PlaneKind::stress ? 1e-10 : 1e-13) * outer_force);
    }
}

// The patch test of a ring: u = (a R, b Z) has H = diag(a, b, a), constant stress with P₁₁ = P₃₃, in
// equilibrium. ∫ ∂N/∂R dV + ∫ N/R dV vanishes exactly under one-point and Gauss quadrature only where ∫ ∂(R
// N)/∂R dR dZ is integrated exactly: quadratic, so on axis-parallel meshes; with distortion the 2 × 2 points
// still are exact for the bilinear map of (R N)'s gradient times the Jacobian, one point is not.
TEST_CASE("a ring under uniform expansion is in equilibrium", "[solid][unit]")
{
  for (const auto& law : law_names())
  {
    const Kind kind = ring_kinds[2];
    auto mesh = distorted_box<2>(kind.type);
    for (auto& x : mesh.x)
      x[0] += 0.5;
    const Solid<2> solid(config_of(2, law, kind), mesh);
    std::vector<Vec<2>> u;
    for (const auto& X : solid.nodes().X)
      u.push_back({{0.05 * X[0], -0.03 * X[1]}});
    const auto F_int = solid.internal_force_at(u);
    std::vector<bool> outer(u.size(), false);
    for (const index_t n : boundary_of(solid.mesh()).nodes)
      outer[static_cast<std::size_t>(n)] = true;
    double inner_force = 0.0, outer_force = 0.0;
    for (std::size_t n = 0; n < u.size(); ++n)
      (outer[n] ? outer_force : inner_force) = std::max(outer[n] ? outer_force : inner_force, norm(F_int[n]));
    INFO(law << ": inner " << inner_force << ", outer " << outer_force);
    CHECK(inner_force < 1e-12 * outer_force);
  }
}

// Pappus: the ring of the section 1 × 0.75 m with centroid at R = 1 m.
TEST_CASE("the mass of a ring is that of Pappus", "[solid][unit]")
{
  for (const auto& kind : ring_kinds)
  {
    auto mesh = distorted_box<2>(kind.type);
    for (auto& x : mesh.x)
      x[0] += 0.5;
    const Solid<2> solid(config_of(2, "linear", kind), mesh);
    // The 2 × 2 points and, for triangles, one point at the centroid integrate R exactly.
    CHECK(solid.mass() == Approx(1000.0 * 2.0 * std::numbers::pi * 0.75).epsilon(1e-12));
  }
}

// Rotation of the reference state: forces of round-off size, 1e-15 of modulus times area, times 30 terms.
TEMPLATE_TEST_CASE_SIG("a rigid rotation gives no force in any form", "[solid][unit]", ((int dim), dim), 2, 3)
{
  for (const auto& kind : kinds<dim>())
    for (const auto& law : law_names())
    {
      if (law == "linear")
        continue;
      const Solid<dim> solid(config_of(dim, law, kind), distorted_box<dim>(kind.type));
      const auto H = rotation<dim>(1.3) - Mat<dim>::identity();
      std::vector<Vec<dim>> u;
      for (const auto& X : solid.nodes().X)
        u.push_back(H * X);
      double worst = 0.0;
      for (const auto& f : solid.internal_force_at(u))
        worst = std::max(worst, norm(f));
      INFO(name_of(kind) << " " << law << ": " << worst);
      CHECK(worst < 1e-13 * 1.4e6);
    }
}

// The internal force is the gradient of the energy (strain and hourglass): central difference along a random
// direction. Truncation h² W''' ~ 1e-10 relative, round-off 1e-16/1e-5.
TEMPLATE_TEST_CASE_SIG("the forces of every form are the derivative of its energy", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  auto all = kinds<dim>();
  if constexpr (dim == 2)
    all.insert(all.end(), ring_kinds.begin(), ring_kinds.end());
  for (const auto& kind : all)
    for (const auto& law : law_names())
    {
      auto mesh = distorted_box<dim>(kind.type);
      if (kind.plane == PlaneKind::axisymmetric)
        for (auto& x : mesh.x)
          x[0] += 0.5;
      Solid<dim> solid(config_of(dim, law, kind), mesh);
      const auto H = Random(17).matrix<dim>(0.1);
      std::vector<Vec<dim>> u, direction;
      Random random(19);
      for (const auto& X : solid.nodes().X)
      {
        u.push_back(H * X + random.vector<dim>(0.02));
        direction.push_back(random.vector<dim>(1.0));
      }
      const double step = 1e-5;
      const auto energy_at = [&](double s)
      {
        std::size_t n = 0;
        solid.set_motion(
            [&](const Vec<dim>&)
            {
              const auto k = n++;
              return u[k] + s * direction[k];
            },
            zero_field<dim>());
        const auto e = solid.energies();
        return e.strain + e.hourglass;
      };
      const double derivative = (energy_at(step) - energy_at(-step)) / (2.0 * step);
      const auto F = solid.internal_force_at(u);
      double power = 0.0, scale = 0.0;
      for (std::size_t n = 0; n < u.size(); ++n)
      {
        power += dot(F[n], direction[n]);
        scale += norm(F[n]);
      }
      INFO(name_of(kind) << " " << law << ": " << power << " against " << derivative);
      CHECK(std::abs(power - derivative) < 1e-6 * scale);
    }
}

// As in critical_time_step_test.cpp: rigorous up to the finite difference; deformed states of the averaged
// forms are covered by the bound's extra factor.
TEMPLATE_TEST_CASE_SIG("the claimed step of every form never exceeds the true limit", "[solid][verification]",
                       ((int dim), dim), 2, 3)
{
  auto all = kinds<dim>();
  if constexpr (dim == 2)
    all.insert(all.end(), ring_kinds.begin(), ring_kinds.end());
  for (const auto& kind : all)
    for (const auto& law : {"linear", "neo_hookean_ln", "hencky", "j2"})
      for (const double poisson : {0.0, 0.3, 0.45})
        for (const double strain : {0.0, 0.15})
        {
          auto config = config_of(dim, law, kind);
          config.material.poisson_ratio = poisson;
          config.step_safety = 1.0;
          auto mesh = distorted_box<dim>(kind.type, 4, 0.2);
          if (kind.plane == PlaneKind::axisymmetric)
            for (auto& x : mesh.x)
              x[0] += 0.01;
          Solid<dim> solid(config, mesh);
          Random random(37);
          const auto H = random.matrix<dim>(strain);
          const auto ripple = random.vector<dim>(0.05 * strain);
          solid.set_motion(
              [&](const Vec<dim>& X)
              {
                const double r = kind.plane == PlaneKind::axisymmetric ? X[0] : 1.0; // no hole on the axis
                return r * (H * X + std::sin(9.0 * X[0] + 5.0 * X[1]) * ripple);
              },
              zero_field<dim>());
          const double claimed = solid.critical_time_step();
          const double limit = 2.0 / highest_frequency(solid, solid.nodes().u, dim == 2 ? 800 : 300);
          INFO(name_of(kind) << " " << law << " nu " << poisson << " strain " << strain
                             << ": claimed/true = " << claimed / limit);
          CHECK(claimed <= limit * (1.0 + 1e-6));
          // Deformed: see the README. Plane stress: the bound ignores the relief across the plane;
          // averaged dilatation: it ignores the averaging.
          CHECK(claimed >= (strain > 0.0 ? 0.25 : 0.38) * limit);
        }
}

// As in solid_test.cpp: symmetric Kirchhoff stress and objective hourglass forces keep angular momentum.
TEMPLATE_TEST_CASE_SIG("a rotating block keeps its angular momentum and its energy in every form",
                       "[solid][unit]", ((int dim), dim), 2, 3)
{
  for (const auto& kind : kinds<dim>())
  {
    auto config = config_of(dim, "neo_hookean_ln", kind);
    Solid<dim> solid(config, distorted_box<dim>(kind.type));
    Random random(5);
    solid.set_motion(zero_field<dim>(),
                     [&](const Vec<dim>& X)
                     {
                       auto v = random.vector<dim>(0.3);
                       v[0] -= 20.0 * X[1];
                       v[1] += 20.0 * X[0];
                       return v;
                     });
    const auto L0 = solid.angular_momentum();
    const double E0 = solid.energies().balance(), dt = 0.5 * solid.critical_time_step();
    double drift = 0.0;
    for (int k = 0; k < 2000; ++k)
    {
      solid.predict(dt);
      solid.solve_free_motion(dt);
      if (k % 50 == 0)
        drift = std::max(drift, std::abs(solid.energies().balance() / E0 - 1.0));
    }
    const auto L = solid.angular_momentum();
    INFO(name_of(kind) << ": L " << norm(L - L0) / norm(L0) << ", energy " << drift);
    CHECK(norm(L - L0) < 1e-11 * norm(L0)); // 2000 steps of round-off; plane stress iterates to 1e-12
    CHECK(drift < 0.01);
  }
}

// Damping takes what the ledger says: the identity of energies is exact for the linear law.
TEST_CASE("the energy balance closes with damping and viscous hourglass control", "[solid][unit]")
{
  auto config = config_of(2, "linear", {ElementType::quadrilateral4, Formulation::one_point});
  config.hourglass_viscosity = 0.1;
  config.material.mass_damping = 2.0;
  config.material.stiffness_damping = 1e-4;
  config.fix = {{"bottom", {"x", "y"}}};
  Solid<2> solid(config, distorted_box<2>(ElementType::quadrilateral4));
  Random random(5);
  solid.set_motion(zero_field<2>(), [&](const Vec<2>&) { return random.vector<2>(1.0); });
  const double dt = solid.critical_time_step();
  const auto correction = [&]
  {
    double sum = 0.0;
    for (std::size_t n = 0; n < solid.nodes().X.size(); ++n)
      sum += 0.125 * dt * dt * solid.nodes().m[n] * norm_squared(solid.nodes().a[n]);
    return sum;
  };
  const double E0 = solid.energies().kinetic;
  const double start = solid.energies().balance() - correction();
  double worst = 0.0;
  for (int k = 0; k < 500; ++k)
  {
    solid.predict(dt);
    solid.solve_free_motion(dt);
    worst = std::max(worst, std::abs(solid.energies().balance() - correction() - start));
  }
  CHECK(worst < 1e-12 * E0); // 500 sums
  CHECK(solid.energies().viscous > 0.5 * E0);
  CHECK(solid.energies().viscous <= E0 * (1.0 + 1e-12));
}

namespace
{

/// v(48, 52) of Cook's membrane under the shear force F at its right side, at rest: strong damping of the
/// lowest mode, whose frequency ω follows from the expected deflection. At t ω = end the rest has decayed to
/// (1 + τ) exp(-τ), τ = end - 2: 8e-5 of the deflection at 14, 3e-3 at 10.
template <int dim>
double cook(const Kind& kind, const std::string& law, double E, double nu, double F, double expected,
            int cells, double end = 14.0)
{
  auto config = config_of(dim, law, kind);
  config.material.youngs_modulus = E;
  config.material.poisson_ratio = nu;
  config.material.density = 1.0;
  const double thickness = dim == 3 ? 48.0 / cells : 1.0;
  const double omega = std::sqrt(F / (0.25 * 1440.0 * expected));
  config.material.mass_damping = 2.0 * omega;
  config.measures_frequency = true; // what comes to rest does not depend on the step
  config.fix = {
      {"left", dim == 2 ? std::vector<std::string>{"x", "y"} : std::vector<std::string>{"x", "y", "z"}}};
  if (dim == 3)
  {
    config.fix.push_back({"front", {"z"}});
    config.fix.push_back({"back", {"z"}});
  }
  config.traction = {{.on = "right", .value = std::vector<double>(dim, 0.0), .ramp = 2.0 / omega}};
  config.traction[0].value[1] = F / 16.0;
  Mesh<dim> mesh;
  if constexpr (dim == 2)
    mesh = box_mesh<2>({}, {{48.0, 1.0}}, {cells, cells}, kind.type);
  else
    mesh = box_mesh<3>({}, {{48.0, 1.0, thickness}}, {cells, cells, 1}, kind.type);
  index_t middle = -1;
  for (index_t n = 0; n < mesh.n_nodes(); ++n)
  {
    auto& x = mesh.x[static_cast<std::size_t>(n)];
    if (x[0] == 48.0 && std::abs(x[1] - 0.5) < 1e-9 && (dim == 2 || x[dim - 1] == 0.0))
      middle = n;
    const double s = x[0] / 48.0, bottom = 44.0 * s, top = 44.0 + 16.0 * s;
    x[1] = bottom + x[1] * (top - bottom);
  }
  Solid<dim> solid(config, mesh);
  const double t_end = end / omega;
  double dt = 0.0;
  for (int k = 0; solid.time() < t_end; ++k)
  {
    if (k % 100 == 0)
      dt = solid.critical_time_step();
    solid.predict(dt);
    solid.solve_free_motion(dt);
  }
  return solid.nodes().u[static_cast<std::size_t>(middle)][1];
}

} // namespace

// benchmarks: own quadratic elements 23.93 (16 × 16), 23.96 quoted as converged; the corner limits the order
// to 1.3.
TEST_CASE("Cook's membrane in plane stress", "[solid][verification][cook]")
{
  const Kind full{ElementType::quadrilateral4, Formulation::full, PlaneKind::stress};
  const Kind one{ElementType::quadrilateral4, Formulation::one_point, PlaneKind::stress};
  const double coarse = cook<2>(full, "linear", 1.0, 1.0 / 3.0, 1.0, 24.0, 16);
  const double fine = cook<2>(full, "linear", 1.0, 1.0 / 3.0, 1.0, 24.0, 32);
  const double one_point = cook<2>(one, "linear", 1.0, 1.0 / 3.0, 1.0, 24.0, 32);
  INFO("Cook plane stress: Q4 16 " << coarse << ", Q4 32 " << fine << ", one point 32 " << one_point);
  CHECK(std::abs(fine / 23.96 - 1.0) < 0.01);
  CHECK(std::abs(one_point / 23.96 - 1.0) < 0.01);
  CHECK(std::abs(fine / 23.96 - 1.0) < 0.55 * std::abs(coarse / 23.96 - 1.0));
}

// Tolerance of the benchmark table: 5 %; full integration is off by half. UNDINE_COOK_TRIANGLES: cells along
// a side for triangles, off by 9, 4.4, 2.7 % with 16, 24, 32.
TEST_CASE("nothing locks in Cook's nearly incompressible membrane but full integration",
          "[solid][verification][cook]")
{
  const double nu = 0.4999, E = 240.565, F = 100.0;
  const char* wanted = std::getenv("UNDINE_COOK_TRIANGLES");
  const int triangles = wanted != nullptr ? std::atoi(wanted) : 24;
  const auto run = [&](const Kind& kind, const char* law)
  { return cook<2>(kind, law, E, nu, F, 7.0, kind.type == ElementType::triangle3 ? triangles : 16, 10.0); };
  const Kind full{ElementType::quadrilateral4, Formulation::full},
      one{ElementType::quadrilateral4, Formulation::one_point},
      mean{ElementType::quadrilateral4, Formulation::locking_free},
      nodal{ElementType::triangle3, Formulation::locking_free};
  const double locked = run(full, "linear");
  const double q1 = run(one, "linear"), qm = run(mean, "linear"), tn = run(nodal, "linear");
  const double q1n = run(one, "neo_hookean_ln"), qmn = run(mean, "neo_hookean_ln"),
               tnn = run(nodal, "neo_hookean_ln");
  INFO("Cook nu 0.4999, 16 x 16 (T3 " << triangles << "): full " << locked << "; linear one point " << q1
                                      << ", mean " << qm << ", nodal T3 " << tn << "; neo-Hookean " << q1n
                                      << ", " << qmn << ", " << tnn);
  CHECK(locked < 0.75 * 7.65);
  for (const double v : {q1, qm, tn})
    CHECK(std::abs(v / 7.65 - 1.0) < 0.05);
  for (const double v : {q1n, qmn, tnn})
    CHECK(std::abs(v / 6.88 - 1.0) < 0.05);
}

// 7.881 from quadratic elements, 20 × 20 (rising); 1 %.
TEST_CASE("Cook's compressible neo-Hookean membrane", "[solid][verification][cook]")
{
  const Kind mean{ElementType::quadrilateral4, Formulation::locking_free};
  const double v = cook<2>(mean, "neo_hookean_ln", 240.565, 0.3, 100.0, 7.9, 32);
  INFO("Cook neo-Hookean nu 0.3, 32 x 32 mean dilatation: " << v);
  CHECK(std::abs(v / 7.881 - 1.0) < 0.01);
}

// The same membrane as a slab of one layer of tetrahedra between smooth plates (plane strain), nu = 0.49: the
// 2-D mean-dilatation value is the truth, 10 % for so coarse a mesh of constant-strain elements; standard
// ones lock.
TEST_CASE("tetrahedra with nodal dilatation do not lock", "[solid][verification][cook]")
{
  const double E = 240.565, nu = 0.49, F = 100.0;
  const double truth =
      cook<2>({ElementType::quadrilateral4, Formulation::locking_free}, "neo_hookean_ln", E, nu, F, 7.0, 24);
  const double hex =
      cook<3>({ElementType::hexahedron8, Formulation::locking_free}, "neo_hookean_ln", E, nu, F, 7.0, 12);
  const double hex1 =
      cook<3>({ElementType::hexahedron8, Formulation::one_point}, "neo_hookean_ln", E, nu, F, 7.0, 12);
  const double nodal =
      cook<3>({ElementType::tetrahedron4, Formulation::locking_free}, "neo_hookean_ln", E, nu, F, 7.0, 12);
  const double locked =
      cook<3>({ElementType::tetrahedron4, Formulation::full}, "neo_hookean_ln", E, nu, F, 7.0, 12);
  INFO("Cook slab nu 0.49: Q4 mean 24 " << truth << ", Hex8 mean 12 " << hex << ", Hex8 one point 12 " << hex1
                                        << ", Tet4 nodal 12 " << nodal << ", Tet4 12 " << locked);
  CHECK(std::abs(hex / truth - 1.0) < 0.03);
  CHECK(std::abs(hex1 / truth - 1.0) < 0.05);
  CHECK(std::abs(nodal / truth - 1.0) < 0.10);
  CHECK(locked < 0.85 * truth);
}
