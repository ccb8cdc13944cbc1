// The fluid's time loops: coupled, and alone.
#pragma once

#include "common/config/run_config.hpp"
#include "common/io/checkpoint.hpp"
#include "common/program/shared_link.hpp"
#include "fluid_pfem/fluid.hpp"

#include <functional>
#include <string>
#include <type_traits>
#include <utility>

namespace undine::fluid
{

/// Who looks at the fluid, on all ranks: at the start and after every window (coupled) or step (alone),
/// always at a synchronised time.
template <int dim>
struct Observer
{
  template <class Look, class = std::enable_if_t<std::is_invocable_v<Look, double, Fluid<dim>&, bool>>>
  Observer(Look look, std::function<double()> next = {}) : look(std::move(look)), next(std::move(next))
  {
  }

  std::function<void(double t, Fluid<dim>& fluid, bool frame)> look; ///< `frame`: a field frame is due
  /// Time until which steps may pass unseen, as known after the last look [s]; empty: every step is seen.
  std::function<double()> next;

  void operator()(double t, Fluid<dim>& fluid, bool frame) const { look(t, fluid, frame); }
  bool must_see(double t) const { return !next || t >= next(); }
};

/// Run coupled until the coupler says good-bye. Collective. `history_interval` [s] of the coupler's rows:
/// energies are computed for them only; 0: after every window.
template <int dim>
void run_coupled(Fluid<dim>& fluid, SharedLink link, double history_interval, const Observer<dim>& observe,
                 const Persistence& persistence = {});

/// Run alone from run.t_begin to run.t_end. Collective. `frame_interval` [s], 0: only the first and the last
/// frame.
/// @returns why it stopped earlier, its state written; empty if it did not
template <int dim>
std::string run_alone(Fluid<dim>& fluid, const RunConfig& run, double frame_interval,
                      const Observer<dim>& observe, const Persistence& persistence = {});

} // namespace undine::fluid
