// The fluid's time loops, to be read beside section 4 of Meduri et al. (2017).
#include "fluid_pfem/run.hpp"

#include "common/error.hpp"
#include "common/io/stop_signal.hpp"
#include "common/program/coupled_checkpoint.hpp"
#include "common/program/coupled_window.hpp"
#include "common/time/row_times.hpp"
#include "fluid_pfem/step_looks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>

namespace undine::fluid
{

namespace
{

double seconds_since(std::chrono::steady_clock::time_point begin)
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

/// Energies and mass at a time when somebody reads them.
struct Balance
{
  FluidEnergy energy;
  double mass = 0.0; ///< [kg]

  template <int dim>
  void take(const Fluid<dim>& fluid)
  {
    energy = fluid.energy();
    mass = fluid.mass();
  }
};

template <int dim>
link::Report report_of(const Fluid<dim>& fluid, double stable_dt, const Balance& balance,
                       double initial_potential)
{
  link::Report report;
  report.stable_dt = stable_dt;
  report.kinetic_energy = balance.energy.kinetic;
  report.internal_energy = balance.energy.internal;
  report.external_work = initial_potential - balance.energy.potential + balance.energy.wall_work +
                         balance.energy.openings; // of weight, moving walls, what flows and waves that leave
  report.dissipated_energy = balance.energy.dissipated;
  report.interface_work = fluid.interface_work();
  report.mass = balance.mass;
  report.steps = fluid.steps();
  return report;
}

/// A step that has collapsed does not recover: the run ends with the reason instead of crawling on.
struct StepWatch
{
  double collapse = 0.0; ///< so far below the largest step is far
  double largest = 0.0;  ///< stable step so far [s]
  std::int64_t slow = 0; ///< steps in a row that were far below it

