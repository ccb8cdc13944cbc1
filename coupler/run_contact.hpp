// The coupler's loop where contact opens and closes.
#pragma once

#include "coupler/run.hpp"

namespace undine::coupler
{

/// Couple one fluid and one solid whose contact opens and closes (UnilateralContact), one step of both per
/// window. Parameters and errors as run_coupler.
std::int64_t run_contact(const CouplerConfig& config, link::PartnerLink& fluid, link::PartnerLink& solid,
                         const std::function<void(const WindowRecord&)>& after_window,
                         const Persistence& persistence = {},
                         const std::function<void(const std::string&)>& say = {});

} // namespace undine::coupler
