// Penalty contact: walls, broad phase on a grid, narrow phase, forces.
#include "solid_fe/contact.hpp"

#include "common/error.hpp"
#include "solid_fe/boundary_conditions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace undine::solid
{

namespace
{

/// A foot may lie outside a facet by this share of it, so that nodes on an edge do not lose their contact to
/// a trifle.
constexpr double overhang = 0.05;
constexpr double stick_fraction =
    0.1; ///< share of the tangential velocity that friction may stop in one step

/// Friction force against `v` [m/s] under the normal force p [N] of a contact with effective mass `mass`
/// [kg].
template <int dim>
Vec<dim> friction_force(double friction, double p, const Vec<dim>& v, double mass, double dt)
{
  const double speed = norm(v);
  if (friction == 0.0 || !(speed > 0.0) || !(dt > 0.0))
    return {};
  return (-std::min(friction * p, stick_fraction * mass * speed / dt) / speed) * v;
}

/// Weights of the point of a facet nearest to the foot of x, and its unit normal; false if the foot lies
/// outside.
bool project(const std::array<Vec<2>, 2>& X, const Vec<2>& x, std::array<double, 2>& weight, Vec<2>& normal,
             double& distance)
{
  const auto edge = X[1] - X[0];
  const double length2 = norm_squared(edge), t = dot(x - X[0], edge) / length2;
  normal = (1.0 / std::sqrt(length2)) * right_normal(edge);
  distance = dot(x - X[0], normal);
  weight = {1.0 - t, t};
  return t >= -overhang && t <= 1.0 + overhang;
}

bool project(const std::array<Vec<3>, 3>& X, const Vec<3>& x, std::array<double, 3>& weight, Vec<3>& normal,
             double& distance)
{
  const auto a = X[1] - X[0], b = X[2] - X[0], r = x - X[0];
  normal = cross(a, b);
  const double area2 = norm(normal);
  normal *= 1.0 / area2;
  distance = dot(r, normal);
  const double u = dot(cross(r, b), normal) / area2, v = dot(cross(a, r), normal) / area2;
  weight = {1.0 - u - v, u, v};
  return u >= -overhang && v >= -overhang && u + v <= 1.0 + overhang;
}

template <int dim>
std::vector<std::array<std::size_t, dim>> straight_pieces(const Surface& surface)
{
  std::vector<std::array<std::size_t, dim>> pieces;
  for (index_t f = 0; f < surface.size(); ++f)
  {
    const auto begin = static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f)]);
    const auto end = static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f) + 1]);
    const auto node = [&](std::size_t k) { return static_cast<std::size_t>(surface.nodes[begin + k]); };
    if constexpr (dim == 2)
      pieces.push_back({node(0), node(1)});
    else
    {
      pieces.push_back({node(0), node(1), node(2)});
      if (end - begin == 4)
        pieces.push_back({node(0), node(2), node(3)});
    }
  }
  return pieces;
}

} // namespace