  bool is_slow(double dt) const { return dt < collapse * largest; }
  template <int dim>
  void look(double dt, Fluid<dim>& fluid)
  {
    constexpr std::int64_t patience = 100; // steps
    largest = std::max(largest, dt);
    slow = is_slow(dt) ? slow + 1 : 0;
    if (slow >= patience)
      throw NumericalError(fmt::format(
          "fluid step {}, t = {:.9g} s: the stable step has collapsed to {:.3g} s, {:.2g} of what "
          "it was, for {} steps in a row (fluid.collapse = {:.2g}); {}. A finer mesh there, or "
          "other limits of fluid.merge and fluid.split, may help",
          fluid.steps(), fluid.time(), dt, dt / largest, patience, collapse, fluid.worst_element()));
  }
};

} // namespace

template <int dim>
void run_coupled(Fluid<dim>& fluid, SharedLink link, double history_interval, const Observer<dim>& observe,
                 const Persistence& persistence)
{
  const auto begin = std::chrono::steady_clock::now();
  double initial_potential = 0.0;
  Balance balance;
  RowTimes rows(history_interval); // of the coupler, which reads energies and mass there only
  LimitLooks looks;
  if (fluid.config().look_every > 0)
    looks.every = fluid.config().look_every;
  const StateVisitor state = [&](StateArchive& archive)
  {
    archive("fluid", fluid);
    archive("initial_potential", initial_potential);
    archive("rows", rows);
    archive("limit", looks.limit);
    archive("last_look", looks.last);
  };
  const auto report = [&](double dt, bool surface_changed, bool row)
  {
    if (row)
      balance.take(fluid);
    if (looks.is_due(fluid.steps(), dt))
      looks.look(fluid.steps(), fluid.critical_time_step());
    link::Report r = report_of(fluid, looks.limit, balance, initial_potential);
    r.surface_changed = surface_changed;
    r.wait_seconds = link.wait_seconds();
    r.compute_seconds = seconds_since(begin) - r.wait_seconds;
    link.send_report(r);
  };

  const link::Setup setup = link.receive_setup();
  require_same_restart(persistence, setup);
  const bool sees_solid = setup.scheme == link::contact_surface_scheme;
  const bool in_contact = sees_solid || setup.scheme == link::contact_scheme;
  if (sees_solid)
  {
    const link::SurfaceMesh solid = link.receive_surface();
    if (!persistence.restarts())
      fluid.meet_solid(solid);
  }
  initial_potential = fluid.energy().potential;
  if (persistence.restarts())
    persistence.restore(state);
  link.on_checkpoint([&](const link::CheckpointOrder& order) { return save_for(order, persistence, state); });
  link.send_mesh(fluid.wet_surface());
  if (!persistence.restarts())
    observe(setup.t_begin, fluid, true);
  std::vector<double> f_link(fluid.interface_velocity().size());
  if (!persistence.restarts())
    rows.written(setup.t_begin);
  report(0.0, false, true);

  bool stop_asked = false;
  while (const auto window = link.next_window())
  {
    if (const std::string signal = stop_signal(); !signal.empty() && !stop_asked)
    {
      link.send_stop_request("the fluid received " + signal);
      stop_asked = true;
    }
    const double dt = window->dt();
    std::optional<StateArchive> at_begin;
    if (window->trial)
      state(at_begin.emplace());
    take_window(fluid, link, *window, in_contact, f_link);
    if (at_begin)
    {
      at_begin->read_back();
      state(*at_begin);
      report(dt, false, false);
      continue;
    }
    observe(window->t_end, fluid, window->output);
    const bool row = window->last || rows.due(window->t_end, window->t_end - window->t_begin);
    if (row)
      rows.written(window->t_end);

    const bool remesh = !window->last && fluid.is_distorted();
    const auto remesh_now = [&]
    {
      fluid.remesh();
      looks.forget();
    };
    if (remesh && !sees_solid)
      remesh_now();
    report(dt, remesh, row);
    if (remesh && sees_solid)
    {
      fluid.meet_solid(link.receive_surface());
      remesh_now();
    }
    if (remesh)
    {
      f_link.resize(fluid.interface_velocity().size());
      link.send_mesh_update(fluid.wet_surface());
    }
    if (remesh && sees_solid)
      report(dt, false, row);
  }
}

template <int dim>
std::string run_alone(Fluid<dim>& fluid, const RunConfig& run, double frame_interval,
                      const Observer<dim>& observe, const Persistence& persistence)
{
  const std::int64_t look = fluid.config().look_every;
  const std::int64_t look_at_mesh_every = look > 0 ? look : 4;
  StepLooks looks{.every = look > 0 ? look : 8, .soon = look == 0};
  const double& dt = looks.dt;
  StepWatch watch{.collapse = fluid.config().collapse};
  double t = run.t_begin;
  std::int64_t frames = 1, step = 0;
  const StateVisitor state = [&](StateArchive& archive)
  {
    archive("fluid", fluid);
    archive("t", t);
    archive("dt", looks.dt);
    archive("last_look", looks.last);
    archive("wait_for_look", looks.wait);
    archive("frames", frames);
    archive("step", step);
    archive("largest_step", watch.largest);
    archive("slow_steps", watch.slow);
  };
  if (persistence.restarts())
    persistence.restore(state);
  else
    observe(t, fluid, true);
  while (t < run.t_end)
  {
    const bool remesh = step > 0 && step % look_at_mesh_every == 0 && fluid.is_distorted();
    if (remesh)
      fluid.remesh();
    if (remesh || looks.is_due(step))
      looks.look(step, fluid.critical_time_step());
    const auto next_dt = [&] // the last two steps share what is left
    { return run.t_end - t <= dt ? run.t_end - t : std::min(dt, 0.5 * (run.t_end - t)); };
    const double this_dt = next_dt();
    const std::int64_t first = step;
    bool frame = false, seen = false;
    while (!seen) // equal steps that nobody wants to see, up to one that somebody does
    {
      t = run.t_end - t <= dt ? run.t_end : t + this_dt;
      ++step;
      frame = t >= run.t_end ||
              (frame_interval > 0.0 && t >= run.t_begin + static_cast<double>(frames) * frame_interval);
      seen = frame || step % look_at_mesh_every == 0 || looks.is_due(step) || next_dt() != this_dt ||
             observe.must_see(t) || watch.is_slow(dt) || persistence.due(t);
    }
    fluid.advance(this_dt, step - first);
    frames += frame;
    observe(t, fluid, frame);
    watch.look(dt, fluid);
    if (std::string reason = persistence.after_step(t, step, state); !reason.empty() && t < run.t_end)
      return reason;
  }
  return "";
}

template void run_coupled<2>(Fluid<2>&, SharedLink, double, const Observer<2>&, const Persistence&);
template void run_coupled<3>(Fluid<3>&, SharedLink, double, const Observer<3>&, const Persistence&);
template std::string run_alone<2>(Fluid<2>&, const RunConfig&, double, const Observer<2>&,
                                  const Persistence&);
template std::string run_alone<3>(Fluid<3>&, const RunConfig&, double, const Observer<3>&,
                                  const Persistence&);

} // namespace undine::fluid
