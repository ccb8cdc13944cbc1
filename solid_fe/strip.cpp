// Fibres of a strip, and strips about lines.
#include "solid_fe/strip.hpp"

#include "common/error.hpp"
#include "solid_fe/boundary_conditions.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace undine::solid
{

namespace
{

using Quad = std::array<index_t, 4>;

std::vector<Quad> quadrilaterals_of(const Mesh<2>& mesh)
{
  std::vector<Quad> quads;
  for (const auto& block : mesh.blocks)
  {
    if (element_dimension(block.type) != 2)
      continue;
    if (block.type != ElementType::quadrilateral4)
      throw InputError(std::string("solid.formulation = \"beam\": the mesh has a ") +
                       element_name(block.type) +
                       "; a thin wall is a strip of quadrilaterals, or a line with solid.thickness");
    for (index_t e = 0; e < block.size(); ++e)
    {
      auto& quad = quads.emplace_back();
      std::copy_n(block.nodes.begin() + 4 * e, 4, quad.begin());
    }
  }
  return quads;
}

} // namespace

Strip make_strip(const Mesh<2>& mesh)
{
  const auto quads = quadrilaterals_of(mesh);
  const auto X = [&](index_t n) { return mesh.x[static_cast<std::size_t>(n)]; };
  const auto edge = [](const Quad& quad, std::size_t k) { return std::minmax(quad[k], quad[(k + 1) % 4]); };
  std::map<std::pair<index_t, index_t>, int> uses, fibre;
  for (const auto& quad : quads)
    for (std::size_t k = 0; k < 4; ++k)
      ++uses[edge(quad, k)];

  Strip strip;
  const auto fibre_at = [&](index_t a, index_t b)
  {
    const auto [found, is_new] = fibre.try_emplace(std::minmax(a, b), static_cast<int>(strip.ends.size()));
    if (is_new)
    {
      strip.ends.push_back({a, b});
      strip.beam.X.push_back(0.5 * (X(a) + X(b)));
      strip.beam.arm.push_back(0.5 * (X(a) - X(b)));
    }
    return static_cast<index_t>(found->second);
  };
  for (const auto& quad : quads)
  {
    const auto shared = [&](std::size_t k) { return uses[edge(quad, k)] > 1 || uses[edge(quad, k + 2)] > 1; };
    const auto length = [&](std::size_t k)
    { return norm(X(quad[k + 1]) - X(quad[k])) + norm(X(quad[(k + 3) % 4]) - X(quad[k + 2])); };
    if (shared(0) && shared(1))
      throw InputError(
          "solid.formulation = \"beam\": the mesh has more than one quadrilateral across the wall: it "
          "must be a strip, one quadrilateral thick");
    const std::size_t k =
        shared(0) || (!shared(1) && length(0) < length(1)) ? 0 : 1; // fibres: edges k and k + 2
    const auto a = k == 0 ? fibre_at(quad[0], quad[1]) : fibre_at(quad[3], quad[0]);
    const auto b = k == 0 ? fibre_at(quad[3], quad[2]) : fibre_at(quad[2], quad[1]);
    const auto d = X(quad[2]) - X(quad[0]), g = X(quad[3]) - X(quad[1]);
    const double area = 0.5 * std::abs(d[0] * g[1] - d[1] * g[0]);
    strip.beam.elements.push_back({a, b});
    strip.beam.element_thickness.push_back(
        area / norm(strip.beam.X[static_cast<std::size_t>(b)] - strip.beam.X[static_cast<std::size_t>(a)]));
  }
  return strip;
}

std::vector<std::array<bool, 3>> fibre_supports(const Mesh<2>& mesh, const Strip& strip,
                                                const SolidConfig& config)
{
  std::map<index_t, std::size_t> fibre;
  for (std::size_t k = 0; k < strip.ends.size(); ++k)
    for (const index_t n : strip.ends[k])
      fibre[n] = k;
  std::vector<std::array<bool, 3>> fixed(strip.ends.size(), {false, false, false});
  const auto hold = [&](const std::string& key, const std::string& on, std::vector<std::string> components,
                        std::vector<std::string> all)
  {
    if (components.empty())
      components = all;
    for (const auto& name : components)
    {
      const auto found = std::find(all.begin(), all.end(), name);
      if (found == all.end())
        throw InputError(key + ".components contains \"" + name + "\": must be of x, y" +
                         (all.size() == 3 ? ", rotation" : "") + " for a beam");
      for (const index_t n : find_nodes(mesh, on, key + ".on"))
        fixed[fibre.at(n)][static_cast<std::size_t>(found - all.begin())] = true;
    }
  };
  for (std::size_t k = 0; k < config.fix.size(); ++k)
    hold("solid.fix[" + std::to_string(k) + "]", config.fix[k].on, config.fix[k].components,
         {"x", "y", "rotation"});
  for (std::size_t k = 0; k < config.velocity.size(); ++k)
    hold("solid.velocity[" + std::to_string(k) + "]", config.velocity[k].on, config.velocity[k].components,
         {"x", "y"});
  return fixed;
}

Mesh<2> strip_about(const Mesh<2>& line, double thickness)
{
  std::vector<std::array<index_t, 2>> elements;
  for (const auto& block : line.blocks)
    if (block.type == ElementType::line2)
      for (index_t e = 0; e < block.size(); ++e)
        elements.push_back(
            {block.nodes[static_cast<std::size_t>(2 * e)], block.nodes[static_cast<std::size_t>(2 * e) + 1]});
  if (elements.empty())
    throw InputError("solid.thickness: the mesh has no two-node elements to make a wall of (B21 of Abaqus)");
  std::map<index_t, std::vector<std::size_t>> at; // elements of a node
  for (std::size_t e = 0; e < elements.size(); ++e)
    for (const index_t n : elements[e])
      at[n].push_back(e);
  for (const auto& [n, list] : at)
    if (list.size() > 2)
      throw InputError("solid.thickness: the line branches at its node " + std::to_string(n) +
                       "; a wall is a chain");

  // Walk: from an end if there is one, else from the first element's first node.
  index_t start = elements[0][0];
  for (const auto& [n, list] : at)
    if (list.size() == 1 && (at.at(start).size() == 2 || elements[list[0]][0] == n))
    {
      start = n;
      if (elements[list[0]][0] == n)
        break;
    }
  const bool closed = at.at(start).size() == 2;
  std::vector<index_t> chain{start};
  std::vector<bool> used(elements.size(), false);
  for (bool more = true; more;)
  {
    more = false;
    for (const auto e : at.at(chain.back()))
      if (!used[e] && (chain.size() > 1 || elements[e][0] == start || !closed))
      {
        used[e] = more = true;
        chain.push_back(elements[e][0] == chain.back() ? elements[e][1] : elements[e][0]);
        break;
      }
  }
  if (chain.size() != elements.size() + 1)
    throw InputError("solid.thickness: the line is in several pieces; a wall is one chain");
  if (closed)
    chain.pop_back();

  const std::size_t n = chain.size();
  const auto X = [&](std::size_t k) { return line.x[static_cast<std::size_t>(chain[k])]; };
  const auto normal_of = [&](std::size_t a, std::size_t b)
  { return (-1.0 / norm(X(b) - X(a))) * right_normal(X(b) - X(a)); };
  Mesh<2> mesh;
  mesh.x.resize(2 * n); // node 2k on the right, 2k + 1 on the left
  std::map<index_t, index_t> place;
  for (std::size_t k = 0; k < n; ++k)
  {
    place[chain[k]] = static_cast<index_t>(k);
    const bool has_before = k > 0 || closed, has_after = k + 1 < n || closed;
    const auto before = normal_of(has_before ? (k + n - 1) % n : k, has_before ? k : k + 1);
    const auto after = has_after ? normal_of(k, (k + 1) % n) : before;
    const auto sum = before + after; // mitred: the faces of both elements meet on it
    const auto arm = (thickness / norm_squared(sum)) * sum;
    mesh.x[2 * k] = X(k) - arm;
    mesh.x[2 * k + 1] = X(k) + arm;
  }
  ElementBlock block{.type = ElementType::quadrilateral4, .nodes = {}, .body = ""};
  const auto add_facet = [&](const char* name, index_t a, index_t b)
  {
    auto& surface = mesh.surfaces[name];
    surface.nodes.insert(surface.nodes.end(), {a, b});
    surface.offset.push_back(static_cast<index_t>(surface.nodes.size()));
  };
  const auto right = [](std::size_t k) { return static_cast<index_t>(2 * k); };
  const auto left = [](std::size_t k) { return static_cast<index_t>(2 * k + 1); };
  for (std::size_t k = 0; k + 1 < n + (closed ? 1 : 0); ++k)
  {
    const std::size_t next = (k + 1) % n;
    block.nodes.insert(block.nodes.end(), {right(k), right(next), left(next), left(k)});
    add_facet("right", right(k), right(next));
    add_facet("left", left(next), left(k));
  }
  if (!closed)
  {
    add_facet("start", left(0), right(0));
    add_facet("end", right(n - 1), left(n - 1));
  }
  mesh.blocks.push_back(std::move(block));
  for (const auto& [name, nodes] : line.node_sets)
    for (const index_t node : nodes)
      if (const auto found = place.find(node); found != place.end())
        for (const index_t side : {0, 1})
          mesh.node_sets[name].push_back(2 * found->second + side);
  return mesh;
}

Mesh<2> polyline(const std::vector<double>& points, double element_size)
{
  Mesh<2> line;
  ElementBlock block{.type = ElementType::line2, .nodes = {}, .body = ""};
  for (std::size_t k = 0; k + 1 < points.size(); k += 2)
  {
    const Vec<2> next{{points[k], points[k + 1]}};
    if (line.x.empty())
    {
      line.x.push_back(next);
      continue;
    }
    const auto from = line.x.back();
    const int n = element_counts({norm(next - from)}, element_size)[0];
    for (int i = 1; i <= n; ++i)
    {
      line.x.push_back(from + (static_cast<double>(i) / n) * (next - from));
      block.nodes.insert(block.nodes.end(), {line.n_nodes() - 2, line.n_nodes() - 1});
    }
  }
  line.blocks.push_back(std::move(block));
  return line;
}

} // namespace undine::solid
