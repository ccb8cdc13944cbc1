// Several solids in one run.
#include "common/mesh/mesh.hpp"
#include "tests/coupled/in_memory.hpp"

#include <catch2/catch.hpp>

#include <array>
#include <memory>

using namespace undine;
using namespace undine::test;

namespace
{

/// Blocks of `width` from each x0 upward from y = 0, as one body; surfaces "a_left", "b_left" ...
std::unique_ptr<solid::Solid<2>> blocks(solid::SolidConfig config, const std::vector<double>& x0,
                                        double width, std::array<int, 2> counts)
{
  Mesh<2> mesh;
  char prefix = 'a';
  for (const double x : x0)
  {
    const auto block = box_mesh<2>({{x, 0.0}}, {{width, 1.0}}, counts, ElementType::quadrilateral4);
    const auto shift = mesh.n_nodes();
    mesh.x.insert(mesh.x.end(), block.x.begin(), block.x.end());
    mesh.blocks.push_back(block.blocks[0]);
    for (auto& n : mesh.blocks.back().nodes)
      n += shift;
    for (auto [name, surface] : block.surfaces)
    {
      for (auto& n : surface.nodes)
        n += shift;
      mesh.surfaces[std::string{prefix, '_'} + name] = surface;
    }
    ++prefix;
  }
  auto solid = std::make_unique<solid::Solid<2>>(config, mesh);
  solid->set_motion([](const Vec<2>&) { return Vec<2>{}; },
                    [](const Vec<2>& X) {
                      return Vec<2>{{0.3 * X[0] * X[1], 0.2 * X[0] - 0.1 * X[1] * X[1]}};
                    });
  return solid;
}

} // namespace

// The coupler knows the solids of a run as one wet surface. So two blocks on both sides of a third, with
// meshes that do not match its own, move the same whether one program holds them or two: the same sums, up to
// the order in which a program adds its own. Each side fine once, and equal steps; a positive slip and a
// no-slip interface. The velocities start incompatible, so that the activation is part of it.
TEST_CASE("two solids of two programs move as two bodies of one program", "[coupled][verification]")
{
  solid::SolidConfig soft, hard;
  soft.material = {.density = 1000.0, .youngs_modulus = 1e5, .poisson_ratio = 0.3, .law = "neo_hookean_ln"};
  hard.material = {.density = 3000.0, .youngs_modulus = 4e6, .poisson_ratio = 0.3, .law = "neo_hookean_ln"};
  struct Roles
  {
    std::string fine;
    std::int64_t substeps;
  };
  for (const auto& [fine, substeps] : {Roles{"auto", 1}, Roles{"fluid", 4}, Roles{"solid", 4}})
    for (const std::string kind : {"slip", "no_slip"})
    {
      coupler::CouplerConfig config;
      config.run.dim = 2;
      config.run.t_end = 0.1;
      config.coupling.present = true;
      config.coupling.fine = fine;
      config.coupling.substeps = substeps;
      config.coupling.interfaces = {{"west", "a_left", "a_right", kind, false, "finer"},
                                    {"east", "a_right", "b_left", kind, false, "finer"}};
      solid::SolidConfig middle = soft, together = hard, west = hard, east = hard;
      middle.wet = {{"west", "a_left"}, {"east", "a_right"}};
      together.wet = {{"west", "a_right"}, {"east", "b_left"}};
      west.wet = {{"west", "a_right"}};
      east.wet = {{"east", "a_left"}};

      const auto core = blocks(middle, {0.0}, 0.5, {4, 9});
      const auto both = blocks(together, {-0.4, 0.5}, 0.4, {3, 7});
      run_in_memory(*core, *both, config, [](const coupler::WindowRecord&) {});

      const auto core2 = blocks(middle, {0.0}, 0.5, {4, 9});
      const auto one = blocks(west, {-0.4}, 0.4, {3, 7}), other = blocks(east, {0.5}, 0.4, {3, 7});
      config.coupling.solids = {"left", "right"};
      config.coupling.interfaces[0].body = "left";
      config.coupling.interfaces[1].body = "right";
      double mismatch = 1.0, made = 0.0;
      std::int64_t windows = 0;
      run_in_memory({participant("fluid", *core2), participant("left", *one), participant("right", *other)},
                    config,
                    [&](const coupler::WindowRecord& r)
                    {
                      mismatch = r.balance.impulse_mismatch / (1e-300 + r.balance.impulse[0]);
                      made = r.balance.work[0] + r.balance.work[1];
                      windows = r.plan.index + 1;
                    });

      double size = 0.0, difference = 0.0;
      const auto compare = [&](const solid::Solid<2>& a, const solid::Solid<2>& b)
      {
        for (const auto& X : b.nodes().X)
        {
          const auto of_b = static_cast<std::size_t>(&X - b.nodes().X.data());
          for (std::size_t k = 0; k < a.nodes().X.size(); ++k)
            if (norm(a.nodes().X[k] - X) < 1e-9)
            {
              size = std::max(size, norm(a.nodes().u[k]));
              difference = std::max(difference, norm(a.nodes().u[k] - b.nodes().u[of_b]));
            }
        }
      };
      compare(*core, *core2);
      compare(*both, *one);
      compare(*both, *other);
      INFO("fine " << fine << ", m = " << substeps << ", " << kind << ": " << windows
                   << " windows, difference " << difference << " of " << size << " m, impulse mismatch "
                   << mismatch << ", interface made " << made << " J");
      CHECK(windows > 10);
      CHECK(size > 1e-3);
      CHECK(difference < 1e-12 * size);
    }
}
