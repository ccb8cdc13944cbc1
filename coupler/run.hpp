// The coupler's time loop.
#pragma once

#include "common/config/coupling_config.hpp"
#include "common/config/run_config.hpp"
#include "common/coupling/link.hpp"
#include "coupler/gravouil_combescure.hpp"
#include "coupler/interface.hpp"
#include "coupler/window_planner.hpp"

#include <functional>

namespace undine::coupler
{

struct CouplerConfig
{
  RunConfig run;
  CouplingConfig coupling;
  double frame_interval = 0.0; ///< [s]; 0: only the first and the last frame
};

/// State after a window, for output and tests.
struct WindowRecord
{
  const WindowPlanner::Plan& plan;
  const link::Report& fluid;
  const link::Report& solid;
  const GravouilCombescure& gc;
  const Interface& interface;
};

WindowRules rules_of(const CouplingConfig&);

/// Couple one fluid and one solid until t_end (or until a participant asks to stop). `after_window` is called
/// at t = 0 too.
/// @returns number of windows
/// @throws InputError if the surfaces do not meet (both participants are told), ProtocolError, NumericalError
std::int64_t run_coupler(const CouplerConfig& config, link::PartnerLink& fluid, link::PartnerLink& solid,
                         const std::function<void(const WindowRecord&)>& after_window);

} // namespace undine::coupler
