// [fluid]: what the fluid program is told.
#pragma once

#include "common/config/case_file.hpp"
#include "common/config/coupling_config.hpp"
#include "common/config/run_config.hpp"
#include "fluid_pfem/momentum.hpp"
#include "fluid_pfem/tait.hpp"

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace undine::fluid
{

enum class WallKind
{
  slip,
  no_slip
};

struct WallConfig
{
  std::string on; ///< surface name
  WallKind kind = WallKind::slip;
};

enum class Pattern
{
  staggered, ///< columns of equal spacing, every other one shifted by half: each element near-equilateral
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
  hydrostatic ///< barotropic rest under gravity, p₀ at the highest point
};

struct FluidConfig
{
  int dim = 2;
  Tait tait;
  Viscosity viscosity;
  std::array<double, 3> gravity{}; ///< [m/s²]
  std::array<double, 3> origin{};  ///< lowest corner of the box [m]
  std::array<double, 3> size{};    ///< [m]
  double element_size = 0.0;       ///< wanted spacing of nodes [m]
  Seeding seeding;
  InitialPressure initial_pressure = InitialPressure::zero;
  std::vector<WallConfig> walls;
  std::vector<std::pair<std::string, std::string>> interfaces; ///< (interface, surface)
  double alpha = 1.3;            ///< a simplex is fluid if its circumradius is at most alpha · spacing
  double step_safety = 0.9;      ///< of the rigorous step bound
  double remesh_quality = 0.5;   ///< remesh when an element's shape falls below this (1: regular) …
  std::int64_t remesh_every = 0; ///< … and at the latest after so many steps; 0: no cap
};

/// @throws InputError
FluidConfig read_fluid(const CaseFile&, const RunConfig&, const CouplingConfig&);

} // namespace undine::fluid
