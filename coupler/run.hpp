// The coupler's time loop.
#pragma once

#include "common/config/coupling_config.hpp"
#include "common/config/run_config.hpp"
#include "common/coupling/team.hpp"
#include "common/io/checkpoint.hpp"
#include "coupler/scheme.hpp"

#include <functional>
#include <span>
#include <string>
#include <vector>

namespace undine::coupler
{

struct CouplerConfig
{
  RunConfig run;
  CouplingConfig coupling;
  double frame_interval = 0.0;      ///< [s]; 0: only the first and the last frame
  std::string restart;              ///< folder of the checkpoint to continue from, or empty
  double t_start = 0.0;             ///< time of that checkpoint [s]
  bool flight = true;               ///< all participants offer capability::flight
  const link::Team* team = nullptr; ///< other ranks of the coupler, which help where that pays
};

/// State after a window, for output and tests.
struct WindowRecord
{
  const WindowPlanner::Plan& plan;
  const link::Report& fluid;
  const link::Report& solid; ///< of all solids together
  const InterfaceBalance& balance;
  std::span<const InterfaceReport> interfaces;
  const link::SurfaceMesh& solid_surface; ///< where it is now, of all solids
  std::span<const double> solid_force;    ///< mean link force on its nodes in the window [N], n × dim
  std::int64_t searches;                  ///< operators built, or searches for contact, since the start
  std::int64_t solves;                    ///< factorisations, or contact problems solved, since the start
  std::int64_t iterations;                ///< of conjugate gradients in this process
  double wait_seconds;                    ///< that the coupler has waited for messages since the start
};

WindowRules rules_of(const CouplingConfig&);

// Pieces of the schemes.
Vector as_vector(const std::vector<double>& v);
std::vector<double> as_std(const Vector& v);
/// SETUP for a participant: the interfaces of its own.
link::Setup setup_of(const CouplerConfig& config, const std::string& role, const std::string& scheme);
void send_setup(const CouplerConfig& config, Group& group, const std::string& scheme);
void accept_meshes(const Sides& side);
void reject_meshes(const Sides& side, const std::string& reason);

/// Couple one fluid and the solids until t_end (or until a participant asks to stop), the way the case says.
/// `after_window` is called at t = 0 too. `persistence`: continue from a checkpoint, write new ones, stop on
/// request. `say(text)`: a line for people.
/// @returns number of windows
/// @throws InputError if the surfaces do not meet (all participants are told), ProtocolError, NumericalError
std::int64_t run(const CouplerConfig& config, Group& fluid, Group& solid,
                 const std::function<void(const WindowRecord&)>& after_window,
                 const Persistence& persistence = {},
                 const std::function<void(const std::string&)>& say = {});

} // namespace undine::coupler
