// Both ends of the conversation over a memory channel: the good course, and every way to leave it.
#include "common/coupling/link.hpp"

#include "tests/link/samples.hpp"

#include <catch2/catch.hpp>

#include <chrono>
#include <cmath>
#include <functional>
#include <thread>

using namespace samples;

namespace
{

/// The partner of an end under test: says whatever it is told to, right or wrong.
class Puppet
{
public:
  explicit Puppet(std::unique_ptr<Channel> channel) : channel_(std::move(channel)) {}

  void say(const Bytes& bytes) { channel_->send(bytes); }
  template <class Fill>
  void say(MessageType type, std::int64_t window, Fill&& fill)
  {
    say(message({.type = type, .sequence = ++sequence_, .window = window}, fill));
  }
  template <class Content>
  void tell(MessageType type, const Content& content, std::int64_t window = -1)
  {
    say(type, window, [&](wire::Writer& out) { wire::write(out, content); });
  }
  void vector(MessageType type, const std::vector<double>& v, std::int64_t window)
  {
    say(type, window, [&](wire::Writer& out) { out.bytes(v.data(), v.size() * sizeof(double)); });
  }
  void empty(MessageType type, std::int64_t window = -1)
  {
    say(type, window, [](wire::Writer&) {});
  }
  MessageType hear()
  {
    channel_->receive(heard_);
    return wire::open(heard_, "the end under test", [] { return std::string("anything"); }).type;
  }
  void skip_numbers(std::uint64_t n) { sequence_ += n; }
  std::span<const std::byte> payload() const { return wire::payload(heard_); }

private:
  std::unique_ptr<Channel> channel_;
  Bytes heard_;
  std::uint64_t sequence_ = 0;
};

SurfaceMesh small_mesh()
{
  SurfaceMesh m = mesh();
  m.epoch = 0;
  return m;
}

Report quiet_report()
{
  Report r = report();
  r.surface_changed = false;
  return r;
}

const std::vector<double> values{0.5, -1.0, 2.5, 3.0, 1.0, 4.0}; // 3 nodes, 2 components
const Kinematics moving{.v = values, .a_free = values};
const Activation push{.impulse = values, .link_force = values};

Window first_window(bool activate)
{
  return {.index = 0, .t_begin = 0.5, .t_end = 0.75, .steps = 2, .fine = true, .activate = activate};
}

/// The coupler's end, led by a puppet solver to a state; `call` then receives what the state expects.
struct CouplerState
{
  const char* expected;
  std::function<void(PartnerLink&, Puppet&)> lead;
  std::function<void(PartnerLink&)> call;
};

std::vector<CouplerState> coupler_states()
{
  const auto to_mesh = [](PartnerLink& link, Puppet&) { link.send_setup(setup()); };
  const auto to_report = [=](PartnerLink& link, Puppet& solver)
  {
    to_mesh(link, solver);
    solver.tell(MessageType::mesh, small_mesh());
    link.receive_mesh();
    link.accept_mesh();
  };
  const auto to_update = [=](PartnerLink& link, Puppet& solver)
  {
    to_report(link, solver);
    solver.tell(MessageType::ready, report());
    link.receive_report();
  };
  const auto to_window = [=](PartnerLink& link, Puppet& solver)
  {
    to_report(link, solver);
    solver.tell(MessageType::ready, quiet_report());
    link.receive_report();
  };
  const auto to_kinematics = [=](PartnerLink& link, Puppet& solver)
  {
    to_window(link, solver);
    link.send_window(first_window(true));
  };
  const auto to_velocity = [=](PartnerLink& link, Puppet& solver)
  {
    to_window(link, solver);
    link.send_window(first_window(false));
  };
  return {{"MESH ", to_mesh, [](PartnerLink& link) { link.receive_mesh(); }},
          {"READY", to_report, [](PartnerLink& link) { link.receive_report(); }},
          {"MESH_UPDATE", to_update, [](PartnerLink& link) { link.receive_mesh_update(); }},
          {"KINEMATICS", to_kinematics, [](PartnerLink& link) { link.receive_kinematics(); }},
          {"FREE_VELOCITY", to_velocity,
           [](PartnerLink& link)
           {
             std::vector<double> v(values.size());
             link.receive_free_velocity(v);
           }},
          {"BYE_ACK", to_window, [](PartnerLink& link) { link.send_bye(); }}};
}

struct SolverState
{
  const char* expected;
  std::function<void(SolverLink&, Puppet&)> lead;
  std::function<void(SolverLink&)> call;
};

std::vector<SolverState> solver_states()
{
  const auto to_reply = [](SolverLink& link, Puppet& coupler)
  {
    coupler.tell(MessageType::setup, setup());
    link.receive_setup();
  };
  const auto to_window = [=](SolverLink& link, Puppet& coupler)
  {
    to_reply(link, coupler);
    coupler.tell(MessageType::mesh_reply, wire::MeshReply{});
    link.send_mesh(small_mesh());
    link.send_report(quiet_report());
  };
  const auto to_activation = [=](SolverLink& link, Puppet& coupler)
  {
    to_window(link, coupler);
    coupler.tell(MessageType::window, first_window(true));
    link.next_window();
    link.send_kinematics(moving);
  };
  const auto to_force = [=](SolverLink& link, Puppet& coupler)
  {
    to_window(link, coupler);
    coupler.tell(MessageType::window, first_window(false));
    link.next_window();
    link.send_free_velocity(values);
  };
  return {{"SETUP", [](SolverLink&, Puppet&) {}, [](SolverLink& link) { link.receive_setup(); }},
          {"MESH_REPLY", to_reply, [](SolverLink& link) { link.send_mesh(small_mesh()); }},
          {"WINDOW or BYE or CHECKPOINT", to_window, [](SolverLink& link) { link.next_window(); }},
          {"ACTIVATION_IMPULSE", to_activation, [](SolverLink& link) { link.receive_activation(); }},
          {"LINK_FORCE", to_force,
           [](SolverLink& link)
           {
             std::vector<double> f(values.size());
             link.receive_link_force(f);
           }}};
}

constexpr MessageType all_types[] = {
    MessageType::setup,           MessageType::mesh,         MessageType::mesh_reply,
    MessageType::ready,           MessageType::window,       MessageType::free_velocity,
    MessageType::link_force,      MessageType::mesh_update,  MessageType::checkpoint,
    MessageType::checkpoint_done, MessageType::stop_request, MessageType::bye,
    MessageType::bye_ack,         MessageType::kinematics,   MessageType::activation_impulse,
    MessageType::surface,         MessageType::motion};

} // namespace

