// One window of the Gravouil-Combescure scheme, and the compatible start.
#include "coupler/gravouil_combescure.hpp"

#include "common/error.hpp"

#include <Eigen/QR>
#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace undine::coupler
{

namespace
{

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
  iterations_ += H_.iterations();
  H_ = std::move(H);
  lambda_ = Vector::Zero(H_.n_multipliers());
  lambda_before_ = lambda_;
  secants_ = {};
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

  lambda_before_ = lambda_;
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
  lambda_before_ = lambda_;
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
  next_lambda(0.5 * dt, 0.0, -(H_.constraint(Side::fluid, v_free) + H_.constraint(Side::solid, v_solid)));
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
  Vector x = Vector::LinSpaced(H_.n_multipliers(), 1.0, 2.0);
  double q = 0.0;
  for (int k = 0; k < 200 && x.norm() > 0.0; ++k) // power iteration: similar to a symmetric matrix
  {
    x /= x.norm();
    x = H_.solve(1.0, 0.0, H_.product(Side::solid, x), q * x);
    q = x.norm();
  }
  return q;
}

void GravouilCombescure::turn_operator(InterfaceOperator H)
{
  require(H.n_dofs(Side::fluid) == v_[Side::fluid].size() && H.n_dofs(Side::solid) == v_[Side::solid].size(),
          "the same wet nodes");
  factorisations_ += H_.factorisations();
  iterations_ += H_.iterations();
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
  archive("lambda_before", lambda_before_);
  archive("secants_of_lambda", secants_.of_lambda);
  archive("secants_of_jump", secants_.of_jump);
  archive("secants_dT", secants_.dT);
  archive("secants_dt", secants_.dt);
  archive("v", v_);
  archive("f", f_);
  archive("travel", travel_);
  archive("impulse", impulse_);
  archive("balance", balance_);
  archive("factorisations", factorisations_);
  archive("window_force", window_force_);
  archive("window_time", window_time_);
}

void GravouilCombescure::next_lambda(double alpha_fluid, double alpha_solid, const Vector& rhs)
{
  const Vector start = 2.0 * lambda_ - lambda_before_;
  lambda_before_ = std::exchange(lambda_, H_.solve(alpha_fluid, alpha_solid, rhs, start));
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
    next_lambda(alpha_fluid, alpha_solid, -((1.0 - s) * L_begin + s * L_end + H_.constraint(q, v_free)));
    const Vector f_link = H_.force(q, lambda_);
    fine.send_link_force(as_span(f_link));
    record_step(q, dt, v_free + 0.5 * dt * H_.acceleration(q, f_link), f_link);
  }
  const Vector f_link = H_.force(c, lambda_); // only the last multiplier acts on the coarse side
  coarse.send_link_force(as_span(f_link));
  record_step(c, dT, v_free_end + 0.5 * dT * H_.acceleration(c, f_link), f_link);
  record_window();
}

void GravouilCombescure::Secants::learn(const Vector& d_lambda, const Vector& d_jump)
{
  constexpr std::size_t most = 12;
  if (of_jump.size() == most)
  {
    of_lambda.erase(of_lambda.begin());
    of_jump.erase(of_jump.begin());
  }
  of_lambda.push_back(d_lambda / d_jump.norm());
  of_jump.push_back(d_jump / d_jump.norm());
}

std::pair<Vector, Vector> GravouilCombescure::Secants::predict(const Vector& jump) const
{
  Vector known = Vector::Zero(jump.size()), rest = jump;
  if (of_jump.empty())
    return {known, rest};
  Eigen::MatrixXd J(jump.size(), static_cast<Eigen::Index>(of_jump.size()));
  for (std::size_t k = 0; k < of_jump.size(); ++k)
    J.col(static_cast<Eigen::Index>(k)) = of_jump[k];
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(J.rows(), J.cols());
  qr.setThreshold(1e-6);
  const Vector weight = qr.compute(J).solve(jump);
  for (std::size_t k = 0; k < of_jump.size(); ++k)
    known += weight[static_cast<Eigen::Index>(k)] * of_lambda[k];
  return {known, rest - J * weight};
}

