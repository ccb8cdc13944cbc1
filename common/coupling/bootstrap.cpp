// The hand-shake over MPI_COMM_WORLD, and the communicators that come of it.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/bootstrap.hpp"

#include "common/coupling/exit_codes.hpp"
#include "common/coupling/failure.hpp"
#include "common/coupling/handshake.hpp"
#include "common/coupling/mpi_channel.hpp"
#include "common/coupling/own_process.hpp"
#include "common/coupling/start_timer.hpp"
#include "common/coupling/text.hpp"

#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <exception>
#include <optional>

namespace undine::link
{
namespace
{

constexpr int hello_tag = 21001;
constexpr int roster_tag = 21002;
constexpr int group_tag = 21003;
constexpr int intercommunicator_tag = 21004;

/// How much later than its own hello limit a rank gives up on world rank 0 [s]: the judge's verdict comes
/// first.
constexpr double roster_grace = 1.0;

/// Errors of MPI_COMM_WORLD are returned, not fatal, while this object lives.
class ReturnedErrors
{
public:
  ReturnedErrors()
  {
    MPI_Comm_get_errhandler(MPI_COMM_WORLD, &old_);
    MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN);
  }
  ~ReturnedErrors()
  {
    MPI_Comm_set_errhandler(MPI_COMM_WORLD, old_);
    MPI_Errhandler_free(&old_);
  }
  ReturnedErrors(const ReturnedErrors&) = delete;
  ReturnedErrors& operator=(const ReturnedErrors&) = delete;

private:
  MPI_Errhandler old_ = MPI_ERRHANDLER_NULL;
};

void require_success(int result, const char* doing) { require_mpi(result, code::no_hello, doing); }

/// Takes a message from the world if one is there.
std::optional<std::vector<std::byte>> take(int source, int tag, int* from)
{
  int found = 0;
  MPI_Message handle = MPI_MESSAGE_NULL;
  MPI_Status status;
  require_success(MPI_Improbe(source, tag, MPI_COMM_WORLD, &found, &handle, &status), "waiting for a hello");
  if (found == 0)
    return std::nullopt;
  int size = 0;
  MPI_Get_count(&status, MPI_BYTE, &size);
  std::vector<std::byte> bytes(static_cast<std::size_t>(size));
  require_success(MPI_Mrecv(bytes.data(), size, MPI_BYTE, &handle, MPI_STATUS_IGNORE), "receiving a hello");
  if (from != nullptr)
    *from = status.MPI_SOURCE;
  return bytes;
}

/// Deadline and manners of the two waiting loops of the hand-shake. `seconds` ≤ 0: no limit.
class Wait
{
public:
  explicit Wait(double seconds) : seconds_(seconds) {}
  bool over() { return seconds_ > 0.0 && time_.seconds() > seconds_; }
  void pause()
  {
    if (++turns_ < 1000)
      sched_yield();
    else
      sleep_for(1e-3);
  }

private:
  OwnTime time_;
  double seconds_;
  int turns_ = 0;
};

using Hellos = std::vector<std::optional<Hello>>; ///< by world rank

/// World rank 0: hear everybody, until all have spoken or something is wrong.
Verdict hear_world(Hellos& hellos, double seconds)
{
  auto missing = std::count(hellos.begin(), hellos.end(), std::nullopt);
  Wait wait(seconds);
  while (missing > 0)
  {
    int from = 0;
    if (const auto bytes = take(MPI_ANY_SOURCE, hello_tag, &from))
    {
      Verdict verdict;
      try
      {
        auto& slot = hellos[static_cast<std::size_t>(from)];
        missing -= slot ? 0 : 1;
        slot = decode_hello(*bytes);
        verdict = judge_pairs(hellos);
      }
      catch (const ProtocolError& error)
      {
        verdict = {error.code(), "world rank " + std::to_string(from) + ": " + error.what()};
      }
      if (verdict.code != 0)
        return verdict;
    }
    else if (wait.over())
      return judge_silence(hellos, seconds);
    else
      wait.pause();
  }
  return judge_roles(hellos);
}

/// To all that spoke.
void send(const Roster& roster, const Hellos& hellos, double seconds)
{
  const std::vector<std::byte> bytes = encode(roster);
  std::vector<MPI_Request> requests;
  for (std::size_t rank = 1; rank < hellos.size(); ++rank)
    if (hellos[rank])
    {
      requests.emplace_back();
      require_success(MPI_Isend(bytes.data(), static_cast<int>(bytes.size()), MPI_BYTE,
                                static_cast<int>(rank), roster_tag, MPI_COMM_WORLD, &requests.back()),
                      "sending the roster");
    }
  // After a good verdict everybody is in the receive loop. After a bad one somebody may be dead: a short try
  // only.
  Wait sending(roster.status == 0 ? seconds : 0.2);
  for (int done = 0; done == 0 && !sending.over();)
  {
    require_success(
        MPI_Testall(static_cast<int>(requests.size()), requests.data(), &done, MPI_STATUSES_IGNORE),
        "sending the roster");
    if (done == 0)
      sending.pause();
  }
}

/// World rank 0: hear, judge, answer.
Roster judge_world(const Hello& own, int world_size, const Deadlines& deadlines)
{
  Hellos hellos(static_cast<std::size_t>(world_size));
  hellos[0] = own;
  const Verdict verdict = hear_world(hellos, deadlines.hello);
  Roster roster{
      .major = own.major, .minor = own.minor, .status = verdict.code, .text = verdict.text, .ranks = {}};
  for (const auto& hello : hellos)
  {
    if (hello)
      roster.minor = std::min(roster.minor, hello->minor);
    if (verdict.code == 0)
      roster.ranks.push_back({hello->role, hello->solver, hello->host, hello->capabilities});
  }
  send(roster, hellos, deadlines.hello);
  return roster;
}

/// Every other rank: send HELLO, wait for ROSTER.
Roster ask_judge(const Hello& own, const Deadlines& deadlines)
{
  // Kept until the process ends: a world rank 0 that is no program of ours never takes it.
  static std::vector<std::byte> hello;
  hello = encode(own);
  MPI_Request request = MPI_REQUEST_NULL;
  require_success(MPI_Isend(hello.data(), static_cast<int>(hello.size()), MPI_BYTE, 0, hello_tag,
                            MPI_COMM_WORLD, &request),
                  "sending the hello");
  const double limit = deadlines.hello > 0.0 ? deadlines.hello + roster_grace : 0.0;
  for (Wait wait(limit); !wait.over(); wait.pause())
    if (const auto bytes = take(0, roster_tag, nullptr))
    {
      MPI_Wait(&request, MPI_STATUS_IGNORE);
      return decode_roster(*bytes);
    }
  MPI_Request_free(&request);
  throw ProtocolError(code::no_hello,
                      "world rank 0 has not answered the hello within " + number_text(limit) +
                          " s\n       the first program of the mpirun line does not speak the Undine "
                          "protocol, or hangs while it starts.");
}

/// Role of this process, for finalize_guard().
std::string& own_role()
{
  static std::string role;
  return role;
}

/// Runs first of all in MPI_Finalize. A program that comes here in the middle of the run would wait in
/// MPI_Finalize for the others, and the others for it: it says FAIL instead and waits to be ended. (That
/// mpirun of Open MPI 4.1.4 now and then crashes or hangs when one program aborts while another sits in
/// MPI_Finalize is one more reason not to go on.)
int finalize_guard(MPI_Comm, int, void*, void*)
{
  const std::string reason = "it called MPI_Finalize before the coupled run had ended";
  if (MpiChannel::say_farewells(reason) || failure_announced)
    abort_world(code::internal_error, own_role(), "'" + own_role() + "': " + reason, "");
  return MPI_SUCCESS;
}

void guard_finalize()
{
  static bool guarded = false;
  if (guarded)
    return;
  guarded = true;
  int key = MPI_KEYVAL_INVALID;
  MPI_Comm_create_keyval(MPI_COMM_NULL_COPY_FN, finalize_guard, &key, nullptr);
  MPI_Comm_set_attr(MPI_COMM_SELF, key, nullptr);
  MPI_Comm_free_keyval(&key); // lives on until the attribute is deleted
}

} // namespace

