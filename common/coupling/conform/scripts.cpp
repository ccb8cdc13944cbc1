// What the fake coupler says in each script, and the rules that the answers must keep.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/conform/scripts.hpp"

#include "common/coupling/bootstrap.hpp"
#include "common/coupling/conform/conversations.hpp"
#include "common/coupling/conform/wrong_messages.hpp"
#include "common/coupling/exit_codes.hpp"
#include "common/coupling/failure.hpp"
#include "common/coupling/handshake.hpp"
#include "common/coupling/link.hpp"
#include "common/coupling/start_timer.hpp"
#include "common/coupling/wire.hpp"

#include <mpi.h>

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <fstream>

namespace undine::link::conform
{
namespace
{

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

/// Without exchange the same happens as with exchanges of no force.
void judge_flight(const Record& record, const std::string& folder, Findings& findings)
{
  const auto steps = read_record(folder + "/steps", record);
  if (steps.empty())
  {
    findings.expect(false, "4.7", "there is no run step by step to compare with");
    return;
  }
  const auto off = [&](std::size_t k)
  {
    std::vector<double> error(record.v_free[k]);
    for (std::size_t i = 0; i < error.size(); ++i)
      error[i] -= steps[k][i];
    return norm(error) / std::max(norm(steps[k]), 1e-300);
  };
  // Round-off of velocities of 1e-3 m/s at positions of metres, and of sums in another order.
  findings.expect(off(1) <= 1e-9, "4.7",
                  "FREE_VELOCITY of a window without exchange is the mean of its steps (off by " +
                      percent(off(1)) + ")");
  findings.expect(off(2) <= 1e-9, "4.7",
                  "a window without exchange ends where its steps one by one end (off by " + percent(off(2)) +
                      ")");
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
                      (hello.capabilities & capability::contact ? ", contact" : "") +
                      (hello.capabilities & capability::rewind ? ", windows on trial" : "") +
                      (hello.capabilities & capability::flight ? ", windows without exchange" : "") +
                      (hello.capabilities & capability::distributed ? ", rows of several ranks" : ""));
  findings.note("2.2",
                hello.case_hash == 0 ? "HELLO: did not read the case (hash 0)" : "HELLO: read the case");
}

World meet(const Options& options)
{
  return World::connect({.role = "coupler",
                         .solver = "undine-conform",
                         .dim = 0,
                         .partners = {options.role},
                         .capabilities = capability::distributed},
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
        {"trial", "windows on trial before they count", 0, "4.8"},
        {"steps", "steps without link force, one by one", 0, "4.7"},
        {"flight", "the same without exchange", 0, "4.7"},
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

namespace
{

/// Hears the hello, and refuses it.
[[noreturn]] void play_hello(const Options& options, Findings& findings)
{
  judge_hello(options, findings);
  const auto roster = encode(Roster{.major = 2,
                                    .minor = 0,
                                    .status = code::wrong_protocol,
                                    .text = "undine-conform refuses every hello of this script",
                                    .ranks = {}});
  for (int rank = 1; rank <= options.ranks; ++rank)
    MPI_Send(roster.data(), static_cast<int>(roster.size()), MPI_BYTE, rank, 21002, MPI_COMM_WORLD);
  wait_for_the_end(options.limit);
}

bool is_in_contact(const std::string& script) { return script == "contact" || script == "contact force"; }
bool is_in_flight(const std::string& script) { return script == "steps" || script == "flight"; }

/// The program can play the script by what it has offered.
bool applies(const std::string& script, const Options& options, const World& world)
{
  const auto can = [&](std::uint64_t what) { return (world.capabilities_of(options.role) & what) != 0; };
  if (options.force_in && (script == "impulse" || script == "oversized count" || script == "trial"))
    return false;
  // A fluid in contact is shown the solid's surface first; that is played by the real coupler only.
  if ((is_in_contact(script) || is_in_flight(script)) &&
      (!can(capability::contact) || options.role == "fluid"))
    return false;
  return !(is_in_flight(script) && !can(capability::flight)) &&
         !(script == "trial" && !can(capability::rewind));
}

/// After one wrong message the program must end the run.
[[noreturn]] void play_wrong(const Wrong& wrong, const Options& options, std::unique_ptr<Channel> channel,
                             const PartnerLink::PathMaker& path)
{
  PartnerLink link(
      std::make_unique<TamperingChannel>(std::move(channel), wrong.type, wrong.which, wrong.tamper),
      options.role, path);
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

/// Scripts that the program must end itself; returns for all others.
void play_refusal(const std::string& script, PartnerLink& link, const Options& options, Findings& findings)
{
  if (script == "unknown interface")
  {
    Setup setup = setup_of(options);
    setup.interfaces = {"an interface that nobody has"};
    link.send_setup(setup);
    const auto mesh = link.receive_mesh(); // throws when the program says FAIL, which is one right answer
    const bool has_it = !mesh.face_interface.empty() && mesh.interfaces == setup.interfaces;
    // A program that gives its only surface to whatever interface is asked for has nothing to refuse.
    findings.note("6.2", has_it ? "the program takes any interface name" : "the program answers with a MESH");
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
}

/// The answers of the program to a whole conversation are kept, or compared with those that are.
void play_record(const std::string& script, PartnerLink& link, const Options& options, Findings& findings)
{
  if (is_in_flight(script))
  {
    const Record record = fly(link, options, script == "flight", findings);
    if (script == "flight")
      judge_flight(record, options.folder, findings);
    else
      write_record(options.folder + "/steps", record);
    return;
  }
  Push push;
  push.activation = script == "impulse";
  push.exchange = script == "coarse force" || script == "contact force" ? 1 : script == "fine force" ? 3 : -1;
  const Record record =
      is_in_contact(script)
          ? converse_in_contact(link, options, push, script == "contact" ? &findings : nullptr)
          : converse(link, options, push, script == "rest" || script == "trial" ? &findings : nullptr,
                     script == "trial");
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
  else if (script == "trial")
  {
    const auto rest = read_record(options.folder + "/rest", record);
    findings.expect(rest == record.v_free, "4.8",
                    "after windows on trial the answers are those of a run without, bit by bit");
  }
  else if (options.force_in)
    play_force(script, record, options.folder, findings);
  else
    play_push(script, record, options.folder, findings);
}

} // namespace

int play(const std::string& script, const Options& given, int argc, char** argv)
{
  Options options = given;
  arm_start_timer("coupler", options.limit);
  MPI_Init(&argc, &argv);
  Findings findings(options.folder);
  try
  {
    if (script == "hello")
      play_hello(options, findings);
    const World world = meet(options);
    auto channel = world.channel(options.role);
    const auto path = [&](int rank) { return world.path(options.role, rank); };
    options.force_in = (world.capabilities_of(options.role) & capability::link) == 0;
    const bool is_played = applies(script, options, world);
    if (!is_played)
      std::ofstream(options.folder + "/" + not_applicable) << script;
    for (const auto& [wrong_script, wrong] : wrong_messages())
      if (is_played && wrong_script.name == script)
        play_wrong(wrong, options, std::move(channel), path);
    PartnerLink link(std::move(channel), options.role, path);
    if (is_played)
    {
      play_refusal(script, link, options, findings);
      play_record(script, link, options, findings);
    }
    else
      converse(link, options, {}, nullptr);
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
