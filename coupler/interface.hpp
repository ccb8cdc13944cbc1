// From two wet surfaces and the case's interfaces to the operator H.
#pragma once

#include "common/config/coupling_config.hpp"
#include "common/coupling/messages.hpp"
#include "common/coupling/team.hpp"
#include "common/io/state_archive.hpp"
#include "coupler/interface_operator.hpp"

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace undine::coupler
{

/// How well the two sides of one interface meet.
struct InterfaceReport
{
  std::string name;
  Side multiplier_side = Side::fluid;
  int multipliers = 0;
  std::array<double, 2> measure{};   ///< length or area of (fluid, solid) side [m^(dim−1)]
  std::array<double, 2> face_size{}; ///< mean length, or root of the mean area, of (fluid, solid) faces [m]
  std::array<double, 2> covered{};   ///< fraction of (fluid, solid) side that meets the other
  double largest_gap = 0.0;          ///< [m]
  std::pair<int, int> rows{0, 0};    ///< its rows of the operator
};

/// Multipliers from which on gradients are cheaper than a factor in space, with a new operator in every
/// window of 20 solutions; docs/benchmarks/scaling.md. In the plane a factor costs less than two solutions.
inline constexpr int gradients_from = 10000;

/// Hand over a wet surface.
void archive_surface(StateArchive& archive, const std::string& name, link::SurfaceMesh& surface);

/// The interfaces of a case on two wet surfaces that move.
class Interface
{
public:
  /// Integrate the mortar matrices of all interfaces and assemble the operator.
  /// team: other ranks of the coupler that help, or nullptr.
  /// @throws InputError if a side has no faces, or if less than `least_cover` of the smaller side meets the
  /// other
  Interface(const CouplingConfig& coupling, link::SurfaceMesh fluid, link::SurfaceMesh solid,
            double least_cover = 0.99, const link::Team* team = nullptr);

  /// The wet nodes of `side` were replaced (remesh).
  void replace_surface(Side side, link::SurfaceMesh surface);
  /// The wet nodes of `side` are now displaced by `travel` from where their message said [m].
  void move(Side side, const Vector& travel);
  /// From now on displacements count from the present positions.
  void fix_positions(Side side) { x_message_[side] = surface_[side].x; }
  /// The surfaces have deformed or slid against each other since the operator was built, beyond a common
  /// translation and a fraction 1e-6 of a face: D, C and the normals are no longer those of the present
  /// surfaces.
  bool has_deformed() const;
  /// Operator of the present surfaces.
  InterfaceOperator build();
  /// Operator of the surfaces as they were at the last build: what a restart needs.
  InterfaceOperator build_again();
  void for_each_state(StateArchive& archive);

  const link::SurfaceMesh& surface(Side side) const { return surface_[side]; }
  const std::vector<InterfaceReport>& report() const { return report_; }
  std::int64_t builds() const { return builds_; }

private:
  CouplingConfig coupling_;
  double least_cover_;
  const link::Team* team_;
  std::array<link::SurfaceMesh, 2> surface_;
  std::array<std::vector<double>, 2> x_message_, x_built_;
  double face_size_ = 0.0;
  std::vector<InterfaceReport> report_;
  std::int64_t builds_ = 0;
};

} // namespace undine::coupler
