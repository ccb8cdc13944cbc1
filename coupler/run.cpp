// The coupler's time loop.
#include "coupler/run.hpp"

#include "common/error.hpp"
#include "coupler/helpers.hpp"

#include <algorithm>
#include <utility>

namespace undine::coupler
{

Vector as_vector(const std::vector<double>& v)
{
  return Eigen::Map<const Vector>(v.data(), static_cast<Eigen::Index>(v.size()));
}

std::vector<double> as_std(const Vector& v) { return {v.data(), v.data() + v.size()}; }

link::Setup setup_of(const CouplerConfig& config, const std::string& role, const std::string& scheme)
{
  link::Setup setup{.dim = config.run.dim,
                    .t_begin = config.restart.empty() ? config.run.t_begin : config.t_start,
                    .t_end = config.run.t_end,
                    .scheme = scheme,
                    .restart = config.restart};
  for (const auto& i : config.coupling.interfaces)
    if (role == "fluid" || role == i.body)
      setup.interfaces.push_back(i.name);
  return setup;
}

void send_setup(const CouplerConfig& config, Group& group, const std::string& scheme)
{
  for (link::PartnerLink* p : group.members())
    p->send_setup(setup_of(config, p->role(), scheme));
}

void accept_meshes(const Sides& side)
{
  for (const Group* group : side)
    for (link::PartnerLink* p : group->members())
      p->accept_mesh();
}

void reject_meshes(const Sides& side, const std::string& reason)
{
  for (const Group* group : side)
    for (link::PartnerLink* p : group->members())
      p->reject_mesh(reason);
}

WindowRules rules_of(const CouplingConfig& coupling)
{
  WindowRules rules;
  if (coupling.fine != "auto")
    rules.fine = coupling.fine == "fluid" ? Side::fluid : Side::solid;
  rules.substeps = coupling.substeps;
  rules.substeps_max = coupling.substeps_max;
  rules.dt_max = coupling.dt_max;
  return rules;
}

namespace
{

/// The coupler's part of checkpoints: orders them from all participants at window ends.
class CheckpointKeeper
{
public:
  /// `persistence.checkpoints` may be null: then there are none.
  CheckpointKeeper(const Persistence& persistence, const Sides& side,
                   std::function<void(const std::string&)> say, const StateVisitor& state)
      : persistence_(persistence), side_(side), say_(std::move(say)), state_(state)
  {
  }

  /// Before the first window: is the case's wish possible? Writes the state at the start, if checkpoints are
  /// wanted.
  void at_start(double t)
  {
    if (persistence_.checkpoints != nullptr && !persistence_.restarts() && persistence_.checkpoints->wanted())
      write(t, 0);
  }

  /// After a window. @returns true if the run shall stop, its state written if that is possible
  bool after_window(double t, std::int64_t windows)
  {
    const bool asked = side_[0]->stop_requested() || side_[1]->stop_requested();
    if (persistence_.checkpoints == nullptr)
      return asked;
    if (const Checkpoints& c = *persistence_.checkpoints; possible_ && (asked || c.due(t) || c.due_now()))
      write(t, windows);
    return asked || !persistence_.checkpoints->stop_reason().empty();
  }

private:
  void write(double t, std::int64_t windows)
  {
    const std::string folder = persistence_.checkpoints->begin();
    const std::string id = folder.substr(folder.rfind('/') + 1);
    for (const Group* group : side_)
      for (link::PartnerLink* p : group->members())
        p->send_checkpoint({.folder = folder, .id = id, .windows = windows, .t = t});
    persistence_.save(folder, state_);
    std::vector<std::string> files{persistence_.file_name()};
    for (const Group* group : side_)
      for (link::PartnerLink* p : group->members())
      {
        const link::CheckpointDone done = p->receive_checkpoint_done();
        if (!done.written)
        {
          possible_ = false;
          if (say_)
            say_("no checkpoints, so that a restart is not possible: '" + p->role() +
                 "' says: " + done.reason);
        }
        files.insert(files.end(), done.files.begin(), done.files.end());
      }
    if (possible_)
      persistence_.checkpoints->finish(folder, t, windows, files);
    else
      persistence_.checkpoints->abandon(folder);
  }

  const Persistence& persistence_;
  Sides side_;
  std::function<void(const std::string&)> say_;
  const StateVisitor& state_;
  bool possible_ = true;
};

std::unique_ptr<Scheme> meet(const CouplerConfig& config, const Sides& side)
{
  if (config.coupling.has_contact())
    return meet_contact(config, side);
  return config.coupling.scheme == "gc" ? meet_permanent(config, side) : meet_staggered(config, side);
}

bool frame_is_due(const CouplerConfig& config, const WindowPlanner::Plan& plan, std::int64_t frames)
{
  return plan.last || (config.frame_interval > 0.0 &&
                       plan.t_end >= config.run.t_begin +
                                         static_cast<double>(frames) * config.frame_interval * (1.0 - 1e-12));
}

} // namespace

std::int64_t run(const CouplerConfig& config, Group& fluid, Group& solid,
                 const std::function<void(const WindowRecord&)>& after_window, const Persistence& persistence,
                 const std::function<void(const std::string&)>& say)
{
  const Sides side{&fluid, &solid};
  const std::unique_ptr<Scheme> scheme = meet(config, side);
  WindowPlanner planner(scheme->rules(), config.run.t_begin, config.run.t_end);
  std::array<link::Report, 2> report{fluid.receive_report(), solid.receive_report()};
  std::int64_t frames = 1, windows = 0;
  WindowPlanner::Plan plan{.t_begin = config.run.t_begin, .t_end = config.run.t_begin};
  const StateVisitor state = [&](StateArchive& archive)
  {
    archive("scheme", *scheme);
    archive("planner", planner);
    archive("frames", frames);
    archive("windows", windows);
  };
  const auto record = [&]
  {
    after_window({plan, report[Side::fluid], report[Side::solid], scheme->balance(), scheme->interfaces(),
                  scheme->solid_surface(), scheme->solid_force(), scheme->searches(), scheme->solves(),
                  scheme->iterations(), fluid.wait_seconds() + solid.wait_seconds()});
  };
  if (persistence.restarts())
    persistence.restore(state);
  else
    record();
  CheckpointKeeper keeper(persistence, side, say, state);
  keeper.at_start(planner.time());

  while (!planner.finished())
  {
    plan = planner.next(report[Side::fluid].stable_dt, report[Side::solid].stable_dt, scheme->flight());
    const bool frame = frame_is_due(config, plan, frames);
    frames += frame;
    std::array<link::Window, 2> orders;
    for (const Side s : both_sides)
    {
      const Scheme::Order order = scheme->order(s, plan);
      orders[s] = {.index = plan.index,
                   .t_begin = plan.t_begin,
                   .t_end = plan.t_end,
                   .steps = order.steps,
                   .fine = order.fine,
                   .activate = order.activate,
                   .output = frame,
                   .last = plan.last,
                   .trial = order.trial,
                   .flight = order.flight};
      side[s]->send_window(orders[s]);
    }
    scheme->advance(plan, orders);
    ++windows;
    report = scheme->end_window();
    record();
    if (keeper.after_window(planner.time(), windows))
      break;
  }
  if (config.team != nullptr) // before the participants leave, so that a silent helper is told to all
    dismiss_helpers(*config.team);
  for (const Group* group : side)
    for (link::PartnerLink* p : group->members())
      p->send_bye();
  return windows;
}

} // namespace undine::coupler
