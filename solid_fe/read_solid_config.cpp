// The keys of the solid, each with unit, meaning, default and rule.
#include "solid_fe/read_solid_config.hpp"

#include "common/config/coupling_config.hpp"
#include "common/error.hpp"

#include <fmt/format.h>

#include <algorithm>

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

void read_plasticity(const CaseTable& solid, MaterialConfig& material)
{
  const Key yield{"yield_stress", "Pa", "first yield in uniaxial stress, laws j2 and johnson_cook"};
  if (material.law == J2::name)
  {
    material.hardening_table = solid.numbers({"hardening_table", "-, Pa",
                                              "equivalent plastic strain (ascending from 0) and yield stress "
                                              "alternately; instead of yield_stress and hardening_modulus"},
                                             0, {}, non_negative());
    const auto& table = material.hardening_table;
    if (table.empty())
    {
      material.yield_stress = solid.number(yield, positive());
      material.hardening_modulus =
          solid.number({"hardening_modulus", "Pa", "slope of the yield stress over plastic strain, j2"}, 0.0,
                       non_negative());
      return;
    }
    bool ascends = table.size() % 2 == 0 && table.size() >= 4 && table[0] == 0.0 && table[1] > 0.0;
    for (std::size_t k = 2; ascends && k < table.size(); k += 2)
      ascends = table[k] > table[k - 2];
    if (!ascends)
      solid.fail("hardening_table",
                 "must be pairs of strain and stress, at least two, the strains ascending from 0 "
                 "and the first stress positive");
  }
  else if (material.law == JohnsonCook::name)
  {
    material.yield_stress = solid.number(yield, positive());
    material.hardening_coefficient =
        solid.number({"hardening_coefficient", "Pa", "B of Johnson and Cook"}, 0.0, non_negative());
    material.hardening_exponent =
        solid.number({"hardening_exponent", "", "n of Johnson and Cook"}, 1.0, between(0.01, 5.0));
    material.rate_coefficient =
        solid.number({"rate_coefficient", "", "C of Johnson and Cook"}, 0.0, non_negative());
    material.reference_rate =
        solid.number({"reference_rate", "1/s", "plastic strain rate below which the rate has no influence"},
                     1.0, positive());
    material.thermal_exponent =
        solid.number({"thermal_exponent", "", "m of Johnson and Cook"}, 1.0, between(0.01, 10.0));
    material.melting_rise =
        solid.number({"melting_rise", "K", "melting temperature above that at the start; 0: no softening"},
                     0.0, non_negative());
    material.heat_capacity = solid.number(
        {"heat_capacity", "J/(kg K)", "per mass; 0: no heating by plastic work"}, 0.0, non_negative());
    material.heat_fraction =
        solid.number({"heat_fraction", "", "share of the plastic work that heats"}, 0.9, between(0.0, 1.0));
  }
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
  for (const auto& key : law_keys(material.law))
    material.own.emplace(
        key.name, solid.number({key.name, key.unit, key.meaning}, key.usual, between(key.low, key.high)));
  read_plasticity(solid, material);
  material.mass_damping =
      solid.number({"mass_damping", "1/s", "alpha of the damping force alpha m v"}, 0.0, non_negative());
  material.stiffness_damping =
      solid.number({"stiffness_damping", "s", "beta of the viscous stress beta C:dE/dt; it costs step size"},
                   0.0, non_negative());
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

/// Keys of another geometry than the one given.
void refuse(const CaseTable& solid, std::initializer_list<const char*> keys, const char* reason)
{
  for (const char* key : keys)
    if (solid.has(key))
      solid.fail(key, reason);
}

/// A thin wall.
void read_line(const CaseTable& solid, GeometryConfig& geometry)
{
  geometry.line =
      solid.numbers({"line", "m",
                     "x, y, x, y, ... of the middle line of a thin wall (formulation beam), instead of "
                     "a box; surfaces left, right, start, end"},
                    0, {}, any_number());
  if (!geometry.line.empty() && (geometry.line.size() % 2 != 0 || geometry.line.size() < 4))
    solid.fail("line", "must be x and y of at least two points");
  geometry.thickness =
      solid.number({"thickness", "m",
                    "thickness of the wall about solid.line or about the two-node elements of "
                    "solid.mesh; 0: solid.mesh is a strip of quadrilaterals"},
                   0.0, non_negative());
  if (!geometry.line.empty() && !(geometry.thickness > 0.0))
    solid.fail("thickness", "must be positive for a wall about solid.line");
}

void read_size(const CaseTable& solid, int dim, bool is_ring, bool is_beam, GeometryConfig& geometry)
{
  if (is_ring)
  {
    if (is_beam)
      solid.fail("inner_radius", "is of a ring of elements; for a wall of beams give solid.line");
    refuse(solid, {"width", "height", "angle"},
           "belongs to the box, but the solid is a ring; remove one of them");
    geometry.inner_radius = solid.number(
        {"inner_radius", "m", "of a ring about `origin` instead of a box; surfaces inner, outer"},
        positive());
    const double outer = solid.number({"outer_radius", "m", "of that ring"}, positive());
    if (!(outer > geometry.inner_radius))
      solid.fail("outer_radius", "must be larger than inner_radius");
    geometry.size = {std::acos(-1.0) * (geometry.inner_radius + outer), outer - geometry.inner_radius};
  }
  else
  {
    geometry.size.push_back(solid.number({"width", "m", "size of the box along x"}, positive()));
    geometry.size.push_back(solid.number({"height", "m", "size of the box along y"}, positive()));
  }
  if (dim == 3)
    geometry.size.push_back(solid.number({"depth", "m", "size of the box along z"}, positive()));
}

void read_element_counts(const CaseTable& solid, bool is_ring, bool is_beam, GeometryConfig& geometry)
{
  const std::size_t n = geometry.size.size();
  double count = 1.0;
  for (const double size : geometry.size)
    count *= std::max(1.0, size / geometry.element_size);
  if (count > 5e7 && !solid.has("elements"))
    solid.fail("width", fmt::format("the box would have {:.2g} elements of {:.3g} m, more than a machine can "
                                    "hold; are its sizes in metres? Else lower run.resolution",
                                    count, geometry.element_size));
  geometry.elements = element_counts(geometry.size, geometry.element_size);
  if (is_ring)
    geometry.elements[0] = std::max(geometry.elements[0], 8);
  if (is_beam) // one quadrilateral across the wall
    geometry.elements[geometry.size[0] < geometry.size[1] ? 0 : 1] = 1;
  const std::vector<double> counted(geometry.elements.begin(), geometry.elements.end());
  const auto elements = solid.numbers(
      {"elements", "", "number of elements of the box along each axis; of a ring around, across, along"}, n,
      counted, between(1.0, 1e6));
  for (std::size_t i = 0; i < n; ++i)
  {
    geometry.elements[i] = static_cast<int>(elements[i]);
    if (geometry.elements[i] != elements[i])
      solid.fail("elements", "must be whole numbers");
  }
  if (is_ring && geometry.elements[0] < 3)
    solid.fail("elements", "must be at least 3 around a ring");
}

GeometryConfig read_geometry(const CaseFile& file, const CaseTable& solid, int dim, double element_size,
                             bool is_beam)
{
  GeometryConfig geometry;
  const double factor = solid.number(
      {"size_factor", "", "element size of the box or line relative to run.element_size"}, 1.0, positive());
  geometry.element_size = factor * element_size;
  if (is_beam)
    read_line(solid, geometry);
  const auto mesh = solid.optional_text(
      {"mesh", "",
       "Gmsh (.msh) or Abaqus (.inp) file of the solid, relative to the case; instead of the built-in box"});
  if (mesh)
  {
    geometry.mesh_file = file.resolve(*mesh);
    refuse(solid,
           {"width", "height", "depth", "origin", "element", "elements", "line", "angle", "inner_radius",
            "outer_radius"},
           "belongs to the built-in box, but the geometry comes from solid.mesh; remove one of them");
    return geometry;
  }
  if (!geometry.line.empty())
  {
    refuse(solid,
           {"width", "height", "origin", "element", "elements", "angle", "inner_radius", "outer_radius"},
           "belongs to the built-in box, but the wall is about solid.line; remove one of them");
    return geometry;
  }

  geometry.element = read_element(solid, dim);
  const bool is_ring = solid.has("inner_radius") || solid.has("outer_radius");
  read_size(solid, dim, is_ring, is_beam, geometry);
  const auto n = static_cast<std::size_t>(dim);
  geometry.origin =
      solid.numbers({"origin", "m", "corner of the box with the smallest coordinates; centre of a ring"}, n,
                    std::vector<double>(n, 0.0), any_number());
  if (!is_ring)
    geometry.angle =
        solid.number({"angle", "degree", "the box is turned by this about `origin`, in the x-y plane"}, 0.0,
                     any_number()) *
        std::acos(-1.0) / 180.0;
  read_element_counts(solid, is_ring, is_beam, geometry);
  return geometry;
}

void read_formulation(const CaseTable& solid, int dim, SolidConfig& config)
{
  const auto formulation = solid.choice(
      {"formulation", "",
       "full integration; one point with hourglass control (quadrilaterals, hexahedra); or "
       "locking_free: mean "
       "dilatation of the element (quadrilaterals, hexahedra) or of the nodes (simplices); beam: thin "
       "walls in 2-D, one quadrilateral across"},
      "full", {"full", "one_point", "locking_free", "beam"});
  config.formulation = formulation == "full"        ? Formulation::full
                       : formulation == "one_point" ? Formulation::one_point
                       : formulation == "beam"      ? Formulation::beam
                                                    : Formulation::locking_free;
  // Other formulations may carry them along, so that a case changes its formulation by one key.
  if (config.formulation == Formulation::one_point || solid.has("hourglass_stiffness") ||
      solid.has("hourglass_viscosity"))
  {
    config.hourglass_stiffness =
        solid.number({"hourglass_stiffness", "",
                      "one_point: stiffness of the hourglass modes relative to E V sum |grad N|^2"},
                     config.hourglass_stiffness, between(0.0, 1.0));
    config.hourglass_viscosity =
        solid.number({"hourglass_viscosity", "",
                      "one_point: viscosity of the hourglass modes relative to sqrt(stiffness x mass)"},
                     0.0, between(0.0, 1.0));
  }
  if (dim == 2)
  {
    const auto plane = solid.choice(
        {"plane", "", "what the plane stands for; axisymmetric: x is the radius, the whole ring counts"},
        "strain", {"strain", "stress", "axisymmetric"});
    config.plane = plane == "strain"   ? PlaneKind::strain
                   : plane == "stress" ? PlaneKind::stress
                                       : PlaneKind::axisymmetric;
  }
}

/// One formula per component, or none.
void check_formulas(const CaseTable& table, const std::vector<std::string>& formulas, std::size_t n,
                    const char* key = "function")
{
  if (!formulas.empty() && formulas.size() != n)
    table.fail(key, "must have one formula per component");
}

/// Factor over time from the key "table" as a formula of t, "" if there is none: linear between the points,
/// constant outside.
std::string factor_over_time(const CaseTable& table)
{
  const auto points =
      table.numbers({"table", "s, -",
                     "time (ascending) and factor alternately, linear between them and constant "
                     "outside: multiplies value or function"},
                    0, {}, any_number());
  if (points.empty())
    return "";
  bool ascends = points.size() % 2 == 0 && points.size() >= 4;
  for (std::size_t k = 2; ascends && k < points.size(); k += 2)
    ascends = points[k] > points[k - 2];
  if (!ascends)
    table.fail("table", "must be pairs of time and factor, at least two, the times ascending");
  std::string formula = fmt::format("{:.17g}", points.back());
  for (std::size_t k = points.size() - 2; k >= 2; k -= 2)
  {
    const double t0 = points[k - 2], f0 = points[k - 1], slope = (points[k + 1] - f0) / (points[k] - t0);
    formula = fmt::format("(t < {:.17g} ? {:.17g} + ({:.17g})*(t - ({:.17g})) : {})", points[k], f0, slope,
                          t0, formula);
  }
  return fmt::format("(t < {:.17g} ? {:.17g} : {})", points[0], points[1], formula);
}

/// The formulas, or the values as formulas, times the factor if there is one.
std::vector<std::string> over_time(const std::vector<std::string>& function, const std::vector<double>& value,
                                   const std::string& factor)
{
  std::vector<std::string> formulas = function;
  if (formulas.empty() && !factor.empty())
    for (const double v : value)
      formulas.push_back(fmt::format("{:.17g}", v));
  if (!factor.empty())
    for (auto& formula : formulas)
      formula = "(" + formula + ")*" + factor;
  return formulas;
}

/// One entry of [[solid.velocity]] or [[solid.acceleration]].
VelocityConfig read_prescribed(const CaseTable& table, int dim, bool is_acceleration)
{
  const auto n = static_cast<std::size_t>(dim);
  const char* unit = is_acceleration ? "m/s2" : "m/s";
  VelocityConfig motion;
  motion.is_acceleration = is_acceleration;
  motion.on = table.text({"on", "", "name of the surface or node set"});
  motion.function =
      table.texts({"function", unit, "formulas of x, y, z, t, one per component, instead of value"}, {});
  check_formulas(table, motion.function, n);
  if (motion.function.empty())
    motion.value =
        table.numbers({"value", unit, is_acceleration ? "acceleration" : "velocity"}, n, any_number());
  motion.components = table.texts({"components", "", "prescribed components"}, component_names(dim));
  std::string factor = factor_over_time(table);
  if (factor.empty() && is_acceleration)
    factor = std::string("1"); // always a formula
  motion.function = over_time(motion.function, motion.value, factor);
  if (!motion.function.empty())
    motion.value.clear();
  return motion;
}

void read_supports_and_loads(const CaseTable& solid, int dim, SolidConfig& config)
{
  const auto n = static_cast<std::size_t>(dim);
  for (const auto& table : solid.tables("fix", "components of a surface or node set that do not move"))
  {
    FixConfig fix;
    fix.on = table.text({"on", "", "name of the surface or node set"});
    fix.components =
        table.texts({"components", "",
                     "fixed components; a roller fixes one; a beam has \"rotation\" too: clamped x, y, "
                     "rotation, pinned x, y"},
                    config.formulation == Formulation::beam ? std::vector<std::string>{"x", "y", "rotation"}
                                                            : component_names(dim));
    config.fix.push_back(std::move(fix));
  }
  for (const auto& table : solid.tables("velocity", "prescribed velocity of a surface or node set"))
    config.velocity.push_back(read_prescribed(table, dim, false));
  for (const auto& table :
       solid.tables("acceleration", "prescribed acceleration of a surface or node set, from the "
                                    "initial velocity on"))
    config.velocity.push_back(read_prescribed(table, dim, true));
  for (const auto& table : solid.tables("traction", "dead load per undeformed area of a surface"))
  {
    TractionConfig traction;
    traction.on = table.text({"on", "", "name of the surface"});
    traction.function =
        table.texts({"function", "Pa",
                     "formulas of x, y, z (undeformed) and t, one per component, instead of value and ramp"},
                    {});
    check_formulas(table, traction.function, n);
    const std::string factor = factor_over_time(table);
    if (traction.function.empty() && !factor.empty())
      traction.value = table.numbers({"value", "Pa", "traction"}, n, any_number());
    traction.function = over_time(traction.function, traction.value, factor);
    if (!traction.function.empty())
    {
      config.traction.push_back(std::move(traction));
      continue;
    }
    traction.value = table.numbers({"value", "Pa", "traction"}, n, any_number());
    traction.ramp =
        table.number({"ramp", "s", "time over which it grows linearly from 0; 0: full from the start"}, 0.0,
                     non_negative());
    config.traction.push_back(std::move(traction));
  }
  config.rigid =
      solid.texts({"rigid", "", "surfaces or node sets, each of which moves as one rigid body"}, {});
  for (const auto& table : solid.tables("pressure", "pressure on the deformed surface"))
  {
    PressureConfig pressure;
    pressure.on = table.text({"on", "", "name of the surface"});
    pressure.function = table.text({"function", "Pa", "formula of x, y, z (undeformed) and t"});
    if (const std::string factor = factor_over_time(table); !factor.empty())
      pressure.function = over_time({pressure.function}, {}, factor)[0];
    config.pressure.push_back(std::move(pressure));
  }
  config.body_force_function = solid.texts(
      {"body_force_function", "m/s2", "formulas of x, y, z, t added to gravity, one per component"}, {});
  check_formulas(solid, config.body_force_function, n, "body_force_function");
  config.initial_velocity_function =
      solid.texts({"initial_velocity_function", "m/s",
                   "formulas of x, y, z instead of initial_velocity, one per component"},
                  {});
  check_formulas(solid, config.initial_velocity_function, n, "initial_velocity_function");
}

void read_contact(const CaseTable& solid, int dim, SolidConfig& config)
{
  const auto n = static_cast<std::size_t>(dim);
  const Key friction{"friction", "", "Coulomb's coefficient"};
  for (const auto& table : solid.tables("wall", "a rigid plane that nodes cannot pass"))
  {
    WallConfig wall;
    wall.point = table.numbers({"point", "m", "a point of the plane"}, n, any_number());
    wall.normal = table.numbers({"normal", "", "direction to the side where the solid is"}, n, any_number());
    wall.friction = table.number(friction, 0.0, non_negative());
    wall.on = table.text({"on", "", "surface or node set that may touch it; empty: the whole boundary"}, "");
    config.wall.push_back(std::move(wall));
  }
  for (const auto& table : solid.tables("contact", "nodes that cannot pass a surface of the solid"))
  {
    ContactConfig contact;
    contact.nodes = table.text({"nodes", "", "surface or node set"});
    contact.surface = table.text({"surface", "", "surface they cannot pass; the same name: self-contact"});
    contact.friction = table.number(friction, 0.0, non_negative());
    config.contact.push_back(std::move(contact));
  }
  if (config.wall.empty() && config.contact.empty())
    return;
  const auto method =
      solid.choice({"contact_method", "",
                    "penalty: springs behind walls and facets; impulse: the force that closes a gap "
                    "exactly, without stiffness, momentum kept and no energy made"},
                   "penalty", {"penalty", "impulse"});
  config.contact_method = method == "penalty" ? ContactMethod::penalty : ContactMethod::impulse;
  if (config.contact_method == ContactMethod::penalty)
    config.contact_stiffness = solid.number(
        {"contact_stiffness", "", "penalty stiffness relative to omega^2 m, omega the highest frequency"},
        config.contact_stiffness, between(1e-6, 1.0));
}

} // namespace

