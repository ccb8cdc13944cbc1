// How a solid is made from its case and mesh, and set in motion.
#include "solid_fe/solid.hpp"

#include "common/error.hpp"
#include "solid_fe/frequency_bounds.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace undine::solid
{

template <int dim>
Solid<dim>::Solid(const SolidConfig& config, const Mesh<dim>& mesh)
    : reference_(number_wet_nodes_first(mesh, config.wet)), wet_(config.wet),
      step_safety_(config.step_safety), gravity_(to_vec<dim>(config.gravity, "solid.gravity"))
{
  const bool is_beam = config.formulation == Formulation::beam;
  const auto motion =
      is_beam ? std::map<index_t, PrescribedMotion<dim>>{} : prescribed_motion(reference_.mesh, config);
  std::vector<double> volume(reference_.mesh.x.size(), 0.0); // of the nodes
  if (!is_beam)
    make_bodies(config, motion, volume);
  measures_frequency_ = config.measures_frequency;
  if (measures_frequency_ && (is_beam || !config.rigid.empty() || remembers(make_material(config.material))))
    throw InputError("solid.step_limit = \"measured\": goes with elastic laws only, without beams and rigid "
                     "bodies; use \"bound\"");
  damping_ = {.mass = config.material.mass_damping,
              .stiffness = config.material.stiffness_damping,
              .elastic = elastic_constants(config.material.youngs_modulus, config.material.poisson_ratio),
              .hourglass = config.formulation == Formulation::one_point ? config.hourglass_viscosity : 0.0,
              .hourglass_modulus = config.material.youngs_modulus};
  if (is_beam)
  {
    make_beam(config);
    for (std::size_t k = 0; k < volume.size(); ++k)
      volume[k] = 0.5 * beam_->mass(place_[k].first) / config.material.density;
  }
  else if (bodies_.empty())
    throw InputError("mesh: no element of dimension " + std::to_string(dim) + " in the solid's mesh",
                     ExitCode::bad_input_file);

  loads_ = nodal_loads(reference_.mesh, config);
  formula_loads_ = formula_loads(reference_.mesh, config);
  body_force_ = FieldFunction(config.body_force_function, "solid.body_force_function");
  for (std::size_t k = 0; k < config.velocity.size(); ++k)
    driving_.emplace_back(config.velocity[k].function, "solid.velocity[" + std::to_string(k) + "].function");

  make_nodes(config, volume);
  prescribe(config, motion);
  for (std::size_t k = 0; k < config.rigid.size(); ++k)
  {
    const std::string key = "solid.rigid[" + std::to_string(k) + "]";
    rigid_.emplace_back(find_nodes(reference_.mesh, config.rigid[k], key), reference_.n_wet, key, nodes_);
  }
  make_room(config);

  const auto v0 = to_vec<dim>(config.initial_velocity, "solid.initial_velocity");
  const FieldFunction v0_function(config.initial_velocity_function, "solid.initial_velocity_function");
  set_motion([](const Vec<dim>&) { return Vec<dim>{}; },
             [&](const Vec<dim>& X) { return v0_function.empty() ? v0 : v0_function.vector(X, 0.0); });
}

/// Elements and their state, and the volume of their nodes.
template <int dim>
void Solid<dim>::make_bodies(const SolidConfig& config,
                             const std::map<index_t, PrescribedMotion<dim>>& motion, std::span<double> volume)
{
  const auto part = parts_that_keep_their_shape(reference_.mesh, config, motion);
  const Material material = make_material(config.material);
  const double modulus = config.material.youngs_modulus; // of the hourglass control: does not grow near ν = ½
  BlockOptions options{.formulation = config.formulation,
                       .plane = config.plane,
                       .hourglass_modulus = config.hourglass_stiffness * modulus,
                       .part = config.skips_idle_elements ? part : std::span<const int>{}};
  const auto make_blocks = [&]
  {
    std::fill(volume.begin(), volume.end(), 0.0);
    return reference_blocks(reference_.mesh, reference_.n_wet, options, volume);
  };
  auto blocks = make_blocks();
  const auto is_idle = [](const auto& block) { return block.n_active == 0; };
  if (std::all_of(blocks.begin(), blocks.end(), [&](const auto& any) { return std::visit(is_idle, any); }))
  {
    options.part = {}; // nothing else would say how long a step and how stiff a contact may be
    blocks = make_blocks();
  }
  for (auto& block : blocks)
  {
    auto& body = bodies_.emplace_back(
        Body<dim>{std::move(block), material, config.material.density, config.plane == PlaneKind::stress});
    body.state = virgin_state(body, reference_.mesh.n_nodes());
  }
}

/// Nodes at rest with their masses, added ones included.
template <int dim>
void Solid<dim>::make_nodes(const SolidConfig& config, std::span<const double> volume)
{
  const auto n = reference_.mesh.x.size();
  share_ = NodeShare(n);
  nodes_.X = reference_.mesh.x;
  nodes_.u.resize(n);
  nodes_.v.resize(n);
  nodes_.a.resize(n);
  nodes_.m.resize(n);
  nodes_.inverse_mass.resize(n);
  for (std::size_t k = 0; k < n; ++k)
    nodes_.m[k] = config.material.density * volume[k];
  given_mass_ = nodes_.m;
  const double bound = bound_frequencies<dim>(bodies_, nodes_.m);
  if (config.scaled_step > 0.0)
  {
    if (beam_)
      throw InputError(
          "solid.mass_scaling_step: a beam takes no added mass; its rotary inertia is scaled already");
    // 2 step_safety / ω is the step; a little less is allowed, so that it is reached in spite of round-off
    const double allowed = std::pow(2.0 * step_safety_ / config.scaled_step, 2) * (1.0 - 1e-9);
    added_mass_.resize(bodies_.size());
    if (bound > allowed)
      added_mass_ = scale_masses<dim>(bodies_, allowed, nodes_.m);
  }
}

/// Supports and driven components; ends of fibres move with the beam only.
template <int dim>
void Solid<dim>::prescribe(const SolidConfig& config, const std::map<index_t, PrescribedMotion<dim>>& motion)
{
  for (std::size_t k = 0; k < nodes_.m.size(); ++k)
    for (int i = 0; i < dim; ++i)
      nodes_.inverse_mass[k][i] = beam_ ? 0.0 : 1.0 / nodes_.m[k];
  for (const auto& [node, prescribed] : motion)
    for (int i = 0; i < dim; ++i)
      if (prescribed.fixed[static_cast<std::size_t>(i)])
      {
        nodes_.inverse_mass[static_cast<std::size_t>(node)][i] = 0.0;
        nodes_.v[static_cast<std::size_t>(node)][i] = prescribed.v[i];
        const int function = prescribed.function[static_cast<std::size_t>(i)];
        if (prescribed.v[i] != 0.0 || function >= 0)
          driven_.push_back(
              {static_cast<std::size_t>(node), i, 0.0, function, prescribed.v[i],
               function >= 0 && config.velocity[static_cast<std::size_t>(function)].is_acceleration});
      }
}

/// For forces and works of what the case has, and the contact.
template <int dim>
void Solid<dim>::make_room(const SolidConfig& config)
{
  const auto n = reference_.mesh.x.size();
  F_int_.resize(n);
  F_ext_.resize(n);
  external_work_.resize(n);
  if (!formula_loads_.empty() || !body_force_.empty())
  {
    F_formula_.resize(n);
    F_formula_old_.resize(n);
  }
  if (!config.wall.empty() || !config.contact.empty())
  {
    const double omega2 = beam_ ? beam_->highest_frequency_squared() : bound_of_frequency_squared();
    contact_.emplace(config, reference_.mesh, nodes_, omega2);
    F_contact_.resize(n);
    F_contact_old_.resize(n);
    contact_work_.resize(n);
    if (contact_->by_impulse())
    {
      if (beam_ || !rigid_.empty())
        throw InputError("solid.contact_method = \"impulse\": beams and rigid bodies need \"penalty\"");
      F_free_.resize(n);
    }
  }
  if (damping_.any())
  {
    F_viscous_.resize(n);
    F_viscous_old_.resize(n);
    viscous_work_.resize(n);
  }
  const auto n_wet = static_cast<std::size_t>(reference_.n_wet);
  a_free_wet_.resize(n_wet);
  f_link_.resize(n_wet);
  interface_work_.resize(n_wet);
  step_of_wet_.resize(beam_ ? n : n_wet);
}

template <int dim>
void Solid<dim>::set_motion(const std::function<Vec<dim>(const Vec<dim>&)>& u,
                            const std::function<Vec<dim>(const Vec<dim>&)>& v, double t)
{
  for (std::size_t n = 0; n < nodes_.X.size(); ++n)
  {
    nodes_.u[n] = u(nodes_.X[n]);
    const auto v_n = v(nodes_.X[n]);
    for (int i = 0; i < dim; ++i)
      if (nodes_.inverse_mass[n][i] > 0.0) // prescribed components keep their velocity
        nodes_.v[n][i] = v_n[i];
  }
  for (auto& body : rigid_)
  {
    for (const auto n : body.members())
      nodes_.v[n] = v(nodes_.X[n]);
    body.start(nodes_);
  }
  if constexpr (dim == 2)
    if (beam_)
      set_motion_of_beam(u, v, t);
  for (auto& driven : driven_)
    if (driven.accelerates)
      nodes_.v[driven.node][driven.component] = v(nodes_.X[driven.node])[driven.component];
    else if (driven.function >= 0)
      nodes_.v[driven.node][driven.component] = formula_of(driven, t);
  for (auto& body : bodies_)
    std::fill(body.state.history.begin(), body.state.history.end(), Lanes(0.0));
  t_origin_ = t;
  steps_of_dt_ = step_ = 0;
  loads_are_full_ = false;
  update_external_force(t);
  std::fill(F_contact_.begin(), F_contact_.end(), Vec<dim>{});
  add_contact_force(0.0);
  std::fill(F_int_.begin(), F_int_.end(), Vec<dim>{});
  std::fill(F_viscous_.begin(), F_viscous_.end(), Vec<dim>{});
  for (const auto part : {Part::interface, Part::interior})
  {
    add_internal_force_of(part, 0.0);
    add_viscous_force_of(part);
  }
  move_free(0.0, 0, nodes_.size());
  solve_beam(0.0);
  solve_rigid_bodies(0.0);
  for (const auto& driven : driven_)
    if (driven.accelerates)
      nodes_.a[driven.node][driven.component] = formula_of(driven, t);
  std::copy_n(nodes_.a.begin(), a_free_wet_.size(), a_free_wet_.begin());
  std::fill(f_link_.begin(), f_link_.end(), Vec<dim>{});
  start_balances();
  measured_bound_ = 0.0;
  measure_frequency();
}

/// Middle line and rotations of the fibres out of the motion of their ends.
template <int dim>
void Solid<dim>::set_motion_of_beam(const std::function<Vec<dim>(const Vec<dim>&)>& u,
                                    const std::function<Vec<dim>(const Vec<dim>&)>& v,
                                    double t) requires(dim == 2)
{
  std::vector<Vec<2>> u_line, v_line;
  std::vector<double> theta, omega;
  for (std::size_t k = 0; k < fibre_.size(); ++k)
  {
    const auto X = [&](int i)
    { return nodes_.X[static_cast<std::size_t>(fibre_[k][static_cast<std::size_t>(i)])]; };
    const auto half = [](const Vec<2>& a, const Vec<2>& b) { return 0.5 * (a + b); };
    const Vec<2> r0 = half(X(0), -1.0 * X(1)), r = r0 + half(u(X(0)), -1.0 * u(X(1)));
    const Vec<2> dv = half(v(X(0)), -1.0 * v(X(1)));
    u_line.push_back(half(u(X(0)), u(X(1))));
    v_line.push_back(half(v(X(0)), v(X(1))));
    theta.push_back(std::atan2(r0[0] * r[1] - r0[1] * r[0], dot(r0, r)));
    omega.push_back((r[0] * dv[1] - r[1] * dv[0]) / norm_squared(r));
    for (int i = 0; i < 2; ++i)
      if (beam_->is_fixed(k, i))
        v_line[k][i] = 0.0;
    if (beam_->is_fixed(k, 2))
      omega[k] = 0.0;
  }
  for (const auto& driven : driven_fibres_)
    v_line[driven.fibre][driven.component] = driven_velocity(driven, t);
  beam_->set_motion(u_line, theta, v_line, omega);
  show_beam(true);
}

template <int dim>
void Solid<dim>::start_balances()
{
  for (auto* work : {&external_work_, &interface_work_, &viscous_work_, &contact_work_})
    std::fill(work->begin(), work->end(), 0.0);
  gravity_reference_ = gravity_work();
  for (auto& driven : driven_)
  {
    driven.reaction = driven_force(driven);
    driven.v_end = nodes_.v[driven.node][driven.component];
  }
  for (auto& driven : driven_fibres_)
    driven.v_end = beam_->v()[driven.fibre][driven.component];
  for (auto& driven : driven_fibres_)
    driven.reaction = -beam_->force(driven.fibre)[driven.component];
}

template class Solid<2>;
template class Solid<3>;

} // namespace undine::solid
