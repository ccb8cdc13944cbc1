// What an end refuses to hear, in every state, and in which words.
#include "tests/link/puppet.hpp"

#include <cmath>

using namespace samples;

namespace
{

constexpr MessageType all_types[] = {
    MessageType::setup,           MessageType::mesh,         MessageType::mesh_reply,
    MessageType::ready,           MessageType::window,       MessageType::free_velocity,
    MessageType::link_force,      MessageType::mesh_update,  MessageType::checkpoint,
    MessageType::checkpoint_done, MessageType::stop_request, MessageType::bye,
    MessageType::bye_ack,         MessageType::kinematics,   MessageType::activation_impulse,
    MessageType::surface,         MessageType::motion};

} // namespace

TEST_CASE("the coupler refuses every message that the state does not allow, and names both", "[link][unit]")
{
  for (const CouplerState& state : coupler_states())
    for (const MessageType type : all_types)
    {
      if (type == MessageType::stop_request ||
          std::string(state.expected).starts_with(std::string(name_of(type)) + " ") ||
          state.expected == std::string(name_of(type)))
        continue;
      INFO(state.expected << "instead of " << name_of(type));
      auto [ours, theirs] = memory_channel(5.0);
      PartnerLink link(std::move(ours), "solid");
      Puppet solver(std::move(theirs));
      state.lead(link, solver);
      solver.empty(type);
      const ProtocolError error = error_of([&] { state.call(link); });
      CHECK(error.code() == 37);
      CHECK(mentions(error, {"'solid' sent", name_of(type), "expected", state.expected}));
    }
}

TEST_CASE("a solver refuses every message that the state does not allow, and names both", "[link][unit]")
{
  for (const SolverState& state : solver_states())
    for (const MessageType type : all_types)
    {
      if (std::string(state.expected).find(name_of(type)) != std::string::npos &&
          !(type == MessageType::mesh && state.expected == std::string("MESH_REPLY")))
        continue;
      INFO(state.expected << " instead of " << name_of(type));
      auto [ours, theirs] = memory_channel(5.0);
      SolverLink link(std::move(ours));
      Puppet coupler(std::move(theirs));
      state.lead(link, coupler);
      coupler.empty(type);
      const ProtocolError error = error_of([&] { state.call(link); });
      CHECK(error.code() == 37);
      CHECK(mentions(error, {"'coupler' sent", name_of(type), "expected", state.expected}));
    }
}

TEST_CASE("an unknown type is refused by number", "[link][unit]")
{
  auto [ours, theirs] = memory_channel(5.0);
  SolverLink link(std::move(ours));
  Puppet coupler(std::move(theirs));
  coupler.empty(static_cast<MessageType>(99));
  const ProtocolError error = error_of([&] { link.receive_setup(); });
  CHECK(error.code() == 37);
  CHECK(mentions(error, {"unknown type 99", "expected SETUP"}));
}

TEST_CASE("FAIL of the partner ends the conversation in every state, with its own words", "[link][unit]")
{
  for (const CouplerState& state : coupler_states())
  {
    auto [ours, theirs] = memory_channel(5.0);
    PartnerLink link(std::move(ours), "solid");
    Puppet solver(std::move(theirs));
    state.lead(link, solver);
    solver.tell(MessageType::fail, failed());
    const ProtocolError error = error_of([&] { state.call(link); });
    CHECK(error.code() == 40);
    CHECK(mentions(error, {"'solid' failed (exit code 10): element 17 is inverted"}));
  }
  for (const SolverState& state : solver_states())
  {
    auto [ours, theirs] = memory_channel(5.0);
    SolverLink link(std::move(ours));
    Puppet coupler(std::move(theirs));
    state.lead(link, coupler);
    coupler.tell(MessageType::fail, failed());
    const ProtocolError error = error_of([&] { state.call(link); });
    CHECK(error.code() == 40);
    CHECK(mentions(error, {"'coupler' failed (exit code 10): element 17 is inverted"}));
  }
}

