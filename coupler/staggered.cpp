// Staggered windows with a solid at level A.
#include "coupler/staggered.hpp"

#include "common/error.hpp"

#include <fmt/format.h>

namespace undine::coupler
{

namespace
{

/// Conventional staggering multiplies a wrong interface velocity by −q per window.
void refuse_unstable(double q, const std::array<link::PartnerLink*, 2>& partner)
{
  if (q < 1.0)
    return;
  const std::string text = fmt::format("coupling.scheme = \"staggered\": the fluid's mass at the interface "
                                       "is {:.3g} times the solid's, and staggering "
                                       "is unstable from 1 on (added mass), whatever the time step\n       "
                                       "refine the fluid or coarsen the solid at the "
                                       "interface, or use a solid that gives free velocities (level B) and "
                                       "scheme \"gc\", which has no such limit",
                                       q);
  for (link::PartnerLink* p : partner)
    p->reject_mesh(text);
  throw InputError(text);
}

} // namespace

std::int64_t run_staggered(const CouplerConfig& given, link::PartnerLink& fluid, link::PartnerLink& solid,
                           const std::function<void(const WindowRecord&)>& after_window,
                           const Persistence& persistence, const std::function<void(const std::string&)>& say)
{
  // The fluid alone carries the operator: as many multipliers as it has nodes, not more.
  CouplerConfig config = given;
  for (auto& i : config.coupling.interfaces)
    i.multiplier = "fluid";
  const std::array<link::PartnerLink*, 2> partner{&fluid, &solid};
  auto [interface, H] = exchange_surfaces(config, partner, {"gc", link::staggered_scheme});
  GravouilCombescure gc(std::move(H), config.run.dim);
  refuse_unstable(gc.added_mass_ratio(), partner);
  for (link::PartnerLink* p : partner)
    p->accept_mesh();

  WindowRules rules = rules_of(config.coupling);
  rules.fine = Side::fluid;
  rules.substeps = 1;
  WindowPlanner planner(rules, config.run.t_begin, config.run.t_end);
  LinkedPartner fluid_partner(fluid);
  Vector v_solid = as_vector(solid.receive_motion().v);
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
    archive("v_solid", v_solid);
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
    const bool frame = frame_is_due(config, plan, frames);
    frames += frame;
    for (const Side s : both_sides)
      partner[s]->send_window({.index = plan.index,
                               .t_begin = plan.t_begin,
                               .t_end = plan.t_end,
                               .fine = s == Side::fluid,
                               .activate = s == Side::fluid && start_compatibly,
                               .output = frame,
                               .last = plan.last});
    if (start_compatibly)
    {
      const link::Kinematics k = fluid.receive_kinematics();
      const auto start = gc.activate_prescribed(as_vector(k.v), as_vector(k.a_free), v_solid);
      fluid.send_activation({.impulse = as_std(start.impulse[Side::fluid]),
                             .link_force = as_std(start.link_force[Side::fluid])});
    }
    solid.send_link_force(as_std(gc.state().f[Side::solid]));
    v_solid = as_vector(solid.receive_motion().v);
    gc.advance_prescribed(plan.t_end - plan.t_begin, fluid_partner, v_solid);
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
