// Windows of one step with contact that opens and closes.
#include "coupler/run_contact.hpp"

#include "coupler/contact.hpp"

namespace undine::coupler
{

namespace
{

InterfaceReport interface_report(const InterfaceConfig& config, const link::SurfaceMesh& solid)
{
  InterfaceReport report;
  report.name = config.name;
  report.multiplier_side = Side::fluid;
  report.measure[Side::solid] = 0.0;
  report.multipliers = static_cast<int>(solid.n_faces());
  return report;
}

template <int dim>
std::int64_t run(const CouplerConfig& config, link::PartnerLink& fluid, link::PartnerLink& solid,
                 const std::function<void(const WindowRecord&)>& after_window, const Persistence& persistence,
                 const std::function<void(const std::string&)>& say)
{
  const std::array<link::PartnerLink*, 2> partner{&fluid, &solid};
  link::Setup setup = setup_of(config);
  setup.scheme = link::contact_surface_scheme;
  fluid.send_setup(setup);
  setup.scheme = link::contact_scheme;
  solid.send_setup(setup);
  const link::SurfaceMesh solid_mesh = solid.receive_mesh();
  fluid.send_surface(solid_mesh);
  UnilateralContact<dim> contact(fluid.receive_mesh(), solid_mesh);
  for (link::PartnerLink* p : partner)
    p->accept_mesh();

  WindowRules rules = rules_of(config.coupling);
  rules.substeps = 1;
  WindowPlanner planner(rules, config.run.t_begin, config.run.t_end);
  std::array<link::Report, 2> report{fluid.receive_report(), solid.receive_report()};
  std::vector<InterfaceReport> interfaces;
  for (const auto& i : config.coupling.interfaces)
    interfaces.push_back(interface_report(i, solid_mesh));
  std::array<std::vector<double>, 2> v, f;
  std::int64_t frames = 1, windows = 0;
  WindowPlanner::Plan plan{.t_begin = config.run.t_begin, .t_end = config.run.t_begin};
  const auto record = [&]
  {
    for (const Side s : both_sides)
      contact.balance().work[s] = report[s].interface_work;
    after_window({plan, report[Side::fluid], report[Side::solid], contact.balance(), interfaces,
                  contact.solid(), f[Side::solid], contact.report().searches, contact.report().solves});
  };
  const StateVisitor state = [&](StateArchive& archive)
  {
    archive("contact", contact);
    archive("planner", planner);
    archive("frames", frames);
    archive("windows", windows);
  };
  if (persistence.restarts())
    persistence.restore(state);
  else
    record();
  CheckpointKeeper keeper(persistence, partner, say);
  keeper.at_start(planner.time(), state);

  while (!planner.finished())
  {
    plan = planner.next(report[Side::fluid].stable_dt, report[Side::solid].stable_dt);
    const bool frame = frame_is_due(config, plan, frames);
    frames += frame;
    for (const Side s : both_sides)
      partner[s]->send_window({.index = plan.index,
                               .t_begin = plan.t_begin,
                               .t_end = plan.t_end,
                               .steps = 1,
                               .fine = true,
                               .output = frame,
                               .last = plan.last});
    for (const Side s : both_sides)
    {
      v[s].resize(contact.size(s));
      partner[s]->receive_free_velocity(v[s]);
    }
    contact.advance(plan.t_end - plan.t_begin, v, f);
    for (const Side s : both_sides)
      partner[s]->send_link_force(f[s]);
    ++windows;

    report[Side::solid] = solid.receive_report();
    if (report[Side::solid].surface_changed)
      contact.replace_solid(solid.receive_mesh_update());
    report[Side::fluid] = fluid.receive_report();
    if (report[Side::fluid].surface_changed)
    {
      fluid.send_surface(contact.solid());
      contact.replace_fluid(fluid.receive_mesh_update());
      report[Side::fluid] = fluid.receive_report();
    }
    record();
    if (keeper.after_window(planner.time(), windows, state))
      break;
  }
  for (link::PartnerLink* p : partner)
    p->send_bye();
  return windows;
}

} // namespace

std::int64_t run_contact(const CouplerConfig& config, link::PartnerLink& fluid, link::PartnerLink& solid,
                         const std::function<void(const WindowRecord&)>& after_window,
                         const Persistence& persistence, const std::function<void(const std::string&)>& say)
{
  return config.run.dim == 2 ? run<2>(config, fluid, solid, after_window, persistence, say)
                             : run<3>(config, fluid, solid, after_window, persistence, say);
}

} // namespace undine::coupler