TEST_CASE("a message number that is left out or repeated is refused", "[link][unit]")
{
  const int skip = GENERATE(1, -1);
  auto [ours, theirs] = memory_channel(5.0);
  PartnerLink link(std::move(ours), "solid");
  Puppet solver(std::move(theirs));
  link.send_setup(setup());
  solver.tell(MessageType::mesh, small_mesh());
  link.receive_mesh();
  link.accept_mesh();
  solver.skip_numbers(std::uint64_t(skip)); // -1 wraps to "the same again"
  solver.tell(MessageType::ready, quiet_report());
  const ProtocolError error = error_of([&] { link.receive_report(); });
  CHECK(error.code() == 37);
  CHECK(mentions(error, {skip == 1 ? "READY #3" : "READY #1", "expected number 2"}));
}

TEST_CASE("a message of another window is refused", "[link][unit]")
{
  auto [ours, theirs] = memory_channel(5.0);
  PartnerLink link(std::move(ours), "solid");
  Puppet solver(std::move(theirs));
  coupler_states()[4].lead(link, solver);
  solver.vector(MessageType::free_velocity, values, 7);
  std::vector<double> v(values.size());
  const ProtocolError error = error_of([&] { link.receive_free_velocity(v); });
  CHECK(error.code() == 37);
  CHECK(mentions(error, {"FREE_VELOCITY", "of window 7", "expected window 0"}));
}

TEST_CASE("a vector of the wrong length or with NaN is refused with place and time", "[link][unit]")
{
  auto [ours, theirs] = memory_channel(5.0);
  PartnerLink link(std::move(ours), "solid");
  Puppet solver(std::move(theirs));
  coupler_states()[4].lead(link, solver);
  std::vector<double> v(values.size());
  SECTION("short")
  {
    solver.vector(MessageType::free_velocity, {1.0, 2.0}, 0);
    const ProtocolError error = error_of([&] { link.receive_free_velocity(v); });
    CHECK(error.code() == 37);
    CHECK(mentions(error, {"FREE_VELOCITY #3 from 'solid'", "16 bytes", "expected 48 bytes (3 nodes"}));
  }
  SECTION("NaN")
  {
    std::vector<double> bad = values;
    bad[3] = std::nan("");
    solver.vector(MessageType::free_velocity, bad, 0);
    const ProtocolError error = error_of([&] { link.receive_free_velocity(v); });
    CHECK(error.code() == 37);
    CHECK(mentions(error, {"FREE_VELOCITY #3 from 'solid'", "component 1 of node 1", "nan", "finite"}));
  }
  SECTION("the receiver's own vector has the wrong length")
  {
    std::vector<double> small(2);
    solver.vector(MessageType::free_velocity, values, 0);
    CHECK(error_of([&] { link.receive_free_velocity(small); }).code() == 1);
  }
}

TEST_CASE("a surface of another dimension or an old epoch is refused", "[link][unit]")
{
  auto [ours, theirs] = memory_channel(5.0);
  PartnerLink link(std::move(ours), "solid");
  Puppet solver(std::move(theirs));
  SECTION("dimension")
  {
    Setup three = setup();
    three.dim = 3;
    link.send_setup(three);
    solver.tell(MessageType::mesh, small_mesh());
    const ProtocolError error = error_of([&] { link.receive_mesh(); });
    CHECK(error.code() == 37);
    CHECK(mentions(error, {"MESH #1 from 'solid'", "dim is 2", "expected 3"}));
  }
  SECTION("epoch")
  {
    coupler_states()[2].lead(link, solver);
    solver.tell(MessageType::mesh_update, small_mesh());
    const ProtocolError error = error_of([&] { link.receive_mesh_update(); });
    CHECK(error.code() == 37);
    CHECK(mentions(error, {"MESH_UPDATE #3", "epoch is 0", "more than 0"}));
  }
}
