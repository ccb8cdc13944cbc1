// Windows of one step with contact that opens and closes.
#include "coupler/contact.hpp"
#include "coupler/run.hpp"

namespace undine::coupler
{

namespace
{

template <int dim>
class ContactScheme : public Scheme
{
public:
  ContactScheme(const CouplerConfig& config, const Sides& side)
      : side_(side), rules_(rules_of(config.coupling)), flight_(config.flight), contact_(meet(config, side))
  {
    rules_.substeps = 1;
    accept_meshes(side_);
    for (const auto& i : config.coupling.interfaces)
      interfaces_.push_back({.name = i.name,
                             .multiplier_side = Side::fluid,
                             .multipliers = static_cast<int>(contact_.solid().n_faces())});
  }

  std::int64_t flight() const override { return flight_ ? contact_.flight() : 1; }

  Order order(Side, const WindowPlanner::Plan& plan) const override
  {
    return {.steps = plan.flight, .flight = plan.flight > 1};
  }

  void advance(const WindowPlanner::Plan& plan, const std::array<link::Window, 2>&) override
  {
    for (const Side s : both_sides)
    {
      v_[s].resize(contact_.size(s));
      side_[s]->receive_free_velocity(v_[s]);
    }
    if (plan.flight > 1)
    {
      contact_.fly(plan.t_end - plan.t_begin, plan.flight, v_);
      for (const Side s : both_sides)
        f_[s].assign(contact_.size(s), 0.0);
      return;
    }
    contact_.advance(plan.t_end - plan.t_begin, v_, f_);
    for (const Side s : both_sides)
      side_[s]->send_link_force(f_[s]);
  }

  std::array<link::Report, 2> end_window() override
  {
    Group &fluid = *side_[Side::fluid], &solid = *side_[Side::solid];
    std::array<link::Report, 2> report;
    report[Side::solid] = solid.receive_report();
    if (report[Side::solid].surface_changed)
      contact_.replace_solid(solid.receive_mesh_update(contact_.solid().x));
    report[Side::fluid] = fluid.receive_report();
    if (report[Side::fluid].surface_changed)
    {
      for (link::PartnerLink* p : fluid.members())
        p->send_surface(contact_.solid());
      contact_.replace_fluid(fluid.receive_mesh_update());
      report[Side::fluid] = fluid.receive_report();
    }
    for (const Side s : both_sides)
      contact_.balance().work[s] = report[s].interface_work;
    return report;
  }

  WindowRules rules() const override { return rules_; }
  const InterfaceBalance& balance() const override { return contact_.balance(); }
  std::span<const InterfaceReport> interfaces() const override { return interfaces_; }
  const link::SurfaceMesh& solid_surface() const override { return contact_.solid(); }
  std::span<const double> solid_force() const override { return f_[Side::solid]; }
  std::int64_t searches() const override { return contact_.report().searches; }
  std::int64_t solves() const override { return contact_.report().solves; }
  void for_each_state(StateArchive& archive) override { archive("contact", contact_); }

private:
  static UnilateralContact<dim> meet(const CouplerConfig& config, const Sides& side)
  {
    send_setup(config, *side[Side::fluid], link::contact_surface_scheme);
    send_setup(config, *side[Side::solid], link::contact_scheme);
    const link::SurfaceMesh solid = side[Side::solid]->receive_mesh();
    for (link::PartnerLink* p : side[Side::fluid]->members())
      p->send_surface(solid);
    std::vector<std::string> no_slip;
    for (const auto& i : config.coupling.interfaces)
      if (i.kind == "no_slip")
        no_slip.push_back(i.name);
    return {side[Side::fluid]->receive_mesh(), solid, std::move(no_slip)};
  }

  Sides side_;
  WindowRules rules_;
  bool flight_;
  UnilateralContact<dim> contact_;
  std::vector<InterfaceReport> interfaces_;
  std::array<std::vector<double>, 2> v_, f_;
};

} // namespace

std::unique_ptr<Scheme> meet_contact(const CouplerConfig& config, const Sides& side)
{
  if (config.run.dim == 2)
    return std::make_unique<ContactScheme<2>>(config, side);
  return std::make_unique<ContactScheme<3>>(config, side);
}

} // namespace undine::coupler
