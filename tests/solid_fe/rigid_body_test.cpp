// Rigid bodies made of node sets: free flight, a spinning plate, a rigid hammer on a soft block.
#include "solid_fe/solid.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

template <int dim>
Mesh<dim> with_set(Mesh<dim> mesh, double above)
{
  for (index_t n = 0; n < mesh.n_nodes(); ++n)
    if (mesh.x[static_cast<std::size_t>(n)][1] > above)
      mesh.node_sets["hammer"].push_back(n);
  return mesh;
}

} // namespace

// No forces: angular momentum is kept by construction, the shape to round-off; the midpoint rule keeps the
// spin energy of a body without symmetry to O(Δt²).
TEMPLATE_TEST_CASE_SIG("a free rigid body flies and spins without changing its shape", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  auto config = soft_config(dim, "neo_hookean_ln");
  config.rigid = {"hammer"};
  config.gravity = std::vector<double>(dim, 0.0);
  config.gravity[1] = -10.0;
  Solid<dim> solid(config, with_set(distorted_box<dim>(element_types<dim>()[1]), -1.0)); // all of it
  solid.set_motion(zero_field<dim>(),
                   [](const Vec<dim>& X)
                   {
                     Vec<dim> v;
                     v[0] = 3.0 - 8.0 * X[1];
                     v[1] = 8.0 * X[0] - (dim == 3 ? 5.0 * X[dim - 1] : 0.0);
                     if (dim == 3)
                       v[dim - 1] = 5.0 * X[1];
                     return v;
                   });
  const auto& nodes = solid.nodes();
  const double edge = norm(nodes.X[0] - nodes.X[nodes.X.size() - 1]), dt = 0.5 * solid.critical_time_step();
  const auto p0 = solid.linear_momentum();
  const double E0 = solid.energies().kinetic;
  double drift = 0.0;
  for (int k = 0; k < 500; ++k)
  {
    solid.predict(dt);
    solid.solve_free_motion(dt);
    drift = std::max(drift, std::abs(solid.energies().balance() / E0 - 1.0));
  }
  const auto last = nodes.X.size() - 1;
  CHECK(norm(nodes.X[0] + nodes.u[0] - nodes.X[last] - nodes.u[last]) == Approx(edge).epsilon(1e-12));
  CHECK(solid.linear_momentum()[1] == Approx(p0[1] - 10.0 * solid.mass() * solid.time()).epsilon(1e-11));
  CHECK(solid.energies().strain < 1e-14 * 1.4e6); // W of a rotation is round-off of the modulus
  INFO("energy " << drift);
  CHECK(drift < 1e-3);
}

// The upper third of a soft block is rigid: the ledger closes like that of the soft block alone, momentum
// exactly.
TEMPLATE_TEST_CASE_SIG("a rigid part on a soft block keeps momentum and energy", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  auto config = soft_config(dim, "neo_hookean_ln");
  config.rigid = {"hammer"};
  Solid<dim> solid(config, with_set(distorted_box<dim>(element_types<dim>()[1]), 0.4));
  Random random(4);
  solid.set_motion(zero_field<dim>(),
                   [&](const Vec<dim>& X)
                   {
                     auto v = random.vector<dim>(0.2);
                     v[0] += 2.0 * X[1];
                     return v;
                   });
  const auto p0 = solid.linear_momentum();
  const auto L0 = solid.angular_momentum();
  const double E0 = solid.energies().balance(), dt = 0.5 * solid.critical_time_step();
  double drift = 0.0;
  for (int k = 0; k < 2000; ++k)
  {
    solid.predict(dt);
    solid.solve_free_motion(dt);
    drift = std::max(drift, std::abs(solid.energies().balance() / E0 - 1.0));
  }
  INFO("energy " << drift << ", L " << norm(solid.angular_momentum() - L0) / norm(L0));
  CHECK(norm(solid.linear_momentum() - p0) < 1e-11 * norm(p0));
  CHECK(norm(solid.angular_momentum() - L0) < 1e-11 * norm(L0));
  CHECK(drift < 0.02);
}

TEST_CASE("a rigid body that is fixed or wet is refused", "[solid][unit]")
{
  auto config = soft_config(2, "linear");
  const auto mesh = with_set(distorted_box<2>(ElementType::quadrilateral4), 0.4);
  config.rigid = {"hammer"};
  config.fix = {{"top", {"x"}}};
  CHECK_THROWS_WITH((Solid<2>(config, mesh)),
                    Catch::Contains("solid.rigid[0]") && Catch::Contains("prescribed"));
  config.fix.clear();
  config.wet = {{"gamma", "top"}};
  CHECK_THROWS_WITH((Solid<2>(config, mesh)), Catch::Contains("may not be wet"));
}
