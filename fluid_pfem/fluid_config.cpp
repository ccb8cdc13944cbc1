// Reader of [fluid].
#include "fluid_pfem/fluid_config.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace undine::fluid
{

namespace
{

Tait read_tait(const CaseTable& t)
{
  Tait tait;
  tait.rho0 = t.number({"density", "kg/m^3", "reference density rho0 of Eq. (3)"}, positive());
  tait.gamma = t.number({"tait_exponent", "", "exponent of Eq. (3)"}, 7.0, at_least(1.0));
  const std::string reading =
      t.choice({"tait_reading", "",
                "K_over_gamma: p = p0 + K/gamma [(rho/rho0)^gamma - 1], K is the bulk modulus; K: as the "
                "paper prints it"},
               "K_over_gamma", {"K_over_gamma", "K"});
  const auto c =
      t.optional_number({"sound_speed", "m/s", "sound speed at rho0, instead of bulk_modulus"}, positive());
  if (c && t.has("bulk_modulus"))
    t.fail("sound_speed", "give either bulk_modulus or sound_speed, not both");
  if (c)
    tait.B = tait.rho0 * *c * *c / tait.gamma;
  else
  {
    const double K = t.number({"bulk_modulus", "Pa", "modulus K of Eq. (3)"}, positive());
    tait.B = reading == "K" ? K : K / tait.gamma;
  }
  return tait;
}

/// `dim` formulas, or none.
std::vector<Expression> formulas(const CaseTable& t, const Key& key, std::size_t dim)
{
  const auto texts = t.texts(key, {});
  if (!texts.empty() && texts.size() != dim)
    t.fail(key.name,
           "needs " + std::to_string(dim) + " formulas, one per component, e.g. [\"0\", \"-9.81\"]");
  std::vector<Expression> result;
  for (std::size_t i = 0; i < texts.size(); ++i)
    result.emplace_back(texts[i], t.path() + "." + std::string(key.name) + "[" + std::to_string(i) + "]");
  return result;
}

/// x, y pairs as points of the plane, or triples as points of space.
std::vector<std::array<double, 3>> corners(const CaseTable& t, const Key& key, std::size_t dim = 2)
{
  const auto flat = t.numbers(key, 0, {}, any_number());
  if (flat.size() % dim != 0)
    t.fail(key.name, dim == 2 ? "must be x, y pairs" : "must be x, y, z triples");
  std::vector<std::array<double, 3>> points;
  for (std::size_t k = 0; k < flat.size(); k += dim)
  {
    points.push_back({});
    std::copy_n(flat.begin() + static_cast<std::ptrdiff_t>(k), dim, points.back().begin());
  }
  return points;
}

void read_terms(const CaseTable& t, bool impact, FluidConfig& config)
{
  config.terms.mu =
      t.number({"viscosity", "Pa s", "dynamic viscosity; 0 skips the viscous terms"}, 0.0, non_negative());
  config.terms.bulk_linear =
      t.number({"bulk_viscosity_linear", "", "b1 of the element bulk viscosity, damps grid-scale sound"},
               impact ? 0.06 : 0.05, non_negative());
  config.terms.bulk_quadratic =
      t.number({"bulk_viscosity_quadratic", "", "b2 of the element bulk viscosity, acts in compression only"},
               impact ? 1.2 : 0.0, non_negative());
  config.terms.residual = t.number(
      {"residual_stabilisation", "", "alpha of the residual-based mass exchange that removes pressure noise"},
      0.1, between(0.0, 1.0));
  config.terms.residual_with_acceleration = t.boolean(
      {"residual_with_acceleration", "", "include the acceleration in the residual; not near moving walls"},
      !impact);
  config.feedback_time = t.number(
      {"mass_feedback_time", "", "relaxation time of the mass-defect feedback in units of h/c; 0: off"},
      impact ? 0.0 : 100.0, non_negative());
  config.least_pressure =
      t.number({"cavitation_pressure", "Pa", "pressure is not allowed below this"}, -1e300, any_number());
  config.surface_tension_allowed = t.boolean(
      {"surface_tension", "", "nodes of the free surface may be in tension; false: p >= 0 there"}, !impact);
}

/// Corners of a box wall: a closed polyline in the plane.
void set_box(WallGeometry& g, const std::vector<double>& box, std::size_t dim)
{
  if (dim == 3)
  {
    g.box = true;
    g.points = {{box[0], box[1], box[2]}, {box[3], box[4], box[5]}};
    return;
  }
  g.closed = true;
  g.points = {{box[0], box[1], 0.0}, {box[2], box[1], 0.0}, {box[2], box[3], 0.0}, {box[0], box[3], 0.0}};
  if (!g.fluid_inside)
    std::reverse(g.points.begin(), g.points.end());
}

/// [[fluid.inlet]] and [[fluid.outlet]].
void read_openings(const CaseTable& t, std::size_t dim, FluidConfig& config)
{
  for (const CaseTable& i : t.tables("inlet", "An opening through which fluid enters at a given speed."))
  {
    InletConfig inlet;
    inlet.name = i.text({"name", "", "in messages"}, "inlet");
    const auto ends =
        corners(i,
                {"points", "m",
                 "2-D: ends of the opening a, b, the fluid enters to the left of a to b; 3-D: a corner "
                 "a of a rectangle and its neighbours b, c, the fluid enters along (b - a) x (c - a)"},
                dim);
    if (ends.size() != dim || ends[0] == ends[1])
      i.fail("points", dim == 2 ? "must be two different points x0, y0, x1, y1"
                                : "must be three corners of a rectangle, nine numbers");
    inlet.a = ends[0];
    inlet.b = ends[1];
    if (dim == 3)
    {
      inlet.c = ends[2];
      const Vec<3> ab = leading<3>(inlet.b) - leading<3>(inlet.a),
                   ac = leading<3>(inlet.c) - leading<3>(inlet.a);
      if (std::abs(dot(ab, ac)) > 1e-6 * norm(ab) * norm(ac) || !(norm(ac) > 0.0))
        i.fail("points", "b - a and c - a must be at a right angle");
    }
    inlet.speed = formulas(i, {"speed", "m/s", "one function of t"}, 1);
    if (inlet.speed.empty())
      i.fail("speed", "is missing, e.g. [\"1.0\"]");
    config.inlets.push_back(std::move(inlet));
  }
  for (const CaseTable& o :
       t.tables("outlet", "A box; nodes that are found in it at a remesh leave the run."))
  {
    OutletConfig outlet;
    const auto box = o.numbers({"box", "m", "lowest corner, then highest corner"}, 2 * dim, any_number());
    std::copy_n(box.begin(), dim, outlet.lower.begin());
    std::copy_n(box.begin() + static_cast<std::ptrdiff_t>(dim), dim, outlet.upper.begin());
    config.outlets.push_back(outlet);
  }
}

/// [[fluid.wall]]: either `on` a surface of the box for ever, or a polyline, a plane or a mesh that the fluid
/// may meet and leave.
void read_walls(const CaseFile& file, const CaseTable& t, int dim, FluidConfig& config)
{
  const auto n = static_cast<std::size_t>(dim);
  for (const CaseTable& w :
       t.tables("wall", "A rigid wall: a surface of the box for ever (on), or a polyline or plane that the "
                        "fluid may meet and leave; surfaces not named are free."))
  {
    const auto on = w.optional_text(
        {"on", "", "surface of the box that is this wall for ever: left right bottom top (back front)"});
    const std::string kind = w.choice(
        {"kind", "",
         "slip, symmetry (the same), no_slip; with on also impedance: not a wall, waves leave there"},
        "slip", {"slip", "symmetry", "no_slip", "impedance"});
    WallGeometry g;
    g.name = w.text({"name", "", "of the wall in histories and messages"}, on ? *on : "wall");
    const auto points = corners(
        w, {"points", "m", "2-D: corners x0, y0, x1, y1, ... of a polyline with the fluid on its left"});
    g.closed = w.boolean({"closed", "", "join the last point to the first"}, false);
    const auto box = w.numbers({"box", "m", "a closed box: lowest corner, then highest corner"},
                               w.has("box") ? 2 * n : 0, {}, any_number());
    const auto mesh = w.optional_text({"mesh", "",
                                       "Gmsh file of the room of the fluid, or of an obstacle, relative to "
                                       "the case; its boundary groups are walls of their names"});
    const auto group = w.text({"group", "", "the only boundary group of the mesh that is wanted"}, "");
    g.fluid_inside =
        w.choice({"fluid", "", "where the fluid is: inside or outside of the box or of what is meshed"},
                 "inside", {"inside", "outside"}) == "inside";
    const auto point =
        w.numbers({"point", "m", "a point of an unbounded plane"}, w.has("point") ? n : 0, {}, any_number());
    const auto normal = w.numbers({"normal", "", "normal of the plane, into the fluid"},
                                  w.has("normal") ? n : 0, {}, any_number());
    g.motion.displacement = formulas(w, {"displacement", "m", "motion of the wall as functions of t"}, n);
    if (const auto angle = w.optional_text(
            {"angle", "rad", "rotation of the wall about the z axis through centre, a function of t"}))
      g.motion.angle = Expression(*angle, w.path() + ".angle");
    const auto centre =
        w.numbers({"centre", "m", "of the rotation"}, n, std::vector<double>(n, 0.0), any_number());
    std::copy(centre.begin(), centre.end(), g.motion.centre.begin());
    if (on)
    {
      if (!points.empty() || !point.empty() || !box.empty())
        w.fail("on", "a wall is either on a surface of the box, or has points, or a point and a normal");
      config.walls.push_back({*on, kind == "no_slip"     ? WallKind::no_slip
                                   : kind == "impedance" ? WallKind::impedance
                                                         : WallKind::slip});
      continue;
    }
    if (kind == "impedance")
      w.fail("kind", "only a face of the fluid can be an impedance boundary; give `on`");
    g.no_slip = kind == "no_slip";
    if (mesh)
    {
      for (WallGeometry& part : walls_of_mesh(file.resolve(*mesh), dim, group, g.fluid_inside))
      {
        part.no_slip = g.no_slip;
        part.motion = g.motion;
        config.contact_walls.push_back(std::move(part));
      }
      continue;
    }
    if (!box.empty())
      set_box(g, box, n);
    else if (!point.empty() && !normal.empty())
    {
      g.plane = true;
      g.points.emplace_back();
      std::copy(point.begin(), point.end(), g.points.back().begin());
      std::copy(normal.begin(), normal.end(), g.normal.begin());
    }
    else if (!points.empty())
    {
      if (dim != 2 || points.size() < 2)
        w.fail("points", "must be at least two corners, in a 2-D case; in 3-D give point and normal");
      g.points = points;
    }
    else
      w.fail("", "a wall needs `on`, `points`, `box`, `mesh`, or `point` and `normal`");
    config.contact_walls.push_back(std::move(g));
  }
}

/// Form, place and velocity of a body of fluid.
void read_body(const CaseTable& t, int dim, Body& body)
{
  const auto n = static_cast<std::size_t>(dim);
  const std::string shape =
      t.choice({"shape", "",
                "a body of fluid: a box, the ellipse inscribed in it, a polygon (2-D), or none: it comes in "
                "through inlets"},
               "box", {"box", "ellipse", "polygon", "none"});
  body.initial_velocity = formulas(t, {"initial_velocity", "m/s", "functions of x, y, z"}, n);
  const auto points = corners(
      t, {"points", "m",
          "polygon: its corners x0, y0, x1, y1, ...; its edges are the surfaces edge_0, edge_1, ..."});
  if (shape == "none")
  {
    body.shape = Shape::none;
    return;
  }
  if (shape == "polygon")
  {
    if (dim != 2 || points.size() < 3)
      t.fail("points", "a polygon needs at least three corners, in a 2-D case");
    body.shape = Shape::polygon;
    body.points = points;
    return;
  }
  body.shape = shape == "box" ? Shape::box : Shape::ellipse;
  const auto origin = t.numbers({"origin", "m", "lowest corner of the box of fluid"}, n,
                                std::vector<double>(n, 0.0), any_number());
  std::copy(origin.begin(), origin.end(), body.origin.begin());
  body.size[0] = t.number({"width", "m", "extent of the box along x"}, positive());
  body.size[1] = t.number({"height", "m", "extent of the box along y, the vertical"}, positive());
  if (dim == 3)
    body.size[2] = t.number({"depth", "m", "extent of the box along z"}, positive());
}

/// Directions in which the box of fluid is the cell of a periodic space.
void read_period(const CaseTable& t, int dim, FluidConfig& config)
{
  const auto axes =
      t.texts({"periodic", "",
               "axes, of x, y, z, along which space repeats itself after the extent of the box of fluid"},
              {});
  for (const std::string& axis : axes)
  {
    const auto i = std::string_view("xyz").substr(0, static_cast<std::size_t>(dim)).find(axis);
    if (axis.size() != 1 || i == std::string_view::npos)
      t.fail("periodic", "'" + axis + "' is no axis; give one or more of " + (dim == 3 ? "x, y, z" : "x, y"));
    config.period[i] = config.size[i];
    if (config.shape != Shape::box || !config.spacing.empty())
      t.fail("periodic", "needs a box of fluid of uniform spacing, whose extent is the period");
    if (config.size[i] < Period<2>::least_cells * config.element_size)
      t.fail("periodic", fmt::format("the box must be at least {:g} spacings of {:.3g} m long along {}",
                                     Period<2>::least_cells, config.element_size, axis));
    if (config.gravity[i] != 0.0)
      t.fail("gravity", "must be 0 along a periodic direction, where there is no height; use body_force");
  }
  if (!axes.empty() && !config.interfaces.empty())
    t.fail("periodic", "does not go together with an [[interface]]");
}

/// [[fluid.spacing]]: the size field.
void read_spacing(const CaseTable& t, std::size_t dim, FluidConfig& config)
{
  for (const CaseTable& z :
       t.tables("spacing",
                "A zone of wanted spacing (graded resolution): in it nodes are factor times element_size "
                "apart, outside their spacing grows; without zones it is uniform."))
  {
    SizeZone zone;
    zone.factor = z.number({"factor", "", "spacing in the zone over element_size"}, 1.0, positive());
    zone.growth =
        z.number({"growth", "", "growth of the spacing per distance from the zone"}, 0.15, between(0.0, 0.4));
    zone.near = z.text(
        {"near", "", "the zone is this wall (where it is at each remesh) or this face of the fluid"}, "");
    const auto box = z.numbers({"box", "m", "the zone is this box: lowest corner, then highest corner"},
                               z.has("box") ? 2 * dim : 0, {}, any_number());
    if (zone.near.empty() == box.empty())
      z.fail("", "a zone is either a box or near a wall or face");
    for (std::size_t i = 0; i < dim && !box.empty(); ++i)
    {
      zone.lower[i] = std::min(box[i], box[dim + i]);
      zone.upper[i] = std::max(box[i], box[dim + i]);
    }
    config.spacing.push_back(std::move(zone));
  }
  config.coarsest =
      t.number({"coarsest", "", "largest spacing of a size field over element_size"}, 16.0, positive());
}

void read_remeshing(const CaseTable& t, bool impact, RemeshConfig& remesh)
{
  remesh.alpha = t.number(
      {"alpha", "",
       "of the first mesh: a simplex is fluid if its circumradius is at most alpha times the spacing"},
      1.3, between(0.6, 3.0));
  remesh.shape.keep =
      t.number({"alpha_keep", "", "what was fluid stays fluid up to this circumradius over the spacing"}, 1.5,
               between(0.6, 4.0));
  remesh.shape.create = t.number(
      {"alpha_create", "", "what was not fluid becomes fluid below this circumradius over the spacing"}, 0.8,
      between(0.0, 4.0));
  remesh.shape.gap = t.number(
      {"contact_gap", "", "> 0: instead, a closing gap becomes fluid below this height over the spacing"},
      0.2, between(0.0, 1.0));
  remesh.shape.sliver_quality =
      t.number({"sliver_quality", "", "flat elements of boundary nodes are dropped below this shape"}, 0.15,
               between(0.0, 0.6));
  remesh.spacing.merge = t.number({"merge", "", "edges shorter than this over the spacing lose a node"},
                                  impact ? 0.30 : 0.45, between(0.0, 0.9));
  remesh.spacing.split = t.number({"split", "", "inner edges longer than this over the spacing get a node"},
                                  1.7, between(1.2, 10.0));
  remesh.spacing.split_wall =
      t.number({"split_wall", "", "the same for edges on walls"}, 1.6, between(1.2, 10.0));
  remesh.quality = t.number(
      {"remesh_quality", "",
       "remesh when the shape of an element falls below this (1 is regular) and below 0.6 of what it was"},
      impact ? 0.3 : 0.5, between(0.0, 0.95));
  remesh.every = t.integer(
      {"remesh_every", "", "remesh after so many steps if nodes have moved against each other; 0: no cap"},
      impact ? 10 : 20, at_least(0));
  remesh.strain =
      t.number({"remesh_strain", "",
                "nodes have moved against each other if an edge has changed its length by so much, over "
                "the spacing, or if a gap closes"},
               0.1, between(0.0, 1.0));
  remesh.only_if_moved = t.boolean(
      {"remesh_only_if_moved", "", "false: remesh_every holds even if nodes have only moved together"}, true);
  remesh.delete_isolated_after = static_cast<int>(t.integer(
      {"delete_isolated_after", "", "remeshes after which an isolated node is deleted and booked; 0: never"},
      impact ? 2 : 0, between(0, 200)));
}

} // namespace

FluidConfig read_fluid(const CaseFile& file, const RunConfig& run, const CouplingConfig& coupling)
{
  const CaseTable t = file.table("fluid", "The fluid: material, domain, walls, remeshing.");
  const auto dim = static_cast<std::size_t>(run.dim);
  const bool impact = run.preset == "impact";
  FluidConfig config;
  config.dim = run.dim;
  config.tait = read_tait(t);
  read_terms(t, impact, config);

  const auto gravity = t.numbers({"gravity", "m/s^2", "body force per mass"}, dim,
                                 std::vector<double>(dim, 0.0), any_number());
  std::copy(gravity.begin(), gravity.end(), config.gravity.begin());
  config.gravity_ramp =
      t.number({"gravity_ramp", "s", "gravity grows smoothly over this time"}, 0.0, non_negative());
  config.body_force = formulas(
      t, {"body_force", "m/s^2", "force per mass as functions of x, y, z, t, added to gravity"}, dim);
  read_body(t, run.dim, config);
  for (const CaseTable& body : t.tables(
           "body", "A further body of fluid; the one of [fluid] itself comes first and has named surfaces."))
    read_body(body, run.dim, config.more_bodies.emplace_back());

  const double factor =
      t.number({"size_factor", "", "spacing of fluid nodes over the run's element size"}, 1.0, positive());
  config.element_size = t.number(
      {"element_size", "m", "spacing of fluid nodes; default: size_factor times the run's element size"},
      factor * run.element_size(), positive());
  if ((config.shape == Shape::box || config.shape == Shape::ellipse) &&
      config.element_size > *std::min_element(config.size.begin(), config.size.begin() + run.dim))
    t.fail(t.has("element_size") ? "element_size" : "size_factor",
           "the spacing of fluid nodes is larger than the smallest extent of the box; refine run.resolution "
           "or element_size");
  read_spacing(t, dim, config);
  double count = 1.0;
  for (int i = 0; i < run.dim; ++i)
    count *= config.size[static_cast<std::size_t>(i)] / config.element_size;
  if (config.spacing.empty() && count > 5e7)
    t.fail("width", fmt::format("the box would have {:.2g} nodes {:.3g} m apart, more than a machine can "
                                "hold; are its sizes in metres? Else lower run.resolution",
                                count, config.element_size));
  const std::string pattern = t.choice(
      {"seeding", "",
       "arrangement of the first nodes: columns, every second one half a spacing higher (mirrored: an even "
       "number of them, so that the left half of a plane box is the mirror image of the right one); or "
       "rows and columns"},
      "staggered", {"staggered", "mirrored", "lattice"});
  config.seeding.pattern = pattern == "staggered"  ? Pattern::staggered
                           : pattern == "mirrored" ? Pattern::mirrored
                                                   : Pattern::lattice;
  config.seeding.jitter =
      t.number({"jitter", "", "random displacement of inner nodes at the start, fraction of the spacing"},
               0.0, between(0.0, 0.4));
  config.seeding.seed =
      static_cast<std::uint64_t>(t.integer({"seed", "", "of the random displacement"}, 1, at_least(0)));
  config.initial_pressure =
      t.choice({"initial_pressure", "",
                "zero: rho = rho0; hydrostatic: at rest under gravity, each body from its highest point"},
               "zero", {"zero", "hydrostatic"}) == "zero"
          ? InitialPressure::zero
          : InitialPressure::hydrostatic;
  read_walls(file, t, run.dim, config);
  read_openings(t, dim, config);
  for (const auto& i : coupling.interfaces)
    config.interfaces.emplace_back(i.name, i.fluid);
  read_period(t, run.dim, config);
  read_remeshing(t, impact, config.remesh);
  config.inertia_floor =
      t.number({"inertia_floor", "", "least mass in Newton's law over that of a regular node"}, 0.1,
               between(0.0, 1.0));
  config.step_safety = t.number({"step_safety", "", "fraction of the rigorous bound on the time step"}, 0.9,
                                between(0.01, 2.0));
  config.collapse =
      t.number({"collapse", "",
                "fluid alone: the run ends with code 10 when its step has been below this fraction of its "
                "largest one for 100 steps; 0: never"},
               1e-3, between(0.0, 1.0));
  config.threads = static_cast<int>(
      t.integer({"threads", "",
                 "threads of each rank of the fluid, each on a core of its own; results do not depend on it"},
                1, between(1, 256)));
  config.order =
      t.choice(
          {"order", "",
           "in which nodes are numbered, of which ranks have ranges: rows across the longest axis of the "
           "fluid, or boxes, whose cuts are shorter where there are many ranks, in the plane some 64. Sums "
           "have another order then, and so another round-off"},
          run.dim == 3 ? "boxes" : "rows", {"rows", "boxes"}) == "rows"
          ? NodeOrder::rows
          : NodeOrder::boxes;
  config.look_every =
      t.integer({"look_every", "",
                 "steps between looks at the stable step, and of a fluid alone at the mesh; 0: 8 "
                 "and 4, and alone at once again where the step had to fall. Beside a solid "
                 "every window looks while its step is within a factor of 4 of the limit"},
                0, at_least(0));
  return config;
}

} // namespace undine::fluid
