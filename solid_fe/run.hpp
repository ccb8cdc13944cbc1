// The two loops of the solid: alone, and coupled through the link.
#pragma once

#include "common/coupling/link.hpp"
#include "common/io/checkpoint.hpp"
#include "common/io/summary.hpp"
#include "common/program/shared_link.hpp"
#include "solid_fe/solid.hpp"
#include "solid_fe/solid_output.hpp"

#include <cstdint>
#include <functional>
#include <string>

namespace undine::solid
{

/// When a run that is not told by a coupler ends and writes.
struct RunTimes
{
  double t_end = 0.0;            ///< [s]
  double frame_interval = 0.0;   ///< [s]; 0: first and last state only
  double history_interval = 0.0; ///< [s]; 0: every step (alone) or every window (coupled)
};

/// What a run was and cost.
struct RunResult
{
  double t_end = 0.0; ///< reached [s]
  std::int64_t steps = 0;
  std::int64_t windows = 0;     ///< coupled only
  double smallest_step = 0.0;   ///< [s]
  double compute_seconds = 0.0; ///< wall time without waiting
  double wait_seconds = 0.0;    ///< wall time waiting for the coupler
  double mass_drift = 0.0;      ///< relative
  double energy_drift =
      0.0; ///< largest |balance − balance at the start| over the largest energy or work, at output times
  bool completed = false;  ///< reached its end (not stopped)
  std::string stop_reason; ///< alone: why it stopped with its state written
};

/// Step after `dt` when `limit` is stable: falls to the limit at once, stays while it can, and grows by 2 %
/// only when there is at least 10 % to gain. Central differences lose their energy bound when the step jumps
/// about.
double next_step(double dt, double limit);

/// Called about once per step with time and step; returns false to stop the run in order.
using Progress = std::function<bool(double t, std::int64_t step, double dt)>;

/// Run from the solid's time to t_end with its own steps, which are adjusted to hit every frame time exactly.
/// `output` may be null. Collective. @throws NumericalError for an inverted element
template <int dim>
RunResult run_alone(Solid<dim>& solid, const RunTimes& times, SolidOutput<dim>* output,
                    const Progress& progress = {}, const Persistence& persistence = {});

/// Serve the coupler until it says goodbye. The set-up is received, the wet surface sent, and then each
/// window is one pass: report → orders → steps, in each of which the wet nodes go first and travel while the
/// interior is computed. `output` may be null; frames are written when the coupler asks, histories every
/// `times.history_interval`. Collective: rank 0 talks to the coupler.
/// @throws InputError if the set-up does not fit the solid, NumericalError, link::ProtocolError
template <int dim>
RunResult run_coupled(Solid<dim>& solid, SharedLink link, const RunTimes& times, SolidOutput<dim>* output,
                      const Progress& progress = {}, const Persistence& persistence = {});

/// The solid's part of summary.json: steps, wall_s, nodes, balances and their definitions. Collective.
template <int dim>
Summary summarise(const Solid<dim>& solid, const RunResult& result);

} // namespace undine::solid
