// A program's end of the coupling on all its ranks: rank 0 talks to the coupler, the others hear what it
// hears.
#pragma once

#include "common/coupling/link.hpp"
#include "common/parallel/ranks.hpp"

#include <functional>
#include <optional>
#include <span>

namespace undine
{

/// link::SolverLink for a program on several ranks. What concerns all of them (setup, surface of the partner,
/// windows, checkpoints) reaches all: these functions are collective. Vectors of the wet surface (velocities,
/// forces, kinematics) are sent and received by every rank that has a link, for the rows that the mesh says
/// are its own; on a rank without a link these functions do nothing. Reports and meshes are sent by rank 0,
/// and the others with a link must call the same functions.
class SharedLink
{
public:
  /// The only rank.
  SharedLink(link::SolverLink& link) : link_(&link) {}
  /// `link`: of this rank; on others than 0 nullptr if they own no rows of any mesh.
  SharedLink(link::SolverLink* link, Ranks ranks) : link_(link), ranks_(std::move(ranks)) {}

  link::Setup receive_setup();
  link::SurfaceMesh receive_surface();
  std::optional<link::Window> next_window();
  void on_checkpoint(std::function<link::CheckpointDone(const link::CheckpointOrder&)> write);
  link::Activation receive_activation();
  void receive_link_force(std::span<double> f_link);
  void send_mesh(const link::SurfaceMesh&);
  void send_mesh_update(const link::SurfaceMesh&);
  void send_report(const link::Report&);
  void send_kinematics(const link::Kinematics&);
  void send_free_velocity(std::span<const double> v_free);
  void send_stop_request(const std::string& reason);
  double wait_seconds() const { return link_ ? link_->wait_seconds() : 0.0; }

private:
  bool is_first() const { return ranks_.rank() == 0; } ///< the rank that talks of all but vectors

  link::SolverLink* link_ = nullptr;
  Ranks ranks_;
  std::function<link::CheckpointDone(const link::CheckpointOrder&)> write_;
};

} // namespace undine