template <int dim>
Contact<dim>::Contact(const SolidConfig& config, const Mesh<dim>& mesh, const SolidNodes<dim>& nodes,
                      double omega2)
    : omega2_(omega2), stiffness_(config.contact_stiffness)
{
  const auto boundary = boundary_of(mesh);
  for (std::size_t k = 0; k < config.wall.size(); ++k)
  {
    const std::string key = "solid.wall[" + std::to_string(k) + "]";
    const auto& entry = config.wall[k];
    Wall wall{.point = to_vec<dim>(entry.point, key + ".point"),
              .normal = to_vec<dim>(entry.normal, key + ".normal"),
              .friction = entry.friction,
              .nodes = {}};
    const double length = norm(wall.normal);
    if (!(length > 0.0))
      throw InputError(key + ".normal: must not be zero; it points to where the solid is");
    wall.normal *= 1.0 / length;
    const auto on = entry.on.empty() ? boundary.node_set() : find_nodes(mesh, entry.on, key + ".on");
    for (const index_t n : on)
      wall.nodes.push_back(static_cast<std::size_t>(n));
    walls_.push_back(std::move(wall));
  }
  for (std::size_t k = 0; k < config.contact.size(); ++k)
  {
    const std::string key = "solid.contact[" + std::to_string(k) + "]";
    const auto& entry = config.contact[k];
    Pair pair{.slaves = {},
              .facets = {},
              .friction = entry.friction,
              .skin = 0.0,
              .x_at_search = {},
              .candidates = {}};
    for (const index_t n : find_nodes(mesh, entry.nodes, key + ".nodes"))
      pair.slaves.push_back(static_cast<std::size_t>(n));
    pair.facets = straight_pieces<dim>(find_surface(mesh, entry.surface, key + ".surface"));
    double shortest = std::numeric_limits<double>::infinity();
    for (const auto& facet : pair.facets)
      for (std::size_t a = 0; a < dim; ++a)
        shortest = std::min(shortest, norm(nodes.X[facet[a]] - nodes.X[facet[(a + 1) % dim]]));
    pair.skin = 0.5 * shortest;
    pair.candidates.resize(pair.slaves.size());
    pairs_.push_back(std::move(pair));
  }
  // A wall adds k/m = stiffness ω² at its nodes. A pair adds at most k (1/m_s + Σ N²/m) with k made from the
  // smallest mass, times the contacts that share a node: three along a line of equal meshes, four times as
  // many on a surface.
  if (!walls_.empty())
    added_frequency2_ = stiffness_ * omega2_;
  if (!pairs_.empty())
    added_frequency2_ += stiffness_ * omega2_ * (dim == 2 ? 2.0 : 4.0);
}

template <int dim>
void Contact<dim>::add_force(const SolidNodes<dim>& nodes, double dt, std::span<Vec<dim>> F)
{
  stored_ = 0.0;
  push_from_walls(nodes, dt, F);
  for (auto& pair : pairs_)
    push_from_facets(pair, nodes, dt, F);
}

template <int dim>
void Contact<dim>::push_from_walls(const SolidNodes<dim>& nodes, double dt, std::span<Vec<dim>> F)
{
  for (auto& wall : walls_)
  {
    wall.force = {};
    for (const auto n : wall.nodes)
    {
      const double depth = dot(wall.point - nodes.X[n] - nodes.u[n], wall.normal);
      if (!(depth > 0.0))
        continue;
      const double k = stiffness(nodes.m[n]), p = k * depth;
      const auto tangential = nodes.v[n] - dot(nodes.v[n], wall.normal) * wall.normal;
      const auto f = p * wall.normal + friction_force(wall.friction, p, tangential, nodes.m[n], dt);
      stored_ += 0.5 * p * depth;
      wall.force += f;
      F[n] += f;
    }
  }
}

