// Resolution of named supports and loads into nodes and forces.
#include "solid_fe/boundary_conditions.hpp"

#include "common/config/nearest_word.hpp"
#include "common/error.hpp"
#include "solid_fe/elements/reference_elements.hpp"

#include <cmath>
#include <numbers>

namespace undine::solid
{

namespace
{

[[noreturn]] void fail_unknown(const std::string& key, const std::string& name, const char* what,
                               const std::vector<std::string>& known)
{
  std::string text = key + " = \"" + name + "\": the solid's mesh has no " + what + " of that name; there ";
  text += known.empty() ? "are none (name physical groups in the mesh)" : "are";
  for (std::size_t k = 0; k < known.size(); ++k)
    text += (k == 0 ? " " : ", ") + known[k];
  if (const auto near = nearest_word(name, known); !near.empty())
    text += "; did you mean \"" + near + "\"?";
  throw InputError(text);
}

template <class Map>
void append_keys(const Map& map, std::vector<std::string>& keys)
{
  for (const auto& [key, value] : map)
    keys.push_back(key);
}

/// Component flags from "x", "y", "z".
template <int dim>
std::array<bool, dim> components(const std::vector<std::string>& names, const std::string& key)
{
  std::array<bool, dim> flags{};
  for (const auto& name : names)
  {
    const int i = name == "x" ? 0 : name == "y" ? 1 : name == "z" ? 2 : -1;
    if (i < 0 || i >= dim)
      throw InputError(key + " contains \"" + name + "\": must be of " + (dim == 2 ? "x, y" : "x, y, z") +
                       " in " + std::to_string(dim) + "-D");
    flags[static_cast<std::size_t>(i)] = true;
  }
  return flags;
}

template <int dim>
void prescribe(PrescribedMotion<dim>& motion, const std::array<bool, dim>& which, const Vec<dim>& v,
               const std::string& key, int function = -1)
{
  for (int i = 0; i < dim; ++i)
  {
    const auto c = static_cast<std::size_t>(i);
    if (!which[c])
      continue;
    if (motion.fixed[c] && (motion.v[i] != v[i] || motion.function[c] != function))
      throw InputError(key + ": component " + std::string(1, "xyz"[i]) +
                       " of a node on this set already has the velocity " + std::to_string(motion.v[i]) +
                       " m/s from another [[solid.fix]] or [[solid.velocity]]; " +
                       "leave that component out of one of them");
    motion.fixed[c] = true;
    motion.v[i] = v[i];
    motion.function[c] = function;
  }
}

} // namespace

template <int dim>
std::vector<int> parts_that_keep_their_shape(const Mesh<dim>& mesh, const SolidConfig& config,
                                             const std::map<index_t, PrescribedMotion<dim>>& motion)
{
  std::vector<int> part(mesh.x.size(), -1);
  std::map<std::array<double, dim>, int> part_of_velocity;
  int parts = 0;
  for (const auto& [node, prescribed] : motion)
  {
    bool all = config.plane != PlaneKind::axisymmetric || prescribed.v[0] == 0.0;
    for (std::size_t i = 0; i < dim; ++i)
      all = all && prescribed.fixed[i] && prescribed.function[i] < 0;
    if (!all)
      continue;
    const auto [known, is_new] = part_of_velocity.try_emplace(prescribed.v.c, parts);
    parts += is_new;
    part[static_cast<std::size_t>(node)] = known->second;
  }
  for (std::size_t k = 0; k < config.rigid.size(); ++k, ++parts)
    for (const index_t node : find_nodes(mesh, config.rigid[k], "solid.rigid[" + std::to_string(k) + "]"))
      part[static_cast<std::size_t>(node)] = parts;
  return part;
}

template <int dim>
const Surface& find_surface(const Mesh<dim>& mesh, const std::string& name, const std::string& key)
{
  const auto found = mesh.surfaces.find(name);
  if (found != mesh.surfaces.end())
    return found->second;
  std::vector<std::string> known;
  append_keys(mesh.surfaces, known);
  fail_unknown(key, name, "surface", known);
}

template <int dim>
std::vector<index_t> find_nodes(const Mesh<dim>& mesh, const std::string& name, const std::string& key)
{
  if (const auto surface = mesh.surfaces.find(name); surface != mesh.surfaces.end())
    return surface->second.node_set();
  if (const auto set = mesh.node_sets.find(name); set != mesh.node_sets.end())
    return set->second;
  std::vector<std::string> known;
  append_keys(mesh.surfaces, known);
  append_keys(mesh.node_sets, known);
  fail_unknown(key, name, "surface or node set", known);
}

template <int dim>
std::map<index_t, PrescribedMotion<dim>> prescribed_motion(const Mesh<dim>& mesh, const SolidConfig& config)
{
  std::map<index_t, PrescribedMotion<dim>> motion;
  for (std::size_t k = 0; k < config.fix.size(); ++k)
  {
    const std::string key = "solid.fix[" + std::to_string(k) + "]";
    const auto which = components<dim>(config.fix[k].components, key + ".components");
    for (const index_t n : find_nodes(mesh, config.fix[k].on, key + ".on"))
      prescribe<dim>(motion[n], which, Vec<dim>{}, key);
  }
  for (std::size_t k = 0; k < config.velocity.size(); ++k)
  {
    const std::string key = "solid.velocity[" + std::to_string(k) + "]";
    const auto& entry = config.velocity[k];
    auto which = components<dim>(entry.components, key + ".components");
    if (entry.components.empty())
      which.fill(true);
    const auto v = to_vec<dim>(entry.value, key + ".value");
    for (const index_t n : find_nodes(mesh, entry.on, key + ".on"))
      prescribe<dim>(motion[n], which, v, key, entry.function.empty() ? -1 : static_cast<int>(k));
  }
  return motion;
}

template <int dim>
std::vector<double> facet_weights(const Mesh<dim>& mesh, std::span<const index_t> facet, bool ring)
{
  const auto X = [&](std::size_t k) { return mesh.x[static_cast<std::size_t>(facet[k])]; };
  if constexpr (dim == 2)
  {
    const double length = norm(X(1) - X(0));
    if (!ring)
      return {0.5 * length, 0.5 * length};
    const double around = 2.0 * std::numbers::pi * length; // R varies linearly
    return {around * (X(0)[0] / 3.0 + X(1)[0] / 6.0), around * (X(0)[0] / 6.0 + X(1)[0] / 3.0)};
  }
  else if (facet.size() == 3)
  {
    const double third = norm(cross(X(1) - X(0), X(2) - X(0))) / 6.0;
    return {third, third, third};
  }
  else
  {
    std::vector<double> weights(4, 0.0);
    for (int q = 0; q < Quadrilateral4::points; ++q)
    {
      const auto N = Quadrilateral4::shape(Quadrilateral4::point(q));
      const auto dN = Quadrilateral4::shape_gradient(Quadrilateral4::point(q));
      Vec<3> along_xi, along_eta;
      for (std::size_t a = 0; a < 4; ++a)
      {
        along_xi += X(a) * dN[a][0];
        along_eta += X(a) * dN[a][1];
      }
      const double area = norm(cross(along_xi, along_eta));
      for (std::size_t a = 0; a < 4; ++a)
        weights[a] += area * N[a];
    }
    return weights;
  }
}

namespace
{

/// ∫ N_a dA of all nodes of a surface.
template <int dim>
std::map<index_t, double> nodal_areas(const Mesh<dim>& mesh, const Surface& surface, bool ring)
{
  std::map<index_t, double> area;
  for (index_t f = 0; f < surface.size(); ++f)
  {
    const auto begin = static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f)]);
    const auto end = static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f) + 1]);
    const std::span<const index_t> facet(surface.nodes.data() + begin, end - begin);
    const auto weights = facet_weights(mesh, facet, ring);
    for (std::size_t a = 0; a < facet.size(); ++a)
      area[facet[a]] += weights[a];
  }
  return area;
}

} // namespace

