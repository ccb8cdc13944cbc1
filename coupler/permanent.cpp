// The scheme of Gravouil and Combescure on surfaces that stay together.
#include "coupler/permanent.hpp"

#include <exception>
#include <utility>

namespace undine::coupler
{

namespace
{

Interface exchange_surfaces(const CouplerConfig& config, const Sides& side,
                            const std::array<std::string, 2>& scheme)
{
  for (const Side s : both_sides)
    send_setup(config, *side[s], scheme[s]);
  auto fluid = side[Side::fluid]->receive_mesh();
  auto solid = side[Side::solid]->receive_mesh();
  return {config.coupling, std::move(fluid), std::move(solid), 0.99, config.team};
}

InterfaceOperator first_operator(Interface& interface, const Sides& side)
{
  try
  {
    return interface.build();
  }
  catch (const std::exception& error)
  {
    reject_meshes(side, error.what());
    throw;
  }
}

/// Each side with a step of its own.
class OwnSteps : public PermanentScheme
{
public:
  OwnSteps(const CouplerConfig& config, const Sides& side)
      : PermanentScheme(config, side, {"gc", "gc"}), rules_(rules_of(config.coupling))
  {
    accept_meshes(side_);
  }

  WindowRules rules() const override { return rules_; }

  Order order(Side side, const WindowPlanner::Plan& plan) const override
  {
    const bool fine = side == plan.steps.fine;
    return {.steps = fine ? plan.steps.m : 1, .fine = fine, .activate = start_compatibly_};
  }

  void exchange(const WindowPlanner::Plan& plan, const std::array<link::Window, 2>&) override
  {
    if (start_compatibly_)
      activate();
    start_compatibly_ = false;
    gc_.advance(plan.steps, *side_[Side::fluid], *side_[Side::solid]);
  }

protected:
  /// Compatible velocities and accelerations on both sides; see GravouilCombescure::activate.
  void activate()
  {
    std::array<Vector, 2> v, a_free;
    for (const Side s : both_sides)
    {
      const link::Kinematics k = side_[s]->receive_kinematics();
      v[s] = as_vector(k.v);
      a_free[s] = as_vector(k.a_free);
    }
    start_ = gc_.activate(v, a_free);
    for (const Side s : both_sides)
      side_[s]->send_activation(start_of(s));
  }
  link::Activation start_of(Side s) const
  {
    return {.impulse = as_std(start_.impulse[s]), .link_force = as_std(start_.link_force[s])};
  }

private:
  WindowRules rules_;
  GravouilCombescure::Start start_; ///< of this window, if it has one
};

/// The same, continuous at the ends of windows only.
class MacroContinuity : public OwnSteps
{
public:
  using OwnSteps::OwnSteps;

  Order order(Side side, const WindowPlanner::Plan& plan) const override
  {
    Order order = OwnSteps::order(side, plan);
    order.trial = order.fine;
    return order;
  }

  void exchange(const WindowPlanner::Plan& plan, const std::array<link::Window, 2>& orders) override
  {
    Group& fine = *side_[plan.steps.fine];
    link::Window order = orders[plan.steps.fine];
    if (order.activate)
      activate();
    start_compatibly_ = false;
    gc_.advance_macro(plan.steps, *side_[Side::fluid], *side_[Side::solid],
                      [&](bool trial)
                      {
                        fine.receive_report(); // of the trial that is over
                        order.trial = trial;
                        fine.send_window(order);
                        if (!order.activate)
                          return;
                        fine.receive_kinematics();
                        fine.send_activation(start_of(plan.steps.fine));
                      });
  }
};

/// One step of both sides per window, the surfaces meet in its middle.
class HalfStep : public PermanentScheme
{
public:
  HalfStep(const CouplerConfig& config, const Sides& side)
      : PermanentScheme(config, side, {link::contact_scheme, link::contact_scheme}),
        rules_(rules_of(config.coupling))
  {
    rules_.substeps = 1;
    accept_meshes(side_);
  }

  WindowRules rules() const override { return rules_; }
  Order order(Side, const WindowPlanner::Plan&) const override { return {}; }

  void exchange(const WindowPlanner::Plan& plan, const std::array<link::Window, 2>&) override
  {
    gc_.advance_half_step(plan.t_end - plan.t_begin, *side_[Side::fluid], *side_[Side::solid]);
  }

  std::array<link::Report, 2> end_window() override
  {
    const auto report = PermanentScheme::end_window();
    for (const Side s : both_sides)
      gc_.set_work(s, report[s].interface_work);
    return report;
  }

private:
  WindowRules rules_;
};

} // namespace

PermanentScheme::PermanentScheme(const CouplerConfig& config, const Sides& side,
                                 const std::array<std::string, 2>& scheme)
    : side_(side), interface_(exchange_surfaces(config, side, scheme)),
      gc_(first_operator(interface_, side), config.run.dim)
{
}

std::array<link::Report, 2> PermanentScheme::end_window()
{
  const std::array<link::Report, 2> report{side_[Side::fluid]->receive_report(),
                                           side_[Side::solid]->receive_report()};
  for (const Side s : both_sides)
  {
    interface_.move(s, gc_.travel(s));
    if (report[s].surface_changed)
      interface_.replace_surface(s, side_[s]->receive_mesh_update(interface_.surface(s).x));
  }
  start_compatibly_ = report[Side::fluid].surface_changed || report[Side::solid].surface_changed;
  if (start_compatibly_)
  {
    for (const Side s : both_sides)
      interface_.fix_positions(s);
    gc_.replace_operator(interface_.build());
  }
  return report;
}

void PermanentScheme::advance(const WindowPlanner::Plan& plan, const std::array<link::Window, 2>& orders)
{
  if (interface_.has_deformed())
    gc_.turn_operator(interface_.build());
  exchange(plan, orders);
}

void PermanentScheme::for_each_state(StateArchive& archive)
{
  archive("interface", interface_);
  if (archive.reading())
    gc_.turn_operator(interface_.build_again());
  archive("gc", gc_);
  archive("start_compatibly", start_compatibly_);
}

std::unique_ptr<Scheme> meet_permanent(const CouplerConfig& config, const Sides& side)
{
  if (config.coupling.form == "half_step")
    return std::make_unique<HalfStep>(config, side);
  if (config.coupling.form == "macro_continuity")
    return std::make_unique<MacroContinuity>(config, side);
  return std::make_unique<OwnSteps>(config, side);
}

} // namespace undine::coupler
