// What a participant of a coupled run does about checkpoints.
#pragma once

#include "common/coupling/link.hpp"
#include "common/error.hpp"
#include "common/io/checkpoint.hpp"

#include <filesystem>

namespace undine
{

/// The coupler and this program must continue from the same checkpoint, or both from the start.
/// @throws InputError (different_case)
inline void require_same_restart(const Persistence& persistence, const link::Setup& setup)
{
  const std::string here = persistence.restarts() ? persistence.from->folder : "";
  std::error_code none;
  if (here.empty() != setup.restart.empty() ||
      (!here.empty() && !std::filesystem::equivalent(here, setup.restart, none)))
    throw InputError("the coupler continues from '" + setup.restart + "', this program from '" + here +
                         "' (empty: from the start); give all programs the same --restart",
                     ExitCode::different_case);
}

/// Obey an order of the coupler.
inline link::CheckpointDone save_for(const link::CheckpointOrder& order, const Persistence& persistence,
                                     const StateVisitor& state)
{
  persistence.save(order.folder, state);
  return {.written = true, .reason = "", .files = {persistence.file_name()}};
}

} // namespace undine
