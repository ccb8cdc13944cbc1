// Contact: walls, broad phase on a grid, narrow phase, penalty forces and exact impulses.
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
    0.1;                         ///< share of the tangential velocity that friction may stop in one step
constexpr int most_sweeps = 500; ///< of Gauss-Seidel over the touches

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
    : by_impulse_(config.contact_method == ContactMethod::impulse), omega2_(omega2),
      stiffness_(config.contact_stiffness)
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
              .members = {},
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
    pair.members = pair.slaves;
    for (const auto& facet : pair.facets)
      pair.members.insert(pair.members.end(), facet.begin(), facet.end());
    std::sort(pair.members.begin(), pair.members.end());
    pair.members.erase(std::unique(pair.members.begin(), pair.members.end()), pair.members.end());
    pairs_.push_back(std::move(pair));
  }
  // A wall adds k/m = stiffness ω² at its nodes. A pair adds at most k (1/m_s + Σ N²/m) with k made from the
  // smallest mass, times the contacts that share a node: three along a line of equal meshes, four times as
  // many on a surface.
  if (by_impulse_)
  {
    v_next_.resize(nodes.X.size());
    return;
  }
  if (!walls_.empty())
    added_frequency2_ = stiffness_ * omega2_;
  if (!pairs_.empty())
    added_frequency2_ += stiffness_ * omega2_ * (dim == 2 ? 2.0 : 4.0);
}

