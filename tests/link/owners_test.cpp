// Rows of a participant on several ranks: each goes to its owner.
#include "tests/link/puppet.hpp"

#include <cmath>

using namespace samples;

namespace
{

/// Three surfaces: rows 0 and 2 are rank 2's, row 1 is rank 0's; then all are rank 2's, then rank 0's.
SurfaceMesh surface(std::size_t k)
{
  static const std::vector<std::vector<std::int32_t>> owners{{2, 0, 2}, {2, 2, 2}, {}};
  SurfaceMesh m = small_mesh();
  m.epoch = static_cast<std::uint32_t>(k);
  m.owner = owners[k];
  return m;
}

Window window_of(std::int64_t k)
{
  Window w = first_window(true);
  w.index = k;
  w.t_begin += 0.25 * static_cast<double>(k);
  w.t_end += 0.25 * static_cast<double>(k);
  return w;
}

/// A window of each surface on one rank of the participant; what rank 0 hears the other is told.
void run_rank(SolverLink& link, int rank, std::string& trouble)
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
      link.hear(window_of(k));
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
}

} // namespace

TEST_CASE("rows of several ranks are exchanged with their owners", "[link][unit]")
{
  auto [for_first, first_for_coupler] = memory_channel();
  auto [for_second, second_for_coupler] = memory_channel();
  std::string trouble_0, trouble_2;
  std::thread first =
      solver_thread(std::move(for_first), trouble_0, [&](SolverLink& link) { run_rank(link, 0, trouble_0); });
  std::thread second = solver_thread(
      std::move(for_second), trouble_2, [&](SolverLink& link) { run_rank(link, 2, trouble_2); }, 2);

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
    link.send_window(window_of(k));
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
  CHECK(trouble_0 + trouble_2 == "");
  CHECK(asked == std::vector<int>{2});
}

// Epochs count the changes of one surface: the partner's says nothing of this rank's own.
TEST_CASE("another rank than 0 takes the partner's surface for the partner's", "[link][unit]")
{
  auto [here, there] = memory_channel(5.0);
  SolverLink link(std::move(here), 2);
  Setup beside = setup();
  beside.scheme = contact_surface_scheme;
  link.hear(beside);
  SurfaceMesh partner = mesh();
  partner.epoch = 7;
  link.hear(partner);
  link.send_mesh(surface(0));
  link.send_report(report()); // the surface has changed
  link.hear(partner);
  CHECK(error_of([&] { link.send_mesh_update(surface(1)); }).code() == 0);
  link.send_report(quiet_report());
  link.hear_end();
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