SolidConfig read_solid_config(const CaseFile& file, int dim, double element_size, const std::string& name)
{
  if (!file.has_table("solid"))
    throw InputError(file.path() + ": there is no [solid] table: add one, or leave out solid_fe");
  const CaseTable solid = file.table("solid", "the deformable body");
  const auto n = static_cast<std::size_t>(dim);
  SolidConfig config;
  config.dim = dim;
  solid.text({"name", "",
              "of one of several [[solid]]: its role on the mpirun line (solid_fe case --name NAME) and in "
              "[[interface]] body"},
             name);
  solid.texts({"program", "",
               "command of another solid to be started by scripts/run instead of solid_fe, such as "
               "[\"python3\", \"my_solid.py\"]; empty: solid_fe"},
              {});
  config.material = read_material(solid);
  read_formulation(solid, dim, config);
  config.geometry = read_geometry(file, solid, dim, element_size, config.formulation == Formulation::beam);
  config.gravity =
      solid.numbers({"gravity", "m/s2", "body force per mass"}, n, std::vector<double>(n, 0.0), any_number());
  config.initial_velocity =
      solid.numbers({"initial_velocity", "m/s", "velocity of all free nodes at the start"}, n,
                    std::vector<double>(n, 0.0), any_number());
  config.step_safety =
      solid.number({"step_safety", "", "fraction of the stable step that is used"}, 0.9, between(0.01, 1.0));
  config.measures_frequency =
      solid.choice({"step_limit", "",
                    "bound: from the elements, never too long; measured: the true highest frequency, at the "
                    "start and after large changes (elastic laws, no beams, no rigid bodies)"},
                   "bound", {"bound", "measured"}) == "measured";
  config.scaled_step = solid.number({"mass_scaling_step", "s",
                                     "mass is added where the step at rest would be smaller than this; how "
                                     "much each set of elements got is told; 0: none"},
                                    0.0, non_negative());
  read_supports_and_loads(solid, dim, config);
  read_contact(solid, dim, config);
  for (const auto& interface : read_coupling(file).interfaces)
    for (const auto& surface : interface.body == name ? interface.solid_surfaces : std::vector<std::string>{})
      config.wet.push_back({interface.name, surface});
  return config;
}

} // namespace undine::solid