template <int dim>
void Contact<dim>::add_force(const SolidNodes<dim>& nodes, double dt, std::span<const Vec<dim>> F_free,
                             std::span<Vec<dim>> F)
{
  stored_ = 0.0;
  if (by_impulse_)
  {
    add_impulses(nodes, dt, F_free, F);
    return;
  }
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
  std::vector<Vec<dim>> x(nodes.X.size());
  pair.x_at_search.clear();
  for (const auto n : pair.members)
    pair.x_at_search.push_back(x[n] = nodes.X[n] + nodes.u[n]);
  const double reach = 2.0 * pair.skin;
  double largest = reach;
  const auto box = [&](const Facet& facet)
  {
    std::array<Vec<dim>, 2> bounds{x[facet[0]], x[facet[0]]};
    for (const auto n : facet)
      for (int i = 0; i < dim; ++i)
      {
        bounds[0][i] = std::min(bounds[0][i], x[n][i]);
        bounds[1][i] = std::max(bounds[1][i], x[n][i]);
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
    const auto& at = x[pair.slaves[s]];
    const auto found = grid.find(cell_of(at));
    if (found == grid.end())
      continue;
    for (const auto f : found->second)
    {
      const auto& facet = pair.facets[f];
      const auto [low, high] = box(facet);
      bool inside = std::find(facet.begin(), facet.end(), pair.slaves[s]) == facet.end();
      for (int i = 0; i < dim; ++i)
        inside = inside && at[i] >= low[i] && at[i] <= high[i];
      if (inside)
        near.push_back(f);
    }
  }
}

template <int dim>
void Contact<dim>::search_if_moved(Pair& pair, const SolidNodes<dim>& nodes)
{
  double moved2 = pair.x_at_search.empty() ? std::numeric_limits<double>::infinity() : 0.0;
  for (std::size_t k = 0; k < pair.x_at_search.size(); ++k)
  {
    const auto n = pair.members[k];
    moved2 = std::max(moved2, norm_squared(nodes.X[n] + nodes.u[n] - pair.x_at_search[k]));
  }
  if (!(moved2 < 0.25 * pair.skin * pair.skin))
    search(pair, nodes);
}

/// The facet nearest to slave `s` among those it is in front of or behind by a gap between the bounds [m].
template <int dim>
std::optional<typename Contact<dim>::Touch> Contact<dim>::touch_of(const Pair& pair, std::size_t s,
                                                                   const SolidNodes<dim>& nodes,
                                                                   double least_gap, double largest_gap) const
{
  const auto slave = pair.slaves[s];
  const auto x = nodes.X[slave] + nodes.u[slave];
  std::optional<Touch> touch;
  for (const auto f : pair.candidates[s])
  {
    std::array<Vec<dim>, dim> corner;
    for (std::size_t a = 0; a < dim; ++a)
      corner[a] = nodes.X[pair.facets[f][a]] + nodes.u[pair.facets[f][a]];
    std::array<double, dim> weight{};
    Vec<dim> outward;
    double distance = 0.0;
    if (project(corner, x, weight, outward, distance) && distance < largest_gap && distance > least_gap &&
        (!touch || std::abs(distance) < std::abs(touch->gap)))
      touch = Touch{.slave = slave,
                    .facet = &pair.facets[f],
                    .wall = nullptr,
                    .weight = weight,
                    .normal = outward,
                    .gap = distance,
                    .friction = pair.friction};
  }
  return touch;
}

template <int dim>
void Contact<dim>::push_from_facets(Pair& pair, const SolidNodes<dim>& nodes, double dt,
                                    std::span<Vec<dim>> F)
{
  search_if_moved(pair, nodes);
  for (std::size_t s = 0; s < pair.slaves.size(); ++s)
  {
    const auto touch = touch_of(pair, s, nodes, -pair.skin, 0.0);
    if (!touch)
      continue;
    const auto slave = touch->slave;
    double smallest = nodes.m[slave], inverse = 1.0 / nodes.m[slave];
    auto v = nodes.v[slave];
    for (std::size_t a = 0; a < dim; ++a)
    {
      const auto n = (*touch->facet)[a];
      smallest = std::min(smallest, nodes.m[n]);
      inverse += touch->weight[a] * touch->weight[a] / nodes.m[n];
      v -= touch->weight[a] * nodes.v[n];
    }
    const auto& normal = touch->normal;
    const double k = stiffness(0.5 * smallest), p = -k * touch->gap;
    const auto f =
        p * normal + friction_force(pair.friction, p, v - dot(v, normal) * normal, 1.0 / inverse, dt);
    stored_ -= 0.5 * p * touch->gap;
    F[slave] += f;
    for (std::size_t a = 0; a < dim; ++a)
      F[(*touch->facet)[a]] -= touch->weight[a] * f;
  }
}

/// Walls and facets that nodes may touch in this step.
template <int dim>
void Contact<dim>::find_touches(const SolidNodes<dim>& nodes)
{
  touches_.clear();
  for (auto& wall : walls_)
  {
    wall.force = {};
    for (const auto n : wall.nodes)
      touches_.push_back({.slave = n,
                          .facet = nullptr,
                          .wall = &wall,
                          .weight = {},
                          .normal = wall.normal,
                          .gap = dot(nodes.X[n] + nodes.u[n] - wall.point, wall.normal),
                          .friction = wall.friction});
  }
  for (auto& pair : pairs_)
  {
    search_if_moved(pair, nodes);
    for (std::size_t s = 0; s < pair.slaves.size(); ++s)
      if (const auto touch = touch_of(pair, s, nodes, -pair.skin, pair.skin))
        touches_.push_back(*touch);
  }
}

/// Velocity `field` of a slave against what it touches.
template <int dim>
template <class Field>
Vec<dim> Contact<dim>::relative(const Touch& touch, Field&& field)
{
  auto v = field(touch.slave);
  if (touch.facet != nullptr)
    for (std::size_t a = 0; a < dim; ++a)
      v -= touch.weight[a] * field((*touch.facet)[a]);
  return v;
}

/// Touches that play a part, with the rate at which each may close, the change of it by its own impulse, and
/// the velocities without any.
template <int dim>
void Contact<dim>::prepare_touches(const SolidNodes<dim>& nodes, double dt, std::span<const Vec<dim>> F_free)
{
  const auto free_velocity = [&](std::size_t n) // v⁻ + Δt a; nodes.v is v⁻ still
  {
    Vec<dim> v = nodes.v[n];
    for (int i = 0; i < dim; ++i)
      v[i] += dt * nodes.inverse_mass[n][i] * F_free[n][i];
    return v;
  };

  // Those that would pass their gap even if the others pushed them as hard as they could are not known
  // before; touches with a gap wider than a few steps' travel play no part.
  double fastest = 0.0;
  for (const auto& touch : touches_)
    fastest = std::max(fastest, -dot(relative(touch, free_velocity), touch.normal));
  std::erase_if(touches_, [&](const Touch& touch) { return touch.gap > 4.0 * dt * fastest; });
  for (auto& touch : touches_)
  {
    const double before = dot(relative(touch, [&](std::size_t n) { return nodes.v[n]; }), touch.normal);
    touch.rate = std::min(-std::max(touch.gap, 0.0) / dt, -std::max(before, 0.0));
    const auto add = [&](std::size_t n, double weight)
    {
      v_next_[n] = free_velocity(n);
      for (int i = 0; i < dim; ++i)
        touch.own += dt * weight * weight * nodes.inverse_mass[n][i] * touch.normal[i] * touch.normal[i];
    };
    add(touch.slave, 1.0);
    if (touch.facet != nullptr)
      for (std::size_t a = 0; a < dim; ++a)
        add((*touch.facet)[a], touch.weight[a]);
  }
  std::erase_if(touches_, [](const Touch& touch) { return !(touch.own > 0.0); }); // both sides are held
}

/// Projected Gauss-Seidel over the touches.
template <int dim>
void Contact<dim>::solve_touches(const SolidNodes<dim>& nodes, double dt)
{
  /// v⁺ changes by Δt M⁻¹ of the force on the slave and its reaction.
  const auto push = [&](const Touch& touch, const Vec<dim>& force)
  {
    const auto move = [&](std::size_t n, double weight)
    {
      for (int i = 0; i < dim; ++i)
        v_next_[n][i] += dt * nodes.inverse_mass[n][i] * weight * force[i];
    };
    move(touch.slave, 1.0);
    if (touch.facet != nullptr)
      for (std::size_t a = 0; a < dim; ++a)
        move((*touch.facet)[a], -touch.weight[a]);
  };
  const auto next = [&](std::size_t n) { return v_next_[n]; };
  for (int sweep = 0; sweep < most_sweeps; ++sweep)
  {
    double change = 0.0, largest = 0.0;
    for (auto& touch : touches_)
    {
      const auto v = relative(touch, next);
      const double p_old = dot(touch.force, touch.normal);
      const double p = std::max(0.0, p_old + (touch.rate - dot(v, touch.normal)) / touch.own);
      auto tangential = touch.force - p_old * touch.normal;
      if (touch.friction > 0.0)
      {
        tangential -= (1.0 / touch.own) * (v - dot(v, touch.normal) * touch.normal); // what would stop it
        if (const double size = norm(tangential); size > touch.friction * p)
          tangential *= touch.friction * p / size;
      }
      const auto force = p * touch.normal + tangential;
      push(touch, force - touch.force);
      change = std::max(change, norm(force - touch.force));
      largest = std::max(largest, p);
      touch.force = force;
    }
    if (change <= 1e-13 * largest)
      break;
  }
}

template <int dim>
void Contact<dim>::add_impulses(const SolidNodes<dim>& nodes, double dt, std::span<const Vec<dim>> F_free,
                                std::span<Vec<dim>> F)
{
  find_touches(nodes);
  if (!(dt > 0.0)) // at the start: the first step has no length yet
    return;
  prepare_touches(nodes, dt, F_free);
  solve_touches(nodes, dt);
  for (const auto& touch : touches_)
  {
    F[touch.slave] += touch.force;
    if (touch.wall != nullptr)
      touch.wall->force += touch.force;
    else
      for (std::size_t a = 0; a < dim; ++a)
        F[(*touch.facet)[a]] -= touch.weight[a] * touch.force;
  }
}

template class Contact<2>;
template class Contact<3>;

} // namespace undine::solid
