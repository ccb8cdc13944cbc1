// What is behind the handle of the C interface: a solver's end of the link, on one rank or on several that
// speak as one. SPDX-License-Identifier: BSD-3-Clause
//
// After undine_distribute each rank gives nodes and faces of its own, and exchanges the rows of its nodes.
// Their numbers decide the order of a surface, whoever gave them: rank 0 joins the parts and sends them, and
// tells the others what it receives.
#pragma once

#include "common/coupling/bootstrap.hpp"
#include "common/coupling/link.hpp"
#include "common/coupling/team.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

struct undine_link
{
  std::string role;
  std::unique_ptr<undine::link::World> world;
  std::optional<undine::link::SolverLink> conversation; ///< on rank 0 of the role; distributed: on all
  double stall_seconds = 0.0;
  std::optional<undine::link::Team> team; ///< distributed
  undine::link::Setup setup;
  bool has_setup = false;
  undine::link::SurfaceMesh surface; ///< distributed: nodes of this rank
  /// Distributed: faces of this rank by node_id, and the place in this rank's arrays of each row of its
  /// vectors.
  std::vector<std::int64_t> face_ids;
  std::vector<std::size_t> place;
  std::vector<double> rows, more_rows;
  undine::link::SurfaceMesh partner_surface;
  bool surface_was_sent = false;
  bool offers_checkpoints = false;
  undine::link::CheckpointOrder checkpoint;
  std::string last_error;
};

namespace undine::link
{

/// @throws ProtocolError(1) with `text` if the caller has made a mistake
void require(bool holds, const std::string& text);

/// The rank that hears the coupler.
bool is_first(const undine_link& link);

// Of rank 0, on all ranks; so is its failure.
Setup receive_setup(undine_link& link);
SurfaceMesh receive_surface(undine_link& link);
/// The next order that concerns the solver: nothing after BYE.
SolverLink::Order next_order(undine_link& link);

/// Starts a new surface: nodes without masses, no faces.
void begin_surface(undine_link& link, std::int64_t n, const std::int64_t* node_id, const double* x);
/// The same for faces whose nodes are known: offsets and interface.
void append_faces(undine_link& link, std::int32_t interface, std::int64_t n_faces,
                  std::int32_t nodes_per_face);
/// The whole surface, for the first time or as an update. Collective.
void send_surface(undine_link& link);

/// The caller's vector of the surface. @throws ProtocolError(1) if it is NULL
template <class T>
std::span<T> vector(const undine_link& link, T* values, const char* name)
{
  const auto size =
      static_cast<std::size_t>(link.surface.n_nodes()) * static_cast<std::size_t>(link.surface.dim);
  require(values != nullptr || size == 0, std::string(name) + " is NULL");
  return {values, size};
}
/// The rows of `values` in the order of the link's vectors; `room` is used if that is another.
std::span<const double> in_link_order(const undine_link& link, const double* values, const char* name,
                                      std::vector<double>& room);
/// The way back.
void in_given_order(const undine_link& link, std::span<const double> rows, std::span<double> values);

} // namespace undine::link
