// The hot messages do not touch the heap. Counts every operator new of this executable.
#include "common/coupling/link.hpp"

#include "tests/link/samples.hpp"
#include "tests/support/counted_new.hpp"

#include <catch2/catch.hpp>

#include <atomic>
#include <thread>

using namespace samples;

// Both ends and the channel: after a first window has grown the buffers, thousands of exchanges allocate
// nothing.
TEST_CASE("exchanging velocities and forces does not allocate after the first window", "[link][unit]")
{
  auto [for_solver, for_coupler] = memory_channel();
  const std::int64_t steps = 2000;
  std::atomic<long> before{0};
  std::atomic<long> after{0};
  std::thread solver(
      [steps, channel = std::move(for_solver)]() mutable
      {
        SolverLink link(std::move(channel));
        link.receive_setup();
        SurfaceMesh m = mesh();
        link.send_mesh(m);
        Report r = report();
        r.surface_changed = false;
        link.send_report(r);
        std::vector<double> v(m.x.size(), 1.0);
        while (link.next_window())
        {
          for (std::int64_t j = 0; j < steps; ++j)
          {
            link.send_free_velocity(v);
            link.receive_link_force(v);
          }
          link.send_report(r);
        }
      });

  PartnerLink link(std::move(for_coupler), "solid");
  link.send_setup(setup());
  std::vector<double> v(link.receive_mesh().x.size());
  link.accept_mesh();
  link.receive_report();
  for (int k = 0; k < 2; ++k)
  {
    link.send_window(
        {.index = k, .t_begin = 0.25 * k, .t_end = 0.25 * k + 0.25, .steps = steps, .fine = true});
    for (std::int64_t j = 0; j < steps; ++j)
    {
      if (k == 1 && j == 1) // the solver is inside its loop as well
        before = allocations.load();
      link.receive_free_velocity(v);
      if (k == 1 && j == steps - 1)
        after = allocations.load();
      link.send_link_force(v);
    }
    link.receive_report();
  }
  link.send_bye();
  solver.join();
  CHECK(after - before == 0);
}
