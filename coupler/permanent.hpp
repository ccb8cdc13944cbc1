// Surfaces that stay together: what Gravouil-Combescure and staggering share.
#pragma once

#include "coupler/run.hpp"

namespace undine::coupler
{

/// Both wet surfaces, the operator between them, and its renewal when they move or are replaced.
class PermanentScheme : public Scheme
{
public:
  /// Both sides have their orders and compute their free motion, while the operator becomes that of the
  /// surfaces they begin with.
  void advance(const WindowPlanner::Plan& plan, const std::array<link::Window, 2>& orders) final;
  std::array<link::Report, 2> end_window() override;
  const InterfaceBalance& balance() const override { return gc_.balance(); }
  std::span<const InterfaceReport> interfaces() const override { return interface_.report(); }
  const link::SurfaceMesh& solid_surface() const override { return interface_.surface(Side::solid); }
  std::span<const double> solid_force() const override { return gc_.window_force(Side::solid); }
  std::int64_t searches() const override { return interface_.builds(); }
  std::int64_t solves() const override { return gc_.factorisations(); }
  std::int64_t iterations() const override { return gc_.iterations(); }
  void for_each_state(StateArchive& archive) override;

protected:
  virtual void exchange(const WindowPlanner::Plan& plan, const std::array<link::Window, 2>& orders) = 0;
  /// SETUP to all, wet surfaces from all, the operator between them. What remains is accept_meshes or
  /// reject_meshes. @throws InputError if the surfaces do not meet (all are told)
  PermanentScheme(const CouplerConfig& config, const Sides& side, const std::array<std::string, 2>& scheme);

  Sides side_;
  Interface interface_;
  GravouilCombescure gc_;
  bool start_compatibly_ = true; ///< the next window begins with a plastic projection
};

} // namespace undine::coupler
