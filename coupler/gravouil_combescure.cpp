// One window of the Gravouil-Combescure scheme, and the compatible start.
#include "coupler/gravouil_combescure.hpp"

#include "common/error.hpp"

#include <utility>

namespace undine::coupler
{

namespace
{

std::span<double> as_span(Vector& v) { return {v.data(), static_cast<std::size_t>(v.size())}; }
std::span<const double> as_span(const Vector& v) { return {v.data(), static_cast<std::size_t>(v.size())}; }

/// Sum of the nodal vectors, one entry per component.
Vector resultant(const Vector& f, int dim)
{
  Vector sum = Vector::Zero(dim);
  for (Eigen::Index k = 0; k < f.size(); ++k)
    sum[k % dim] += f[k];
  return sum;
}

} // namespace

GravouilCombescure::GravouilCombescure(InterfaceOperator H, int dim) : dim_(dim)
{
  replace_operator(std::move(H));
}

void GravouilCombescure::replace_operator(InterfaceOperator H)
{
  factorisations_ += H_.factorisations();
  H_ = std::move(H);
  lambda_ = Vector::Zero(H_.n_multipliers());
  for (const Side s : both_sides)
  {
    v_[s] = Vector::Zero(H_.n_dofs(s));
    f_[s] = Vector::Zero(H_.n_dofs(s));
    travel_[s] = Vector::Zero(H_.n_dofs(s));
    if (impulse_[s].size() == 0)
      impulse_[s] = Vector::Zero(dim_);
  }
}

GravouilCombescure::Start GravouilCombescure::activate(const std::array<Vector, 2>& v,
                                                       const std::array<Vector, 2>& a_free)
{
  // (L_f M_f⁻¹ L_fᵀ + L_s M_s⁻¹ L_sᵀ) Λ = −(L_f v_f + L_s v_s): the velocity jump closes inelastically.
  const Vector jump = H_.constraint(Side::fluid, v[Side::fluid]) + H_.constraint(Side::solid, v[Side::solid]);
  const Vector Lambda = H_.solve(1.0, 1.0, -jump);
  balance_.activation_loss -= 0.5 * Lambda.dot(jump);
  // The same operator makes the accelerations compatible; otherwise e = L_f a_f + L_s a_s would alternate in
  // sign for ever.
  lambda_ = H_.solve(
      1.0, 1.0,
      -(H_.constraint(Side::fluid, a_free[Side::fluid]) + H_.constraint(Side::solid, a_free[Side::solid])));

  Start start;
  for (const Side s : both_sides)
    start_side(s, v[s], Lambda, start);
  return start;
}

/// Applies Λ and λ to one side.
void GravouilCombescure::start_side(Side s, const Vector& v, const Vector& Lambda, Start& start)
{
  start.impulse[s] = H_.force(s, Lambda);
  start.link_force[s] = H_.force(s, lambda_);
  v_[s] = v + H_.acceleration(s, start.impulse[s]);
  f_[s] = start.link_force[s];
  impulse_[s] += resultant(start.impulse[s], dim_);
}

GravouilCombescure::Start GravouilCombescure::activate_prescribed(const Vector& v_fluid,
                                                                  const Vector& a_free_fluid,
                                                                  const Vector& v_solid)
{
  const Vector jump = H_.constraint(Side::fluid, v_fluid) + H_.constraint(Side::solid, v_solid);
  const Vector Lambda = H_.solve(1.0, 0.0, -jump);
  balance_.activation_loss -= 0.5 * Lambda.dot(jump);
  lambda_ =
      H_.solve(1.0, 0.0, -H_.constraint(Side::fluid, a_free_fluid)); // the solid's acceleration is not known
  Start start;
  start_side(Side::fluid, v_fluid, Lambda, start);
  v_[Side::solid] = v_solid;
  f_[Side::solid] = H_.force(Side::solid, lambda_);
  return start;
}

void GravouilCombescure::advance_prescribed(double dt, Partner& fluid, const Vector& v_solid)
{
  Vector v_free(H_.n_dofs(Side::fluid));
  fluid.receive_free_velocity(as_span(v_free));
  const Vector lambda_begin = lambda_;
  lambda_ =
      H_.solve(0.5 * dt, 0.0, -(H_.constraint(Side::fluid, v_free) + H_.constraint(Side::solid, v_solid)));
  const Vector f_link = H_.force(Side::fluid, lambda_);
  fluid.send_link_force(as_span(f_link));
  record_step(Side::solid, dt, v_solid, f_[Side::solid]); // it was driven by the force of the step before
  // The solid gets the mean over the fluid's step: the fluid's impulse, and free of the part of λ that
  // alternates from step to step where a velocity is prescribed. Fed back, that part would grow as (1 + 2q)ⁿ.
  f_[Side::solid] = H_.force(Side::solid, 0.5 * (lambda_begin + lambda_));
  record_step(Side::fluid, dt, v_free + 0.5 * dt * H_.acceleration(Side::fluid, f_link), f_link);
  record_window();
}

double GravouilCombescure::added_mass_ratio()
{
  const SparseMatrix A_solid = H_.assemble(0.0, 1.0);
  Vector x = Vector::LinSpaced(H_.n_multipliers(), 1.0, 2.0);
  double q = 0.0;
  for (int k = 0; k < 200 && x.norm() > 0.0; ++k) // power iteration: similar to a symmetric matrix
  {
    x /= x.norm();
    x = H_.solve(1.0, 0.0, A_solid * x);
    q = x.norm();
  }
  return q;
}

void GravouilCombescure::turn_operator(InterfaceOperator H)
{
  require(H.n_dofs(Side::fluid) == v_[Side::fluid].size() && H.n_dofs(Side::solid) == v_[Side::solid].size(),
          "the same wet nodes");
  factorisations_ += H_.factorisations();
  H_ = std::move(H);
}

void GravouilCombescure::restore(const State& state)
{
  for (const Side s : both_sides)
  {
    require(state.v[s].size() == H_.n_dofs(s) && state.f[s].size() == H_.n_dofs(s),
            "the state fits the wet surfaces");
    v_[s] = state.v[s];
    f_[s] = state.f[s];
  }
}

void GravouilCombescure::for_each_state(StateArchive& archive)
{
  archive("lambda", lambda_);
  archive("v", v_);
  archive("f", f_);
  archive("travel", travel_);
  archive("impulse", impulse_);
  archive("balance", balance_);
  archive("factorisations", factorisations_);
  archive("window_force", window_force_);
  archive("window_time", window_time_);
}

void GravouilCombescure::advance(const WindowSteps& steps, Partner& fluid, Partner& solid)
{
  const Side c = steps.coarse(), q = steps.fine;
  Partner& coarse = c == Side::fluid ? fluid : solid;
  Partner& fine = q == Side::fluid ? fluid : solid;
  const double dT = steps.coarse_dt, dt = steps.fine_dt();
  const double alpha_fluid = 0.5 * steps.dt(Side::fluid), alpha_solid = 0.5 * steps.dt(Side::solid);

  // Free part of the coarse velocity at the window's begin, for the step of *this* window.
  const Vector v_free_begin = v_[c] - 0.5 * dT * H_.acceleration(c, f_[c]);
  Vector v_free_end(H_.n_dofs(c));
  coarse.receive_free_velocity(as_span(v_free_end));
  const Vector L_begin = H_.constraint(c, v_free_begin), L_end = H_.constraint(c, v_free_end);

  Vector v_free(H_.n_dofs(q));
  for (std::int64_t j = 1; j <= steps.m; ++j)
  {
    fine.receive_free_velocity(as_span(v_free));
    const double s = static_cast<double>(j) / static_cast<double>(steps.m);
    lambda_ =
        H_.solve(alpha_fluid, alpha_solid, -((1.0 - s) * L_begin + s * L_end + H_.constraint(q, v_free)));
    const Vector f_link = H_.force(q, lambda_);
    fine.send_link_force(as_span(f_link));
    record_step(q, dt, v_free + 0.5 * dt * H_.acceleration(q, f_link), f_link);
  }
  const Vector f_link = H_.force(c, lambda_); // only the last multiplier acts on the coarse side
  coarse.send_link_force(as_span(f_link));
  record_step(c, dT, v_free_end + 0.5 * dT * H_.acceleration(c, f_link), f_link);
  record_window();
}

void GravouilCombescure::record_step(Side side, double dt, const Vector& v_new, const Vector& f_new)
{
  const Vector mean_v = 0.5 * (v_[side] + v_new), mean_f = 0.5 * (f_[side] + f_new);
  balance_.work[side] += dt * mean_f.dot(mean_v);
  impulse_[side] += dt * resultant(mean_f, dim_);
  travel_[side] += dt * mean_v;
  if (window_time_[side] == 0.0)
    window_force_[side] = Vector::Zero(mean_f.size());
  window_force_[side] += dt * mean_f;
  window_time_[side] += dt;
  v_[side] = v_new;
  f_[side] = f_new;
}

void GravouilCombescure::record_window()
{
  for (const Side s : both_sides)
  {
    if (window_time_[s] > 0.0)
      window_force_[s] /= window_time_[s];
    window_time_[s] = 0.0;
  }
  for (const Side s : both_sides)
    balance_.impulse[s] = impulse_[s].norm();
  balance_.impulse_mismatch = (impulse_[Side::fluid] + impulse_[Side::solid]).norm();
  const auto largest = [this](const std::array<Vector, 2>& v)
  {
    return H_.largest_jump(H_.constraint(Side::fluid, v[Side::fluid]) +
                           H_.constraint(Side::solid, v[Side::solid]));
  };
  balance_.velocity_jump = largest(v_);
  balance_.displacement_gap = largest(travel_);
}

} // namespace undine::coupler
