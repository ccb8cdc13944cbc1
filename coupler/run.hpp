// The coupler's time loop.
#pragma once

#include "common/config/coupling_config.hpp"
#include "common/config/run_config.hpp"
#include "common/coupling/link.hpp"
#include "common/io/checkpoint.hpp"
#include "coupler/gravouil_combescure.hpp"
#include "coupler/interface.hpp"
#include "coupler/window_planner.hpp"

#include <array>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace undine::coupler
{

struct CouplerConfig
{
  RunConfig run;
  CouplingConfig coupling;
  double frame_interval = 0.0; ///< [s]; 0: only the first and the last frame
  std::string restart;         ///< folder of the checkpoint to continue from, or empty
  double t_start = 0.0;        ///< time of that checkpoint [s]
};

/// State after a window, for output and tests.
struct WindowRecord
{
  const WindowPlanner::Plan& plan;
  const link::Report& fluid;
  const link::Report& solid;
  const InterfaceBalance& balance;
  std::span<const InterfaceReport> interfaces;
  const link::SurfaceMesh& solid_surface; ///< where it is now
  std::span<const double> solid_force;    ///< mean link force on its nodes in the window [N], n × dim
  std::int64_t searches;                  ///< operators built, or searches for contact, since the start
  std::int64_t solves;                    ///< factorisations, or contact problems solved, since the start
};

WindowRules rules_of(const CouplingConfig&);

/// A participant behind the protocol.
class LinkedPartner : public Partner
{
public:
  explicit LinkedPartner(link::PartnerLink& link) : link_(link) {}
  void receive_free_velocity(std::span<double> v_free) override { link_.receive_free_velocity(v_free); }
  void send_link_force(std::span<const double> f_link) override { link_.send_link_force(f_link); }

private:
  link::PartnerLink& link_;
};

// Pieces of the loops of run_coupler and run_staggered.
Vector as_vector(const std::vector<double>& v);
std::vector<double> as_std(const Vector& v);
/// SETUP without the scheme.
link::Setup setup_of(const CouplerConfig& config);
/// SETUP to both, wet surfaces from both, the operator between them. What remains is accept_mesh or
/// reject_mesh.
std::pair<Interface, InterfaceOperator> exchange_surfaces(const CouplerConfig& config,
                                                          const std::array<link::PartnerLink*, 2>& partner,
                                                          const std::array<std::string, 2>& scheme);
/// `frames`: written so far.
bool frame_is_due(const CouplerConfig& config, const WindowPlanner::Plan& plan, std::int64_t frames);
/// After a window: the surfaces move, or are replaced, and the operator with them.
/// @returns true if the next window must start compatibly
bool renew_operator(Interface& interface, GravouilCombescure& gc,
                    const std::array<link::PartnerLink*, 2>& partner,
                    const std::array<link::Report, 2>& report);

/// The coupler's part of checkpoints: orders them from both participants at window ends.
class CheckpointKeeper
{
public:
  /// `persistence.checkpoints` may be null: then there are none. `say(text)`: a line for people.
  CheckpointKeeper(const Persistence& persistence, std::array<link::PartnerLink*, 2> partner,
                   std::function<void(const std::string&)> say);
  /// Before the first window: is the case's wish possible? Writes the state at the start, if checkpoints are
  /// wanted.
  void at_start(double t, const StateVisitor& state);
  /// After a window. @returns true if the run shall stop, its state written if that is possible
  bool after_window(double t, std::int64_t windows, const StateVisitor& state);

private:
  void write(double t, std::int64_t windows, const StateVisitor& state);

  Persistence persistence_;
  std::array<link::PartnerLink*, 2> partner_;
  std::function<void(const std::string&)> say_;
  bool possible_ = true;
};

/// Couple one fluid and one solid until t_end (or until a participant asks to stop). `after_window` is called
/// at t = 0 too. `persistence`: continue from a checkpoint, write new ones, stop on request.
/// @returns number of windows
/// @throws InputError if the surfaces do not meet (both participants are told), ProtocolError, NumericalError
std::int64_t run_coupler(const CouplerConfig& config, link::PartnerLink& fluid, link::PartnerLink& solid,
                         const std::function<void(const WindowRecord&)>& after_window,
                         const Persistence& persistence = {},
                         const std::function<void(const std::string&)>& say = {});

} // namespace undine::coupler