struct World::State
{
  std::string role;
  Roster roster;
  MPI_Comm comm = MPI_COMM_NULL;
  int role_rank = 0;
  double stall = 0.0;
  bool coupled = false;
  std::map<std::string, MPI_Comm> intercommunicator;
  std::shared_ptr<Intercommunicators> owner = std::make_shared<Intercommunicators>();

  ~State()
  {
    // While an exception unwinds the program is about to abort; MPI_Comm_free is collective and could wait.
    if (comm != MPI_COMM_NULL && std::uncaught_exceptions() == 0 && mpi_is_running())
      MPI_Comm_free(&comm);
  }

  std::vector<int> ranks_of(const std::string& wanted) const
  {
    std::vector<int> ranks;
    for (std::size_t rank = 0; rank < roster.ranks.size(); ++rank)
      if (roster.ranks[rank].role == wanted)
        ranks.push_back(static_cast<int>(rank));
    return ranks;
  }

  /// Rank 0 of a role. @throws ProtocolError(1)
  const RosterEntry& first_of(const std::string& wanted) const
  {
    const std::vector<int> ranks = ranks_of(wanted);
    if (ranks.empty())
      throw ProtocolError(code::internal_error, "there is no program with role '" + wanted + "'");
    return roster.ranks[static_cast<std::size_t>(ranks.front())];
  }

