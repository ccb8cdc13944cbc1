// [fluid]: what the fluid program is told.
#pragma once

#include "common/config/case_file.hpp"
#include "common/config/coupling_config.hpp"
#include "common/config/expression.hpp"
#include "common/config/run_config.hpp"
#include "fluid_pfem/momentum.hpp"
#include "fluid_pfem/openings.hpp"
#include "fluid_pfem/remesh/alpha_shape.hpp"
#include "fluid_pfem/remesh/refine_coarsen.hpp"
#include "fluid_pfem/size_field.hpp"
#include "fluid_pfem/tait.hpp"
#include "fluid_pfem/walls.hpp"

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace undine::fluid
{

enum class WallKind
{
  slip, ///< a symmetry plane is one
  no_slip,
  impedance ///< no wall: waves leave through it, p = p(rest) + rho c v_n
};

/// A surface of the box that stays a wall for ever: its nodes move in it (slip) or not at all (no slip); or
/// an end of what is computed, through which waves leave (impedance).
struct WallConfig
{
  std::string on; ///< surface name
  WallKind kind = WallKind::slip;
};

/// Form of a body of fluid.
enum class Shape
{
  box,
  none,    ///< no body: the fluid comes in through inlets
  ellipse, ///< inscribed in the box (an ellipsoid in 3-D)
  polygon  ///< 2-D
};

struct Body
{
  Shape shape = Shape::box;
  std::array<double, 3> origin{};            ///< lowest corner of the box [m]
  std::array<double, 3> size{};              ///< [m]
  std::vector<std::array<double, 3>> points; ///< corners of the polygon, counter-clockwise [m]
  std::vector<Expression> initial_velocity;  ///< [m/s], functions of x, y, z; empty or dim
};

enum class Pattern
{
  staggered, ///< columns of equal spacing, every other one shifted by half: each element near-equilateral
  mirrored,  ///< the same with an even number of columns: its left half is the mirror image of its right one
  lattice    ///< rows and columns
};

struct Seeding
{
  Pattern pattern = Pattern::staggered;
  double jitter = 0.0;    ///< random displacement of inner nodes, fraction of the spacing
  std::uint64_t seed = 1; ///< of the random displacement
};

enum class InitialPressure
{
  zero,       ///< ρ = ρ₀ everywhere
  hydrostatic ///< barotropic rest under gravity, p₀ at the highest point of each body
};

/// In which order nodes are numbered; ranks and threads have ranges of it.
enum class NodeOrder
{
  usual, ///< rows in the plane, boxes in space
  rows,  ///< two spacings wide, across the longest axis of the fluid: neighbours are near in memory
  boxes  ///< of a recursive bisection: ranges are compact, and so cuts between many ranks short
};

/// When to remesh and what becomes of isolated nodes.
struct RemeshConfig
{
  double alpha =
      1.3;          ///< of the first mesh: a simplex is fluid if its circumradius is at most alpha · spacing
  ShapeRules shape; ///< of all later ones
  SpacingRules spacing;
  double quality =
      0.5; ///< remesh when an element's shape falls below this (1: regular) and below 0.6 of what it was …
  std::int64_t every =
      20; ///< … or after at least so many steps if nodes have moved against each other; 0: no cap
  double strain = 0.1;           ///< that is: an edge has changed its length by so much, over the spacing
  bool only_if_moved = true;     ///< false: the cap holds even if nodes have only moved together
  int delete_isolated_after = 0; ///< remeshes; 0: isolated nodes fly for ever
};

/// The first body, which has the named surfaces, and everything else.
struct FluidConfig : Body
{
  int dim = 2;
  Tait tait;
  ElementTermsConfig terms;
  double feedback_time = 0.0;          ///< T_r of the mass-defect feedback in units of h/c; 0: off
  double least_pressure = -1e300;      ///< cavitation cut-off [Pa]
  bool surface_tension_allowed = true; ///< false: p ≥ 0 at nodes of the free surface
  std::array<double, 3> gravity{};     ///< [m/s²]
  double gravity_ramp = 0.0;           ///< gravity grows smoothly to its value over this time [s]
  std::vector<Expression> body_force;  ///< [m/s²], functions of x, y, z, t, added to gravity; empty or dim
  std::vector<Body> more_bodies;
  std::array<double, 3>
      period{};              ///< length along each axis after which space repeats itself; 0: it does not [m]
  double element_size = 0.0; ///< wanted spacing of nodes where nothing else is asked for [m]
  std::vector<SizeZone> spacing; ///< zones of a size field; without them the spacing is uniform
  double coarsest = 16.0;        ///< largest spacing of the size field over element_size
  Seeding seeding;
  InitialPressure initial_pressure = InitialPressure::zero;
  std::vector<WallConfig> walls;
  std::vector<WallGeometry> contact_walls; ///< walls that the fluid may meet and leave
  std::vector<InletConfig> inlets;
  std::vector<OutletConfig> outlets;
  std::vector<std::pair<std::string, std::string>> interfaces; ///< (interface, surface)
  RemeshConfig remesh;
  double inertia_floor = 0.0; ///< least mass in Newton's law, fraction of a regular node's
  double step_safety = 0.9;   ///< of the rigorous step bound
  NodeOrder order = NodeOrder::usual;
  int threads = 1; ///< that compute the fluid; results do not depend on it
  double collapse =
      1e-3; ///< alone: a stable step below this fraction of the largest one ends the run; 0: never
  std::int64_t look_every = 0; ///< steps between looks at the stable step, alone at the mesh too; 0: 8 and 4
};

/// @throws InputError
FluidConfig read_fluid(const CaseFile&, const RunConfig&, const CouplingConfig&);

} // namespace undine::fluid
