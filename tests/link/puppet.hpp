// Partners for an end under test: a puppet that says what it is told to, or a solver in a thread.
#pragma once

#include "common/coupling/link.hpp"

#include "tests/link/samples.hpp"

#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace samples
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

inline SurfaceMesh small_mesh()
{
  SurfaceMesh m = mesh();
  m.epoch = 0;
  return m;
}

inline Report quiet_report()
{
  Report r = report();
  r.surface_changed = false;
  return r;
}

inline const std::vector<double> values{0.5, -1.0, 2.5, 3.0, 1.0, 4.0}; // 3 nodes, 2 components
inline const Kinematics moving{.v = values, .a_free = values};
inline const Activation push{.impulse = values, .link_force = values};

inline Window first_window(bool activate)
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

inline std::vector<CouplerState> coupler_states()
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

inline std::vector<SolverState> solver_states()
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

/// A solver that does run(link) in a thread; what goes wrong is added to `trouble`, to be looked at after
/// join().
template <class Run>
std::thread solver_thread(std::unique_ptr<Channel> channel, std::string& trouble, Run run, int rank = 0)
{
  return std::thread(
      [channel = std::move(channel), &trouble, run, rank]() mutable
      {
        try
        {
          SolverLink link(std::move(channel), rank);
          run(link);
        }
        catch (const std::exception& error)
        {
          trouble += error.what();
        }
      });
}

} // namespace samples