template <int dim>
std::vector<NodalLoad<dim>> nodal_loads(const Mesh<dim>& mesh, const SolidConfig& config)
{
  std::vector<NodalLoad<dim>> loads;
  for (std::size_t k = 0; k < config.traction.size(); ++k)
  {
    const std::string key = "solid.traction[" + std::to_string(k) + "]";
    const auto& entry = config.traction[k];
    const auto& surface = find_surface(mesh, entry.on, key + ".on");
    if (!entry.function.empty())
      continue;
    const auto traction = to_vec<dim>(entry.value, key + ".value");
    NodalLoad<dim> load;
    load.ramp = entry.ramp;
    for (const auto& [node, area] : nodal_areas(mesh, surface, config.plane == PlaneKind::axisymmetric))
    {
      load.nodes.push_back(node);
      load.force.push_back(area * traction);
    }
    loads.push_back(std::move(load));
  }
  return loads;
}

template <int dim>
std::vector<FormulaLoad<dim>> formula_loads(const Mesh<dim>& mesh, const SolidConfig& config)
{
  std::vector<FormulaLoad<dim>> loads;
  const bool ring = config.plane == PlaneKind::axisymmetric;
  for (std::size_t k = 0; k < config.traction.size(); ++k)
  {
    const std::string key = "solid.traction[" + std::to_string(k) + "]";
    const auto& entry = config.traction[k];
    if (entry.function.empty())
      continue;
    auto& load = loads.emplace_back();
    load.function = FieldFunction(entry.function, key + ".function");
    load.ring = ring;
    for (const auto& [node, area] : nodal_areas(mesh, find_surface(mesh, entry.on, key + ".on"), ring))
    {
      load.nodes.push_back(node);
      load.area.push_back(area);
    }
  }
  for (std::size_t k = 0; k < config.pressure.size(); ++k)
  {
    const std::string key = "solid.pressure[" + std::to_string(k) + "]";
    auto& load = loads.emplace_back();
    load.function = FieldFunction({config.pressure[k].function}, key + ".function");
    load.follows = true;
    load.ring = ring;
    load.surface = find_surface(mesh, config.pressure[k].on, key + ".on");
  }
  return loads;
}

