// The loops that read like the method: predict, free motion, link, correct.
#include "solid_fe/run.hpp"

#include "common/error.hpp"
#include "common/io/stop_signal.hpp"
#include "common/program/coupled_checkpoint.hpp"
#include "common/program/coupled_window.hpp"
#include "common/time/row_times.hpp"
#include "solid_fe/step_watch.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>

namespace undine::solid
{

namespace
{

double seconds_now()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Writes rows when they are due and keeps the largest imbalance.
template <int dim>
class Ledger
{
public:
  Ledger(const Energies& start, const RunTimes& times, SolidOutput<dim>* output)
      : output_(output), rows_(times.history_interval), balance_at_start_(start.balance())
  {
  }

  /// Is a row due after a step or window of length `dt` that ended at `t`?
  bool is_due(double t, double dt) const { return rows_.due(t, dt); }

  void record(double t, const Solid<dim>& solid, const Energies& e)
  {
    imbalance_ = std::max(imbalance_, std::abs(e.balance() - balance_at_start_));
    scale_ = std::max({scale_, e.kinetic, e.strain, std::abs(e.external), std::abs(e.interface)});
    if (output_ != nullptr)
      output_->write_history(solid, e);
    rows_.written(t);
  }
  void for_each_state(StateArchive& archive)
  {
    archive("balance_at_start", balance_at_start_);
    archive("rows", rows_);
    archive("imbalance", imbalance_);
    archive("scale", scale_);
  }
  double drift() const { return scale_ > 0.0 ? imbalance_ / scale_ : 0.0; }

private:
  SolidOutput<dim>* output_;
  RowTimes rows_;
  double balance_at_start_;
  double imbalance_ = 0.0, scale_ = 0.0;
};

/// Frame times of a run on its own: multiples of the interval, and the end.
std::vector<double> frame_times(double t_begin, const RunTimes& times)
{
  std::vector<double> due;
  if (times.frame_interval > 0.0)
    for (std::int64_t k = 1;; ++k)
    {
      const double t = t_begin + static_cast<double>(k) * times.frame_interval;
      if (t > times.t_end - 0.01 * times.frame_interval)
        break;
      due.push_back(t);
    }
  due.push_back(times.t_end);
  return due;
}

link::Report report_of(const Energies& e, double stable_dt, double mass, std::int64_t steps)
{
  link::Report report;
  report.stable_dt = stable_dt;
  report.kinetic_energy = e.kinetic;
  report.internal_energy = e.strain + e.hourglass + e.plastic + e.viscous + e.contact;
  report.external_work = e.external;
  report.interface_work = e.interface;
  report.mass = mass;
  report.steps = steps;
  return report;
}

/// The interfaces the coupler wants must be exactly those the solid serves.
void require_same_interfaces(const link::Setup& setup, const link::SurfaceMesh& surface)
{
  if (setup.dim != surface.dim)
    throw InputError("coupling: the coupler works in " + std::to_string(setup.dim) + "-D, the solid in " +
                         std::to_string(surface.dim) + "-D",
                     ExitCode::different_case);
  for (const auto& name : setup.interfaces)
    if (std::find(surface.interfaces.begin(), surface.interfaces.end(), name) == surface.interfaces.end())
      throw InputError("interface \"" + name +
                       "\": the solid has no surface for it; set solid = \"<surface>\" in its "
                       "[[interface]] table");
}

} // namespace

double next_step(double dt, double limit)
{
  if (limit < dt)
    return limit;
  return limit > 1.1 * dt ? 1.02 * dt : dt;
}

template <int dim>
RunResult run_alone(Solid<dim>& solid, const RunTimes& times, SolidOutput<dim>* output,
                    const Progress& progress, const Persistence& persistence)
{
  RunResult result{.smallest_step = std::numeric_limits<double>::infinity()};
  const double started = seconds_now();
  double mass = solid.mass();
  Ledger<dim> ledger(solid.energies(), times, output);
  StepWatch<dim> watch;
  double dt_wanted = 0.0, dt = 0.0, t_begin = solid.time();
  std::int64_t steps_left = 0;
  std::uint64_t frame = 0; // the one that is on its way
  const StateVisitor state = [&](StateArchive& archive)
  {
    archive("solid", solid);
    archive("ledger", ledger);
    archive("watch", watch);
    archive("dt_wanted", dt_wanted);
    archive("dt", dt);
    archive("t_begin", t_begin);
    archive("steps_left", steps_left);
    archive("frame", frame);
    archive("smallest_step", result.smallest_step);
    archive("mass", mass);
  };
  const bool continues = persistence.restarts();
  if (continues)
    persistence.restore(state);
  else
  {
    ledger.record(solid.time(), solid, solid.energies());
    if (output != nullptr)
      output->write_frame(solid);
    dt_wanted = watch.limit(solid);
  }

  bool go_on = true;
  bool on_its_way = continues;
  for (const auto frames = frame_times(t_begin, times); frame < frames.size(); ++frame)
  {
    const double t_due = frames[frame];
    if (!on_its_way)
      dt_wanted = next_step(dt_wanted, watch.limit(solid));
    const auto divide = [&] // the way to the next frame into equal steps
    {
      steps_left = std::max<std::int64_t>(
          1, std::llround(std::ceil((t_due - solid.time()) / dt_wanted * (1.0 - 1e-12))));
      dt = (t_due - solid.time()) / static_cast<double>(steps_left);
      result.smallest_step = std::min(result.smallest_step, dt);
    };
    if (!on_its_way)
      divide();
    on_its_way = false;
    while (go_on && steps_left > 0)
    {
      if (const double limit = watch.limit(solid); limit < dt)
      {
        dt_wanted = limit;
        divide();
      }
      solid.predict(dt);           // v ← v + Δt/2 a,  u ← u + Δt v
      solid.solve_free_motion(dt); // M a = F_ext − F_int(u),  v ← v + Δt/2 a
      if (ledger.is_due(solid.time(), dt) || (steps_left == 1 && t_due == times.t_end))
        ledger.record(solid.time(), solid, solid.energies());
      --steps_left;
      go_on = !progress || progress(solid.time(), solid.steps(), dt);
      result.stop_reason = persistence.after_step(solid.time(), solid.steps(), state);
      if (!result.stop_reason.empty() && !(steps_left == 0 && frame + 1 == frames.size()))
        break;
      result.stop_reason.clear();
    }
    if (!result.stop_reason.empty())
    {
      go_on = false;
      break;
    }
    if (output != nullptr)
      output->write_frame(solid);
    if (!go_on)
      break;
  }
  result.t_end = solid.time();
  result.steps = solid.steps();
  result.compute_seconds = seconds_now() - started;
  result.mass_drift = solid.mass() / mass - 1.0;
  result.energy_drift = ledger.drift();
  result.completed = go_on;
  return result;
}

template <int dim>
RunResult run_coupled(Solid<dim>& solid, SharedLink link, const RunTimes& times, SolidOutput<dim>* output,
                      const Progress& progress, const Persistence& persistence)
{
  RunResult result{.smallest_step = std::numeric_limits<double>::infinity()};
  const auto setup = link.receive_setup();
  require_same_restart(persistence, setup);
  double mass = solid.mass();
  Ledger<dim> ledger(solid.energies(), times, output);
  StepWatch<dim> watch;
  const StateVisitor state = [&](StateArchive& archive)
  {
    archive("solid", solid);
    archive("ledger", ledger);
    archive("watch", watch);
    archive("windows", result.windows);
    archive("smallest_step", result.smallest_step);
    archive("mass", mass);
  };
  if (persistence.restarts())
    persistence.restore(state);
  else
    solid.set_time(setup.t_begin);
  link.on_checkpoint([&](const link::CheckpointOrder& order) { return save_for(order, persistence, state); });
  const auto surface = solid.wet_surface();
  require_same_interfaces(setup, surface);
  const bool in_contact = setup.scheme == link::contact_scheme;
  link.send_mesh(surface);
  if (persistence.restarts()) // a beam's surface was told its present rotations; the coupler has those of the
                              // checkpoint
    persistence.restore(state);

  const double started = seconds_now(), waited = link.wait_seconds();
  Energies energies = solid.energies();
  if (!persistence.restarts())
  {
    ledger.record(setup.t_begin, solid, energies);
    if (output != nullptr)
      output->write_frame(solid);
  }
  std::vector<double> f_link(solid.interface_velocity().size());
  bool stop_asked = false;

  while (true)
  {
    auto report = report_of(energies, watch.limit(solid), solid.mass(), solid.steps());
    report.wait_seconds = link.wait_seconds() - waited;
    report.compute_seconds = seconds_now() - started - report.wait_seconds;
    report.surface_changed = solid.wet_surface_has_changed();
    link.send_report(report);
    if (report.surface_changed)
      link.send_mesh_update(solid.wet_surface());
    const auto window = link.next_window();
    if (!window)
      break;

    std::optional<StateArchive> at_begin;
    if (window->trial)
      state(at_begin.emplace());
    solid.set_time(window->t_begin);
    take_window(solid, link, *window, in_contact, f_link);
    const double dt = window->dt();
    result.smallest_step = std::min(result.smallest_step, dt);
    if (at_begin)
    {
      at_begin->read_back();
      state(*at_begin);
      continue;
    }
    ++result.windows;
    const bool row = ledger.is_due(window->t_end, window->t_end - window->t_begin) || window->last;
    if (row) // between rows the coupler reads the work of the link only, and in flight it does not change
    {
      energies = solid.energies();
      ledger.record(window->t_end, solid, energies);
    }
    else if (!window->flight)
      energies.interface = solid.interface_work();
    if (output != nullptr && (window->output || window->last))
      output->write_frame(solid);
    const bool go_on = !progress || progress(solid.time(), solid.steps(), dt);
    if (const std::string signal = stop_signal(); !stop_asked && (!go_on || !signal.empty()))
    {
      link.send_stop_request(signal.empty() ? "the solid was asked to stop" : "the solid received " + signal);
      stop_asked = true;
    }
  }
  result.t_end = solid.time();
  result.steps = solid.steps();
  result.wait_seconds = link.wait_seconds() - waited;
  result.compute_seconds = seconds_now() - started - result.wait_seconds;
  result.mass_drift = solid.mass() / mass - 1.0;
  result.energy_drift = ledger.drift();
  result.completed = !stop_asked;
  return result;
}

template <int dim>
Summary summarise(const Solid<dim>& solid, const RunResult& result)
{
  Summary summary;
  const auto e = solid.energies();
  summary.set("t_end", result.t_end);
  summary.set("steps", static_cast<long long>(result.steps));
  summary.set("windows", static_cast<long long>(result.windows));
  summary.set("wall_s", result.compute_seconds + result.wait_seconds);
  summary.set("compute_s", result.compute_seconds);
  summary.set("wait_s", result.wait_seconds);
  summary.set("ns_per_node_step",
              1e9 * result.compute_seconds /
                  (static_cast<double>(result.steps) * static_cast<double>(solid.nodes().size())));
  summary.set("nodes", static_cast<long long>(solid.nodes().size()));
  summary.set("ranks", solid.ranks().size());
  summary.set("rank_wait_s", solid.ranks().cost().wall);
  summary.set("elements", static_cast<long long>(solid.n_elements()));
  summary.set("smallest_step", result.smallest_step);
  summary.set("mass", solid.mass());
  if (!solid.added_mass().empty())
    for (std::size_t k = 0; k < solid.bodies().size(); ++k)
    {
      const auto name = std::visit([](const auto& block) { return block.body; }, solid.whole_block(k));
      summary.set("added_mass." + (name.empty() ? "body_" + std::to_string(k) : name), solid.added_mass()[k]);
    }
  summary.set("mass_drift", result.mass_drift);
  summary.set("energy_drift", result.energy_drift);
  summary.set("energy_drift_definition",
              std::string("largest |balance - start| over the largest energy or "
                          "work, balance = kinetic + strain + hourglass + plastic + "
                          "viscous + contact - external - interface, at history times"));
  summary.set("kinetic_energy", e.kinetic);
  summary.set("strain_energy", e.strain);
  summary.set("hourglass_energy", e.hourglass);
  summary.set("plastic_work", e.plastic);
  summary.set("viscous_work", e.viscous);
  summary.set("contact_energy", e.contact);
  summary.set("external_work", e.external);
  summary.set("interface_work", e.interface);
  return summary;
}

template RunResult run_alone(Solid<2>&, const RunTimes&, SolidOutput<2>*, const Progress&,
                             const Persistence&);
template RunResult run_alone(Solid<3>&, const RunTimes&, SolidOutput<3>*, const Progress&,
                             const Persistence&);
template RunResult run_coupled(Solid<2>&, SharedLink, const RunTimes&, SolidOutput<2>*, const Progress&,
                               const Persistence&);
template RunResult run_coupled(Solid<3>&, SharedLink, const RunTimes&, SolidOutput<3>*, const Progress&,
                               const Persistence&);
template Summary summarise(const Solid<2>&, const RunResult&);
template Summary summarise(const Solid<3>&, const RunResult&);

} // namespace undine::solid
