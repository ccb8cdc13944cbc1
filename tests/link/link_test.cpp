// Both ends of the conversation over a memory channel: the good course, and a program's own mistakes.
#include "tests/link/puppet.hpp"

using namespace samples;

namespace
{

constexpr int windows = 40;

/// A solver through all windows: v_free is its window and exchange, and twice that comes back.
void converse(SolverLink& link, std::string& trouble)
{
  if (payload_of(link.receive_setup()) != payload_of(setup()))
    trouble = "setup";
  SurfaceMesh m = small_mesh();
  link.send_mesh(m);
  link.send_report(quiet_report());
  std::vector<double> v = values;
  std::vector<double> f(v.size());
  int written = 0;
  link.on_checkpoint(
      [&](const CheckpointOrder& order)
      {
        if (order.windows != 10 * written++ || order.folder != "folder")
          trouble = "checkpoint";
        return CheckpointDone{.written = true, .reason = "", .files = {"solid.h5"}};
      });
  for (int k = 0; const auto w = link.next_window(); ++k)
  {
    if (w->index != k || w->last != (k + 1 == windows))
      trouble = "window";
    if (w->activate)
    {
      link.send_kinematics(moving);
      if (payload_of(link.receive_activation()) != payload_of(push))
        trouble = "activation";
    }
    for (int j = 0; j < (w->fine ? w->steps : 1); ++j)
    {
      v[0] = k + 0.01 * j;
      link.send_free_velocity(v);
      link.ping();
      link.receive_link_force(f);
      if (f[0] != 2.0 * v[0])
        trouble = "force";
    }
    if (k == 20)
      link.send_stop_request("SIGTERM");
    Report r = quiet_report();
    r.steps = k;
    r.surface_changed = k % 7 == 3;
    link.send_report(r);
    if (r.surface_changed)
    {
      ++m.epoch;
      link.send_mesh_update(m);
    }
  }
}

} // namespace

TEST_CASE("a whole conversation: what one end sends is what the other receives", "[link][unit]")
{
  auto [for_solver, for_coupler] = memory_channel();
  const int m = 5;
  std::string trouble;
  std::thread solver =
      solver_thread(std::move(for_solver), trouble, [&](SolverLink& link) { converse(link, trouble); });

  PartnerLink link(std::move(for_coupler), "solid");
  CHECK(link.role() == "solid");
  link.send_setup(setup());
  CHECK(payload_of(link.receive_mesh()) == payload_of(small_mesh()));
  link.accept_mesh();
  CHECK(payload_of(link.receive_report()) == payload_of(quiet_report()));
  std::vector<double> v(values.size());
  for (int k = 0; k < windows; ++k)
  {
    const Window w{.index = k,
                   .t_begin = 0.5 + 0.25 * k,
                   .t_end = 0.75 + 0.25 * k,
                   .steps = m,
                   .fine = k % 3 != 0,
                   .activate = k % 10 == 0,
                   .last = k + 1 == windows};
    if (k % 10 == 0)
    {
      link.send_checkpoint({.folder = "folder", .id = "7", .windows = k, .t = w.t_begin});
      CHECK(link.receive_checkpoint_done().files == std::vector<std::string>{"solid.h5"});
    }
    link.send_window(w);
    if (w.activate)
    {
      CHECK(payload_of(link.receive_kinematics()) == payload_of(moving));
      link.send_activation(push);
    }
    for (int j = 0; j < (w.fine ? m : 1); ++j)
    {
      link.receive_free_velocity(v);
      CHECK(v[0] == k + 0.01 * j);
      v[0] *= 2.0;
      link.send_link_force(v);
    }
    const Report r = link.receive_report();
    CHECK(r.steps == k);
    CHECK(r.surface_changed == (k % 7 == 3));
    if (r.surface_changed)
      link.receive_mesh_update();
    CHECK(link.stop_requested() == (k >= 20));
  }
  link.send_bye();
  solver.join();
  CHECK(trouble == "");
  CHECK(link.stop_requested());
  CHECK(link.stop_reason() == "SIGTERM");
  CHECK(link.wait_seconds() > 0.0);
}

TEST_CASE("at level A forces go out and positions and velocities come back", "[link][unit]")
{
  auto [for_solver, for_coupler] = memory_channel();
  std::string trouble;
  std::thread solver = solver_thread(std::move(for_solver), trouble,
                                     [&trouble](SolverLink& link)
                                     {
                                       link.receive_setup();
                                       link.send_mesh(small_mesh());
                                       if (error_of([&] { link.send_report(quiet_report()); }).code() != 37)
                                         trouble = "a report was sent before the first motion";
                                       std::vector<double> f(values.size());
                                       Motion motion{.x = values, .v = values};
                                       link.send_motion(motion);
                                       link.send_report(quiet_report());
                                       while (const auto w = link.next_window())
                                       {
                                         link.receive_link_force(f);
                                         for (std::size_t k = 0; k < f.size(); ++k)
                                           motion.v[k] += f[k];
                                         link.send_motion(motion);
                                         link.send_report(quiet_report());
                                       }
                                     });

  PartnerLink link(std::move(for_coupler), "solid");
  Setup forces = setup();
  forces.scheme = staggered_scheme;
  link.send_setup(forces);
  link.receive_mesh();
  link.accept_mesh();
  CHECK(link.receive_motion().x == values);
  link.receive_report();
  const std::vector<double> f(values.size(), 0.5);
  for (int k = 0; k < 20; ++k)
  {
    link.send_window({.index = k, .t_begin = 0.5 + 0.25 * k, .t_end = 0.75 + 0.25 * k, .last = k == 19});
    CHECK(error_of([&] { link.receive_motion(); }).code() == 1); // the force comes first
    link.send_link_force(f);
    CHECK(link.receive_motion().v[0] == Approx(values[0] + 0.5 * (k + 1)));
    link.receive_report();
  }
  link.send_bye();
  solver.join();
  CHECK(trouble == "");
}

TEST_CASE("a rejected surface ends the solver with the coupler's reason", "[link][unit]")
{
  auto [a, b] = memory_channel(5.0);
  std::thread coupler(
      [channel = std::move(b)]() mutable
      {
        PartnerLink link(std::move(channel), "fluid");
        link.send_setup(setup());
        link.receive_mesh();
        link.reject_mesh("only 71 % of the fluid side finds a solid face");
      });
  SolverLink solver(std::move(a));
  solver.receive_setup();
  const ProtocolError error = error_of([&] { solver.send_mesh(small_mesh()); });
  coupler.join();
  CHECK(error.code() == 4);
  CHECK(mentions(error, {"rejected", "only 71 % of the fluid side"}));
}

TEST_CASE("this program's own mistakes are told apart from the partner's", "[link][unit]")
{
  auto [a, b] = memory_channel(5.0);
  SolverLink solver(std::move(a));
  PartnerLink coupler(std::move(b), "fluid");
  // out of turn: nothing is sent
  CHECK(
      mentions(error_of([&] { solver.send_report(report()); }), {"READY cannot be sent", "expected SETUP"}));
  CHECK(mentions(error_of([&] { coupler.send_window(window()); }),
                 {"WINDOW cannot be sent", "expected SETUP"}));
  // waiting for what cannot come: no dead-lock
  CHECK(error_of([&] { solver.next_window(); }).code() == 1);
  CHECK(error_of([&] { coupler.receive_report(); }).code() == 1);
  CHECK(error_of([&] { PartnerLink(nullptr, "fluid"); }).code() == 1);
  // the conversation is unharmed
  coupler.send_setup(setup());
  CHECK(solver.receive_setup().scheme == "gc");
}
