// The participants of one side, seen as one: their wet surfaces joined, their vectors one after the other.
#pragma once

#include "common/coupling/link.hpp"
#include "coupler/partner.hpp"

#include <span>
#include <vector>

namespace undine::coupler
{

/// Wet surfaces one after the other: nodes, faces and coupled nodes numbered through, interfaces by name,
/// node ids shifted so that each stays unique, epochs added (any change raises the sum). A single one comes
/// back as it is.
link::SurfaceMesh join(std::span<const link::SurfaceMesh> surfaces);

/// What several bodies report as one: energies, works and masses added, the smallest stable step, times of
/// the busiest.
link::Report join(std::span<const link::Report> reports);

/// The fluid, or all solids of a run. With one member every call is that of its link. Errors as PartnerLink.
class Group : public Partner
{
public:
  /// The links must outlive the group, at least one.
  explicit Group(std::vector<link::PartnerLink*> members);

  std::span<link::PartnerLink* const> members() const { return members_; }

  link::SurfaceMesh receive_mesh();
  link::Report receive_report();
  /// After a report with surface_changed. `x` [m], n × dim: where the joined surface is now; members that
  /// have not announced a change keep their faces and masses there. Not needed if all have.
  link::SurfaceMesh receive_mesh_update(std::span<const double> x = {});
  void send_window(const link::Window&);
  link::Kinematics receive_kinematics();
  void send_activation(const link::Activation&);
  void receive_free_velocity(std::span<double> v_free) override;
  void send_link_force(std::span<const double> f_link) override;
  link::Motion receive_motion();
  bool stop_requested() const;
  double wait_seconds() const; ///< that the coupler spent waiting for it

private:
  std::size_t size(std::size_t member) const; ///< numbers in its vectors

  std::vector<link::PartnerLink*> members_;
  std::vector<link::SurfaceMesh> surface_;
  std::vector<char> changed_;
};

} // namespace undine::coupler
