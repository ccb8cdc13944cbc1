// Large bending of solid elements: the elastica under a tip load and under its own weight.
#include "solid_fe/solid.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

#include <cmath>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

/// Displacement of the tip's middle of a strip of length 1, at rest, under the tip load P L²/(E I) or the
/// weight q L³/(E I). The load grows over half a period of the first mode, which is damped critically.
Vec<2> bend(const Kind& kind, int along, int across, double h, double tip, double weight)
{
  SolidConfig config = soft_config(2, "svk");
  config.formulation = kind.formulation;
  config.hourglass_stiffness = 2.0 / 3.0; // one point: the bending stiffness of a square
  config.material.poisson_ratio = 0.0;
  const double EI = 1e6 * h * h * h / 12.0, omega = 3.516 * std::sqrt(EI / (1000.0 * h)), ramp = 3.0 / omega;
  config.material.mass_damping = 2.0 * omega;
  config.fix = {{"left", {}}};
  auto mesh = box_mesh<2>({{0.0, -0.5 * h}}, {{1.0, h}}, {along, across}, kind.type);
  config.fix[0].components = {"x", "y"};
  if (kind.formulation == Formulation::beam)
    config.fix[0].components.push_back("rotation");
  config.traction = {{.on = "right", .value = {0.0, -tip * EI / h}, .ramp = ramp}};
  if (weight > 0.0) // a dead load per mass that grows in the same way
    config.body_force_function = {"0", "-" + std::to_string(weight * EI / (1000.0 * h)) + "*min(1, t/" +
                                           std::to_string(ramp) + ")"};
  Solid<2> solid(config, mesh);
  double dt = 0.0;
  for (int k = 0; solid.time() < 15.0 / omega; ++k)
  {
    if (k % 200 == 0)
      dt = 0.98 * solid.critical_time_step();
    solid.predict(dt);
    solid.solve_free_motion(dt);
  }
  Vec<2> u;
  int count = 0;
  for (std::size_t n = 0; n < solid.nodes().X.size(); ++n)
  {
    const auto& X = solid.nodes().X[n];
    if (X[0] > 1.0 - 1e-9 && std::abs(std::abs(X[1]) - 0.5 * h) < 1e-9)
    {
      u += solid.nodes().u[n];
      ++count;
    }
  }
  return (1.0 / count) * u;
}

} // namespace

// Inextensible elastica (benchmark S2, S2b): drop and retreat of the tip over L. Stretch and shear of the
// strip add (h/L)² = 4e-4 of the size; gate 1 %.
TEST_CASE("strips of squares and of beams bend like the elastica, tip load and weight, four loads",
          "[solid][verification]")
{
  const double truth[][4] = {
      // load, drop and retreat under P L²/EI, drop under q L³/EI
      {1.0, 0.301721, 0.056433, 0.123471},
      {2.0, 0.493458, 0.160642, 0.238507},
      {5.0, 0.713792, 0.387628, 0.495905},
      {10.0, 0.810609, 0.554996, 0.700200},
  };
  const std::tuple<const char*, Kind, int> kinds[] = {
      {"Q4 B-bar", {ElementType::quadrilateral4, Formulation::locking_free}, 50},
      {"Q4 one point", {ElementType::quadrilateral4, Formulation::one_point}, 50},
      {"beam", {ElementType::quadrilateral4, Formulation::beam}, 20},
  };
  for (const auto& [name, kind, along] : kinds)
    for (const auto& [load, drop, retreat, drop_of_weight] : truth)
    {
      const auto p = bend(kind, along, 1, 0.02, load, 0.0), q = bend(kind, along, 1, 0.02, 0.0, load);
      INFO(name << " at " << load << ": drop " << -p[1] / drop - 1.0 << ", retreat " << -p[0] / retreat - 1.0
                << ", under weight " << -q[1] / drop_of_weight - 1.0);
      CHECK(std::abs(-p[1] / drop - 1.0) < 0.01);
      CHECK(std::abs(-p[0] / retreat - 1.0) < 0.01);
      CHECK(std::abs(-q[1] / drop_of_weight - 1.0) < 0.01);
    }
}

// Squares bend exactly by construction; rectangles twice as long as high show the order. The truth is the
// limit of the same thick strip. What locks adds to the stiffness, load over drop, in proportion to the
// length of the elements squared already on coarse meshes, T3 included.
TEST_CASE("bending converges with order 2", "[solid][verification]")
{
  const std::pair<const char*, Kind> kinds[] = {
      {"Q4", {ElementType::quadrilateral4, Formulation::full}},
      {"Q4 B-bar", {ElementType::quadrilateral4, Formulation::locking_free}},
      {"Q4 one point", {ElementType::quadrilateral4, Formulation::one_point}},
      {"T3", {ElementType::triangle3, Formulation::full}},
  };
  for (const auto& [name, kind] : kinds)
    for (const auto& [tip, weight] : {std::pair{2.0, 0.0}, {0.0, 2.0}})
    {
      double stiffness[3];
      for (int k = 0; k < 3; ++k)
        stiffness[k] = 2.0 / -bend(kind, 5 << k, 1 << k, 0.1, tip, weight)[1];
      const double order = std::log2((stiffness[0] - stiffness[1]) / (stiffness[1] - stiffness[2]));
      INFO(name << (tip > 0.0 ? " tip load" : " weight") << ": " << stiffness[0] << ", " << stiffness[1]
                << ", " << stiffness[2] << ", order " << order);
      CHECK(order > 1.85);
      CHECK(order < 2.2);
    }
}