  void make_communicators(const std::vector<std::string>& partners)
  {
    const std::vector<int> own = ranks_of(role);
    MPI_Group world;
    MPI_Group group;
    MPI_Comm_group(MPI_COMM_WORLD, &world);
    MPI_Group_incl(world, static_cast<int>(own.size()), own.data(), &group);
    require_success(MPI_Comm_create_group(MPI_COMM_WORLD, group, group_tag, &comm),
                    "making the communicator of a role");
    MPI_Group_free(&group);
    MPI_Group_free(&world);
    MPI_Comm_rank(comm, &role_rank);

    // Star: the coupler meets its partners one after the other, each partner only the coupler.
    for (const std::string& partner : partners)
    {
      MPI_Comm inter = MPI_COMM_NULL;
      require_success(MPI_Intercomm_create(comm, 0, MPI_COMM_WORLD, ranks_of(partner).front(),
                                           intercommunicator_tag, &inter),
                      "connecting two programs");
      MPI_Comm_set_errhandler(inter, MPI_ERRORS_RETURN);
      intercommunicator[partner] = inter;
      owner->add(inter);
    }
    // What the solver does inside its own communicator is its affair: MPI's default.
    MPI_Comm_set_errhandler(comm, MPI_ERRORS_ARE_FATAL);
  }
};

World::World(std::unique_ptr<State> state) : state_(std::move(state)) {}
World::World(World&&) noexcept = default;
World::~World() = default;

World World::connect(const Identity& identity, const Deadlines& deadlines)
{
  if (!mpi_is_running())
    throw ProtocolError(code::internal_error, "World::connect needs MPI_Init first");
  int rank = 0;
  int size = 0;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  courtesy = courtesy_of(rank); // world rank 0 judges, and speaks

  if (deadlines.hello > 0.0) // world rank 0 first; mpirun ends the others within two seconds
    arm_hand_shake_timer(deadlines.hello + roster_grace + 5.0 + (rank == 0 ? 0.0 : 2.0),
                         "'" + identity.role + "': the hand-shake hangs although all programs have spoken");
  else
    disarm_start_timer();
  struct Disarm
  {
    ~Disarm() { disarm_start_timer(); }
  } const disarm;
  const ReturnedErrors returned_errors;

  const Hello hello{.major = protocol_major,
                    .minor = protocol_minor,
                    .dim = identity.dim,
                    .capabilities = identity.capabilities,
                    .case_hash = identity.case_hash,
                    .world_rank = rank,
                    .pid = static_cast<std::int32_t>(getpid()),
                    .role = identity.role,
                    .solver = identity.solver,
                    .host = host_name(),
                    .partners = identity.partners};

  auto state = std::make_unique<State>();
  state->role = identity.role;
  state->stall = deadlines.stall;
  state->roster = rank == 0 ? judge_world(hello, size, deadlines) : ask_judge(hello, deadlines);
  if (state->roster.status != 0)
    throw ProtocolError(state->roster.status, state->roster.text);

  const bool has_coupler = !state->ranks_of("coupler").empty();
  std::vector<std::string> partners;
  if (identity.role == "coupler")
    partners = identity.partners;
  else if (has_coupler)
    partners = {"coupler"};
  state->coupled = !partners.empty();
  state->make_communicators(partners);

  own_role() = identity.role;
  guard_finalize();

  // In the run the coupler speaks first: it hears of every error.
  if (state->coupled)
    courtesy = identity.role == "coupler" && state->role_rank == 0 ? 0.0 : courtesy_of(rank + 1);
  else
    courtesy = courtesy_of(state->role_rank);
  return World(std::move(state));
}

MPI_Comm World::comm() const { return state_->comm; }
bool World::coupled() const { return state_->coupled; }

std::unique_ptr<Channel> World::channel(const std::string& role) const
{
  return state_->role_rank == 0 ? path(role, 0) : nullptr;
}

std::unique_ptr<Channel> World::path(const std::string& role, int rank) const
{
  const auto found = state_->intercommunicator.find(role);
  if (found == state_->intercommunicator.end())
    throw ProtocolError(code::internal_error, "'" + state_->role + "' has no channel to '" + role + "'");
  if (const auto n = static_cast<int>(state_->ranks_of(role).size()); rank < 0 || rank >= n)
    throw ProtocolError(code::message_out_of_order,
                        "'" + role + "' gave rows of its wet surface to its rank " + std::to_string(rank) +
                            ", but it has " + std::to_string(n) + " ranks");
  return std::make_unique<MpiChannel>(state_->owner, found->second, rank, state_->stall);
}

std::string World::solver_of(const std::string& role) const { return state_->first_of(role).solver; }

std::uint64_t World::capabilities_of(const std::string& role) const
{
  return state_->first_of(role).capabilities;
}

} // namespace undine::link