// Rows 0 and 2 are rank 2's, row 1 is rank 0's; after the first window all are rank 2's, after the second
// rank 0's.
TEST_CASE("rows of several ranks are exchanged with their owners", "[link][unit]")
{
  const std::vector<std::vector<std::int32_t>> owners{{2, 0, 2}, {2, 2, 2}, {}};
  auto [for_first, first_for_coupler] = memory_channel();
  auto [for_second, second_for_coupler] = memory_channel();
  std::string trouble;
  const auto surface = [&](std::size_t k)
  {
    SurfaceMesh m = small_mesh();
    m.epoch = static_cast<std::uint32_t>(k);
    m.owner = owners[k];
    return m;
  };
  const auto window = [](std::int64_t k)
  {
    Window w = first_window(true);
    w.index = k;
    w.t_begin += 0.25 * static_cast<double>(k);
    w.t_end += 0.25 * static_cast<double>(k);
    return w;
  };
  // Both ranks run the same; what rank 0 hears the other is told.
  const auto run = [&](SolverLink& link, int rank)
  {
    if (rank == 0)
      link.receive_setup();
    else
      link.hear(setup());
    link.send_mesh(surface(0));
    link.send_report(quiet_report());
    for (std::int64_t k = 0; k < 3; ++k)
    {
      if (rank == 0)
        link.next_window();
      else
        link.hear(window(k));
      const auto rows = surface(static_cast<std::size_t>(k)).rows_of(rank);
      std::vector<double> v, f(2 * rows.size());
      for (const auto row : rows)
        v.insert(v.end(), {10.0 * static_cast<double>(row), 10.0 * static_cast<double>(row) + 1.0});
      link.send_kinematics({.v = v, .a_free = v});
      if (link.receive_activation().impulse != v)
        trouble += "impulse ";
      for (int j = 0; j < 2; ++j)
      {
        link.send_free_velocity(v);
        link.ping();
        link.receive_link_force(f);
        if (f != v)
          trouble += "force of rank " + std::to_string(rank) + " ";
      }
      Report r = quiet_report();
      r.surface_changed = k < 2;
      link.send_report(r);
      if (k < 2)
        link.send_mesh_update(surface(static_cast<std::size_t>(k) + 1));
    }
    if (rank == 0)
      link.next_window();
    else
      link.hear_end();
  };
  const auto guarded = [&](std::unique_ptr<Channel> channel, int rank)
  {
    try
    {
      SolverLink link(std::move(channel), rank);
      run(link, rank);
    }
    catch (const std::exception& error)
    {
      trouble += error.what();
    }
  };
  std::thread first([&, c = std::move(for_first)]() mutable { guarded(std::move(c), 0); });
  std::thread second([&, c = std::move(for_second)]() mutable { guarded(std::move(c), 2); });

  std::vector<int> asked;
  PartnerLink link(std::move(first_for_coupler), "solid",
                   [&](int rank)
                   {
                     asked.push_back(rank);
                     return std::move(second_for_coupler);
                   });
  link.send_setup(setup());
  CHECK(payload_of(link.receive_mesh()) == payload_of(small_mesh())); // the owners are the link's affair
  link.accept_mesh();
  link.receive_report();
  const std::vector<double> all{0.0, 1.0, 10.0, 11.0, 20.0, 21.0};
  for (std::int64_t k = 0; k < 3; ++k)
  {
    link.send_window(window(k));
    const Kinematics state = link.receive_kinematics();
    CHECK(state.v == all);
    link.send_activation({.impulse = state.v, .link_force = state.a_free});
    for (int j = 0; j < 2; ++j)
    {
      std::vector<double> v(all.size());
      link.receive_free_velocity(v);
      CHECK(v == all);
      link.send_link_force(v);
      link.ping();
    }
    if (link.receive_report().surface_changed)
      link.receive_mesh_update();
  }
  link.send_bye();
  first.join();
  second.join();
  CHECK(trouble == "");
  CHECK(asked == std::vector<int>{2});
}

