// What fluid and solid do alike in a window of the coupled run: the steps, and where in them they exchange.
//
// `Body` is Fluid or Solid: its functions are the acts of a step of the Gravouil-Combescure scheme, those of
// "interface" for the wet nodes.
#pragma once

#include "common/coupling/link.hpp"
#include "common/program/shared_link.hpp"

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace undine
{

/// Steps without an exchange; at the end the coupler gets the mean velocity of the wet nodes.
template <class Body>
void fly(Body& body, SharedLink& link, const link::Window& window)
{
  const double dt = window.dt();
  std::vector<double> mean(body.interface_velocity().size(), 0.0);
  for (std::int64_t j = 0; j < window.steps; ++j)
  {
    body.predict_velocity(dt);
    const auto v = body.interface_velocity();
    for (std::size_t k = 0; k < mean.size(); ++k)
      mean[k] += v[k] / static_cast<double>(window.steps);
    body.predict_position(dt);
    body.solve_free_motion(dt);
  }
  link.send_free_velocity(mean);
}

/// The step of a window in contact: the exchange is in its middle.
template <class Body>
void step_in_contact(Body& body, SharedLink& link, double dt, std::span<double> f_link)
{
  body.predict_velocity(dt); // v ← v + Δt/2 a
  link.send_free_velocity(body.interface_velocity());
  link.receive_link_force(f_link);
  body.push(f_link, dt);     // v ← v + Δt M⁻¹ f
  body.predict_position(dt); // x ← x + Δt v
  body.solve_free_motion(dt);
}

/// A step of a side that stays on the other; `exchange`: at its end they meet.
template <class Body>
void step_together(Body& body, SharedLink& link, double dt, bool exchange, std::span<double> f_link)
{
  body.predict(dt);                        // v ← v + Δt/2 a,  x ← x + Δt v
  body.solve_free_motion_of_interface(dt); // M a = F_ext − F_int,  v_free = v + Δt/2 a on the wet nodes
  if (exchange)
    link.send_free_velocity(body.interface_velocity());
  body.solve_free_motion_of_interior(dt); // the same for the rest, while the message travels
  if (exchange)
  {
    link.receive_link_force(f_link);
    body.correct_with_link(f_link, dt); // a ← a + M⁻¹ f,  v ← v + Δt/2 M⁻¹ f
  }
}

/// All steps of a window. @param f_link room for the force on the wet nodes [N]
template <class Body>
void take_window(Body& body, SharedLink& link, const link::Window& window, bool in_contact,
                 std::span<double> f_link)
{
  if (window.activate)
  {
    link.send_kinematics(body.kinematics());
    body.apply_activation(link.receive_activation());
  }
  if (window.flight)
    fly(body, link, window);
  else if (in_contact)
    step_in_contact(body, link, window.dt(), f_link);
  else
    for (std::int64_t j = 1; j <= window.steps; ++j)
      step_together(body, link, window.dt(), window.fine || j == window.steps, f_link);
}

} // namespace undine
