// The coupler's time loop.
#include "coupler/run.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <span>

namespace undine::coupler
{

namespace
{

/// A participant behind the protocol.
class LinkedPartner : public Partner
{
public:
  explicit LinkedPartner(link::PartnerLink& link) : link_(link) {}
  void receive_free_velocity(std::span<double> v_free) override { link_.receive_free_velocity(v_free); }
  void send_link_force(std::span<const double> f_link) override { link_.send_link_force(f_link); }

private:
  link::PartnerLink& link_;
};

Vector as_vector(const std::vector<double>& v)
{
  return Eigen::Map<const Vector>(v.data(), static_cast<Eigen::Index>(v.size()));
}

std::vector<double> as_std(const Vector& v) { return {v.data(), v.data() + v.size()}; }

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

std::int64_t run_coupler(const CouplerConfig& config, link::PartnerLink& fluid, link::PartnerLink& solid,
                         const std::function<void(const WindowRecord&)>& after_window)
{
  const std::array<link::PartnerLink*, 2> partner{&fluid, &solid};
  link::Setup setup{.dim = config.run.dim,
                    .t_begin = config.run.t_begin,
                    .t_end = config.run.t_end,
                    .scheme = config.coupling.scheme};
  for (const auto& i : config.coupling.interfaces)
    setup.interfaces.push_back(i.name);

  for (link::PartnerLink* p : partner)
    p->send_setup(setup);
  Interface interface(config.coupling, fluid.receive_mesh(), solid.receive_mesh());
  InterfaceOperator H;
  try
  {
    H = interface.build();
  }
  catch (const std::exception& error)
  {
    for (link::PartnerLink* p : partner)
      p->reject_mesh(error.what());
    throw;
  }
  for (link::PartnerLink* p : partner)
    p->accept_mesh();

  GravouilCombescure gc(std::move(H), config.run.dim);
  WindowPlanner planner(rules_of(config.coupling), config.run.t_begin, config.run.t_end);
  LinkedPartner fluid_partner(fluid), solid_partner(solid);
  std::array<link::Report, 2> report{fluid.receive_report(), solid.receive_report()};
  bool start_compatibly = true;
  std::int64_t frames = 1, windows = 0;
  WindowPlanner::Plan plan{.t_begin = config.run.t_begin, .t_end = config.run.t_begin};
  after_window({plan, report[Side::fluid], report[Side::solid], gc, interface});

  while (!planner.finished())
  {
    plan = planner.next(report[Side::fluid].stable_dt, report[Side::solid].stable_dt);
    const bool frame_due =
        plan.last || (config.frame_interval > 0.0 &&
                      plan.t_end >= config.run.t_begin +
                                        static_cast<double>(frames) * config.frame_interval * (1.0 - 1e-12));
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
    after_window({plan, report[Side::fluid], report[Side::solid], gc, interface});

    for (const Side s : both_sides)
      if (report[s].surface_changed)
        interface.replace_surface(s, partner[s]->receive_mesh_update());
      else
        interface.move(s, gc.travel(s));
    start_compatibly = report[Side::fluid].surface_changed || report[Side::solid].surface_changed;
    if (start_compatibly)
    {
      for (const Side s : both_sides)
        interface.fix_positions(s);
      gc.replace_operator(interface.build());
    }
    else if (interface.has_deformed())
      gc.turn_operator(interface.build());
    if (fluid.stop_requested() || solid.stop_requested())
      break;
  }
  for (link::PartnerLink* p : partner)
    p->send_bye();
  return windows;
}

} // namespace undine::coupler
