// The loop for a solid that takes forces and returns velocities (level A of docs/protocol.md).
#pragma once

#include "coupler/run.hpp"

#include <functional>

namespace undine::coupler
{

/// Couple a fluid and a solid at level A, in windows of one fluid step: the solid moves under the force of
/// the window's begin, then the fluid's surface is moved along to the solid's new velocity, which gives the
/// next force. First order in time.
/// @throws InputError if the fluid's mass at the interface is not smaller than the solid's (both participants
/// are told); otherwise as run_coupler
std::int64_t run_staggered(const CouplerConfig& config, link::PartnerLink& fluid, link::PartnerLink& solid,
                           const std::function<void(const WindowRecord&)>& after_window,
                           const Persistence& persistence = {},
                           const std::function<void(const std::string&)>& say = {});

} // namespace undine::coupler
