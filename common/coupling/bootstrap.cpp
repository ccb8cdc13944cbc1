// From MPI_COMM_WORLD to roles, and the way out when something fails.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/bootstrap.hpp"

#include "common/coupling/exit_codes.hpp"
#include "common/coupling/failure_state.hpp"
#include "common/coupling/handshake.hpp"
#include "common/coupling/mpi_channel.hpp"

#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>

namespace undine::link
{
namespace
{

using Clock = std::chrono::steady_clock;

constexpr int hello_tag = 21001;
constexpr int roster_tag = 21002;
constexpr int group_tag = 21003;
constexpr int intercommunicator_tag = 21004;

/// How much later than its own hello limit a rank gives up on world rank 0 [s]: the judge's verdict comes
/// first.
constexpr double roster_grace = 1.0;

/// Seconds this process leaves to others that see the same error, before it speaks itself; negative: not
/// known yet.
std::atomic<double> courtesy{-1.0};

std::string number_text(double value)
{
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

/// One write, so that the lines of several programs do not mix.
void print(const std::string& text)
{
  const char* p = text.data();
  std::size_t left = text.size();
  while (left > 0)
  {
    const ssize_t written = ::write(STDERR_FILENO, p, left);
    if (written <= 0)
      return;
    p += written;
    left -= static_cast<std::size_t>(written);
  }
}

void sleep_for(double seconds)
{
  const timespec duration{
      .tv_sec = static_cast<time_t>(seconds),
      .tv_nsec = static_cast<long>((seconds - static_cast<double>(static_cast<time_t>(seconds))) * 1e9)};
  nanosleep(&duration, nullptr);
}

bool mpi_is_running()
{
  int initialized = 0;
  int finalized = 0;
  MPI_Initialized(&initialized);
  MPI_Finalized(&finalized);
  return initialized != 0 && finalized == 0;
}

std::string host_name()
{
  char name[256] = {};
  gethostname(name, sizeof name - 1);
  return name;
}

/// Time that this process has had. One that was stopped (SIGSTOP; mpirun wakes it to end it) must not wake up
/// past a limit and speak: from one look to the next at most a second counts.
class OwnTime
{
public:
  double seconds()
  {
    const auto now = Clock::now();
    sum_ += std::min(1.0, std::chrono::duration<double>(now - last_).count());
    last_ = now;
    return sum_;
  }

private:
  double sum_ = 0.0;
  Clock::time_point last_ = Clock::now();
};

/// Ends the process when a piece of the start hangs inside MPI, where nothing else can end it.
class Watchdog
{
public:
  /// `during_mpi_init`: only if MPI_Init has not returned by then.
  void arm(double seconds, int code, std::string text, bool during_mpi_init)
  {
    const std::lock_guard lock(mutex_);
    time_ = {};
    limit_ = seconds;
    code_ = code;
    text_ = std::move(text);
    during_mpi_init_ = during_mpi_init;
    armed_ = true;
    if (!running_)
    {
      running_ = true;
      // Signals stay with the main thread.
      sigset_t all;
      sigset_t old;
      sigfillset(&all);
      pthread_sigmask(SIG_SETMASK, &all, &old);
      std::thread([this] { watch(); }).detach();
      pthread_sigmask(SIG_SETMASK, &old, nullptr);
    }
    changed_.notify_all();
  }

  void disarm()
  {
    const std::lock_guard lock(mutex_);
    armed_ = false;
    changed_.notify_all();
  }

private:
  void watch()
  {
    std::unique_lock lock(mutex_);
    while (armed_)
    {
      if (const double left = limit_ - time_.seconds(); left > 0.0)
      {
        changed_.wait_for(lock, std::chrono::duration<double>(std::min(left, 0.25)));
        continue;
      }
      if (during_mpi_init_ && mpi_is_running())
        break; // started; from here on the deadline of the hello counts
      print("error: " + text_ + "\n");
      _exit(code_); // exit() could wait for the thread that hangs inside MPI
    }
    armed_ = false;
    running_ = false;
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  OwnTime time_;
  double limit_ = 0.0; ///< [s]
  int code_ = 0;
  std::string text_;
  bool during_mpi_init_ = false;
  bool armed_ = false;
  bool running_ = false;
};

/// Never destroyed: its thread may outlive main().
Watchdog& watchdog()
{
  static Watchdog* const dog = new Watchdog;
  return *dog;
}

/// Rank in the world as the launcher tells it, for errors before MPI_Init.
int rank_from_launcher()
{
  for (const char* name : {"OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "SLURM_PROCID"})
    if (const char* value = std::getenv(name))
      return std::atoi(value);
  return 0;
}

/// The one that speaks first when several see the same error has 0; the others follow one after the other.
double courtesy_of(int position) { return position == 0 ? 0.0 : 0.3 + 0.1 * std::min(position, 20); }

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

/// World rank 0: hear everybody, judge, answer all that spoke.
Roster judge_world(const Hello& own, int world_size, const Deadlines& deadlines)
{
  std::vector<std::optional<Hello>> hellos(static_cast<std::size_t>(world_size));
  hellos[0] = own;
  int missing = world_size - 1;
  Verdict verdict;
  Wait wait(deadlines.hello);
  while (missing > 0 && verdict.code == 0)
  {
    int from = 0;
    if (const auto bytes = take(MPI_ANY_SOURCE, hello_tag, &from))
    {
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
      continue;
    }
    if (wait.over())
      verdict = judge_silence(hellos, deadlines.hello);
    else
      wait.pause();
  }
  if (verdict.code == 0)
    verdict = judge_roles(hellos);

  Roster roster{
      .major = own.major, .minor = own.minor, .status = verdict.code, .text = verdict.text, .ranks = {}};
  for (const auto& hello : hellos)
    if (hello)
      roster.minor = std::min(roster.minor, hello->minor);
  if (verdict.code == 0)
    for (const auto& hello : hellos)
      roster.ranks.push_back({hello->role, hello->solver, hello->host, hello->capabilities});

  const std::vector<std::byte> bytes = encode(roster);
  std::vector<MPI_Request> requests;
  for (int rank = 1; rank < world_size; ++rank)
    if (hellos[static_cast<std::size_t>(rank)])
    {
      requests.emplace_back();
      require_success(MPI_Isend(bytes.data(), static_cast<int>(bytes.size()), MPI_BYTE, rank, roster_tag,
                                MPI_COMM_WORLD, &requests.back()),
                      "sending the roster");
    }
  // After a good verdict everybody is in the receive loop. After a bad one somebody may be dead: a short try
  // only.
  Wait sending(verdict.code == 0 ? deadlines.hello : 0.2);
  for (int done = 0; done == 0 && !sending.over();)
  {
    require_success(
        MPI_Testall(static_cast<int>(requests.size()), requests.data(), &done, MPI_STATUSES_IGNORE),
        "sending the roster");
    if (done == 0)
      sending.pause();
  }
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

// --- the way out
// ----------------------------------------------------------------------------------------------------

std::string toml_string(const std::string& text)
{
  std::string quoted = "\"";
  for (const char c : text)
    switch (c)
    {
    case '"':
      quoted += "\\\"";
      break;
    case '\\':
      quoted += "\\\\";
      break;
    case '\n':
      quoted += "\\n";
      break;
    case '\t':
      quoted += "\\t";
      break;
    case '\r':
      quoted += "\\r";
      break;
    default:
      if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F)
      {
        char escaped[8];
        std::snprintf(escaped, sizeof escaped, "\\u%04X",
                      static_cast<unsigned>(static_cast<unsigned char>(c)));
        quoted += escaped;
      }
      else
        quoted += c;
    }
  return quoted + "\"";
}

/// The number behind `name` ("step 12", "t = 0.5 s") as it stands in the text, or nothing.
std::string number_after(const std::string& text, const std::string& name, bool with_equal_sign)
{
  for (std::size_t at = text.find(name); at != std::string::npos; at = text.find(name, at + 1))
  {
    if (at > 0 && (std::isalnum(static_cast<unsigned char>(text[at - 1])) != 0 || text[at - 1] == '_'))
      continue;
    std::size_t i = at + name.size();
    while (i < text.size() && text[i] == ' ')
      ++i;
    if (with_equal_sign)
    {
      if (i >= text.size() || text[i] != '=')
        continue;
      ++i;
      while (i < text.size() && text[i] == ' ')
        ++i;
    }
    char* end = nullptr;
    std::strtod(text.c_str() + i, &end);
    std::string number(text.c_str() + i, static_cast<const char*>(end));
    if (!number.empty() && (std::isdigit(static_cast<unsigned char>(number[0])) != 0 || number[0] == '-'))
      return number;
  }
  return {};
}

/// When this process started, before main().
const time_t process_start = time(nullptr);

/// A file of an earlier run in the same folder. The programs of one run start within seconds of each other.
bool is_stale(const std::string& path)
{
  struct stat status
  {
  };
  return stat(path.c_str(), &status) == 0 && status.st_mtime < process_start - 10;
}

/// Writes FAILED.toml whole or not at all, and never over that of a program of this run that failed earlier.
void write_failed(const std::string& out_dir, int code, const std::string& role, int rank,
                  const std::string& text)
{
  std::string content = "# Why the run ended.\n";
  content += "code = " + std::to_string(code) + "\n";
  content += "program = " + toml_string(role) + "\n";
  content += "rank = " + std::to_string(rank) + "\n";
  content += "host = " + toml_string(host_name()) + "\n";
  content += "pid = " + std::to_string(getpid()) + "\n";
  if (const std::string step = number_after(text, "step", false); !step.empty())
    content += "step = " + step + "\n";
  if (const std::string time = number_after(text, "t", true); !time.empty())
    content += "time = " + time + "\n";
  content += "text = " + toml_string(text) + "\n";

  mkdir(out_dir.c_str(), 0777); // an error before the output folder was made
  const std::string target = out_dir + "/FAILED.toml";
  const std::string temporary = target + "." + std::to_string(getpid());
  const int file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (file < 0)
    return; // the message on stderr must do
  const bool complete =
      ::write(file, content.data(), content.size()) == static_cast<ssize_t>(content.size()) &&
      fsync(file) == 0;
  close(file);
  // link() refuses to replace, rename() does not; some file systems have no links.
  if (complete && (is_stale(target) ||
                   (::link(temporary.c_str(), target.c_str()) != 0 && access(target.c_str(), F_OK) != 0)))
    rename(temporary.c_str(), target.c_str());
  unlink(temporary.c_str());
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

void arm_start_timer(const std::string& role, double seconds)
{
  if (seconds <= 0.0 || mpi_is_running())
    return;
  // The coupler's timer, or that of the first process, runs out first, so that the message comes once.
  const double delay = rank_from_launcher() == 0 ? 0.0 : 0.5;
  watchdog().arm(
      seconds + delay, code::mpi_start_incomplete,
      "'" + role + "' still waits in MPI_Init after " + number_text(seconds) +
          " s: at least one program on the mpirun line never called MPI_Init"
          "\n       check that every name on the line is an MPI program, built with the MPI of this mpirun.",
      true);
}

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
    watchdog().arm(deadlines.hello + roster_grace + 5.0 + (rank == 0 ? 0.0 : 2.0), code::no_hello,
                   "'" + identity.role + "': the hand-shake hangs although all programs have spoken", false);
  else
    watchdog().disarm();
  struct Disarm
  {
    ~Disarm() { watchdog().disarm(); }
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

std::string World::solver_of(const std::string& role) const
{
  const std::vector<int> ranks = state_->ranks_of(role);
  if (ranks.empty())
    throw ProtocolError(code::internal_error, "there is no program with role '" + role + "'");
  return state_->roster.ranks[static_cast<std::size_t>(ranks.front())].solver;
}

std::uint64_t World::capabilities_of(const std::string& role) const
{
  const std::vector<int> ranks = state_->ranks_of(role);
  if (ranks.empty())
    throw ProtocolError(code::internal_error, "there is no program with role '" + role + "'");
  return state_->roster.ranks[static_cast<std::size_t>(ranks.front())].capabilities;
}

void abort_world(int code, const std::string& role, const std::string& text, const std::string& out_dir)
{
  watchdog().disarm();
  const bool running = mpi_is_running();
  int rank = rank_from_launcher();
  if (running)
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);

  // Others may see the same error, or hear of it from us; whoever speaks first ends all, so this wait is
  // rarely slept through.
  const double leave = courtesy.load() >= 0.0 ? courtesy.load() : courtesy_of(rank);
  const double announced = failure_announced ? 5.0 : 0.0;
  if (std::max(leave, announced) > 0.0)
    sleep_for(std::max(leave, announced));

  std::fflush(nullptr);
  print("error: " + text + "\n       (" + role + ", world rank " + std::to_string(rank) + " on " +
        host_name() + ", exit code " + std::to_string(code) + ")\n");
  if (!out_dir.empty())
    write_failed(out_dir, code, role, rank, text);
  if (running)
    MPI_Abort(MPI_COMM_WORLD, code);
  // Before MPI_Init the launcher ends the others when it sees this code.
  std::_Exit(code);
}

void report_failure(int code, const std::string& role, const std::string& text, const std::string& out_dir)
{
  watchdog().disarm();
  print("error: " + text + "\n");
  if (!out_dir.empty())
    write_failed(out_dir, code, role, rank_from_launcher(), text);
}

} // namespace undine::link
