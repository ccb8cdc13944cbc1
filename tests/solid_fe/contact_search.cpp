// Time of the broad phase of contact: the grid of solid_fe/contact.cpp beside CGAL's AABB tree, same
// surfaces.
//
//   build/release/tests/solid_contact_search     rows of solid_fe/README.md
#include "common/mesh/mesh.hpp"
#include "solid_fe/solid.hpp"

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Simple_cartesian.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <iterator>
#include <vector>

namespace
{

using namespace undine;
using namespace undine::solid;

using Kernel = CGAL::Simple_cartesian<double>;
using Triangles = std::vector<Kernel::Triangle_3>;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

/// CPU time: others may use the core as well.
template <class Act>
double milliseconds(Act&& act)
{
  const auto begin = std::clock();
  act();
  return 1e3 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
}

double median(std::vector<double> values)
{
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

/// Two blocks of one layer that face each other across a small gap, n × n quadrilaterals each.
void compare(int n)
{
  const double size = 1.0, h = size / n, gap = 0.1 * h;
  Mesh<3> both;
  for (const bool upper : {false, true})
  {
    auto mesh =
        box_mesh<3>({{0.0, upper ? gap : -h, 0.0}}, {{size, h, size}}, {n, 1, n}, ElementType::hexahedron8);
    const auto shift = both.n_nodes();
    both.x.insert(both.x.end(), mesh.x.begin(), mesh.x.end());
    for (auto& block : mesh.blocks)
    {
      for (auto& node : block.nodes)
        node += shift;
      both.blocks.push_back(std::move(block));
    }
    auto surface = mesh.surfaces.at(upper ? "bottom" : "top");
    for (auto& node : surface.nodes)
      node += shift;
    both.surfaces[upper ? "upper" : "lower"] = std::move(surface);
  }
  SolidConfig config;
  config.dim = 3;
  config.material = {.density = 1000.0, .youngs_modulus = 1e6, .poisson_ratio = 0.3, .law = "neo_hookean_ln"};
  config.contact = {{.nodes = "upper", .surface = "lower", .friction = 0.0}};
  const Solid<3> solid(config, both);
  auto nodes = solid.nodes();
  Contact<3> contact(config, both, nodes, 1.0);
  std::vector<Vec<3>> F(nodes.X.size()), F_free(nodes.X.size());
  contact.add_force(nodes, 1e-6, F_free, F);

  const auto& lower = both.surfaces.at("lower");
  const auto slaves = both.surfaces.at("upper").node_set();
  std::vector<double> grid, narrow, tree;
  std::size_t found = 0;
  for (int repeat = 0; repeat < 11; ++repeat)
  {
    for (auto& u : nodes.u) // further than half the skin: candidates are looked for anew
      u[0] += (repeat % 2 == 0 ? 0.4 : -0.4) * h;
    const auto searches = contact.searches();
    const double with = milliseconds([&] { contact.add_force(nodes, 1e-6, F_free, F); });
    const double without = milliseconds([&] { contact.add_force(nodes, 1e-6, F_free, F); });
    if (contact.searches() != searches + 1)
      std::abort(); // not what is to be measured
    grid.push_back(with - without);
    narrow.push_back(without);
    tree.push_back(milliseconds(
        [&]
        {
          const auto at = [&](std::size_t k)
          {
            const auto x = nodes.X[k] + nodes.u[k];
            return Kernel::Point_3(x[0], x[1], x[2]);
          };
          Triangles triangles;
          for (index_t f = 0; f < lower.size(); ++f)
          {
            const auto begin = static_cast<std::size_t>(lower.offset[static_cast<std::size_t>(f)]);
            const auto corner = [&](std::size_t k)
            { return at(static_cast<std::size_t>(lower.nodes[begin + k])); };
            triangles.emplace_back(corner(0), corner(1), corner(2));
            triangles.emplace_back(corner(0), corner(2), corner(3));
          }
          Tree candidates(triangles.cbegin(), triangles.cend());
          candidates.build();
          std::vector<Tree::Primitive_id> near;
          found = 0;
          for (const index_t s : slaves)
          {
            const auto x = at(static_cast<std::size_t>(s));
            const CGAL::Bbox_3 box(x.x() - h, x.y() - h, x.z() - h, x.x() + h, x.y() + h, x.z() + h);
            near.clear();
            candidates.all_intersected_primitives(box, std::back_inserter(near));
            found += near.size();
          }
        }));
  }
  if (found < slaves.size())
    std::abort();
  std::printf("| %d | %zu | %.2f | %.2f | %.1f | %.2f |\n", 2 * n * n, slaves.size(), median(grid),
              median(tree), median(tree) / median(grid), median(narrow));
}

} // namespace

int main()
{
  std::printf("| triangles | nodes | grid [ms] | AABB tree [ms] | ratio | a step without a search [ms] |\n"
              "| --- | --- | --- | --- | --- | --- |\n");
  for (const int n : {20, 60, 120})
    compare(n);
  return 0;
}
