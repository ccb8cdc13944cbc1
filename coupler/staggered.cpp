// Staggered windows with solids at level A.
#include "common/error.hpp"
#include "coupler/permanent.hpp"

#include <fmt/format.h>

namespace undine::coupler
{

namespace
{

/// The fluid alone carries the operator: as many multipliers as it has nodes, not more.
CouplerConfig with_fluid_multipliers(CouplerConfig config)
{
  for (auto& i : config.coupling.interfaces)
    i.multiplier = "fluid";
  return config;
}

class Staggered : public PermanentScheme
{
public:
  Staggered(const CouplerConfig& config, const Sides& side)
      : PermanentScheme(with_fluid_multipliers(config), side, {"gc", link::staggered_scheme}),
        rules_(rules_of(config.coupling))
  {
    rules_.fine = Side::fluid;
    rules_.substeps = 1;
    refuse_unstable(gc_.added_mass_ratio());
    accept_meshes(side_);
    v_solid_ = as_vector(side_[Side::solid]->receive_motion().v);
  }

  WindowRules rules() const override { return rules_; }

  Order order(Side side, const WindowPlanner::Plan&) const override
  {
    return {.steps = 1, .fine = side == Side::fluid, .activate = side == Side::fluid && start_compatibly_};
  }

  void exchange(const WindowPlanner::Plan& plan, const std::array<link::Window, 2>&) override
  {
    Group &fluid = *side_[Side::fluid], &solid = *side_[Side::solid];
    if (start_compatibly_)
    {
      const link::Kinematics k = fluid.receive_kinematics();
      const auto start = gc_.activate_prescribed(as_vector(k.v), as_vector(k.a_free), v_solid_);
      fluid.send_activation({.impulse = as_std(start.impulse[Side::fluid]),
                             .link_force = as_std(start.link_force[Side::fluid])});
    }
    solid.send_link_force(as_std(gc_.state().f[Side::solid]));
    v_solid_ = as_vector(solid.receive_motion().v);
    gc_.advance_prescribed(plan.t_end - plan.t_begin, fluid, v_solid_);
  }

  void for_each_state(StateArchive& archive) override
  {
    PermanentScheme::for_each_state(archive);
    archive("v_solid", v_solid_);
  }

private:
  /// Conventional staggering multiplies a wrong interface velocity by −q per window.
  void refuse_unstable(double q) const
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
    reject_meshes(side_, text);
    throw InputError(text);
  }

  WindowRules rules_;
  Vector v_solid_;
};

} // namespace

std::unique_ptr<Scheme> meet_staggered(const CouplerConfig& config, const Sides& side)
{
  return std::make_unique<Staggered>(config, side);
}

} // namespace undine::coupler