template <int dim>
void FormulaLoad<dim>::add(double t, std::span<const Vec<dim>> X, std::span<const Vec<dim>> u,
                           std::span<Vec<dim>> F) const
{
  for (std::size_t k = 0; k < nodes.size(); ++k)
  {
    const auto n = static_cast<std::size_t>(nodes[k]);
    F[n] += area[k] * function.vector(X[n], t);
  }
  if (!follows)
    return;
  for (index_t f = 0; f < surface.size(); ++f)
  {
    const auto begin = static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f)]);
    const auto end = static_cast<std::size_t>(surface.offset[static_cast<std::size_t>(f) + 1]);
    const auto node = [&](std::size_t a) { return static_cast<std::size_t>(surface.nodes[begin + a]); };
    const auto x = [&](std::size_t a) { return X[node(a)] + u[node(a)]; };
    const std::size_t n = end - begin;
    Vec<dim> middle, normal; // outward, of the size of the area
    for (std::size_t a = 0; a < n; ++a)
      middle += (1.0 / static_cast<double>(n)) * X[node(a)];
    if constexpr (dim == 2)
      normal = right_normal(x(1) - x(0));
    else if (n == 3)
      normal = 0.5 * cross(x(1) - x(0), x(2) - x(0));
    else
      normal = 0.5 * cross(x(2) - x(0), x(3) - x(1));
    const double p = function(0, middle, t);
    for (std::size_t a = 0; a < n; ++a)
    {
      double share = 1.0 / static_cast<double>(n);
      if (ring) // 2π ∫ N_a r ds / length
        share = 2.0 * std::numbers::pi * (x(a)[0] / 3.0 + x(1 - a)[0] / 6.0);
      F[node(a)] -= (p * share) * normal;
    }
  }
}

template struct FormulaLoad<2>;
template struct FormulaLoad<3>;
template std::vector<FormulaLoad<2>> formula_loads(const Mesh<2>&, const SolidConfig&);
template std::vector<FormulaLoad<3>> formula_loads(const Mesh<3>&, const SolidConfig&);
template const Surface& find_surface(const Mesh<2>&, const std::string&, const std::string&);
template const Surface& find_surface(const Mesh<3>&, const std::string&, const std::string&);
template std::vector<index_t> find_nodes(const Mesh<2>&, const std::string&, const std::string&);
template std::vector<index_t> find_nodes(const Mesh<3>&, const std::string&, const std::string&);
template std::map<index_t, PrescribedMotion<2>> prescribed_motion(const Mesh<2>&, const SolidConfig&);
template std::map<index_t, PrescribedMotion<3>> prescribed_motion(const Mesh<3>&, const SolidConfig&);
template std::vector<int> parts_that_keep_their_shape(const Mesh<2>&, const SolidConfig&,
                                                      const std::map<index_t, PrescribedMotion<2>>&);
template std::vector<int> parts_that_keep_their_shape(const Mesh<3>&, const SolidConfig&,
                                                      const std::map<index_t, PrescribedMotion<3>>&);
template std::vector<double> facet_weights(const Mesh<2>&, std::span<const index_t>, bool);
template std::vector<double> facet_weights(const Mesh<3>&, std::span<const index_t>, bool);
template std::vector<NodalLoad<2>> nodal_loads(const Mesh<2>&, const SolidConfig&);
template std::vector<NodalLoad<3>> nodal_loads(const Mesh<3>&, const SolidConfig&);

} // namespace undine::solid
