// The conversations of the scripts.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/conform/conversations.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>

namespace undine::link::conform
{
namespace
{

/// The windows of the recording scripts. Steps are small against the stable one, so that the answer to a link
/// force is that of the mass alone.
struct Planned
{
  double dt;          ///< of one step, over the stable step
  std::int64_t steps; ///< of the window
  bool fine;
  bool activate;
};
constexpr Planned plan[] = {{0.02, 1, false, true},  {0.02, 1, false, false}, {0.01, 4, true, false},
                            {0.02, 1, true, false},  {0.015, 1, false, true}, {0.005, 3, true, false},
                            {0.02, 1, false, false}, {0.02, 1, false, false}};

/// A reproducible kick of every component, not the same for two.
std::vector<double> pattern(std::size_t size)
{
  std::vector<double> values(size);
  for (std::size_t k = 0; k < size; ++k)
    values[k] = std::sin(1.0 + 2.7 * static_cast<double>(k));
  return values;
}

void judge_mesh(const SurfaceMesh& mesh, const Options& options, Findings& findings)
{
  const auto dim = static_cast<std::size_t>(mesh.dim);
  for (const auto& name : options.interfaces)
  {
    bool has_faces = false;
    for (const std::int32_t i : mesh.face_interface)
      has_faces = has_faces || mesh.interfaces[static_cast<std::size_t>(i)] == name;
    findings.expect(has_faces, "4.4", "MESH has faces of interface '" + name + "'");
  }
  const std::set<std::int64_t> unique(mesh.node_id.begin(), mesh.node_id.end());
  findings.expect(unique.size() == mesh.node_id.size(), "4.4", "MESH has each node once");
  std::vector<bool> used(mesh.node_id.size(), false);
  for (const std::int32_t n : mesh.face_nodes)
    used[static_cast<std::size_t>(n)] = true;
  bool all_used = true, symmetric = true, positive = true;
  double largest = 0.0;
  for (std::size_t n = 0; n < mesh.node_id.size(); ++n)
  {
    all_used = all_used && used[n];
    for (std::size_t i = 0; i < dim; ++i)
    {
      const auto W = [&](std::size_t a, std::size_t b) { return mesh.inverse_mass[(n * dim + a) * dim + b]; };
      largest = std::max(largest, W(i, i));
      positive = positive && W(i, i) >= 0.0;
      for (std::size_t j = 0; j < dim; ++j)
        symmetric =
            symmetric && std::abs(W(i, j) - W(j, i)) <= 1e-12 * (std::abs(W(i, i)) + std::abs(W(j, j)));
    }
  }
  findings.expect(all_used, "4.4", "every node of MESH belongs to a face");
  findings.expect(symmetric && positive && largest > 0.0, "4.4",
                  "the inverse masses of MESH are symmetric and not negative, and some node can move");
}

/// SETUP of scheme "contact" to the first READY.
Report begin_contact(PartnerLink& link, const Options& options, SurfaceMesh& mesh)
{
  Setup setup = setup_of(options);
  setup.scheme = contact_scheme;
  link.send_setup(setup);
  mesh = link.receive_mesh();
  link.accept_mesh();
  return link.receive_report();
}

/// The force of step `k` of the plan with one exchange per window: the push over its length, or none.
std::vector<double> push_in(const std::vector<double>& p, double dt, std::size_t k, const Push& push)
{
  std::vector<double> f(p.size(), 0.0);
  if (static_cast<int>(k) == push.exchange)
    for (std::size_t i = 0; i < p.size(); ++i)
      f[i] = p[i] / dt;
  return f;
}

/// Level A: the plan's windows with one step each, the push as the force of a whole window.
Record converse_with_forces(PartnerLink& link, const Options& options, const Push& push, Findings* findings)
{
  Record record;
  link.send_setup(setup_of(options));
  record.mesh = link.receive_mesh();
  link.accept_mesh();
  Motion before = link.receive_motion();
  const Report start = link.receive_report();
  if (findings != nullptr)
  {
    judge_mesh(record.mesh, options, *findings);
    findings->expect(before.x == record.mesh.x, "8.1", "the first MOTION has the positions of MESH");
  }
  const auto p = kick(record.mesh);
  double t = 0.0, off = 0.0;
  bool dt_positive = start.stable_dt > 0.0;
  for (std::size_t k = 0; k < std::size(plan); ++k)
  {
    const double dt = plan[k].dt * start.stable_dt;
    link.send_window({.index = static_cast<std::int64_t>(k),
                      .t_begin = t,
                      .t_end = t + dt,
                      .output = k % 2 == 1,
                      .last = k + 1 == std::size(plan)});
    t += dt;
    link.send_link_force(push_in(p, dt, k, push));
    const Motion motion = link.receive_motion();
    record.v_free.push_back(motion.v);
    record.dt.push_back(dt);
    std::vector<double> error(p.size()), travel(p.size());
    for (std::size_t i = 0; i < p.size(); ++i)
    {
      travel[i] = 0.5 * dt * (before.v[i] + motion.v[i]);
      error[i] = motion.x[i] - before.x[i] - travel[i];
    }
    // Positions of the size of a body leave room for round-off only.
    off = std::max(off, (norm(error) - 1e-14 * norm(motion.x)) / std::max(norm(travel), 1e-300));
    before = motion;
    dt_positive = dt_positive && link.receive_report().stable_dt > 0.0;
  }
  link.send_bye();
  if (findings != nullptr)
  {
    findings->expect(dt_positive, "4.2", "every READY tells a stable step");
    findings->expect(off <= 0.5, "8.1", "positions move by the velocities");
    findings->expect(true, "4.5", "windows of changing length, BYE and BYE_ACK");
  }
  return record;
}

/// A window on trial, 4.8: its conversation, with kicks for link forces, and whether its READY is right.
/// @param steps  that the program has made before it
bool try_window(PartnerLink& link, Window window, const std::vector<double>& p, std::int64_t steps)
{
  window.trial = true;
  link.send_window(window);
  const std::vector<double> zero(p.size(), 0.0);
  std::vector<double> v(p.size()), f(p);
  for (double& value : f)
    value /= window.dt();
  if (window.activate)
  {
    link.receive_kinematics();
    link.send_activation({.impulse = zero, .link_force = zero});
  }
  for (std::int64_t j = 0; j < (window.fine ? window.steps : 1); ++j)
  {
    link.receive_free_velocity(v);
    link.send_link_force(f);
  }
  const Report report = link.receive_report();
  return !report.surface_changed && report.steps == steps;
}

} // namespace

std::vector<double> times_inverse_mass(const SurfaceMesh& mesh, const std::vector<double>& f)
{
  const auto dim = static_cast<std::size_t>(mesh.dim);
  std::vector<double> y(f.size(), 0.0);
  for (std::size_t n = 0; n < mesh.node_id.size(); ++n)
    for (std::size_t i = 0; i < dim; ++i)
      for (std::size_t j = 0; j < dim; ++j)
        y[n * dim + i] += mesh.inverse_mass[(n * dim + i) * dim + j] * f[n * dim + j];
  return y;
}

double norm(const std::vector<double>& v)
{
  double sum = 0.0;
  for (const double x : v)
    sum += x * x;
  return std::sqrt(sum);
}

std::vector<double> kick(const SurfaceMesh& mesh)
{
  auto p = pattern(mesh.x.size());
  const double y = norm(times_inverse_mass(mesh, p));
  const double scale = y > 0.0 ? 1e-3 * std::sqrt(static_cast<double>(p.size())) / y : 0.0;
  for (double& value : p)
    value *= scale;
  return p;
}

Setup setup_of(const Options& options)
{
  return {.dim = options.dim,
          .t_begin = 0.0,
          .t_end = 1.0,
          .scheme = options.force_in ? staggered_scheme : "gc",
          .interfaces = options.interfaces};
}

Report begin(PartnerLink& link, const Options& options, SurfaceMesh& mesh)
{
  link.send_setup(setup_of(options));
  mesh = link.receive_mesh();
  link.accept_mesh();
  if (options.force_in)
    link.receive_motion();
  return link.receive_report();
}

Record converse(PartnerLink& link, const Options& options, const Push& push, Findings* findings, bool trials)
{
  if (options.force_in)
    return converse_with_forces(link, options, push, findings);
  Record record;
  const Report start = begin(link, options, record.mesh);
  if (findings != nullptr && !trials)
  {
    judge_mesh(record.mesh, options, *findings);
    findings->expect(start.stable_dt > 0.0, "4.2", "READY tells a stable step");
    findings->expect(start.steps == 0, "4.2", "READY counts steps from 0");
  }
  std::vector<double> zero(record.mesh.x.size(), 0.0), f(zero), v(zero);
  const auto p = kick(record.mesh);
  double t = 0.0;
  std::int64_t steps = 0, index = 0;
  int exchange = 0;
  bool steps_right = true, times_right = true, dt_positive = true, tries_right = true;
  constexpr std::int64_t n_windows = std::size(plan);
  for (const Planned& planned : plan)
  {
    const double length = planned.dt * start.stable_dt * static_cast<double>(planned.steps);
    const Window window{.index = index,
                        .t_begin = t,
                        .t_end = t + length,
                        .steps = planned.steps,
                        .fine = planned.fine,
                        .activate = planned.activate,
                        .output = index % 2 == 1,
                        .last = index + 1 == n_windows};
    if (trials && planned.fine)
      tries_right = try_window(link, window, p, steps) && tries_right;
    link.send_window(window);
    if (planned.activate)
    {
      link.receive_kinematics();
      Activation activation{.impulse = zero, .link_force = zero};
      if (push.activation && index == 0)
      {
        activation.impulse = p;
        for (std::size_t k = 0; k < p.size(); ++k)
          activation.link_force[k] = p[k] / window.dt();
      }
      link.send_activation(activation);
    }
    for (std::int64_t j = 0; j < (planned.fine ? planned.steps : 1); ++j, ++exchange)
    {
      link.receive_free_velocity(v);
      record.v_free.push_back(v);
      record.dt.push_back(window.dt());
      f = zero;
      if (exchange == push.exchange)
        for (std::size_t k = 0; k < p.size(); ++k)
          f[k] = p[k] / window.dt();
      link.send_link_force(f);
    }
    const Report report = link.receive_report();
    steps += planned.steps;
    steps_right = steps_right && report.steps == steps;
    dt_positive = dt_positive && report.stable_dt > 0.0;
    if (report.surface_changed)
    {
      const auto update = link.receive_mesh_update();
      times_right = times_right && update.node_id.size() > 0;
    }
    t = window.t_end;
    ++index;
  }
  link.send_bye();
  if (trials)
    findings->expect(tries_right, "4.8",
                     "READY after a window on trial neither counts its steps nor tells of a new surface");
  if (findings != nullptr && !trials)
  {
    findings->expect(dt_positive, "4.2", "every READY tells a stable step");
    findings->expect(steps_right, "4.3", "READY counts exactly the steps of the windows");
    findings->expect(times_right, "4.4", "MESH_UPDATE has nodes");
    findings->expect(true, "4.5",
                     "windows as coarse side, as fine side with 1, 3 and 4 steps, with changing step, "
                     "with activation at the start and later, BYE and BYE_ACK");
  }
  return record;
}

Record converse_in_contact(PartnerLink& link, const Options& options, const Push& push, Findings* findings)
{
  Record record;
  const Report start = begin_contact(link, options, record.mesh);
  if (findings != nullptr)
    judge_mesh(record.mesh, options, *findings);
  const auto p = kick(record.mesh);
  std::vector<double> v(p.size());
  double t = 0.0;
  bool steps_right = true;
  for (std::size_t k = 0; k < std::size(plan); ++k)
  {
    const double dt = plan[k].dt * start.stable_dt;
    link.send_window({.index = static_cast<std::int64_t>(k),
                      .t_begin = t,
                      .t_end = t + dt,
                      .fine = true,
                      .output = k % 2 == 1,
                      .last = k + 1 == std::size(plan)});
    t += dt;
    link.receive_free_velocity(v);
    record.v_free.push_back(v);
    record.dt.push_back(dt);
    link.send_link_force(push_in(p, dt, k, push));
    const Report report = link.receive_report();
    steps_right = steps_right && report.steps == static_cast<std::int64_t>(k) + 1;
    if (report.surface_changed)
      link.receive_mesh_update();
  }
  link.send_bye();
  if (findings != nullptr)
    findings->expect(steps_right, "4.7",
                     "windows of one step with the exchange in its middle, BYE and BYE_ACK");
  return record;
}

Record fly(PartnerLink& link, const Options& options, bool in_flight, Findings& findings)
{
  Record record;
  const double dt = 0.01 * begin_contact(link, options, record.mesh).stable_dt;
  constexpr std::int64_t length = 4;
  const std::vector<double> zero(record.mesh.x.size(), 0.0);
  std::vector<double> v(zero), mean(zero), f(kick(record.mesh));
  for (double& value : f)
    value /= dt;
  std::int64_t index = 0, steps = 0;
  bool steps_right = true;
  const auto run = [&](std::int64_t n, bool flight, const std::vector<double>& force)
  {
    const double t = dt * static_cast<double>(steps);
    link.send_window({.index = index,
                      .t_begin = t,
                      .t_end = t + dt * static_cast<double>(n),
                      .steps = n,
                      .fine = true,
                      .last = steps + n == length + 2,
                      .flight = flight});
    link.receive_free_velocity(v);
    if (!flight)
      link.send_link_force(force);
    const Report report = link.receive_report();
    ++index;
    steps += n;
    steps_right = steps_right && report.steps == steps;
    if (report.surface_changed)
      link.receive_mesh_update();
  };
  run(1, false, f);
  record.v_free.push_back(v);
  if (in_flight)
  {
    run(length, true, zero);
    mean = v;
  }
  for (std::int64_t j = 0; j < length && !in_flight; ++j)
  {
    run(1, false, zero);
    for (std::size_t k = 0; k < v.size(); ++k)
      mean[k] += v[k] / static_cast<double>(length);
  }
  record.v_free.push_back(mean);
  run(1, false, zero);
  record.v_free.push_back(v);
  link.send_bye();
  if (in_flight)
    findings.expect(steps_right, "4.7", "READY counts the steps of a window without exchange");
  return record;
}

} // namespace undine::link::conform
