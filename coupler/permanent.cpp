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
  return {config.coupling, std::move(fluid), std::move(solid)};
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

  void advance(const WindowPlanner::Plan& plan) override
  {
    if (start_compatibly_)
      activate();
    start_compatibly_ = false;
    gc_.advance(plan.steps, *side_[Side::fluid], *side_[Side::solid]);
  }

private:
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
    const auto start = gc_.activate(v, a_free);
    for (const Side s : both_sides)
      side_[s]->send_activation(
          {.impulse = as_std(start.impulse[s]), .link_force = as_std(start.link_force[s])});
  }

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
  else if (interface_.has_deformed())
    gc_.turn_operator(interface_.build());
  return report;
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
  return std::make_unique<OwnSteps>(config, side);
}

} // namespace undine::coupler
