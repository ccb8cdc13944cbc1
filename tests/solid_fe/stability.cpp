// How sharp the claimed stable step is: the smallest multiple of it at which the energy of random small
// solids grows.
//
//   build/release/tests/solid_stability [samples]      (default 30)
#include "solid_fe/solid.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace
{

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

/// Does the energy of small random motion grow beyond all bounds at `fraction` of the claim? An excess δ over
/// the true limit makes the worst mode grow by 2 √(2 δ) per step: 1e-4 is e^84 in 3000 steps.
template <int dim>
bool grows(const SolidConfig& config, const Mesh<dim>& mesh, double fraction, unsigned seed)
{
  Solid<dim> solid(config, mesh);
  Random random(seed);
  solid.set_motion(zero_field<dim>(), [&](const Vec<dim>&) { return random.vector<dim>(1e-4); });
  const double E0 = solid.energies().kinetic, dt = fraction * solid.critical_time_step();
  try
  {
    for (int k = 1; k <= 3000; ++k)
    {
      solid.predict(dt);
      solid.solve_free_motion(dt);
      if (k % 100 == 0 && !(solid.energies().kinetic < 1e6 * E0))
        return true;
    }
  }
  catch (const std::exception&)
  {
    return true; // an element is inverted
  }
  return false;
}

template <int dim>
void measure(const char* name, ElementType type, Formulation formulation, PlaneKind plane, int samples)
{
  double sharpest = 1e9, sum = 0.0;
  int unstable = 0;
  for (int sample = 0; sample < samples; ++sample)
  {
    Random random(static_cast<unsigned>(100 + sample));
    auto config = soft_config(dim, sample % 2 == 0 ? "neo_hookean_ln" : "svk");
    config.formulation = formulation;
    config.plane = plane;
    config.step_safety = 1.0;
    config.material.poisson_ratio = 0.24 * (random() + 1.0);
    if (random() > 0.0)
      config.fix = {{formulation == Formulation::beam ? "start" : "bottom", {}}};
    auto mesh = distorted_box<dim>(type, 3, 0.3);
    if constexpr (dim == 2)
      if (formulation == Formulation::beam)
      {
        config.geometry.line = {0.0, 0.0, 1.0, random(0.5)};
        config.geometry.thickness = std::pow(10.0, -1.0 + random());
        config.geometry.element_size = 0.3;
        config.material.law = "svk";
        mesh = make_mesh<2>(config);
      }
    const double flat = std::pow(2.0, random()), shear = random(0.3);
    for (auto& x : mesh.x) // flattened and sheared as a whole
    {
      x[1] *= flat;
      x[0] += shear * x[1] + (plane == PlaneKind::axisymmetric ? 0.7 : 0.0);
    }
    const auto seed = static_cast<unsigned>(sample);
    unstable += grows<dim>(config, mesh, 1.0, seed);
    double low = 1.0, high = 4.0;
    while (high / low > 1.005)
    {
      const double middle = std::sqrt(low * high);
      (grows<dim>(config, mesh, middle, seed) ? high : low) = middle;
    }
    sharpest = std::min(sharpest, high);
    sum += high;
  }
  std::printf("| %-16s | %7d | %10d | %8.2f | %7.2f |\n", name, samples, unstable, sharpest, sum / samples);
  std::fflush(stdout);
}

} // namespace

int main(int argc, char** argv)
{
  const int samples = argc > 1 ? std::atoi(argv[1]) : 30;
  std::printf("| element | samples | growing at 1.0 | smallest that grows | mean |\n| --- | --- | --- | --- "
              "| --- |\n");
  using enum ElementType;
  using enum Formulation;
  measure<2>("T3", triangle3, full, PlaneKind::strain, samples);
  measure<2>("T3 locking free", triangle3, locking_free, PlaneKind::strain, samples);
  measure<2>("Q4", quadrilateral4, full, PlaneKind::strain, samples);
  measure<2>("Q4 one point", quadrilateral4, one_point, PlaneKind::strain, samples);
  measure<2>("Q4 B-bar", quadrilateral4, locking_free, PlaneKind::strain, samples);
  measure<2>("Q4 plane stress", quadrilateral4, full, PlaneKind::stress, samples);
  measure<2>("Q4 ring", quadrilateral4, one_point, PlaneKind::axisymmetric, samples);
  measure<2>("beam", quadrilateral4, Formulation::beam, PlaneKind::strain, samples);
  measure<3>("Tet4", tetrahedron4, full, PlaneKind::strain, samples);
  measure<3>("Tet4 locking free", tetrahedron4, locking_free, PlaneKind::strain, samples);
  measure<3>("Hex8", hexahedron8, full, PlaneKind::strain, samples);
  measure<3>("Hex8 one point", hexahedron8, one_point, PlaneKind::strain, samples);
  measure<3>("Hex8 B-bar", hexahedron8, locking_free, PlaneKind::strain, samples);
  return 0;
}
