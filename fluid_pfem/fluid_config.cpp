// Reader of [fluid].
#include "fluid_pfem/fluid_config.hpp"

#include <algorithm>

namespace undine::fluid
{

namespace
{

Tait read_tait(const CaseTable& t)
{
  Tait tait;
  tait.rho0 = t.number({"density", "kg/m^3", "reference density rho0 of Eq. (3)"}, positive());
  tait.gamma = t.number({"tait_exponent", "", "exponent of Eq. (3)"}, 7.0, at_least(1.0));
  const std::string reading = t.choice({"tait_reading", "",
                                        "K_over_gamma: p = p0 + K/gamma [(rho/rho0)^gamma - 1], K is the "
                                        "bulk modulus; K: as the paper prints it"},
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

} // namespace

FluidConfig read_fluid(const CaseFile& file, const RunConfig& run, const CouplingConfig& coupling)
{
  const CaseTable t = file.table("fluid", "The fluid: material, domain, walls, remeshing.");
  const auto dim = static_cast<std::size_t>(run.dim);
  FluidConfig config;
  config.dim = run.dim;
  config.tait = read_tait(t);
  config.viscosity.mu =
      t.number({"viscosity", "Pa s", "dynamic viscosity; 0 skips the viscous terms"}, 0.0, non_negative());
  config.viscosity.bulk_linear =
      t.number({"bulk_viscosity_linear", "", "b1 of the element bulk viscosity, damps grid-scale sound"}, 0.0,
               non_negative());
  config.viscosity.bulk_quadratic =
      t.number({"bulk_viscosity_quadratic", "", "b2 of the element bulk viscosity, acts in compression only"},
               0.0, non_negative());

  const auto gravity = t.numbers({"gravity", "m/s^2", "body force per mass"}, dim,
                                 std::vector<double>(dim, 0.0), any_number());
  const auto origin = t.numbers({"origin", "m", "lowest corner of the box of fluid"}, dim,
                                std::vector<double>(dim, 0.0), any_number());
  std::copy(gravity.begin(), gravity.end(), config.gravity.begin());
  std::copy(origin.begin(), origin.end(), config.origin.begin());
  config.size[0] = t.number({"width", "m", "extent of the box along x"}, positive());
  config.size[1] = t.number({"height", "m", "extent of the box along y, the vertical"}, positive());
  if (run.dim == 3)
    config.size[2] = t.number({"depth", "m", "extent of the box along z"}, positive());

  const double factor =
      t.number({"size_factor", "", "spacing of fluid nodes over the run's element size"}, 1.0, positive());
  config.element_size = t.number(
      {"element_size", "m", "spacing of fluid nodes; default: size_factor times the run's element size"},
      factor * run.element_size(), positive());
  const double smallest = *std::min_element(config.size.begin(), config.size.begin() + run.dim);
  if (config.element_size > smallest)
    t.fail(t.has("element_size") ? "element_size" : "size_factor",
           "the spacing of fluid nodes is larger than the smallest extent of the box; refine run.resolution "
           "or element_size");
  config.seeding.pattern = t.choice({"seeding", "", "arrangement of the first nodes"}, "staggered",
                                    {"staggered", "lattice"}) == "staggered"
                               ? Pattern::staggered
                               : Pattern::lattice;
  config.seeding.jitter =
      t.number({"jitter", "", "random displacement of inner nodes at the start, fraction of the spacing"},
               0.0, between(0.0, 0.4));
  config.seeding.seed =
      static_cast<std::uint64_t>(t.integer({"seed", "", "of the random displacement"}, 1, at_least(0)));
  config.initial_pressure =
      t.choice({"initial_pressure", "", "zero: rho = rho0; hydrostatic: at rest under gravity"}, "zero",
               {"zero", "hydrostatic"}) == "zero"
          ? InitialPressure::zero
          : InitialPressure::hydrostatic;

  for (const CaseTable& w :
       t.tables("wall", "A surface of the fluid that is a rigid wall; surfaces not named are free."))
  {
    WallConfig wall;
    wall.on = w.text({"on", "", "surface of the box: left right bottom top (back front)"});
    wall.kind = w.choice({"kind", "", "slip or no_slip"}, "slip", {"slip", "no_slip"}) == "slip"
                    ? WallKind::slip
                    : WallKind::no_slip;
    config.walls.push_back(wall);
  }
  for (const auto& i : coupling.interfaces)
    config.interfaces.emplace_back(i.name, i.fluid);

  config.alpha =
      t.number({"alpha", "", "a simplex is fluid if its circumradius is at most alpha times the spacing"},
               1.3, between(0.6, 3.0));
  config.step_safety = t.number({"step_safety", "", "fraction of the rigorous bound on the time step"}, 0.9,
                                between(0.01, 2.0));
  config.remesh_quality =
      t.number({"remesh_quality", "", "remesh when the shape of an element falls below this; 1 is regular"},
               0.5, between(0.0, 0.95));
  config.remesh_every =
      t.integer({"remesh_every", "", "remesh at the latest after so many steps; 0: no cap"}, 0, at_least(0));
  return config;
}

} // namespace undine::fluid
