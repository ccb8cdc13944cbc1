// [[interface]] and [coupling]: what all three programs must know about the coupling.
#pragma once

#include "common/config/case_file.hpp"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace undine
{

struct InterfaceConfig
{
  static constexpr const char* whole_boundary =
      "boundary"; ///< value of `fluid` where the fluid may come and go
  std::string name;
  std::string fluid;                            ///< name of the fluid's surface
  std::string solid;                            ///< name of the solid's surface, for messages
  std::string kind;                             ///< "slip" | "no_slip"
  bool separation;                              ///< the fluid may leave the solid
  std::string multiplier;                       ///< "finer" | "fluid" | "solid"
  std::vector<std::string> solid_surfaces = {}; ///< `solid`, one by one
  std::string body = "solid";                   ///< name of the solid they belong to
};

struct CouplingConfig
{
  bool present = false; ///< the case couples: a [coupling] table or an [[interface]] is written
  std::vector<InterfaceConfig> interfaces;
  std::vector<std::string> solids = {"solid"}; ///< names, each the role of a program
  std::string scheme = "gc";
  std::string form = "gravouil_combescure"; ///< of the window: | "macro_continuity" | "half_step"
  bool lumped = false;                      ///< the interface operator by its row sums
  std::string solver = "auto";              ///< of the multipliers: | "factor" | "gradients"
  std::string fine = "auto";                ///< "auto" | "fluid" | "solid"
  std::optional<std::int64_t> substeps;     ///< nothing: "auto"
  std::int64_t substeps_max = 300;
  double dt_max = 0.0;          ///< [s], 0 = no limit
  double search_distance = 0.0; ///< [m], 0 = automatic
  double energy_limit = 0.05;   ///< unexplained interface energy over the work done
  double hello_timeout = 60.0;  ///< [s]
  double stall_timeout = 300.0; ///< [s], 0 = off

  /// The fluid may leave the solid somewhere: contact with one step for both sides.
  bool has_contact() const
  {
    return std::any_of(interfaces.begin(), interfaces.end(), [](const auto& i) { return i.separation; });
  }
};

/// Read [coupling] and [[interface]]. @throws InputError
CouplingConfig read_coupling(const CaseFile&);

} // namespace undine