void GravouilCombescure::advance_macro(const WindowSteps& steps, Partner& fluid, Partner& solid,
                                       const std::function<void(bool trial)>& again)
{
  constexpr int most = 50, patience = 10;
  constexpr double small = 1e-10, learnt = 1e-7, round_off = 1e-8; // of the largest velocity
  const Side c = steps.coarse(), q = steps.fine;
  Partner& coarse = c == Side::fluid ? fluid : solid;
  Partner& fine = q == Side::fluid ? fluid : solid;
  const double dT = steps.coarse_dt, dt = steps.fine_dt();
  Vector v_coarse(H_.n_dofs(c)), v_fine(H_.n_dofs(q));
  coarse.receive_free_velocity(as_span(v_coarse));

  const Vector begin = lambda_;
  const auto run = [&](const Vector& end, bool trial)
  {
    for (std::int64_t j = 1; j <= steps.m; ++j)
    {
      const double s = static_cast<double>(j) / static_cast<double>(steps.m);
      fine.receive_free_velocity(as_span(v_fine));
      const Vector f_link = H_.force(q, (1.0 - s) * begin + s * end);
      fine.send_link_force(as_span(f_link));
      v_fine += 0.5 * dt * H_.acceleration(q, f_link);
      if (!trial)
        record_step(q, dt, v_fine, f_link);
    }
  };
  if (secants_.dT != dT || secants_.dt != dt)
    secants_ = {.dT = dT, .dt = dt};
  lambda_ = 2.0 * begin - lambda_before_;
  lambda_before_ = begin;
  Vector last_lambda, last_jump;
  for (int trial = 1;; ++trial)
  {
    run(lambda_, true);
    const Vector v_end = v_coarse + 0.5 * dT * H_.acceleration(c, H_.force(c, lambda_));
    const Vector jump = H_.constraint(c, v_end) + H_.constraint(q, v_fine);
    const double left = H_.largest_jump(jump),
                 scale = std::max(v_end.lpNorm<Eigen::Infinity>(), v_fine.lpNorm<Eigen::Infinity>());
    if (left <= (trial < patience ? small : round_off) * scale) // stiff water at rest has more than small
      break;
    if (trial == most)
      throw NumericalError(fmt::format(
          "coupling.form = \"macro_continuity\": after {} trials of the window the velocities of "
          "both sides still differ by {:.3g} m/s ({:.3g} m/s at most), expected {:.1g} of it: the "
          "fine side does not answer linearly, or the interface has too many multipliers ({}); use "
          "form = \"gravouil_combescure\"",
          most, left, scale, round_off, H_.n_multipliers()));
    if (trial > 1 && H_.largest_jump(jump - last_jump) > learnt * scale)
      secants_.learn(lambda_ - last_lambda, jump - last_jump);
    last_lambda = lambda_;
    last_jump = jump;
    // The operator of [13] is a little too stiff for the fine side; what the secants know is better.
    const auto [known, rest] = secants_.predict(jump);
    lambda_ -= known + H_.solve(0.5 * steps.dt(Side::fluid), 0.5 * steps.dt(Side::solid), rest);
    again(true);
  }
  again(false);
  run(lambda_, false);
  const Vector f_link = H_.force(c, lambda_);
  coarse.send_link_force(as_span(f_link));
  record_step(c, dT, v_coarse + 0.5 * dT * H_.acceleration(c, f_link), f_link);
  record_window();
}

void GravouilCombescure::advance_half_step(double dt, Partner& fluid, Partner& solid)
{
  const std::array<Partner*, 2> side{&fluid, &solid};
  std::array<Vector, 2> v;
  for (const Side s : both_sides)
  {
    v[s].resize(H_.n_dofs(s));
    side[s]->receive_free_velocity(as_span(v[s]));
  }
  next_lambda(dt, dt,
              -(H_.constraint(Side::fluid, v[Side::fluid]) + H_.constraint(Side::solid, v[Side::solid])));
  for (const Side s : both_sides)
  {
    f_[s] = H_.force(s, lambda_);
    side[s]->send_link_force(as_span(f_[s]));
    v_[s] = v[s] + dt * H_.acceleration(s, f_[s]);
    travel_[s] += dt * v_[s];
    impulse_[s] += dt * resultant(f_[s], dim_);
    window_force_[s] = dt * f_[s];
    window_time_[s] = dt;
  }
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