TEST_CASE("an owner that says something wrong is named", "[link][unit]")
{
  SurfaceMesh m = small_mesh();
  m.owner = {2, 0, 2};
  struct Wrong
  {
    std::function<void(Puppet&)> say;
    int code;
    std::initializer_list<const char*> words;
  };
  std::vector<double> bad{0.5, std::nan(""), 1.0, 2.0};
  const std::vector<double> two_rows{1.0, 2.0, 3.0, 4.0};
  const std::vector<Wrong> wrongs{
      {[&](Puppet& p) { p.vector(MessageType::free_velocity, bad, 0); },
       37,
       {"solid rank 2", "component 1 of node 0"}},
      {[&](Puppet& p) {
         p.vector(MessageType::free_velocity, {1.0, 2.0}, 0);
       },
       37,
       {"solid rank 2", "2 nodes"}},
      {[&](Puppet& p) { p.vector(MessageType::free_velocity, two_rows, 1); },
       37,
       {"solid rank 2", "window 1"}},
      {[&](Puppet& p) { p.empty(MessageType::bye_ack, 0); }, 37, {"solid rank 2", "expected FREE_VELOCITY"}},
      {[&](Puppet& p) { p.tell(MessageType::fail, wire::Failed{.code = 10, .text = "inverted"}, 0); },
       40,
       {"solid rank 2", "inverted"}},
      {[&](Puppet& p)
       {
         p.skip_numbers(1);
         p.vector(MessageType::free_velocity, two_rows, 0);
       },
       37,
       {"solid rank 2", "#2", "expected number 1"}}};
  for (const Wrong& wrong : wrongs)
  {
    auto [here, there] = memory_channel();
    auto [owner_here, owner_there] = memory_channel();
    Puppet first(std::move(there)), owner(std::move(owner_there));
    PartnerLink link(std::move(here), "solid", [&](int) { return std::move(owner_here); });
    first.tell(MessageType::mesh, m);
    first.tell(MessageType::ready, quiet_report());
    link.send_setup(setup());
    link.receive_mesh();
    link.accept_mesh();
    link.receive_report();
    link.send_window(first_window(false));
    first.vector(MessageType::free_velocity, {1.0, 2.0}, 0);
    wrong.say(owner);
    std::vector<double> v(6);
    const auto error = error_of([&] { link.receive_free_velocity(v); });
    CHECK(error.code() == wrong.code);
    CHECK(mentions(error, wrong.words));
    link.send_failure(37, "the test is over");
  }
}

