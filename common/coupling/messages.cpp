// Names of the message types.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/messages.hpp"

namespace undine::link
{

const char* name_of(MessageType type)
{
  switch (type)
  {
  case MessageType::setup:
    return "SETUP";
  case MessageType::mesh:
    return "MESH";
  case MessageType::mesh_reply:
    return "MESH_REPLY";
  case MessageType::ready:
    return "READY";
  case MessageType::window:
    return "WINDOW";
  case MessageType::free_velocity:
    return "FREE_VELOCITY";
  case MessageType::link_force:
    return "LINK_FORCE";
  case MessageType::mesh_update:
    return "MESH_UPDATE";
  case MessageType::checkpoint:
    return "CHECKPOINT";
  case MessageType::checkpoint_done:
    return "CHECKPOINT_DONE";
  case MessageType::stop_request:
    return "STOP_REQUEST";
  case MessageType::bye:
    return "BYE";
  case MessageType::bye_ack:
    return "BYE_ACK";
  case MessageType::fail:
    return "FAIL";
  case MessageType::ping:
    return "PING";
  case MessageType::kinematics:
    return "KINEMATICS";
  case MessageType::activation_impulse:
    return "ACTIVATION_IMPULSE";
  case MessageType::surface:
    return "SURFACE";
  case MessageType::motion:
    return "MOTION";
  }
  return "UNKNOWN";
}

std::vector<std::int64_t> SurfaceMesh::rows_of(int rank) const
{
  std::vector<std::int64_t> rows;
  for (std::int64_t n = 0; n < n_nodes(); ++n)
    if ((owner.empty() ? 0 : owner[static_cast<std::size_t>(n)]) == rank)
      rows.push_back(n);
  return rows;
}

} // namespace undine::link
