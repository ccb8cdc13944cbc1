// How a conversation ends or is kept alive: last words, silence, pings.
#include "tests/link/puppet.hpp"

#include <chrono>

using namespace samples;

TEST_CASE("a link says its last word through send_failure", "[link][unit]")
{
  auto [a, b] = memory_channel(5.0);
  SolverLink solver(std::move(a));
  PartnerLink coupler(std::move(b), "fluid");
  coupler.send_setup(setup());
  solver.receive_setup();
  solver.send_failure(10, "time step below its limit in element 5");
  const ProtocolError error = error_of([&] { coupler.receive_mesh(); });
  CHECK(error.code() == 40);
  CHECK(mentions(error, {"'fluid' failed (exit code 10): time step below its limit in element 5"}));
}

TEST_CASE("a link that is dropped in the middle of the conversation says so", "[link][unit]")
{
  auto [a, b] = memory_channel(5.0);
  PartnerLink coupler(std::move(b), "fluid");
  coupler.send_setup(setup());
  {
    SolverLink solver(std::move(a));
    solver.receive_setup();
  }
  const ProtocolError error = error_of([&] { coupler.receive_mesh(); });
  CHECK(error.code() == 40);
  CHECK(mentions(error, {"'fluid' failed", "left in the middle", "next was MESH"}));
}

TEST_CASE("a link that is dropped after BYE says nothing more", "[link][unit]")
{
  auto [ours, theirs] = memory_channel(5.0);
  Puppet coupler(std::move(theirs));
  {
    SolverLink link(std::move(ours));
    solver_states()[2].lead(link, coupler);
    coupler.say(MessageType::bye, -1, [](wire::Writer& out) { out.string(""); });
    CHECK_FALSE(link.next_window());
  }
  CHECK(coupler.hear() == MessageType::mesh);
  CHECK(coupler.hear() == MessageType::ready);
  CHECK(coupler.hear() == MessageType::bye_ack);
  CHECK(error_of([&] { coupler.hear(); }).code() == 36); // closed
}

TEST_CASE("a link that is dropped by an exception leaves the last word to main", "[link][unit]")
{
  auto [a, b] = memory_channel(5.0);
  PartnerLink coupler(std::move(b), "fluid");
  coupler.send_setup(setup());
  try
  {
    SolverLink solver(std::move(a));
    solver.receive_setup();
    throw std::runtime_error("negative volume");
  }
  catch (const std::runtime_error&)
  {
  }
  CHECK(error_of([&] { coupler.receive_mesh(); }).code() == 36); // closed, without a FAIL
}

TEST_CASE("a silent partner is named after the stall limit, with its last message", "[link][unit]")
{
  auto [ours, theirs] = memory_channel(0.1);
  PartnerLink link(std::move(ours), "solid");
  Puppet solver(std::move(theirs));
  link.send_setup(setup());
  solver.tell(MessageType::mesh, small_mesh());
  link.receive_mesh();
  link.accept_mesh();
  const ProtocolError error = error_of([&] { link.receive_report(); });
  CHECK(error.code() == 36);
  const std::string said = "'solid' has sent nothing for ";
  CHECK(mentions(error, {said.c_str(), "Last: MESH #1", "expected READY"}));
  const std::string what = error.what();
  CHECK(std::stod(what.substr(what.find(said) + said.size())) >= 0.1); // more on a busy machine
}

TEST_CASE("a partner that pings may take longer than the stall limit", "[link][unit]")
{
  auto [ours, theirs] = memory_channel(0.5);
  PartnerLink link(std::move(ours), "solid");
  link.send_setup(setup());
  std::thread solver(
      [channel = std::move(theirs)]() mutable
      {
        Puppet puppet(std::move(channel));
        for (int i = 0; i < 10; ++i) // 1 s in all
        {
          std::this_thread::sleep_for(std::chrono::milliseconds(100));
          puppet.empty(MessageType::ping);
        }
        puppet.tell(MessageType::mesh, small_mesh());
      });
  CHECK(link.receive_mesh().n_nodes() == 3);
  CHECK(link.wait_seconds() > 0.9);
  solver.join();
}

TEST_CASE("pings are sent four times a second at most", "[link][unit]")
{
  auto [ours, theirs] = memory_channel(0.1);
  SolverLink link(std::move(ours));
  Puppet coupler(std::move(theirs));
  for (int i = 0; i < 1000; ++i)
    link.ping();
  CHECK(coupler.hear() == MessageType::ping);
  CHECK(error_of([&] { coupler.hear(); }).code() == 36); // no second one
}

TEST_CASE("an end that is gone is noticed at once, after what it still said", "[link][unit]")
{
  auto [ours, theirs] = memory_channel(0.0); // no stall limit: only the closed end can end the wait
  PartnerLink link(std::move(ours), "solid");
  link.send_setup(setup());
  {
    Puppet solver(std::move(theirs));
    solver.tell(MessageType::mesh, small_mesh());
  }
  CHECK(link.receive_mesh().n_nodes() == 3);
  link.accept_mesh(); // nobody hears it; not an error of this end
  const ProtocolError error = error_of([&] { link.receive_report(); });
  CHECK(error.code() == 36);
  CHECK(mentions(error, {"closed", "'solid'", "Last: MESH #1"}));
}
