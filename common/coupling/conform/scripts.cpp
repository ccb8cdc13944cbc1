// What the fake coupler says in each script, and the rules that the answers must keep.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/conform/scripts.hpp"

#include "common/coupling/bootstrap.hpp"
#include "common/coupling/exit_codes.hpp"
#include "common/coupling/handshake.hpp"
#include "common/coupling/link.hpp"
#include "common/coupling/wire.hpp"

#include <mpi.h>

#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <set>

namespace undine::link::conform
{
namespace
{

/// Findings of one run, kept on disk line by line: a run may end in the middle.
class Findings
{
public:
  explicit Findings(const std::string& folder) : out_(folder + "/findings", std::ios::app) {}
  void expect(bool holds, const std::string& clause, const std::string& text)
  {
    out_ << (holds ? "pass" : "FAIL") << '\t' << clause << '\t' << text << std::endl;
  }
  void note(const std::string& clause, const std::string& text)
  {
    out_ << "note" << '\t' << clause << '\t' << text << std::endl;
  }

private:
  std::ofstream out_;
};

/// Changes one outgoing message, to see whether the program notices.
class TamperingChannel final : public Channel
{
public:
  using Tamper = std::function<void(std::vector<std::byte>&)>;
  /// @param which  the n-th message of `type`, from 1
  TamperingChannel(std::unique_ptr<Channel> channel, MessageType type, int which, Tamper tamper)
      : channel_(std::move(channel)), type_(type), left_(which), tamper_(std::move(tamper))
  {
  }
  void send(std::span<const std::byte> message) override
  {
    std::uint16_t type = 0;
    std::memcpy(&type, message.data() + 4, sizeof type);
    if (tamper_ && type == static_cast<std::uint16_t>(type_) && --left_ == 0)
    {
      std::vector<std::byte> changed(message.begin(), message.end());
      tamper_(changed);
      channel_->send(changed);
    }
    else
      channel_->send(message);
  }
  void receive(std::vector<std::byte>& message) override { channel_->receive(message); }

private:
  std::unique_ptr<Channel> channel_;
  MessageType type_;
  int left_;
  Tamper tamper_;
};

/// Writes the checksum anew: what is wrong is something else.
void reseal(std::vector<std::byte>& message)
{
  const std::uint64_t size = message.size() - wire::header_size;
  std::memcpy(message.data() + 40, &size, sizeof size);
  const std::uint32_t zero = 0;
  std::memcpy(message.data() + 48, &zero, sizeof zero);
  const std::uint32_t crc = wire::crc32c(message);
  std::memcpy(message.data() + 48, &crc, sizeof crc);
}

/// A wrong message: which one, and what is done to it.
struct Wrong
{
  MessageType type;
  int which;
  TamperingChannel::Tamper tamper;
};

const std::vector<std::pair<Script, Wrong>>& wrong_messages()
{
  using Bytes = std::vector<std::byte>;
  static const std::vector<std::pair<Script, Wrong>> list{
      {{"wrong checksum", "one bit of a LINK_FORCE is flipped", 37, "3.3"},
       {MessageType::link_force, 2, [](Bytes& m) { m.back() ^= std::byte{1}; }}},
      {{"wrong magic", "a message of somebody else", 37, "3.3"},
       {MessageType::window, 2, [](Bytes& m) { m[0] ^= std::byte{0x20}; }}},
      {{"truncated message", "a LINK_FORCE ends early", 37, "3.3"},
       {MessageType::link_force, 2, [](Bytes& m) { m.resize(m.size() - 8); }}},
      {{"short header", "ten bytes instead of a message", 37, "3.3"},
       {MessageType::window, 2, [](Bytes& m) { m.resize(10); }}},
      {{"wrong size", "a LINK_FORCE for one node less, well formed", 37, "3.3"},
       {MessageType::link_force, 2,
        [](Bytes& m)
        {
          m.resize(m.size() - 8);
          reseal(m);
        }}},
      {{"oversized count", "an ACTIVATION_IMPULSE that promises 2^60 numbers", 37, "3.3"},
       {MessageType::activation_impulse, 1,
        [](Bytes& m)
        {
          const std::uint64_t count = 1ull << 60;
          std::memcpy(m.data() + wire::header_size, &count, sizeof count);
          reseal(m);
        }}},
      {{"NaN", "a LINK_FORCE with a number that is none", 37, "3.3"},
       {MessageType::link_force, 2,
        [](Bytes& m)
        {
          const double nan = std::numeric_limits<double>::quiet_NaN();
          std::memcpy(m.data() + m.size() - 8, &nan, sizeof nan);
          reseal(m);
        }}},
      {{"lost message", "a sequence number is left out", 37, "3.3"},
       {MessageType::link_force, 2,
        [](Bytes& m)
        {
          std::uint64_t sequence = 0;
          std::memcpy(&sequence, m.data() + 8, sizeof sequence);
          ++sequence;
          std::memcpy(m.data() + 8, &sequence, sizeof sequence);
          reseal(m);
        }}},
      {{"out of order", "MESH_REPLY where LINK_FORCE is expected", 37, "4.1"},
       {MessageType::link_force, 2,
        [](Bytes& m)
        {
          const auto type = static_cast<std::uint16_t>(MessageType::mesh_reply);
          std::memcpy(m.data() + 4, &type, sizeof type);
          reseal(m);
        }}},
      {{"unknown type", "a message of type 999", 37, "4.1"},
       {MessageType::link_force, 2,
        [](Bytes& m)
        {
          const std::uint16_t type = 999;
          std::memcpy(m.data() + 4, &type, sizeof type);
          reseal(m);
        }}},
      {{"wrong window", "a LINK_FORCE of another window", 37, "4.1"},
       {MessageType::link_force, 2,
        [](Bytes& m)
        {
          const std::int64_t window = 4711;
          std::memcpy(m.data() + 16, &window, sizeof window);
          reseal(m);
        }}},
  };
  return list;
}

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

/// Everything the program answered.
struct Record
{
  SurfaceMesh mesh;
  std::vector<std::vector<double>> v_free; ///< per exchange
  std::vector<double> dt;                  ///< per exchange: step that led to it
};

/// What the script adds to the zero forces: a velocity change of the order `kick` at all free components.
struct Push
{
  int exchange = -1;       ///< link force after that exchange
  bool activation = false; ///< impulse and link force of the first activation
};

/// A reproducible kick of every component, not the same for two.
std::vector<double> pattern(std::size_t size)
{
  std::vector<double> values(size);
  for (std::size_t k = 0; k < size; ++k)
    values[k] = std::sin(1.0 + 2.7 * static_cast<double>(k));
  return values;
}

/// y = M⁻¹ f per node.
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

/// The kick as a nodal vector of momentum [N s]: 1e-3 m/s per component for a node of the mean mass.
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

/// SETUP to the first READY.
Report begin(PartnerLink& link, const Options& options, SurfaceMesh& mesh)
{
  link.send_setup(setup_of(options));
  mesh = link.receive_mesh();
  link.accept_mesh();
  if (options.force_in)
    link.receive_motion();
  return link.receive_report();
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
    std::vector<double> f(p.size(), 0.0);
    if (static_cast<int>(k) == push.exchange)
      for (std::size_t i = 0; i < p.size(); ++i)
        f[i] = p[i] / dt;
    link.send_link_force(f);
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

/// Plays the plan with zero forces and the push.
Record converse(PartnerLink& link, const Options& options, const Push& push, Findings* findings)
{
  if (options.force_in)
    return converse_with_forces(link, options, push, findings);
  Record record;
  const Report start = begin(link, options, record.mesh);
  if (findings != nullptr)
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
  bool steps_right = true, times_right = true, dt_positive = true;
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
  if (findings != nullptr)
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

/// Scheme "contact": the plan's windows with one step each, the exchange in the middle.
Record converse_in_contact(PartnerLink& link, const Options& options, const Push& push, Findings* findings)
{
  Record record;
  Setup setup = setup_of(options);
  setup.scheme = contact_scheme;
  link.send_setup(setup);
  record.mesh = link.receive_mesh();
  link.accept_mesh();
  const Report start = link.receive_report();
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
    std::vector<double> f(p.size(), 0.0);
    if (static_cast<int>(k) == push.exchange)
      for (std::size_t i = 0; i < p.size(); ++i)
        f[i] = p[i] / dt;
    link.send_link_force(f);
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

void write_record(const std::string& path, const Record& record)
{
  std::ofstream out(path, std::ios::binary);
  for (const auto& v : record.v_free)
    out.write(reinterpret_cast<const char*>(v.data()),
              static_cast<std::streamsize>(v.size() * sizeof(double)));
}

/// The exchanges recorded by an earlier script, or nothing if it did not get so far.
std::vector<std::vector<double>> read_record(const std::string& path, const Record& like)
{
  std::vector<std::vector<double>> v_free;
  std::ifstream in(path, std::ios::binary);
  for (const auto& v : like.v_free)
  {
    v_free.emplace_back(v.size());
    if (!in.read(reinterpret_cast<char*>(v_free.back().data()),
                 static_cast<std::streamsize>(v.size() * sizeof(double))))
      return {};
  }
  return v_free;
}

std::string percent(double fraction)
{
  char text[32];
  std::snprintf(text, sizeof text, "%.2g %%", 100.0 * fraction);
  return text;
}

/// Compares exchange `k` with the undisturbed run: the change must be `factor` M⁻¹p.
void judge_response(const Record& record, const std::vector<std::vector<double>>& rest, std::size_t k,
                    double factor, const std::string& clause, const std::string& claim, Findings& findings)
{
  auto expected = times_inverse_mass(record.mesh, kick(record.mesh));
  for (double& value : expected)
    value *= factor;
  std::vector<double> error(expected.size());
  for (std::size_t i = 0; i < error.size(); ++i)
    error[i] = record.v_free[k][i] - rest[k][i] - expected[i];
  const double off = norm(error) / norm(expected);
  // The step is a fiftieth of the stable one: (ω Δt)² ≤ (2/50/0.9)², two in a thousand at the most.
  findings.expect(off <= 0.01, clause, claim + " (off by " + percent(off) + ")");
}

/// Level A: the force of a window shows at its end.
void play_force(const std::string& script, const Record& record, const std::string& folder,
                Findings& findings)
{
  const auto rest = read_record(folder + "/rest", record);
  const std::size_t k = script == "coarse force" ? 1 : 3;
  if (rest.empty())
    findings.expect(false, "8.1", "there is no undisturbed run to compare with");
  else
    judge_response(record, rest, k, 1.0, "8.1", "LINK_FORCE acts with M^-1 of MESH over its window",
                   findings);
}

/// In contact: a link force moves the nodes in its own step, whole.
void play_contact(const Record& record, const std::string& folder, Findings& findings)
{
  const auto rest = read_record(folder + "/contact", record);
  if (rest.empty())
    findings.expect(false, "4.7", "there is no undisturbed run to compare with");
  else
  {
    judge_response(record, rest, 2, 1.0, "4.7",
                   "LINK_FORCE acts with M^-1 of MESH in the middle of its step, whole", findings);
    findings.expect(record.v_free[1] == rest[1], "4.7",
                    "a free velocity does not know the link force of its own instant");
  }
}

void play_push(const std::string& script, const Record& record, const std::string& folder, Findings& findings)
{
  const auto rest = read_record(folder + "/rest", record);
  if (rest.empty())
  {
    findings.expect(false, "4.3", "there is no undisturbed run to compare with");
    return;
  }
  if (script == "impulse")
    // v ← v + M⁻¹p, then Δt/2 of the link force p/Δt
    judge_response(record, rest, 0, 1.5, "4.3",
                   "ACTIVATION_IMPULSE changes velocity and acceleration by M^-1 of MESH", findings);
  else
  {
    const std::size_t k = script == "coarse force" ? 1 : 3;
    const double factor = 0.5 * (1.0 + record.dt[k + 1] / record.dt[k]);
    judge_response(
        record, rest, k + 1, factor, "4.3",
        std::string(
            "LINK_FORCE acts with M^-1 of MESH at the end of its step and at the begin of the next, ") +
            (script == "coarse force" ? "as coarse side" : "as fine side"),
        findings);
  }
  double before = 0.0;
  const std::size_t pushed = script == "impulse" ? 0 : script == "coarse force" ? 2 : 4;
  for (std::size_t k = 0; k < pushed; ++k)
    for (std::size_t i = 0; i < record.v_free[k].size(); ++i)
      before = std::max(before, std::abs(record.v_free[k][i] - rest[k][i]));
  if (pushed > 0)
    findings.expect(before <= 1e-9, "4.3", "a free velocity does not know the link force of its own instant");
}

/// After a wrong message the program under test must end the run; this process only waits.
[[noreturn]] void wait_for_the_end(double seconds)
{
  usleep(static_cast<useconds_t>(1e6 * seconds));
  MPI_Abort(MPI_COMM_WORLD, not_noticed);
  _exit(not_noticed);
}

void judge_hello(const Options& options, Findings& findings)
{
  MPI_Status status;
  MPI_Message handle;
  MPI_Mprobe(1, 21001, MPI_COMM_WORLD, &handle, &status);
  int size = 0;
  MPI_Get_count(&status, MPI_BYTE, &size);
  std::vector<std::byte> bytes(static_cast<std::size_t>(size));
  MPI_Mrecv(bytes.data(), size, MPI_BYTE, &handle, MPI_STATUS_IGNORE);
  findings.expect(bytes.size() == hello_size, "2.2", "HELLO has 512 bytes");
  const Hello hello = decode_hello(bytes);
  findings.expect(hello.major == protocol_major, "2.2",
                  "HELLO: major version " + std::to_string(hello.major));
  findings.expect(hello.endian == 0x01020304u, "2.2", "HELLO: little-endian");
  findings.expect(hello.role == options.role, "2.2", "HELLO: role '" + hello.role + "'");
  findings.expect(hello.world_rank == 1, "2.2", "HELLO: world rank " + std::to_string(hello.world_rank));
  findings.expect(!hello.solver.empty(), "2.2", "HELLO: the solver is named '" + hello.solver + "'");
  findings.expect(hello.partners == std::vector<std::string>{"coupler"}, "2.2",
                  "HELLO: needs a coupler and nobody else");
  findings.expect((hello.capabilities & (capability::force_in | capability::link)) != 0, "2.2",
                  "HELLO: level" + std::string(hello.capabilities & capability::force_in ? " A" : "") +
                      (hello.capabilities & capability::link ? " B" : "") +
                      (hello.capabilities & capability::contact ? ", contact" : ""));
  findings.note("2.2",
                hello.case_hash == 0 ? "HELLO: did not read the case (hash 0)" : "HELLO: read the case");
}

World meet(const Options& options)
{
  return World::connect({.role = "coupler", .solver = "undine-conform", .dim = 0, .partners = {options.role}},
                        {.hello = options.limit, .stall = options.limit});
}

} // namespace

const std::vector<Script>& scripts()
{
  static const std::vector<Script> list = []
  {
    std::vector<Script> all{
        {"hello", "the first word, answered by a ROSTER with status 33", 33, "2.4"},
        {"rest", "an orderly run without link forces", 0, "4.5"},
        {"repeat", "the same again", 0, "4.5"},
        {"coarse force", "a link force in a window without sub-steps", 0, "4.5"},
        {"fine force", "a link force in the middle of a sub-cycled window", 0, "4.5"},
        {"impulse", "an activation impulse", 0, "4.5"},
        {"contact", "windows with the exchange in the middle of the step", 0, "4.5"},
        {"contact force", "a link force in the middle of a step", 0, "4.5"},
        {"unknown interface", "SETUP names an interface that the program cannot have", -1, "6.2"},
        {"rejected mesh", "MESH_REPLY says no", 4, "6.1"},
        {"failed partner", "the coupler says FAIL", 40, "6.1"},
        {"silent coupler", "the coupler says nothing more", 36, "5.2"},
    };
    for (const auto& [script, wrong] : wrong_messages())
      all.push_back(script);
    return all;
  }();
  return list;
}

int play(const std::string& script, const Options& given, int argc, char** argv)
{
  Options options = given;
  arm_start_timer("coupler", options.limit);
  MPI_Init(&argc, &argv);
  Findings findings(options.folder);
  try
  {
    if (script == "hello")
    {
      judge_hello(options, findings);
      const auto roster = encode(Roster{.major = 2,
                                        .minor = 0,
                                        .status = code::wrong_protocol,
                                        .text = "undine-conform refuses every hello of this script",
                                        .ranks = {}});
      MPI_Send(roster.data(), static_cast<int>(roster.size()), MPI_BYTE, 1, 21002, MPI_COMM_WORLD);
      wait_for_the_end(options.limit);
    }
    const World world = meet(options);
    auto channel = world.channel(options.role);
    options.force_in = (world.capabilities_of(options.role) & capability::link) == 0;
    const bool in_contact = script == "contact" || script == "contact force";
    // A fluid in contact is shown the solid's surface first; that is played by the real coupler only.
    const bool can_contact =
        (world.capabilities_of(options.role) & capability::contact) != 0 && options.role != "fluid";
    if ((options.force_in && (script == "impulse" || script == "oversized count")) ||
        (in_contact && !can_contact))
    {
      std::ofstream(options.folder + "/" + not_applicable) << script;
      PartnerLink link(std::move(channel), options.role);
      converse(link, options, {}, nullptr);
      MPI_Finalize();
      return 0;
    }

    for (const auto& [wrong_script, wrong] : wrong_messages())
      if (wrong_script.name == script)
      {
        PartnerLink link(
            std::make_unique<TamperingChannel>(std::move(channel), wrong.type, wrong.which, wrong.tamper),
            options.role);
        try
        {
          converse(link, options, {}, nullptr);
        }
        catch (const ProtocolError&)
        {
          // the program fell silent or complained; it must end the run now
        }
        wait_for_the_end(options.limit);
      }

    PartnerLink link(std::move(channel), options.role);
    if (script == "unknown interface")
    {
      Setup setup = setup_of(options);
      setup.interfaces = {"an interface that nobody has"};
      link.send_setup(setup);
      const auto mesh = link.receive_mesh(); // throws when the program says FAIL, which is one right answer
      const bool has_it = !mesh.face_interface.empty() && mesh.interfaces == setup.interfaces;
      // A program that gives its only surface to whatever interface is asked for has nothing to refuse.
      findings.note("6.2",
                    has_it ? "the program takes any interface name" : "the program answers with a MESH");
      link.reject_mesh("undine-conform: there is no such interface");
      wait_for_the_end(options.limit);
    }
    if (script == "rejected mesh")
    {
      link.send_setup(setup_of(options));
      link.receive_mesh();
      link.reject_mesh("undine-conform does not like it");
      wait_for_the_end(options.limit);
    }
    if (script == "failed partner" || script == "silent coupler")
    {
      SurfaceMesh mesh;
      const Report report = begin(link, options, mesh);
      link.send_window({.index = 0, .t_begin = 0.0, .t_end = 0.02 * report.stable_dt, .steps = 1});
      std::vector<double> v(mesh.x.size());
      if (!options.force_in)
        link.receive_free_velocity(v);
      if (script == "failed partner")
        link.send_failure(10, "undine-conform pretends to have failed, step 1, t = 0 s");
      wait_for_the_end(options.limit + options.stall);
    }

    Push push;
    push.activation = script == "impulse";
    push.exchange = script == "coarse force" || script == "contact force" ? 1
                    : script == "fine force"                              ? 3
                                                                          : -1;
    const Record record =
        in_contact ? converse_in_contact(link, options, push, script == "contact" ? &findings : nullptr)
                   : converse(link, options, push, script == "rest" ? &findings : nullptr);
    if (script == "contact")
      write_record(options.folder + "/contact", record);
    else if (script == "contact force")
      play_contact(record, options.folder, findings);
    else if (script == "rest")
      write_record(options.folder + "/rest", record);
    else if (script == "repeat")
    {
      const auto rest = read_record(options.folder + "/rest", record);
      findings.expect(rest == record.v_free, "4.3", "the same orders give the same answers, bit by bit");
    }
    else if (options.force_in)
      play_force(script, record, options.folder, findings);
    else
      play_push(script, record, options.folder, findings);
  }
  catch (const ProtocolError& error)
  {
    // In the script of an unknown interface a FAIL is the right answer, and its code the one of the run.
    if (script != "unknown interface")
      findings.expect(false, "4.1", error.what());
    abort_world(error.code(), "coupler", error.what(), "");
  }
  MPI_Finalize();
  return 0;
}

} // namespace undine::link::conform
