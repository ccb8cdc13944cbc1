// Elements and blocks: interpolation, patch test, mass, loads.
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

#include <set>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

TEMPLATE_TEST_CASE("shape functions sum to one and their gradients to zero", "[solid][unit]", Triangle3,
                   Quadrilateral4, Tetrahedron4, Hexahedron8)
{
  Random random(1);
  for (int k = 0; k < 10; ++k)
  {
    const auto xi = random.vector<TestType::dim>(1.0);
    double sum = 0.0;
    Vec<TestType::dim> gradient;
    for (std::size_t a = 0; a < TestType::nodes; ++a)
    {
      sum += TestType::shape(xi)[a];
      gradient += TestType::shape_gradient(xi)[a];
    }
    CHECK(std::abs(sum - 1.0) < 1e-15);
    CHECK(norm(gradient) < 1e-15);
  }
}

TEMPLATE_TEST_CASE("shape gradients are the derivatives of the shape functions", "[solid][unit]", Triangle3,
                   Quadrilateral4, Tetrahedron4, Hexahedron8)
{
  const auto xi = Random(2).vector<TestType::dim>(0.5);
  const double step = 1e-6;
  for (int j = 0; j < TestType::dim; ++j)
  {
    auto forward = xi, backward = xi;
    forward[j] += step;
    backward[j] -= step;
    for (std::size_t a = 0; a < TestType::nodes; ++a)
    {
      // Multilinear in each coordinate: the central difference has round-off 1e-16/1e-6 only.
      const double difference = (TestType::shape(forward)[a] - TestType::shape(backward)[a]) / (2.0 * step);
      CHECK(std::abs(TestType::shape_gradient(xi)[a][j] - difference) < 1e-9);
    }
  }
}

// Linear displacement on a distorted mesh: constant stress P, so forces cancel at inner nodes and equal ∫ N_a
// P N dA on the boundary. Patch test, Hughes (1987) ch. 4. About 30 terms of size P A each: 30 · 1e-16 · 1e2.
TEMPLATE_TEST_CASE_SIG("a patch of constant strain is in equilibrium with its boundary", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
    for (const auto& law_name : law_names())
    {
      const auto mesh = distorted_box<dim>(type);
      const Solid<dim> solid(soft_config(dim, law_name), mesh);
      const auto H = Random(17).matrix<dim>(0.1);
      std::vector<Vec<dim>> u;
      for (const auto& X : solid.nodes().X)
        u.push_back(H * X);
      const auto F_int = solid.internal_force_at(u);

      const auto P =
          std::visit([&H](const auto& law) { return law.first_piola(H); }, solid.bodies()[0].material);
      std::vector<Vec<dim>> expected(u.size());
      for (const auto& [name, surface] : solid.mesh().surfaces)
        for (index_t f = 0; f < surface.size(); ++f)
        {
          const auto begin = static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f)]);
          const auto end = static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f) + 1]);
          const std::span<const index_t> facet(surface.nodes.data() + begin, end - begin);
          const auto weights = facet_weights(solid.mesh(), facet);
          Vec<dim> normal;
          if constexpr (dim == 2)
            normal = right_normal(mesh.x[static_cast<std::size_t>(facet[1])] -
                                  mesh.x[static_cast<std::size_t>(facet[0])]);
          else
            normal = cross(
                mesh.x[static_cast<std::size_t>(facet[1])] - mesh.x[static_cast<std::size_t>(facet[0])],
                mesh.x[static_cast<std::size_t>(facet[2])] - mesh.x[static_cast<std::size_t>(facet[0])]);
          normal *= 1.0 / norm(normal);
          for (std::size_t a = 0; a < facet.size(); ++a)
            expected[static_cast<std::size_t>(facet[a])] += weights[a] * (P * normal);
        }
      double worst = 0.0;
      for (std::size_t n = 0; n < u.size(); ++n)
        worst = std::max(worst, norm(F_int[n] - expected[n]));
      INFO(element_name(type) << " " << law_name << ": largest force error " << worst << " N");
      CHECK(worst < 1e-14 * 30 * std::sqrt(contract(P, P)));
    }
}

TEMPLATE_TEST_CASE_SIG("the lumped mass is density times volume", "[solid][unit]", ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
  {
    const Solid<dim> solid(soft_config(dim, "linear"), distorted_box<dim>(type));
    const double volume = dim == 2 ? 0.75 : 0.75 * 0.5;
    CHECK(solid.mass() == Approx(1000.0 * volume).epsilon(1e-13)); // about 1e2 additions
    for (const double m : solid.nodes().m)
      CHECK(m > 0.0);
  }
}

