// The fluid's time loops: coupled, and alone.
#pragma once

#include "common/config/run_config.hpp"
#include "common/io/checkpoint.hpp"
#include "common/program/shared_link.hpp"
#include "fluid_pfem/fluid.hpp"

#include <functional>
#include <string>

namespace undine::fluid
{

/// Called on all ranks at the start and after every window (coupled) or step (alone), always at a
/// synchronised time. `frame`: a field frame is due.
template <int dim>
using Observer = std::function<void(double t, Fluid<dim>& fluid, bool frame)>;

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
