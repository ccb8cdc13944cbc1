// The coupler's time loop.
#include "coupler/run.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <span>

namespace undine::coupler
{

Vector as_vector(const std::vector<double>& v)
{
  return Eigen::Map<const Vector>(v.data(), static_cast<Eigen::Index>(v.size()));
}

std::vector<double> as_std(const Vector& v) { return {v.data(), v.data() + v.size()}; }

link::Setup setup_of(const CouplerConfig& config)
{
  link::Setup setup{.dim = config.run.dim,
                    .t_begin = config.restart.empty() ? config.run.t_begin : config.t_start,
                    .t_end = config.run.t_end,
                    .restart = config.restart};
  for (const auto& i : config.coupling.interfaces)
    setup.interfaces.push_back(i.name);
  return setup;
}

std::pair<Interface, InterfaceOperator> exchange_surfaces(const CouplerConfig& config,
                                                          const std::array<link::PartnerLink*, 2>& partner,
                                                          const std::array<std::string, 2>& scheme)
{
  link::Setup setup = setup_of(config);
  for (const Side s : both_sides)
  {
    setup.scheme = scheme[s];
    partner[s]->send_setup(setup);
  }
  auto fluid = partner[Side::fluid]->receive_mesh();
  auto solid = partner[Side::solid]->receive_mesh();
  Interface interface(config.coupling, std::move(fluid), std::move(solid));
  try
  {
    InterfaceOperator H = interface.build();
    return {std::move(interface), std::move(H)};
  }
  catch (const std::exception& error)
  {
    for (link::PartnerLink* p : partner)
      p->reject_mesh(error.what());
    throw;
  }
}

bool frame_is_due(const CouplerConfig& config, const WindowPlanner::Plan& plan, std::int64_t frames)
{
  return plan.last || (config.frame_interval > 0.0 &&
                       plan.t_end >= config.run.t_begin +
                                         static_cast<double>(frames) * config.frame_interval * (1.0 - 1e-12));
}

bool renew_operator(Interface& interface, GravouilCombescure& gc,
                    const std::array<link::PartnerLink*, 2>& partner,
                    const std::array<link::Report, 2>& report)
{
  for (const Side s : both_sides)
    if (report[s].surface_changed)
      interface.replace_surface(s, partner[s]->receive_mesh_update());
    else
      interface.move(s, gc.travel(s));
  const bool replaced = report[Side::fluid].surface_changed || report[Side::solid].surface_changed;
  if (replaced)
  {
    for (const Side s : both_sides)
      interface.fix_positions(s);
    gc.replace_operator(interface.build());
  }
  else if (interface.has_deformed())
    gc.turn_operator(interface.build());
  return replaced;
}

namespace
{

/// Compatible velocities and accelerations on both sides; see GravouilCombescure::activate.
void activate(GravouilCombescure& gc, const std::array<link::PartnerLink*, 2>& partner)
{
  std::array<Vector, 2> v, a_free;
  for (const Side s : both_sides)
  {
    const link::Kinematics k = partner[s]->receive_kinematics();
    v[s] = as_vector(k.v);
    a_free[s] = as_vector(k.a_free);
  }
  const auto start = gc.activate(v, a_free);
  for (const Side s : both_sides)
    partner[s]->send_activation(
        {.impulse = as_std(start.impulse[s]), .link_force = as_std(start.link_force[s])});
}

} // namespace

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

CheckpointKeeper::CheckpointKeeper(const Persistence& persistence, std::array<link::PartnerLink*, 2> partner,
                                   std::function<void(const std::string&)> say)
    : persistence_(persistence), partner_(partner), say_(std::move(say))
{
}

void CheckpointKeeper::at_start(double t, const StateVisitor& state)
{
  if (persistence_.checkpoints == nullptr)
    return;
  if (persistence_.restarts())
    persistence_.checkpoints->continue_from(t);
  else if (persistence_.checkpoints->wanted())
    write(t, 0, state);
}

bool CheckpointKeeper::after_window(double t, std::int64_t windows, const StateVisitor& state)
{
  const bool asked = partner_[0]->stop_requested() || partner_[1]->stop_requested();
  if (persistence_.checkpoints == nullptr)
    return asked;
  if (possible_ && (asked || persistence_.checkpoints->due(t)))
    write(t, windows, state);
  return asked || !persistence_.checkpoints->stop_reason().empty();
}

void CheckpointKeeper::write(double t, std::int64_t windows, const StateVisitor& state)
{
  const std::string folder = persistence_.checkpoints->begin();
  const std::string id = folder.substr(folder.rfind('/') + 1);
  for (link::PartnerLink* p : partner_)
    p->send_checkpoint({.folder = folder, .id = id, .windows = windows, .t = t});
  persistence_.save(folder, state);
  std::vector<std::string> files{persistence_.file_name()};
  for (link::PartnerLink* p : partner_)
  {
    const link::CheckpointDone done = p->receive_checkpoint_done();
    if (!done.written)
    {
      possible_ = false;
      if (say_)
        say_("no checkpoints, so that a restart is not possible: '" + p->role() + "' says: " + done.reason);
    }
    files.insert(files.end(), done.files.begin(), done.files.end());
  }
  if (possible_)
    persistence_.checkpoints->finish(folder, t, windows, files);
  else
    persistence_.checkpoints->abandon(folder);
}

std::int64_t run_coupler(const CouplerConfig& config, link::PartnerLink& fluid, link::PartnerLink& solid,
                         const std::function<void(const WindowRecord&)>& after_window,
                         const Persistence& persistence, const std::function<void(const std::string&)>& say)
{
  const std::array<link::PartnerLink*, 2> partner{&fluid, &solid};
  auto [interface, H] = exchange_surfaces(config, partner, {config.coupling.scheme, config.coupling.scheme});
  for (link::PartnerLink* p : partner)
    p->accept_mesh();

  GravouilCombescure gc(std::move(H), config.run.dim);
  WindowPlanner planner(rules_of(config.coupling), config.run.t_begin, config.run.t_end);
  LinkedPartner fluid_partner(fluid), solid_partner(solid);
  std::array<link::Report, 2> report{fluid.receive_report(), solid.receive_report()};
  bool start_compatibly = true;
  std::int64_t frames = 1, windows = 0;
  WindowPlanner::Plan plan{.t_begin = config.run.t_begin, .t_end = config.run.t_begin};
  const StateVisitor state = [&](StateArchive& archive)
  {
    archive("interface", interface);
    if (archive.reading())
      gc.turn_operator(interface.build_again());
    archive("gc", gc);
    archive("planner", planner);
    archive("start_compatibly", start_compatibly);
    archive("frames", frames);
    archive("windows", windows);
  };
  if (persistence.restarts())
    persistence.restore(state);
  else
    after_window({plan, report[Side::fluid], report[Side::solid], gc.balance(), interface.report(),
                  interface.surface(Side::solid), gc.window_force(Side::solid), interface.builds(),
                  gc.factorisations()});
  CheckpointKeeper keeper(persistence, partner, say);
  keeper.at_start(planner.time(), state);

  while (!planner.finished())
  {
    plan = planner.next(report[Side::fluid].stable_dt, report[Side::solid].stable_dt);
    const bool frame_due = frame_is_due(config, plan, frames);
    frames += frame_due;
    for (const Side s : both_sides)
      partner[s]->send_window({.index = plan.index,
                               .t_begin = plan.t_begin,
                               .t_end = plan.t_end,
                               .steps = s == plan.steps.fine ? plan.steps.m : 1,
                               .fine = s == plan.steps.fine,
                               .activate = start_compatibly,
                               .output = frame_due,
                               .last = plan.last});
    if (start_compatibly)
      activate(gc, partner);
    start_compatibly = false;

    gc.advance(plan.steps, fluid_partner, solid_partner);
    ++windows;

    for (const Side s : both_sides)
      report[s] = partner[s]->receive_report();
    after_window({plan, report[Side::fluid], report[Side::solid], gc.balance(), interface.report(),
                  interface.surface(Side::solid), gc.window_force(Side::solid), interface.builds(),
                  gc.factorisations()});

    start_compatibly = renew_operator(interface, gc, partner, report);
    if (keeper.after_window(planner.time(), windows, state))
      break;
  }
  for (link::PartnerLink* p : partner)
    p->send_bye();
  return windows;
}

} // namespace undine::coupler