TEST_CASE("owners of rows that make no sense", "[link][unit]")
{
  const auto refused = [](std::vector<std::int32_t> owner)
  {
    SurfaceMesh m = small_mesh();
    m.owner = std::move(owner);
    const Bytes bytes = payload_of(m);
    return error_of([&] { wire::read_surface_mesh(wire::Reader(bytes, "MESH")); });
  };
  CHECK(refused({0, 1, 5}).code() == 0);
  CHECK(mentions(refused({0, 1}), {"size of owner is 2, expected 3"}));
  CHECK(mentions(refused({0, -1, 0}), {"owner[1] is -1, expected a rank"}));
  Bytes empty = payload_of(small_mesh());
  empty.resize(empty.size() + 24); // three empty lists
  CHECK(mentions(error_of([&] { wire::read_surface_mesh(wire::Reader(empty, "MESH")); }),
                 {"owner is an empty list, expected left out"}));

  // A coupler that knows of no other ranks.
  auto [here, there] = memory_channel();
  Puppet first(std::move(there));
  SurfaceMesh m = small_mesh();
  m.owner = {0, 1, 0};
  PartnerLink link(std::move(here), "solid");
  first.tell(MessageType::mesh, m);
  link.send_setup(setup());
  const auto error = error_of([&] { link.receive_mesh(); });
  CHECK(error.code() == 37);
  CHECK(mentions(error, {"owner", "this coupler takes all rows from rank 0"}));
  link.send_failure(37, "the test is over");
}

TEST_CASE("a whole conversation: what one end sends is what the other receives", "[link][unit]")
{
  auto [for_solver, for_coupler] = memory_channel();
  const int windows = 40;
  const int m = 5;
  std::string trouble;

  std::thread solver(
      [&, channel = std::move(for_solver)]() mutable
      {
        try
        {
          SolverLink link(std::move(channel));
          if (payload_of(link.receive_setup()) != payload_of(setup()))
            trouble = "setup";
          SurfaceMesh m0 = small_mesh();
          link.send_mesh(m0);
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
              ++m0.epoch;
              link.send_mesh_update(m0);
            }
          }
        }
        catch (const std::exception& error)
        {
          trouble = error.what();
        }
      });

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
  std::thread solver(
      [&, channel = std::move(for_solver)]() mutable
      {
        try
        {
          SolverLink link(std::move(channel));
          link.receive_setup();
          link.send_mesh(small_mesh());
          const auto refused = samples::error_of([&] { link.send_report(quiet_report()); });
          if (refused.code() != 37)
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
        }
        catch (const std::exception& error)
        {
          trouble = error.what();
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
    CHECK(samples::error_of([&] { link.receive_motion(); }).code() == 1); // the force comes first
    link.send_link_force(f);
    CHECK(link.receive_motion().v[0] == Approx(values[0] + 0.5 * (k + 1)));
    link.receive_report();
  }
  link.send_bye();
  solver.join();
  CHECK(trouble == "");
}

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
