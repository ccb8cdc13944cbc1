// The keys of the solid, each with unit, meaning, default and rule.
#include "solid_fe/read_solid_config.hpp"

#include "common/config/coupling_config.hpp"
#include "common/error.hpp"

namespace undine::solid
{

namespace
{

std::vector<std::string> component_names(int dim)
{
  std::vector<std::string> names = {"x", "y", "z"};
  names.resize(static_cast<std::size_t>(dim));
  return names;
}

MaterialConfig read_material(const CaseTable& solid)
{
  MaterialConfig material;
  material.density = solid.number({"density", "kg/m3", "density in the undeformed state"}, positive());
  material.youngs_modulus =
      solid.number({"youngs_modulus", "Pa", "Young's modulus at small strain"}, positive());
  material.poisson_ratio =
      solid.number({"poisson_ratio", "", "Poisson's ratio at small strain"}, strictly_between(-1.0, 0.5));
  material.law = solid.choice({"law", "", "constitutive law; \"linear\" is for small displacements only"},
                              NeoHookeanLn::name, law_names());
  return material;
}

ElementType read_element(const CaseTable& solid, int dim)
{
  const std::vector<std::string> names =
      dim == 2 ? std::vector<std::string>{"T3", "Q4"} : std::vector<std::string>{"Tet4", "Hex8"};
  const auto name = solid.choice({"element", "", "element type of the built-in box"}, names[1], names);
  if (name == "T3")
    return ElementType::triangle3;
  if (name == "Q4")
    return ElementType::quadrilateral4;
  return name == "Tet4" ? ElementType::tetrahedron4 : ElementType::hexahedron8;
}

GeometryConfig read_geometry(const CaseFile& file, const CaseTable& solid, int dim, double element_size)
{
  GeometryConfig geometry;
  const auto mesh = solid.optional_text(
      {"mesh", "", "Gmsh file of the solid, relative to the case; instead of the built-in box"});
  if (mesh)
  {
    geometry.mesh_file = file.resolve(*mesh);
    for (const char* key : {"width", "height", "depth", "origin", "element", "elements", "size_factor"})
      if (solid.has(key))
        solid.fail(key,
                   "belongs to the built-in box, but the geometry comes from solid.mesh; remove one of them");
    return geometry;
  }

  geometry.element = read_element(solid, dim);
  geometry.size.push_back(solid.number({"width", "m", "size of the box along x"}, positive()));
  geometry.size.push_back(solid.number({"height", "m", "size of the box along y"}, positive()));
  if (dim == 3)
    geometry.size.push_back(solid.number({"depth", "m", "size of the box along z"}, positive()));
  const auto n = static_cast<std::size_t>(dim);
  geometry.origin = solid.numbers({"origin", "m", "corner of the box with the smallest coordinates"}, n,
                                  std::vector<double>(n, 0.0), any_number());
  const double factor = solid.number(
      {"size_factor", "", "element size of the box relative to run.element_size"}, 1.0, positive());
  geometry.elements = element_counts(geometry.size, factor * element_size);
  const std::vector<double> counted(geometry.elements.begin(), geometry.elements.end());
  const auto elements = solid.numbers({"elements", "", "number of elements of the box along each axis"}, n,
                                      counted, between(1.0, 1e6));
  for (std::size_t i = 0; i < n; ++i)
  {
    geometry.elements[i] = static_cast<int>(elements[i]);
    if (geometry.elements[i] != elements[i])
      solid.fail("elements", "must be whole numbers");
  }
  return geometry;
}

void read_supports_and_loads(const CaseTable& solid, int dim, SolidConfig& config)
{
  const auto n = static_cast<std::size_t>(dim);
  for (const auto& table : solid.tables("fix", "components of a surface or node set that do not move"))
  {
    FixConfig fix;
    fix.on = table.text({"on", "", "name of the surface or node set"});
    fix.components =
        table.texts({"components", "", "fixed components; a roller fixes one"}, component_names(dim));
    config.fix.push_back(std::move(fix));
  }
  for (const auto& table : solid.tables("velocity", "constant prescribed velocity of a surface or node set"))
  {
    VelocityConfig velocity;
    velocity.on = table.text({"on", "", "name of the surface or node set"});
    velocity.value = table.numbers({"value", "m/s", "velocity"}, n, any_number());
    velocity.components = table.texts({"components", "", "prescribed components"}, component_names(dim));
    config.velocity.push_back(std::move(velocity));
  }
  for (const auto& table : solid.tables("traction", "dead load per undeformed area of a surface"))
  {
    TractionConfig traction;
    traction.on = table.text({"on", "", "name of the surface"});
    traction.value = table.numbers({"value", "Pa", "traction"}, n, any_number());
    traction.ramp =
        table.number({"ramp", "s", "time over which it grows linearly from 0; 0: full from the start"}, 0.0,
                     non_negative());
    config.traction.push_back(std::move(traction));
  }
}

} // namespace

SolidConfig read_solid_config(const CaseFile& file, int dim, double element_size)
{
  if (!file.has_table("solid"))
    throw InputError(file.path() + ": there is no [solid] table: add one, or leave out solid_fe");
  const CaseTable solid = file.table("solid", "the deformable body");
  const auto n = static_cast<std::size_t>(dim);
  SolidConfig config;
  config.dim = dim;
  solid.texts({"program", "",
               "command of another solid to be started by scripts/run instead of solid_fe, such as "
               "[\"python3\", \"my_solid.py\"]; empty: solid_fe"},
              {});
  config.material = read_material(solid);
  config.geometry = read_geometry(file, solid, dim, element_size);
  config.gravity =
      solid.numbers({"gravity", "m/s2", "body force per mass"}, n, std::vector<double>(n, 0.0), any_number());
  config.initial_velocity =
      solid.numbers({"initial_velocity", "m/s", "velocity of all free nodes at the start"}, n,
                    std::vector<double>(n, 0.0), any_number());
  config.step_safety =
      solid.number({"step_safety", "", "fraction of the stable step that is used"}, 0.9, between(0.01, 1.0));
  read_supports_and_loads(solid, dim, config);
  for (const auto& interface : read_coupling(file).interfaces)
    config.wet.push_back({interface.name, interface.solid});
  return config;
}

} // namespace undine::solid