TEMPLATE_TEST_CASE_SIG("a traction adds up to traction times area, at its centroid", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
  {
    auto config = soft_config(dim, "linear");
    std::vector<double> value = {3.0, -2.0, 5.0};
    value.resize(dim);
    config.traction.push_back({.on = "right", .value = value, .ramp = 0.0});
    const auto mesh = distorted_box<dim>(type);
    const auto loads = nodal_loads(mesh, config);
    REQUIRE(loads.size() == 1);
    Vec<dim> total, moment;
    for (std::size_t k = 0; k < loads[0].nodes.size(); ++k)
    {
      total += loads[0].force[k];
      moment += loads[0].force[k][0] * mesh.x[static_cast<std::size_t>(loads[0].nodes[k])];
    }
    const double area = dim == 2 ? 0.75 : 0.75 * 0.5;
    for (int i = 0; i < dim; ++i)
      CHECK(total[i] == Approx(area * value[static_cast<std::size_t>(i)]).epsilon(1e-13));
    const double centroid[] = {1.0, 0.375, 0.25};
    for (int i = 0; i < dim; ++i)
      CHECK(moment[i] == Approx(area * value[0] * centroid[i]).epsilon(1e-13));
  }
}

TEST_CASE("a traction ramp grows linearly and then stays", "[solid][unit]")
{
  const NodalLoad<2> load{.nodes = {}, .force = {}, .ramp = 2.0};
  CHECK(load.factor(0.0) == 0.0);
  CHECK(load.factor(0.5) == 0.25);
  CHECK(load.factor(2.0) == 1.0);
  CHECK(load.factor(9.0) == 1.0);
  CHECK(NodalLoad<2>{}.factor(0.0) == 1.0);
}

TEMPLATE_TEST_CASE_SIG("wet nodes and the elements that touch them come first", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
  {
    auto config = soft_config(dim, "linear");
    config.wet = {{"front_side", "right"}, {"lid", "top"}};
    const auto mesh = distorted_box<dim>(type);
    Solid<dim> solid(config, mesh);
    std::set<index_t> wet;
    for (const auto* name : {"right", "top"})
      for (const index_t n : mesh.surfaces.at(name).node_set())
        wet.insert(n);
    REQUIRE(solid.n_wet_nodes() == static_cast<index_t>(wet.size()));
    for (index_t n = 0; n < solid.n_wet_nodes(); ++n)
      CHECK(wet.count(solid.given_number()[static_cast<std::size_t>(n)]) == 1);
    std::visit(
        [&](const auto& block)
        {
          for (index_t e = 0; e < block.size(); ++e)
          {
            bool touches = false;
            for (const index_t n : block.nodes[static_cast<std::size_t>(e)])
              touches = touches || n < solid.n_wet_nodes();
            CHECK(touches == (e < block.n_interface));
          }
        },
        solid.bodies()[0].block);

    const auto message = solid.wet_surface();
    CHECK(message.interfaces == std::vector<std::string>{"front_side", "lid"});
    CHECK(message.n_nodes() == solid.n_wet_nodes());
    CHECK(message.n_faces() == mesh.surfaces.at("right").size() + mesh.surfaces.at("top").size());
    for (std::size_t n = 0; n < message.node_id.size(); ++n)
      for (int i = 0; i < dim; ++i)
        CHECK(message.x[n * dim + static_cast<std::size_t>(i)] ==
              mesh.x[static_cast<std::size_t>(message.node_id[n])][i]);
  }
}

// Two bodies of different element types share a curve: 2 m² of triangles and 0.75 m² of quadrilaterals.
// Constant strain must not notice (patch test); tolerance as above.
TEST_CASE("a Gmsh mesh of triangles and quadrilaterals passes the patch test", "[solid][unit]")
{
  const auto mesh = read_gmsh<2>(SOLID_TEST_DATA "/../../common/data/plane_41.msh");
  const Solid<2> solid(soft_config(2, "neo_hookean_ln"), mesh);
  REQUIRE(solid.bodies().size() == 2);
  CHECK(solid.mass() == Approx(2750.0).epsilon(1e-13));
  const auto H = Random(19).matrix<2>(0.1);
  std::vector<Vec<2>> u;
  for (const auto& X : solid.nodes().X)
    u.push_back(H * X);
  const auto F_int = solid.internal_force_at(u);
  std::set<index_t> outer;
  for (const index_t n : boundary_of(solid.mesh()).nodes)
    outer.insert(n);
  double worst = 0.0, largest = 0.0;
  for (index_t n = 0; n < solid.nodes().size(); ++n)
  {
    double& record = outer.count(n) == 1 ? largest : worst;
    record = std::max(record, norm(F_int[static_cast<std::size_t>(n)]));
  }
  CHECK(outer.size() < u.size()); // there are inner nodes, two of them on the shared curve
  CHECK(worst < 1e-14 * 30 * largest);
}
