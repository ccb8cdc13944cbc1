// Work that is left out changes no answer.
#include "solid_fe/solid.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

/// A box whose nodes up to x = 0.55 are the set "part".
template <int dim>
Mesh<dim> box_with_part(ElementType type)
{
  auto mesh = distorted_box<dim>(type, 6);
  for (index_t n = 0; n < mesh.n_nodes(); ++n)
    if (mesh.x[static_cast<std::size_t>(n)][0] < 0.55)
      mesh.node_sets["part"].push_back(n);
  return mesh;
}

template <int dim>
index_t idle_elements(const Solid<dim>& solid)
{
  index_t idle = 0;
  for (const auto& body : solid.bodies())
    std::visit([&](const auto& block) { idle += block.size() - block.n_active; }, body.block);
  return idle;
}

/// Largest distance of the nodes, now and of their velocities times the step, after `steps` steps of both;
/// the first leaves its idle elements out, the second does not.
template <int dim>
double distance(SolidConfig config, const Mesh<dim>& mesh, double spin, int steps)
{
  Solid<dim> skipping(config, mesh);
  config.skips_idle_elements = false;
  Solid<dim> working(config, mesh);
  CHECK(idle_elements(skipping) > 0);
  CHECK(idle_elements(working) == 0);
  const auto v = [&](const Vec<dim>& X)
  {
    Vec<dim> velocity;
    velocity[0] = -spin * X[1];
    velocity[1] = spin * X[0] + 0.3 * X[0] * X[0];
    return velocity;
  };
  for (auto* solid : {&skipping, &working})
    solid->set_motion(zero_field<dim>(), v);
  const double dt = std::min(skipping.critical_time_step(), working.critical_time_step());
  CHECK(skipping.critical_time_step() >= working.critical_time_step() * (1.0 - 1e-12));
  double largest = 0.0;
  for (int k = 0; k < steps; ++k)
  {
    for (auto* solid : {&skipping, &working})
    {
      solid->predict(dt);
      solid->solve_free_motion(dt);
    }
    for (std::size_t n = 0; n < mesh.x.size(); ++n)
      largest = std::max({largest, norm(skipping.nodes().u[n] - working.nodes().u[n]),
                          dt * norm(skipping.nodes().v[n] - working.nodes().v[n])});
  }
  CHECK(skipping.energies().balance() == Approx(working.energies().balance()).epsilon(1e-9));
  return largest;
}

} // namespace

// The rigid elements turn by a radian; their stresses are zero up to 1e-16 E, whose sum over a body is no
// force and no moment: what is left of it in 500 steps is below 1e-11 of the body's size.
TEMPLATE_TEST_CASE_SIG("elements inside a rigid body are left out, and the answer is the same",
                       "[solid][unit]", ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
  {
    auto config = soft_config(dim, "neo_hookean_ln");
    config.rigid = {"part"};
    INFO(element_name(type));
    CHECK(distance<dim>(config, box_with_part<dim>(type), 3.0, 500) < 1e-11);
  }
}

// Fixed nodes never moved: their elements' forces are exactly zero. The same bits.
TEMPLATE_TEST_CASE_SIG("elements between fixed nodes are left out, and the bits are the same",
                       "[solid][unit]", ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
    for (const auto form : {Formulation::full, Formulation::one_point})
    {
      auto config = soft_config(dim, "neo_hookean_ln");
      config.formulation = form;
      config.fix = {
          {"part", dim == 2 ? std::vector<std::string>{"x", "y"} : std::vector<std::string>{"x", "y", "z"}}};
      INFO(element_name(type));
      CHECK(distance<dim>(config, box_with_part<dim>(type), 1.0, 200) == 0.0);
    }
}

// All nodes of a part that is pushed as a whole have the same displacement: strains are round-off of it.
TEMPLATE_TEST_CASE_SIG("elements pushed as a whole are left out, and the answer is the same", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  auto config = soft_config(dim, "neo_hookean_ln");
  config.velocity = {{.on = "part", .value = std::vector<double>(dim, 0.4)}};
  CHECK(distance<dim>(config, box_with_part<dim>(element_types<dim>().back()), 0.0, 300) < 1e-12);
}

// Elements of nodal dilatation share their volume changes: none may be left out beside a working one.
TEST_CASE("elements with nodal dilatation work inside fixed parts", "[solid][unit]")
{
  auto config = soft_config(2, "neo_hookean_ln");
  config.formulation = Formulation::locking_free;
  config.fix = {{"part", {"x", "y"}}};
  CHECK(idle_elements(Solid<2>(config, box_with_part<2>(ElementType::triangle3))) == 0);
  CHECK(idle_elements(Solid<2>(config, box_with_part<2>(ElementType::quadrilateral4))) > 0);
}

// A ring that is pushed along its radius is stretched.
TEST_CASE("a ring that is widened works", "[solid][unit]")
{
  auto config = soft_config(2, "neo_hookean_ln");
  config.formulation = Formulation::one_point;
  config.plane = PlaneKind::axisymmetric;
  auto mesh = box_with_part<2>(ElementType::quadrilateral4);
  for (auto& x : mesh.x)
    x[0] += 0.2;
  config.velocity = {{.on = "part", .value = {0.1, 0.0}}};
  CHECK(idle_elements(Solid<2>(config, mesh)) == 0);
  config.velocity = {{.on = "part", .value = {0.0, 0.1}}};
  CHECK(idle_elements(Solid<2>(config, mesh)) > 0);
}

// Without pairs nothing is searched; with a pair that never meets nothing is pushed: the same bits, apart
// from the step, which penalty springs shorten before they are there.
TEST_CASE("a contact pair that never meets changes no bit", "[solid][unit]")
{
  auto config = soft_config(2, "neo_hookean_ln");
  const auto mesh = distorted_box<2>(ElementType::quadrilateral4, 6);
  const Solid<2> alone(config, mesh);
  config.contact = {{"left", "right", 0.0}};
  const Solid<2> paired(config, mesh);
  CHECK(alone.contact() == nullptr);
  CHECK(paired.contact() != nullptr);
  std::vector<Solid<2>> both = {alone, paired};
  const double dt = paired.critical_time_step();
  for (auto& solid : both)
  {
    solid.set_motion(zero_field<2>(), [](const Vec<2>& X) { return Vec<2>{{0.2 * X[1], 0.1 * X[0]}}; });
    for (int k = 0; k < 200; ++k)
    {
      solid.predict(dt);
      solid.solve_free_motion(dt);
    }
  }
  double difference = 0.0;
  for (std::size_t n = 0; n < mesh.x.size(); ++n)
    difference = std::max(difference, norm(both[0].nodes().u[n] - both[1].nodes().u[n]));
  CHECK(difference == 0.0);
}
