// One program of a coupled run without physics: it plays its role of the protocol, or breaks it as --behave
// says. Driven by failure_matrix.py.
#include "common/coupling/bootstrap.hpp"
#include "common/coupling/failure.hpp"
#include "common/coupling/handshake.hpp"
#include "common/coupling/link.hpp"
#include "common/coupling/start_timer.hpp"
#include "common/coupling/team.hpp"
#include "common/coupling/wire.hpp"

#include <mpi.h>

#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace
{

using namespace undine::link;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start)
{
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// CPU time of this process [s].
double cpu_seconds()
{
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return double(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * double(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

/// --key=value
class Options
{
public:
  Options(int argc, char** argv)
  {
    for (int i = 1; i < argc; ++i)
    {
      const std::string argument = argv[i];
      const std::size_t equal = argument.find('=');
      if (argument.rfind("--", 0) == 0 && equal != std::string::npos)
        values_[argument.substr(2, equal - 2)] = argument.substr(equal + 1);
    }
  }
  std::string text(const std::string& key, const std::string& otherwise) const
  {
    const auto found = values_.find(key);
    return found == values_.end() ? otherwise : found->second;
  }
  double number(const std::string& key, double otherwise) const
  {
    const auto found = values_.find(key);
    return found == values_.end() ? otherwise : std::atof(found->second.c_str());
  }

private:
  std::map<std::string, std::string> values_;
};

/// A row of nodes with edges between them.
SurfaceMesh row_of_nodes(int n)
{
  SurfaceMesh mesh;
  mesh.interfaces = {"line"};
  for (int i = 0; i < n; ++i)
  {
    mesh.node_id.push_back(i);
    mesh.x.insert(mesh.x.end(), {double(i), 0.0});
    mesh.inverse_mass.insert(mesh.inverse_mass.end(), {1.0, 0.0, 0.0, 1.0});
  }
  for (int i = 0; i + 1 < n; ++i)
  {
    mesh.face_nodes.insert(mesh.face_nodes.end(), {i, i + 1});
    mesh.face_offset.push_back(2 * (i + 1));
    mesh.face_interface.push_back(0);
  }
  return mesh;
}

/// Spoils messages on their way: "cut" and "lost" the second FREE_VELOCITY of window `at`, "oversized" the
/// first KINEMATICS, whose count becomes 2^60.
class SpoilingChannel final : public Channel
{
public:
  SpoilingChannel(std::unique_ptr<Channel> channel, std::string how, std::int64_t at)
      : channel_(std::move(channel)), how_(std::move(how)), at_(at)
  {
  }
  void send(std::span<const std::byte> message) override
  {
    std::uint16_t type = 0;
    std::int64_t window = 0;
    std::memcpy(&type, message.data() + 4, sizeof type);
    std::memcpy(&window, message.data() + 16, sizeof window);
    const bool oversized = how_ == "oversized";
    const auto wanted = oversized ? MessageType::kinematics : MessageType::free_velocity;
    if (type != static_cast<std::uint16_t>(wanted) || !(oversized || window == at_) ||
        seen_++ != (oversized ? 0 : 1))
      return channel_->send(message);
    std::vector<std::byte> bytes(message.begin(), message.end());
    if (how_ == "cut")
      bytes.resize(bytes.size() - 8);
    else
    {
      std::uint64_t number = 0;
      std::byte* const place = bytes.data() + (oversized ? wire::header_size : 8);
      std::memcpy(&number, place, sizeof number);
      number = oversized ? std::uint64_t(1) << 60 : number + 1;
      std::memcpy(place, &number, sizeof number);
      const std::uint32_t zero = 0;
      std::memcpy(bytes.data() + 48, &zero, sizeof zero);
      const std::uint32_t crc = wire::crc32c(bytes);
      std::memcpy(bytes.data() + 48, &crc, sizeof crc);
    }
    channel_->send(bytes);
  }
  void receive(std::vector<std::byte>& message) override { channel_->receive(message); }

private:
  std::unique_ptr<Channel> channel_;
  std::string how_;
  std::int64_t at_;
  int seen_ = 0;
};

struct NumericalFailure : std::runtime_error
{
  using std::runtime_error::runtime_error;
};

/// What goes wrong in the middle of window `--at`, after the first exchange has begun.
void misbehave(const std::string& behave, SolverLink* link)
{
  if (behave == "killed")
    kill(getpid(), SIGKILL);
  else if (behave == "stopped")
    kill(getpid(), SIGSTOP);
  else if (behave == "segfault")
    raise(SIGSEGV);
  else if (behave == "throw")
    throw std::logic_error("an exception that nobody catches");
  else if (behave == "loop")
    for (volatile double work = 0.0;;)
      work = std::sqrt(1.0 + work);
  else if (behave == "exit0")
    _exit(0);
  else if (behave == "exit3")
    _exit(3);
  else if (behave == "finalize")
  {
    MPI_Finalize();
    std::exit(0);
  }
  else if (behave == "fail")
    throw NumericalFailure("element 17 is inverted: step 120, t = 0.012 s");
  else if (behave == "work") // part of every window, so that the run lasts some seconds
    usleep(20000);
  else if (behave == "slow") // twice the stall limit, but alive
    for (const auto start = Clock::now(); seconds_since(start) < 4.0;)
    {
      link->ping();
      usleep(10000);
    }
}

/// The next window, told to all ranks if rows are `split` over them.
std::optional<Window> next_window(SolverLink& link, bool split, MPI_Comm comm)
{
  if (!split)
    return link.next_window();
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  struct
  {
    Window window;
    bool is_end = true;
  } told;
  if (rank == 0)
    if (const auto window = link.next_window())
      told = {*window, false};
  MPI_Bcast(&told, int(sizeof told), MPI_BYTE, 0, comm);
  if (rank > 0 && told.is_end)
    link.hear_end();
  else if (rank > 0)
    link.hear(told.window);
  return told.is_end ? std::nullopt : std::optional(told.window);
}

/// With --split=yes the rows of wet nodes belong to all ranks, in stretches that change hands with each new
/// surface, and it is the last rank that misbehaves.
void solve(const World& world, const Options& options)
{
  const bool split = options.text("split", "no") == "yes";
  int rank = 0, size = 1;
  MPI_Comm_rank(world.comm(), &rank);
  MPI_Comm_size(world.comm(), &size);
  auto channel = split ? world.path("coupler", 0) : world.channel("coupler");
  if (!channel)
    return; // other ranks of a solver have nothing to do here
  const std::string behave = split && rank + 1 < size ? "well" : options.text("behave", "well");
  const auto at = std::int64_t(options.number("at", 3));
  if (behave == "cut" || behave == "lost" || behave == "oversized")
    channel = std::make_unique<SpoilingChannel>(std::move(channel), behave, at);
  SolverLink link(std::move(channel), rank);
  try
  {
    if (rank == 0)
      link.receive_setup();
    else
      link.hear(Setup{});
    const int n = int(options.number("nodes", 64));
    SurfaceMesh mesh = row_of_nodes(n);
    std::vector<double> v, f;
    const auto share_rows = [&]
    {
      mesh.owner.clear();
      for (int i = 0; split && i < n; ++i)
        mesh.owner.push_back((int(std::int64_t(i) * size / n) + int(mesh.epoch)) % size);
      v.assign(mesh.rows_of(rank).size() * 2, 0.5);
      f.resize(v.size());
    };
    share_rows();
    link.send_mesh(mesh);
    Report report{.stable_dt = options.number("dt", 1e-3)};
    link.send_report(report);
    while (const auto window = next_window(link, split, world.comm()))
    {
      if (window->activate)
      {
        link.send_kinematics({.v = v, .a_free = v});
        link.receive_activation();
      }
      if (window->index == at && behave == "nan")
        v[5] = std::nan("");
      if (window->index == at && behave == "early_report")
        link.send_report(report);
      for (std::int64_t j = 0; j < (window->fine ? window->steps : 1); ++j)
      {
        link.send_free_velocity(v);
        if (window->index == at && behave == "return")
          return;
        if ((window->index == at || behave == "work") && j == 0)
          misbehave(behave, &link);
        link.receive_link_force(f);
      }
      report.steps += window->steps;
      report.wait_seconds = link.wait_seconds();
      report.surface_changed = window->index % 50 == 49;
      link.send_report(report);
      if (report.surface_changed)
      {
        ++mesh.epoch;
        share_rows();
        link.send_mesh_update(mesh);
      }
    }
  }
  catch (const NumericalFailure& failure)
  {
    link.send_failure(10, failure.what());
    abort_world(10, options.text("role", ""), failure.what(), options.text("out", ""));
  }
  if (options.text("cpu", "") == "print")
    std::printf("%s: waited %.3f s, CPU %.3f s\n", options.text("role", "").c_str(), link.wait_seconds(),
                cpu_seconds());
}

void couple(const World& world, const Options& options)
{
  const Team team(world.comm(), 0.0);
  if (team.rank() > 0)
  {
    team.tell({}); // comes at the end: other ranks have nothing to do here
    return;
  }
  PartnerLink fluid(world.channel("fluid"), "fluid", [&](int rank) { return world.path("fluid", rank); });
  PartnerLink solid(world.channel("solid"), "solid", [&](int rank) { return world.path("solid", rank); });
  const std::int64_t windows = std::int64_t(options.number("windows", 200));
  const std::int64_t m = std::int64_t(options.number("m", 5));
  const double dt = 1e-3;

  for (PartnerLink* partner : {&fluid, &solid})
    partner->send_setup({.dim = 2, .t_begin = 0.0, .t_end = double(windows) * dt, .interfaces = {"line"}});
  std::vector<double> v_fluid(fluid.receive_mesh().x.size());
  std::vector<double> v_solid(solid.receive_mesh().x.size());
  for (PartnerLink* partner : {&fluid, &solid})
    partner->accept_mesh();
  for (PartnerLink* partner : {&fluid, &solid})
    partner->receive_report();

  const std::string behave = options.text("behave", "well");
  const auto at = std::int64_t(options.number("at", 3));
  const auto start = Clock::now();
  for (std::int64_t k = 0; k < windows; ++k)
  {
    Window window{.index = k,
                  .t_begin = double(k) * dt,
                  .t_end = double(k + 1) * dt,
                  .activate = k == 0,
                  .last = k + 1 == windows};
    window.steps = m;
    window.fine = false;
    fluid.send_window(window);
    window.fine = true;
    solid.send_window(window);
    if (window.activate)
      for (PartnerLink* partner : {&fluid, &solid})
      {
        const Kinematics kinematics = partner->receive_kinematics();
        partner->send_activation({.impulse = kinematics.v, .link_force = kinematics.v});
      }
    fluid.receive_free_velocity(v_fluid);
    for (std::int64_t j = 0; j < m; ++j)
    {
      solid.receive_free_velocity(v_solid);
      if (k == at && j == 1)
        misbehave(behave, nullptr);
      solid.send_link_force(v_solid);
    }
    fluid.send_link_force(v_fluid);
    for (PartnerLink* partner : {&fluid, &solid})
      if (partner->receive_report().surface_changed)
        partner->receive_mesh_update();
  }
  const double wall = seconds_since(start);
  fluid.send_bye();
  solid.send_bye();
  team.tell({});
  std::printf("%lld windows with %lld exchanges each: %.1f us per exchange\n",
              static_cast<long long>(windows), static_cast<long long>(m + 1),
              1e6 * wall / double(windows * (m + 1)));
  if (options.text("cpu", "") == "print")
    std::printf("coupler: waited %.3f s, CPU %.3f s\n", fluid.wait_seconds() + solid.wait_seconds(),
                cpu_seconds());
}

/// An MPI program that knows nothing of the protocol.
int foreign(bool with_barrier)
{
  MPI_Init(nullptr, nullptr);
  if (with_barrier)
    MPI_Barrier(MPI_COMM_WORLD);
  MPI_Finalize();
  return 0;
}

/// Says HELLO as a program of protocol 2.0 would, and leaves the verdict to the judge.
int hello_of_the_future(const std::string& role)
{
  MPI_Init(nullptr, nullptr);
  int rank = 0;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  const auto bytes = encode(Hello{.major = 2,
                                  .world_rank = rank,
                                  .pid = getpid(),
                                  .role = role,
                                  .solver = "future 2.0",
                                  .host = "node7",
                                  .partners = {"coupler"}});
  MPI_Send(bytes.data(), int(bytes.size()), MPI_BYTE, 0, 21001, MPI_COMM_WORLD);
  sleep(60);
  MPI_Finalize();
  return 0;
}

} // namespace

int main(int argc, char** argv)
{
  const Options options(argc, argv);
  const std::string role = options.text("role", "solid");
  const std::string behave = options.text("behave", "well");
  const std::string out = options.text("out", "");
  if (behave == "foreign" || behave == "foreign_finalize")
    return foreign(behave == "foreign");
  if (behave == "future")
    return hello_of_the_future(role);

  arm_start_timer(role, options.number("start", 3.0));
  if (behave == "bad_case")
    abort_world(2, role, "case.toml:3:1: [solid] density = -1: must be positive", out);
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  try
  {
    if (behave == "late")
      sleep(30);
    Identity identity{.role = role,
                      .solver = options.text("solver", "actor 1"),
                      .dim = 2,
                      .case_hash = std::uint64_t(options.number("hash", 7)),
                      .partners = {"coupler"},
                      .capabilities = capability::link | capability::distributed};
    if (role == "coupler")
      identity.partners = {"fluid", "solid"};
    if (options.text("alone", "") == "yes")
      identity.partners.clear();
    const World world = World::connect(
        identity, {.hello = options.number("hello", 3.0), .stall = options.number("stall", 3.0)});
    if (!world.coupled())
      std::printf("%s runs alone\n", role.c_str());
    else if (role == "coupler")
      couple(world, options);
    else
      solve(world, options);
  }
  catch (const ProtocolError& error)
  {
    abort_world(error.code(), role, error.what(), out);
  }
  MPI_Finalize();
  return 0;
}