/// Facets near each slave: those whose boxes, widened by the skin, share a cell of a grid with it. Holds
/// until a node has moved by half the skin.
template <int dim>
void Contact<dim>::search(Pair& pair, const SolidNodes<dim>& nodes)
{
  ++searches_;
  pair.x_at_search.resize(nodes.X.size());
  for (std::size_t n = 0; n < nodes.X.size(); ++n)
    pair.x_at_search[n] = nodes.X[n] + nodes.u[n];
  const double reach = 2.0 * pair.skin;
  double largest = reach;
  const auto box = [&](const Facet& facet)
  {
    std::array<Vec<dim>, 2> bounds{pair.x_at_search[facet[0]], pair.x_at_search[facet[0]]};
    for (const auto n : facet)
      for (int i = 0; i < dim; ++i)
      {
        bounds[0][i] = std::min(bounds[0][i], pair.x_at_search[n][i]);
        bounds[1][i] = std::max(bounds[1][i], pair.x_at_search[n][i]);
      }
    for (int i = 0; i < dim; ++i)
    {
      bounds[0][i] -= reach;
      bounds[1][i] += reach;
    }
    return bounds;
  };
  for (const auto& facet : pair.facets)
  {
    const auto [low, high] = box(facet);
    for (int i = 0; i < dim; ++i)
      largest = std::max(largest, high[i] - low[i]);
  }
  using Cell = std::array<std::int64_t, dim>;
  const auto cell_of = [&](const Vec<dim>& x)
  {
    Cell cell;
    for (int i = 0; i < dim; ++i)
      cell[static_cast<std::size_t>(i)] = static_cast<std::int64_t>(std::floor(x[i] / largest));
    return cell;
  };
  const auto hash = [](const Cell& cell)
  {
    std::size_t h = 0;
    for (const auto c : cell)
      h = h * 1000003u + static_cast<std::size_t>(c);
    return h;
  };
  std::unordered_map<Cell, std::vector<std::size_t>, decltype(hash)> grid(pair.facets.size(), hash);
  for (std::size_t f = 0; f < pair.facets.size(); ++f)
  {
    const auto [low, high] = box(pair.facets[f]);
    const auto first = cell_of(low), last = cell_of(high);
    Cell cell = first;
    for (bool more = true; more;)
    {
      grid[cell].push_back(f);
      more = false;
      for (std::size_t i = 0; i < dim && !more; ++i) // count through the box of cells
      {
        more = ++cell[i] <= last[i];
        if (!more)
          cell[i] = first[i];
      }
    }
  }
  for (std::size_t s = 0; s < pair.slaves.size(); ++s)
  {
    auto& near = pair.candidates[s];
    near.clear();
    const auto& x = pair.x_at_search[pair.slaves[s]];
    const auto found = grid.find(cell_of(x));
    if (found == grid.end())
      continue;
    for (const auto f : found->second)
    {
      const auto& facet = pair.facets[f];
      const auto [low, high] = box(facet);
      bool inside = std::find(facet.begin(), facet.end(), pair.slaves[s]) == facet.end();
      for (int i = 0; i < dim; ++i)
        inside = inside && x[i] >= low[i] && x[i] <= high[i];
      if (inside)
        near.push_back(f);
    }
  }
}

template <int dim>
void Contact<dim>::push_from_facets(Pair& pair, const SolidNodes<dim>& nodes, double dt,
                                    std::span<Vec<dim>> F)
{
  double moved2 = pair.x_at_search.empty() ? std::numeric_limits<double>::infinity() : 0.0;
  for (std::size_t n = 0; n < pair.x_at_search.size(); ++n)
    moved2 = std::max(moved2, norm_squared(nodes.X[n] + nodes.u[n] - pair.x_at_search[n]));
  if (!(moved2 < 0.25 * pair.skin * pair.skin))
    search(pair, nodes);

  for (std::size_t s = 0; s < pair.slaves.size(); ++s)
  {
    const auto slave = pair.slaves[s];
    const auto x = nodes.X[slave] + nodes.u[slave];
    double shallowest = pair.skin;
    const Facet* touched = nullptr;
    std::array<double, dim> weight{};
    Vec<dim> normal;
    for (const auto f : pair.candidates[s])
    {
      std::array<Vec<dim>, dim> corner;
      for (std::size_t a = 0; a < dim; ++a)
        corner[a] = nodes.X[pair.facets[f][a]] + nodes.u[pair.facets[f][a]];
      std::array<double, dim> w{};
      Vec<dim> outward;
      double distance = 0.0;
      if (project(corner, x, w, outward, distance) && distance < 0.0 && -distance < shallowest)
      {
        shallowest = -distance;
        touched = &pair.facets[f];
        weight = w;
        normal = outward;
      }
    }
    if (touched == nullptr)
      continue;
    double smallest = nodes.m[slave], inverse = 1.0 / nodes.m[slave];
    auto v = nodes.v[slave];
    for (std::size_t a = 0; a < dim; ++a)
    {
      const auto n = (*touched)[a];
      smallest = std::min(smallest, nodes.m[n]);
      inverse += weight[a] * weight[a] / nodes.m[n];
      v -= weight[a] * nodes.v[n];
    }
    const double k = stiffness(0.5 * smallest), p = k * shallowest;
    const auto f =
        p * normal + friction_force(pair.friction, p, v - dot(v, normal) * normal, 1.0 / inverse, dt);
    stored_ += 0.5 * p * shallowest;
    F[slave] += f;
    for (std::size_t a = 0; a < dim; ++a)
      F[(*touched)[a]] -= weight[a] * f;
  }
}

template class Contact<2>;
template class Contact<3>;

} // namespace undine::solid
