// Ledgers and progress of the coupled run.
#include "coupler/coupler_output.hpp"

#include "common/error.hpp"
#include "common/io/summary.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>

namespace undine::coupler
{

namespace
{

const std::vector<std::string> interface_columns{
    "work_on_fluid[J]",   "work_on_solid[J]",   "velocity_jump[m/s]",    "displacement_gap[m]",
    "impulse_fluid[N s]", "impulse_solid[N s]", "impulse_mismatch[N s]", "activation_loss[J]",
    "substeps[]",         "window[s]"};

} // namespace

EnergyBalance energy_of(const link::Report& fluid, const link::Report& solid)
{
  return {.kinetic = fluid.kinetic_energy + solid.kinetic_energy,
          .internal = fluid.internal_energy + solid.internal_energy,
          .external_work = fluid.external_work + solid.external_work,
          .dissipated = fluid.dissipated_energy + solid.dissipated_energy};
}

CouplerOutput::CouplerOutput(const OutputConfig& output, const CouplerConfig& config,
                             const std::vector<ProbeConfig>& probes)
    : output_(output), config_(config),
      energy_(output.dir, "energy",
              "energies of fluid and solid; total = kinetic + internal + dissipated - external_work, changed "
              "by the interface, by remeshing and by what moves mass between nodes only (fluid_energy tells "
              "how much); works cumulated",
              {"fluid_kinetic[J]", "fluid_internal[J]", "fluid_external_work[J]", "fluid_dissipated[J]",
               "solid_kinetic[J]", "solid_internal[J]", "solid_external_work[J]", "solid_dissipated[J]",
               "work_on_fluid[J]", "work_on_solid[J]", "total[J]"}),
      probes_(probes), on_terminal_(isatty(STDERR_FILENO) != 0), begin_(std::chrono::steady_clock::now()),
      last_progress_(begin_), rows_(output.history_interval)
{
  for (const auto& i : config.coupling.interfaces)
    interface_.emplace_back(
        output.dir, "interface_" + i.name,
        "ledger of the coupling: cumulated work and impulse of the link forces on each side, the velocity "
        "jump at the "
        "window's end, the gap between integrated velocities; over all interfaces of the case",
        interface_columns);
}

void CouplerOutput::observe(const WindowRecord& r)
{
  balance_ = r.balance;
  t_ = r.plan.t_end;
  const bool start = r.plan.t_end == r.plan.t_begin,
             row = start || r.plan.last || rows_.due(t_, r.plan.t_end - r.plan.t_begin);
  if (row) // else energies may be those of an earlier window
  {
    const EnergyBalance e = energy_of(r.fluid, r.solid);
    total_now_ = e.total();
    largest_energy_ = std::max({largest_energy_, e.kinetic, std::abs(e.internal)});
  }
  largest_jump_ = std::max(largest_jump_, balance_.velocity_jump);
  largest_gap_ = std::max(largest_gap_, balance_.displacement_gap);
  compute_ = {r.fluid.compute_seconds, r.solid.compute_seconds};
  wait_ = {r.fluid.wait_seconds, r.solid.wait_seconds};
  coupler_wait_ = r.wait_seconds;
  builds_ = r.searches;
  factorisations_ = r.solves;
  iterations_ = r.iterations;
  if (start)
  {
    total_at_start_ = total_now_;
    solid_at_start_ = r.solid_surface;
    gauges_.emplace(output_, probes_, solid_at_start_);
  }
  else
    gauges_->observe(t_, r.plan.t_end - r.plan.t_begin, r.solid_force, r.solid_surface);
  if (!start)
  {
    ++windows_;
    fine_steps_ += r.plan.steps.m;
    flown_ += r.plan.flight > 1 ? r.plan.flight : 0;
    substeps_least_ = windows_ == 1 ? r.plan.steps.m : std::min(substeps_least_, r.plan.steps.m);
    substeps_most_ = std::max(substeps_most_, r.plan.steps.m);
  }

  if (row)
  {
    energy_.write(t_, {r.fluid.kinetic_energy, r.fluid.internal_energy, r.fluid.external_work,
                       r.fluid.dissipated_energy, r.solid.kinetic_energy, r.solid.internal_energy,
                       r.solid.external_work, r.solid.dissipated_energy, balance_.work[Side::fluid],
                       balance_.work[Side::solid], total_now_});
    for (History& h : interface_)
      h.write(t_, {balance_.work[Side::fluid], balance_.work[Side::solid], balance_.velocity_jump,
                   balance_.displacement_gap, balance_.impulse[Side::fluid], balance_.impulse[Side::solid],
                   balance_.impulse_mismatch, balance_.activation_loss, static_cast<double>(r.plan.steps.m),
                   r.plan.steps.coarse_dt});
    rows_.written(t_);
  }

  // The scheme may lose energy at the interface (sub-cycling, activation); it must not make any.
  const double made = balance_.work[Side::fluid] + balance_.work[Side::solid];
  if (made > config_.coupling.energy_limit * largest_energy_ && largest_energy_ > 0.0)
    throw NumericalError(fmt::format(
        "window {}, t = {:.6g} s: the interface has made {:.3g} J, {:.2g} of the largest energy in motion; "
        "coupling.energy_limit = {:.2g}. See history/interface_*.csv; a participant may report wrong "
        "interface "
        "masses or a stable step that is too long",
        r.plan.index, t_, made, made / largest_energy_, config_.coupling.energy_limit));

  // A step that has collapsed never recovers: end with the reason instead of crawling on.
  constexpr double collapsed = 1e-3;
  constexpr std::int64_t patience = 2000;
  largest_window_ = std::max(largest_window_, r.plan.steps.coarse_dt);
  stalled_ = r.plan.steps.coarse_dt < collapsed * largest_window_ && !r.plan.last ? stalled_ + 1 : 0;
  if (stalled_ > patience)
    throw NumericalError(fmt::format("window {}, t = {:.6g} s: the time step has collapsed to {:.3g} s, "
                                     "{:.2g} of what it was ({} windows in a row). "
                                     "Stable steps: fluid {:.3g} s, solid {:.3g} s; look at the last frame "
                                     "of the side with the smaller one",
                                     r.plan.index, t_, r.plan.steps.coarse_dt,
                                     r.plan.steps.coarse_dt / largest_window_, patience, r.fluid.stable_dt,
                                     r.solid.stable_dt));
  show_progress(r);
}

void CouplerOutput::for_each_state(StateArchive& archive)
{
  archive("energy", energy_);
  archive("interface", interface_);
  archive_surface(archive, "solid_at_start", solid_at_start_);
  if (archive.reading())
    gauges_.emplace(output_, probes_, solid_at_start_);
  archive("gauges", gauges_);
  archive("rows", rows_);
  archive("total_at_start", total_at_start_);
  archive("largest_energy", largest_energy_);
  archive("total_now", total_now_);
  archive("t", t_);
  archive("windows", windows_);
  archive("substeps_least", substeps_least_);
  archive("substeps_most", substeps_most_);
  archive("fine_steps", fine_steps_);
  archive("flown", flown_);
  archive("balance", balance_);
  archive("largest_jump", largest_jump_);
  archive("largest_gap", largest_gap_);
  archive("largest_window", largest_window_);
  archive("stalled", stalled_);
}

void CouplerOutput::show_progress(const WindowRecord& r)
{
  using seconds = std::chrono::duration<double>;
  const auto now = std::chrono::steady_clock::now();
  if (seconds(now - last_progress_).count() < (on_terminal_ ? 1.0 : 30.0) && !r.plan.last)
    return;
  last_progress_ = now;
  const double wall = seconds(now - begin_).count();
  const double done = (t_ - config_.run.t_begin) / (config_.run.t_end - config_.run.t_begin);
  const double left = done > 0.0 ? wall * (1.0 - done) / done : 0.0;
  const auto share = [wall](double s) { return wall > 0.0 ? 100.0 * s / wall : 0.0; };
  const bool fluid_fine = r.plan.steps.fine == Side::fluid;
  fmt::print(stderr,
             "{}t={:.5g}/{:.5g} {:3.0f}% win {} dt {:.2e} (fluid {}, solid {} substeps) wait F {:.0f}% S "
             "{:.0f}% dE/E {:+.2g} ETA {:02d}:{:02d}{}",
             on_terminal_ ? "\r" : "", t_, config_.run.t_end, 100.0 * done, r.plan.index + 1,
             r.plan.steps.coarse_dt, fluid_fine ? r.plan.steps.m : 1, fluid_fine ? 1 : r.plan.steps.m,
             share(r.fluid.wait_seconds), share(r.solid.wait_seconds),
             largest_energy_ > 0.0 ? (total_now_ - total_at_start_) / largest_energy_ : 0.0,
             static_cast<int>(left) / 60, static_cast<int>(left) % 60,
             !on_terminal_ || r.plan.last ? "\n" : "");
  std::fflush(stderr);
}

void CouplerOutput::write_summary(const std::string& status) const
{
  const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  const double scale = largest_energy_ > 0.0 ? largest_energy_ : 1.0;
  Summary s;
  s.set("status", status);
  s.set("exit_code", status == "completed" ? 0 : static_cast<int>(ExitCode::stopped));
  s.set("t_end", t_);
  s.set("wall_s", wall);
  s.set("windows", windows_);
  s.set("substeps", substeps_most_);
  s.set("conservation.energy_drift", (total_now_ - total_at_start_) / scale);
  s.set("conservation.energy_drift_definition", "change of kinetic + internal + dissipated - external work "
                                                "over the largest kinetic or internal energy");
  s.set("conservation.interface_energy", (balance_.work[Side::fluid] + balance_.work[Side::solid]) / scale);
  s.set("conservation.interface_energy_definition",
        "work of the link on both sides over the same energy; negative: lost by sub-cycling");
  s.set("conservation.momentum_drift",
        balance_.impulse_mismatch / std::max({balance_.impulse[0], balance_.impulse[1], 1e-300}));
  s.set("conservation.momentum_drift_definition",
        "norm of the sum of the impulses on both sides over the larger of them");
  s.set("conservation.velocity_jump", largest_jump_);
  s.set("conservation.velocity_jump_definition",
        "largest difference of the velocities of both sides at the ends of windows [m/s]");
  s.set("conservation.displacement_gap", largest_gap_);
  s.set("conservation.displacement_gap_definition",
        "largest integral of that difference over the fine steps, or depth in contact [m]");
  s.set("conservation.activation_loss", balance_.activation_loss / scale);
  s.set(
      "conservation.activation_loss_definition",
      "kinetic energy lost where velocities were made to fit, at the start and after remeshes, over the same "
      "energy");
  s.set("coupler.wall_s", wall);
  s.set("coupler.wait_s", coupler_wait_);
  s.set("coupler.share", wall > 0.0 ? 1.0 - coupler_wait_ / wall : 0.0);
  s.set("coupler.share_definition", "part of the run in which the coupler does not wait for a message: its "
                                    "searches, solutions, ledgers and files");
  s.set("coupler.substeps_least", substeps_least_);
  s.set("coupler.substeps_most", substeps_most_);
  s.set("coupler.exchanges", fine_steps_ + windows_);
  s.set("coupler.steps_without_exchange", flown_);
  s.set("coupler.operator_builds", builds_);
  s.set("coupler.factorisations", factorisations_);
  s.set("coupler.gradient_iterations", iterations_);
  s.set("coupler.fluid_compute_s", compute_[Side::fluid]);
  s.set("coupler.fluid_wait_s", wait_[Side::fluid]);
  s.set("coupler.solid_compute_s", compute_[Side::solid]);
  s.set("coupler.solid_wait_s", wait_[Side::solid]);
  s.write(output_.dir + "/coupler.json");
}

} // namespace undine::coupler
