// One step of the explicit solid, and how long it may be. How a solid is made: solid_start.cpp.
#include "solid_fe/solid.hpp"

#include "common/error.hpp"
#include "solid_fe/critical_time_step.hpp"
#include "solid_fe/frequency_bounds.hpp"
#include "solid_fe/true_frequency.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

namespace undine::solid
{

namespace
{

/// Verlet's scheme has a resonance of third order at ωΔt = √3 (Schlick et al. 1998), 0.866 of the limit,
/// where large motion makes the highest modes grow; the element bound's step stays below it by its slack.
constexpr double below_resonance = 0.85;

} // namespace

template <int dim>
void Solid<dim>::predict(double dt)
{
  predict_velocity(dt);
  predict_position(dt);
}

template <int dim>
void Solid<dim>::predict_velocity(double dt)
{
  if (dt != dt_)
  {
    t_origin_ = time();
    steps_of_dt_ = 0;
    dt_before_ = dt_ > 0.0 ? dt_ : dt;
    dt_ = dt;
  }
  else
    dt_before_ = dt;
  const double load_time = time();
  ++steps_of_dt_;
  ++step_;

  const double half = 0.5 * dt;
  share_.for_own([&](std::size_t n) { nodes_.v[n] += half * nodes_.a[n]; });
  if (moves_beam())
  {
    for (auto& driven : driven_fibres_) // the velocity in the middle of the step moves the fibre
    {
      driven.v_step = driven_velocity(driven, load_time + half);
      beam_->set_velocity(driven.fibre, driven.component, driven.v_step);
    }
    beam_->predict_velocity(dt);
    show_beam(false);
  }
  for (auto& driven : driven_)
    if (driven.accelerates) // it has had its half step already
      driven.v_step = nodes_.v[driven.node][driven.component];
    else if (driven.function >= 0 &&
             share_.owns(driven.node)) // the velocity in the middle of the step moves it
    {
      driven.v_step = formula_of(driven, load_time + half);
      nodes_.v[driven.node][driven.component] = driven.v_step;
    }
}

template <int dim>
void Solid<dim>::predict_position(double dt)
{
  const double load_time = time() - dt;
  if constexpr (dim == 2)
    if (moves_beam())
    {
      beam_->predict_position(dt);
      for (std::size_t n = 0; n < nodes_.X.size(); ++n)
      {
        const auto& [k, face] = place_[n];
        const auto u = beam_->face_position(face, k) - nodes_.X[n];
        nodes_.v[n] = (1.0 / dt) * (u - nodes_.u[n]); // mean over the step: u gets there below
      }
    }
  share_.for_own([&](std::size_t n) { nodes_.u[n] += dt * nodes_.v[n]; });
  if (share_.is_first())
    for (auto& body : rigid_)
      body.predict(dt, nodes_);
  if (damping_.in_elements()) // to those who hold copies, while the loads are looked at
    share_.halo().start(nodes_.u, nodes_.v);
  else
    share_.halo().start(nodes_.u);
  for (std::size_t n = 0; n < step_of_wet_.size(); ++n)
    step_of_wet_[n] = dt * nodes_.v[n];
  for (const auto& load : loads_)
  {
    const double mean_factor = 0.5 * (load.factor(load_time) + load.factor(time()));
    for (std::size_t k = 0; k < load.nodes.size(); ++k)
    {
      const auto n = static_cast<std::size_t>(load.nodes[k]);
      external_work_[n] += mean_factor * dt * dot(load.force[k], nodes_.v[n]);
    }
  }
}

template <int dim>
void Solid<dim>::solve_free_motion(double dt)
{
  solve_free_motion_of_interface(dt);
  solve_free_motion_of_interior(dt);
}

template <int dim>
void Solid<dim>::solve_free_motion_of_interface(double dt)
{
  share_.clear(F_int_);
  F_viscous_.swap(F_viscous_old_);
  share_.clear(F_viscous_);
  if (damping_.in_elements())
    share_.halo().finish(nodes_.u, nodes_.v);
  else
    share_.halo().finish(nodes_.u);
  update_external_force(time());
  add_internal_force_of(Part::interface, dt);
  add_viscous_force_of(Part::interface);
  F_contact_.swap(F_contact_old_);
  share_.clear(F_contact_);
  if (at_once())
  {
    add_internal_force_of(Part::interior, dt);
    add_viscous_force_of(Part::interior);
  }
  add_contact_force(dt);
  move_free(dt, 0, reference_.n_wet);
  solve_beam(dt);
  finish_driven(dt, Part::interface);
  std::copy_n(nodes_.a.begin(), a_free_wet_.size(), a_free_wet_.begin());
}

template <int dim>
double Solid<dim>::formula_of(const DrivenComponent& driven, double t) const
{
  return driving_[static_cast<std::size_t>(driven.function)](static_cast<std::size_t>(driven.component),
                                                             nodes_.X[driven.node], t);
}

/// The support also works on the node's own mass.
template <int dim>
void Solid<dim>::finish_driven(double dt, Part part)
{
  for (auto& driven : driven_)
    if (driven.function >= 0 && (driven.node < f_link_.size()) == (part == Part::interface) &&
        share_.owns(driven.node))
    {
      double &v = nodes_.v[driven.node][driven.component], value = formula_of(driven, time());
      if (driven.accelerates)
      {
        nodes_.a[driven.node][driven.component] = value;
        v += 0.5 * dt * value;
      }
      else
        v = value;
      external_work_[driven.node] += 0.5 * nodes_.m[driven.node] * (v * v - driven.v_end * driven.v_end);
      driven.v_end = v;
    }
  if (part == Part::interior || !moves_beam())
    return;
  for (auto& driven : driven_fibres_)
  {
    const double v = beam_->v()[driven.fibre][driven.component];
    external_work_[node_of(driven)] +=
        0.5 * beam_->mass(driven.fibre) * (v * v - driven.v_end * driven.v_end);
    driven.v_end = v;
  }
}

template <int dim>
void Solid<dim>::solve_free_motion_of_interior(double dt)
{
  if (!at_once())
  {
    add_internal_force_of(Part::interior, dt);
    add_viscous_force_of(Part::interior);
  }
  count_works(dt);
  if (!beam_)
    move_free(dt, reference_.n_wet, nodes_.size());
  finish_driven(dt, Part::interior);
  solve_rigid_bodies(dt);

  for (auto& driven : driven_)
  {
    if (!share_.owns(driven.node))
      continue;
    const double reaction = driven_force(driven);
    external_work_[driven.node] += 0.5 * (driven.reaction + reaction) * dt * driven.v_step;
    driven.reaction = reaction;
  }
  if (!moves_beam())
    return;
  for (auto& driven : driven_fibres_)
  {
    const double reaction = -beam_->force(driven.fibre)[driven.component];
    external_work_[node_of(driven)] += 0.5 * (driven.reaction + reaction) * dt * driven.v_step;
    driven.reaction = reaction;
  }
}

template <int dim>
double Solid<dim>::critical_time_step() const
{
  const std::span<const Vec<dim>> u(nodes_.u);
  const double contact = contact_ ? contact_->frequency_squared() : 0.0;
  std::vector<double> bounds; // of M⁻¹K and of M⁻¹C, body by body
  for (const auto& body : bodies_)
  {
    bounds.push_back(highest_frequency_squared(body, u));
    bounds.push_back(damping_bound(body, damping_, u));
  }
  ranks().max(bounds);
  double dt = std::numeric_limits<double>::infinity(), measured = dt;
  for (std::size_t k = 0; k < bodies_.size(); ++k)
  {
    const double bound = bounds[2 * k], damping = bounds[2 * k + 1];
    dt = std::min(dt, stable_step(bound + contact, damping));
    measured = std::min(measured, stable_step(frequency_ratio_ * bound + contact, damping));
  }
  if (measures_frequency_ && std::isfinite(measured)) // the bound's step is never too long either
    return std::max(step_safety_ * dt, std::min(step_safety_, below_resonance) * measured);
  if (beam_)
  {
    // Damping acts at the ends of the fibres: on the rotation with the arm squared.
    double share = 1.0;
    for (std::size_t k = 0; k < beam_->n_nodes(); ++k)
      share =
          std::max(share, beam_->mass(k) * norm_squared(beam_->arm(BeamFace::left, k)) / beam_->inertia(k));
    // So does contact, at most four times as strong as on a node of the fibre's whole mass.
    dt = of_first(stable_step(beam_->highest_frequency_squared() +
                                  (contact_ ? share * contact_->frequency_squared() : 0.0),
                              share * damping_.mass));
  }
  return step_safety_ * dt;
}

template <int dim>
void Solid<dim>::measure_frequency()
{
  if (!measures_frequency_)
    return;
  const double bound = bound_of_frequency_squared();
  const bool large_change = !(std::abs(bound - measured_bound_) <= 0.05 * measured_bound_);
  if (measured_bound_ > 0.0 && !large_change && step_ - measured_step_ < 2000)
    return;
  share_.collect(nodes_.u); // all ranks make the same vectors
  frequency_ratio_ = std::min(1.0, true_frequency_squared(*this) / bound);
  measured_bound_ = bound;
  measured_step_ = step_;
}

template <int dim>
double Solid<dim>::bound_of_frequency_squared() const
{
  double omega2 = 0.0;
  for (const auto& body : bodies_)
    omega2 = std::max(omega2, highest_frequency_squared(body, std::span<const Vec<dim>>(nodes_.u)));
  return ranks().max(omega2);
}

template <int dim>
double Solid<dim>::time() const
{
  return t_origin_ + static_cast<double>(steps_of_dt_) * dt_;
}

template <int dim>
void Solid<dim>::set_time(double t)
{
  t_origin_ = t;
  steps_of_dt_ = 0;
}

template <int dim>
std::vector<Vec<dim>> Solid<dim>::internal_force_at(std::span<const Vec<dim>> u) const
{
  std::vector<Vec<dim>> F(u.size());
  for (const auto& body : bodies_)
  {
    auto state = body.state;
    for (const auto part : {Part::interface, Part::interior})
      add_internal_force(body, part, u, 0.0, state, std::span<Vec<dim>>(F));
  }
  share_.collect(F);
  return F;
}

template <int dim>
void Solid<dim>::add_internal_force_of(Part part, double dt)
{
  for (auto& body : bodies_)
  {
    const index_t inverted = add_internal_force(body, part, std::span<const Vec<dim>>(nodes_.u), dt,
                                                body.state, std::span<Vec<dim>>(F_int_));
    if (inverted >= 0)
      fail_inverted(body, inverted);
  }
}

template <int dim>
void Solid<dim>::add_viscous_force_of(Part part)
{
  if (F_viscous_.empty())
    return;
  if (damping_.in_elements())
    for (const auto& body : bodies_)
      add_viscous_force(body, damping_, part, std::span<const Vec<dim>>(nodes_.u),
                        std::span<const Vec<dim>>(nodes_.v), std::span<Vec<dim>>(F_viscous_));
  const auto n_wet = static_cast<std::size_t>(reference_.n_wet);
  share_.for_own(part == Part::interface ? 0 : n_wet, part == Part::interface ? n_wet : nodes_.X.size(),
                 [&](std::size_t n) { F_viscous_[n] += (damping_.mass * nodes_.m[n]) * nodes_.v[n]; });
}

template <int dim>
void Solid<dim>::add_contact_force(double dt)
{
  if (!contact_ || !share_.is_first())
    return;
  share_.for_own(0, F_free_.size(),
                 [&](std::size_t n)
                 {
                   F_free_[n] = F_ext_[n] - F_int_[n];
                   if (!F_viscous_.empty())
                     F_free_[n] -= F_viscous_[n];
                 });
  contact_->add_force(nodes_, dt, F_free_, std::span<Vec<dim>>(F_contact_));
}

/// Works of the step by the trapezoidal rule; v of the wet nodes has moved on already, so their way is taken.
template <int dim>
void Solid<dim>::count_works(double dt)
{
  const auto add = [&](std::vector<double>& work, double sign, const std::vector<Vec<dim>>& F,
                       const std::vector<Vec<dim>>& F_old)
  {
    const auto of_step = std::min(F.size(), step_of_wet_.size());
    const double half = 0.5 * sign;
    share_.for_own(0, of_step,
                   [&](std::size_t n) { work[n] += half * dot(F[n] + F_old[n], step_of_wet_[n]); });
    share_.for_own(of_step, F.size(),
                   [&](std::size_t n) { work[n] += half * dt * dot(F[n] + F_old[n], nodes_.v[n]); });
  };
  add(viscous_work_, 1.0, F_viscous_, F_viscous_old_);
  add(contact_work_, -1.0, F_contact_, F_contact_old_);
  add(external_work_, 1.0, F_formula_, F_formula_old_);
}

template <int dim>
void Solid<dim>::update_external_force(double t)
{
  if (loads_are_full_ && F_formula_.empty())
    return;
  share_.for_own([&](std::size_t n) { F_ext_[n] = given_mass_[n] * gravity_; });
  loads_are_full_ = true;
  for (const auto& load : loads_)
  {
    const double factor = load.factor(t);
    loads_are_full_ = loads_are_full_ && factor == 1.0;
    for (std::size_t k = 0; k < load.nodes.size(); ++k)
      F_ext_[static_cast<std::size_t>(load.nodes[k])] += factor * load.force[k];
  }
  if (F_formula_.empty())
    return;
  F_formula_.swap(F_formula_old_);
  share_.clear(F_formula_);
  if (!body_force_.empty())
    share_.for_own([&](std::size_t n)
                   { F_formula_[n] += given_mass_[n] * body_force_.vector(nodes_.X[n], t); });
  for (const auto& load : formula_loads_)
    load.add(t, nodes_.X, nodes_.u, F_formula_);
  share_.for_own([&](std::size_t n) { F_ext_[n] += F_formula_[n]; });
}

template <int dim>
void Solid<dim>::solve_rigid_bodies(double dt)
{
  if (!share_.is_first())
    return;
  for (auto& body : rigid_)
    body.solve(
        dt,
        [&](std::size_t n)
        {
          Vec<dim> f = F_ext_[n] - F_int_[n];
          for (int i = 0; i < dim; ++i)
            f[i] -= opposing(n, i);
          return f;
        },
        nodes_);
}

template <int dim>
double Solid<dim>::opposing(std::size_t n, int i) const
{
  return (F_viscous_.empty() ? 0.0 : F_viscous_[n][i]) - (F_contact_.empty() ? 0.0 : F_contact_[n][i]);
}

template <int dim>
void Solid<dim>::move_free(double dt, index_t begin, index_t end)
{
  const double half = 0.5 * dt;
  share_.for_own(static_cast<std::size_t>(begin), static_cast<std::size_t>(end),
                 [&](std::size_t n)
                 {
                   for (int i = 0; i < dim; ++i)
                   {
                     const double a =
                         nodes_.inverse_mass[n][i] * (F_ext_[n][i] - F_int_[n][i] - opposing(n, i));
                     nodes_.a[n][i] = a;
                     nodes_.v[n][i] += half * a;
                   }
                 });
}

template <int dim>
double Solid<dim>::driven_force(const DrivenComponent& driven) const
{
  return F_int_[driven.node][driven.component] + opposing(driven.node, driven.component) -
         F_ext_[driven.node][driven.component];
}

template <int dim>
void Solid<dim>::fail_inverted(const Body<dim>& body, index_t element) const
{
  std::visit(
      [&]<class Element>(const ReferenceBlock<Element>& block)
      {
        const auto e = static_cast<std::size_t>(element);
        Vec<dim> x;
        for (const index_t n : block.nodes[e])
          x += (1.0 / Element::nodes) *
               (nodes_.X[static_cast<std::size_t>(n)] + nodes_.u[static_cast<std::size_t>(n)]);
        std::string position;
        for (int i = 0; i < dim; ++i)
          position += fmt::format("{}{:.6g}", i > 0 ? ", " : "", x[i]);
        throw NumericalError(fmt::format(
            "solid: det F of {} number {} near ({}) m is not positive at step {}, t = {:.9g} s: the element "
            "is "
            "inverted. The load is beyond what this mesh and law can carry, or the step is too large",
            element_name(Element::type), block.number[e], position, step_, time()));
      },
      body.block);
  throw InternalError("unreachable");
}

template class Solid<2>;
template class Solid<3>;

} // namespace undine::solid
