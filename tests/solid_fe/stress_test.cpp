// Random small solids run at random fractions of the claimed step: the energy stays bounded.
#include "solid_fe/solid.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

template <class T>
const T& pick(Random& random, const std::vector<T>& from)
{
  const auto k = static_cast<std::size_t>(0.5 * (random() + 1.0) * static_cast<double>(from.size()));
  return from[std::min(k, from.size() - 1)];
}

} // namespace

// Mesh, form, plane, law, Poisson's ratio, damping, a wall, supports and motion are drawn; the step is 0.5
// to 1.0 of the claimed one and follows it downward. The plain energy may exceed the conserved one by 1/(1 −
// (Δt/Δt_true)²), at most 20 (see critical_time_step_test.cpp), while an unstable mode would grow by orders
// of magnitude within some steps.
TEMPLATE_TEST_CASE_SIG("random solids are stable up to the claimed step", "[solid][verification]",
                       ((int dim), dim), 2, 3)
{
  Random random(20240 + dim);
  for (int sample = 0; sample < 150; ++sample)
  {
    auto config = soft_config(dim, pick(random, law_names()));
    config.formulation =
        pick<Formulation>(random, {Formulation::full, Formulation::one_point, Formulation::locking_free});
    config.plane =
        dim == 2 ? pick<PlaneKind>(random, {PlaneKind::strain, PlaneKind::stress, PlaneKind::axisymmetric})
                 : PlaneKind::strain;
    const auto type = pick(random, element_types<dim>());
    if (config.plane == PlaneKind::stress && config.formulation == Formulation::locking_free)
      config.formulation = Formulation::full;
    if (config.plane == PlaneKind::axisymmetric)
      config.formulation = type == ElementType::triangle3                 ? Formulation::full
                           : config.formulation == Formulation::one_point ? Formulation::one_point
                                                                          : Formulation::locking_free;
    config.material.poisson_ratio = 0.225 * (random() + 1.0);
    if (config.material.law == "j2" || config.material.law == "johnson_cook")
    {
      config.material.yield_stress = 5e4;
      config.material.hardening_modulus = config.material.hardening_coefficient = 1e5;
    }
    if (random() > 0.5)
      config.material.mass_damping = 5.0;
    if (random() > 0.5)
      config.material.stiffness_damping = 2e-4;
    if (random() > 0.0)
      config.hourglass_viscosity = 0.1;
    if (random() > 0.0)
      config.fix = {{"bottom", {"x", "y"}}};
    else
    {
      WallConfig wall{.point = std::vector<double>(dim, 0.0),
                      .normal = std::vector<double>(dim, 0.0),
                      .friction = 0.2,
                      .on = ""};
      wall.point[1] = -0.01;
      wall.normal[1] = 1.0;
      config.wall.push_back(wall);
    }
    config.step_safety = 0.75 + 0.25 * random();
    auto mesh = distorted_box<dim>(type, 3, 0.2);
    if (config.plane == PlaneKind::axisymmetric)
      for (auto& x : mesh.x)
        x[0] += 0.2;
    Solid<dim> solid(config, mesh);
    const double speed = config.material.law == "linear" ? 3.0 : 0.6;
    solid.set_motion(zero_field<dim>(), [&](const Vec<dim>&) { return random.template vector<dim>(speed); });
    const double E0 = solid.energies().kinetic;
    double highest = 0.0, dt = solid.critical_time_step();
    for (int k = 0; k < 2000; ++k)
    {
      if (k % 5 == 0)
        dt = std::min(dt, solid.critical_time_step());
      solid.predict(dt);
      solid.solve_free_motion(dt);
      if (k % 20 == 0)
      {
        const auto e = solid.energies();
        highest = std::max(highest, e.kinetic + e.strain + e.hourglass);
      }
    }
    INFO("sample " << sample << ": " << element_name(type) << ", form "
                   << static_cast<int>(config.formulation) << ", plane " << static_cast<int>(config.plane)
                   << ", " << config.material.law << ", nu " << config.material.poisson_ratio << ", fraction "
                   << config.step_safety << ": highest energy " << highest / E0);
    CHECK(highest < 20.0 * E0);
  }
}
