// What differs between the ways of coupling. The time loop around it is run() of coupler/run.hpp.
#pragma once

#include "coupler/gravouil_combescure.hpp"
#include "coupler/group.hpp"
#include "coupler/interface.hpp"
#include "coupler/window_planner.hpp"

#include <array>
#include <cstdint>
#include <memory>
#include <span>

namespace undine::coupler
{

struct CouplerConfig;

/// The fluid and the solids.
using Sides = std::array<Group*, 2>;

/// One way of coupling, made when both sides have been met. In each window the loop asks in this order:
/// order → advance → end_window, and may look at the rest between two windows.
class Scheme
{
public:
  virtual ~Scheme() = default;

  /// Orders to a side, beyond times and output.
  struct Order
  {
    std::int64_t steps = 1; ///< of that side
    bool fine = true;       ///< it exchanges in every step
    bool activate = false;  ///< KINEMATICS and ACTIVATION_IMPULSE come first
    bool trial = false;     ///< it goes back to the window's begin afterwards
    bool flight = false;    ///< it does not exchange in its steps
  };
  /// Coarse steps that may go by without an exchange.
  virtual std::int64_t flight() const { return 1; }
  virtual Order order(Side side, const WindowPlanner::Plan& plan) const = 0;
  /// The exchanges of one window.
  /// @param orders as sent to both sides
  virtual void advance(const WindowPlanner::Plan& plan, const std::array<link::Window, 2>& orders) = 0;
  /// Both sides report; surfaces that have moved or changed are taken over.
  virtual std::array<link::Report, 2> end_window() = 0;

  virtual WindowRules rules() const = 0;
  virtual const InterfaceBalance& balance() const = 0;
  virtual std::span<const InterfaceReport> interfaces() const = 0;
  virtual const link::SurfaceMesh& solid_surface() const = 0; ///< where it is now
  virtual std::span<const double>
  solid_force() const = 0;                   ///< mean link force of the last window [N], n × dim
  virtual std::int64_t searches() const = 0; ///< operators built, or searches for contact, since the start
  virtual std::int64_t solves() const = 0;   ///< factorisations, or contact problems solved, since the start
  virtual std::int64_t iterations() const { return 0; } ///< of conjugate gradients in this process
  virtual void for_each_state(StateArchive& archive) = 0;
};

/// SETUP to all, wet surfaces from all, MESH_REPLY; what remains are the first reports.
/// Surfaces that stay together: Gravouil-Combescure with a step of each side's own, or another
/// `coupling.form`.
/// @throws InputError if the surfaces do not meet (all participants are told), ProtocolError
std::unique_ptr<Scheme> meet_permanent(const CouplerConfig& config, const Sides& side);

/// Contact that opens and closes (UnilateralContact), one step of both sides per window.
std::unique_ptr<Scheme> meet_contact(const CouplerConfig& config, const Sides& side);

/// Solids at level A, in windows of one fluid step: the solid moves under the force of the window's begin,
/// then the fluid's surface is moved along to the solid's new velocity, which gives the next force. First
/// order in time.
/// @throws InputError if the fluid's mass at the interface is not smaller than the solid's (all are told)
std::unique_ptr<Scheme> meet_staggered(const CouplerConfig& config, const Sides& side);

} // namespace undine::coupler
