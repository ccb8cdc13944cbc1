// The two ends of the coupling protocol: one state machine, walked by both.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/link.hpp"

#include "common/coupling/exit_codes.hpp"
#include "common/coupling/failure_state.hpp"
#include "common/coupling/wire.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <exception>

namespace undine::link
{
namespace
{

using Clock = std::chrono::steady_clock;
using wire::Header;

enum class End
{
  coupler,
  participant
};

/// Named after what comes next.
enum class State
{
  setup,
  surface,
  mesh,
  mesh_reply,
  report,
  mesh_update,
  window_or_bye,
  checkpoint_done,
  kinematics,
  activation,
  free_velocity,
  link_force,
  motion,
  bye_ack,
  closed
};

/// What may come in a state, and from whom. PING, FAIL and a participant's STOP_REQUEST may come at any time.
struct Turn
{
  End speaker;
  std::array<MessageType, 3> types; ///< the first again in the places that are not needed

  bool allows(MessageType type) const { return type == types[0] || type == types[1] || type == types[2]; }
};

constexpr Turn only(End speaker, MessageType type) { return {speaker, {type, type, type}}; }

constexpr Turn turn(State state)
{
  switch (state)
  {
  case State::setup:
    return only(End::coupler, MessageType::setup);
  case State::surface:
    return only(End::coupler, MessageType::surface);
  case State::mesh:
    return only(End::participant, MessageType::mesh);
  case State::mesh_reply:
    return only(End::coupler, MessageType::mesh_reply);
  case State::report:
    return only(End::participant, MessageType::ready);
  case State::mesh_update:
    return only(End::participant, MessageType::mesh_update);
  case State::window_or_bye:
    return {End::coupler, {MessageType::window, MessageType::bye, MessageType::checkpoint}};
  case State::checkpoint_done:
    return only(End::participant, MessageType::checkpoint_done);
  case State::kinematics:
    return only(End::participant, MessageType::kinematics);
  case State::activation:
    return only(End::coupler, MessageType::activation_impulse);
  case State::free_velocity:
    return only(End::participant, MessageType::free_velocity);
  case State::link_force:
    return only(End::coupler, MessageType::link_force);
  case State::motion:
    return only(End::participant, MessageType::motion);
  case State::bye_ack:
  case State::closed:
    break;
  }
  return only(End::participant, MessageType::bye_ack);
}

std::string number_text(double value)
{
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

/// What both ends derive from the messages between the coupler and rank 0 of a participant.
struct Progress
{
  State state_ = State::setup;
  int setup_dim_ = 0;
  bool takes_forces_ = false; ///< level A
  bool sees_surface_ = false; ///< the partner's surface precedes its own
  bool size_known_ = false;   ///< MESH has been exchanged
  int dim_ = 1;
  std::uint32_t epoch_ = 0;
  bool mesh_accepted_ = false;
  bool surface_changed_ = false;
  Window window_{.index = -1};
  std::int64_t exchange_ = 0;
  std::int64_t exchanges_ = 0;
};

/// Both ends of the conversation: buffers, counters, progress. With another rank of a participant than 0 only
/// the vectors of its rows are exchanged; of the other messages this end hears from its program.
class Conversation : private Progress
{
public:
  /// rank: of the participant
  Conversation(std::unique_ptr<Channel> channel, End end, std::string partner, int rank = 0)
      : channel_(std::move(channel)), end_(end), partner_(std::move(partner)), rank_(rank)
  {
    if (!channel_)
      throw ProtocolError(code::internal_error,
                          "a link to '" + partner_ + "' needs a channel; only rank 0 of a role has one");
    channel_->describe_waiting([this](double seconds) { return silence_text(seconds); });
    channel_->on_early_end([this](const std::string& reason) { send_failure(code::internal_error, reason); });
  }

  /// A program that drops its link in the middle of the conversation tells the partner. While an exception
  /// unwinds it does not: main() knows the reason and will say it.
  ~Conversation()
  {
    if (!over_ && std::uncaught_exceptions() == 0)
      send_failure(code::internal_error,
                   "it left in the middle of the conversation; next was " + expected_text());
  }

  Conversation(const Conversation&) = delete;
  Conversation& operator=(const Conversation&) = delete;

  /// Sends a message whose payload is written by `fill(Writer&)` and steps to the next state by `advance`.
  template <class Fill>
  void send(MessageType type, Fill&& fill)
  {
    require_my_turn(type);
    wire::begin(outgoing_);
    wire::Writer writer(outgoing_);
    fill(writer);
    send_sealed(type);
  }

  const Progress& progress() const { return *this; }
  /// Be as far as the conversation with rank 0.
  void follow(const Progress& first) { static_cast<Progress&>(*this) = first; }
  /// The same, with a new surface.
  void follow(const Progress& first, const SurfaceMesh& mesh)
  {
    follow(first);
    count_rows(mesh);
  }
  /// Take note of what rank 0 has sent or received.
  template <class Content>
  void hear(MessageType type, const Content& content)
  {
    if (!turn(state_).allows(type))
      throw ProtocolError(code::internal_error, "rank " + std::to_string(rank_) + " heard of " +
                                                    name_of(type) + ", but next comes " + expected_text());
    accept(type, content);
  }
  /// The conversation of rank 0 has ended.
  void hear_end()
  {
    state_ = State::closed;
    end();
  }
  /// Another rank than 0 without rows: it neither sends nor receives.
  bool is_silent() const { return rank_ > 0 && size_ == 0; }

  /// Sends content that the next state depends on; its header already speaks of the new state (WINDOW).
  template <class Content>
  void send_learning(MessageType type, const Content& content)
  {
    send(type,
         [&](wire::Writer& out)
         {
           learn(type, content);
           wire::write(out, content);
         });
  }

  void send_vector(MessageType type, std::span<const double> values)
  {
    require_my_turn(type);
    require_vector_size(type, values.size());
    wire::begin(outgoing_);
    wire::Writer(outgoing_).bytes(values.data(), values.size_bytes());
    send_sealed(type);
  }

  /// Waits for `wanted` or what else the state allows in its place (BYE for WINDOW); reader() has the
  /// payload.
  MessageType receive(MessageType wanted)
  {
    if (state_ == State::closed || turn(state_).speaker == end_ || !turn(state_).allows(wanted))
      throw ProtocolError(code::internal_error, "this program waits for " + std::string(name_of(wanted)) +
                                                    " of '" + partner_ + "', but next comes " +
                                                    expected_text());
    for (;;)
    {
      const auto start = Clock::now();
      try
      {
        channel_->receive(incoming_);
      }
      catch (...)
      {
        waited_ += Clock::now() - start;
        throw;
      }
      waited_ += Clock::now() - start;

      const Header header = wire::open(incoming_, partner_, [this] { return expected_text(); });
      if (header.sequence != last_in_.sequence + 1)
        throw ProtocolError(code::message_out_of_order,
                            "'" + partner_ + "' sent " + title(header) + ", expected number " +
                                std::to_string(last_in_.sequence + 1) + " (" + expected_text() + ")");
      last_in_ = header;
      switch (header.type)
      {
      case MessageType::ping:
        continue;
      case MessageType::fail:
        throw_failure();
      case MessageType::stop_request:
        if (end_ == End::coupler)
        {
          stop_reason_ = wire::read_reason(reader());
          stop_requested_ = true;
          continue;
        }
        [[fallthrough]];
      default:
        require_allowed(header);
        return header.type;
      }
    }
  }

  void receive_vector(MessageType type, std::span<double> values)
  {
    receive(type);
    require_vector_size(type, values.size());
    const auto payload = wire::payload(incoming_);
    if (payload.size() != values.size_bytes())
      reader().reject("payload", std::to_string(payload.size()) + " bytes",
                      std::to_string(values.size_bytes()) + " bytes (" +
                          std::to_string(size_ / std::size_t(dim_)) + " nodes of the MESH x " +
                          std::to_string(dim_) + ")");
    if (!values.empty())
      std::memcpy(values.data(), payload.data(), payload.size());
    if (const std::size_t bad = wire::first_not_finite(values); bad < values.size())
      reader().reject("component " + std::to_string(bad % std::size_t(dim_)) + " of node " +
                          std::to_string(bad / std::size_t(dim_)) +
                          (split_ ? " of its own in the MESH" : " of the MESH"),
                      std::to_string(values[bad]), "a finite number (t = " + number_text(last_in_.t) + " s)");
    advance(type);
  }

  /// Payload of the message received last, with its name for errors.
  wire::Reader reader() const
  {
    return wire::Reader(wire::payload(incoming_), title(last_in_) + " from '" + partner_ + "'");
  }

  // What both ends learn from the content of a message and the next state depends on.
  void learn(MessageType, const Setup& setup)
  {
    setup_dim_ = setup.dim;
    takes_forces_ = setup.scheme == staggered_scheme;
    sees_surface_ = setup.scheme == contact_surface_scheme;
    window_.t_begin = window_.t_end = setup.t_begin;
  }

  void learn(MessageType type, const SurfaceMesh& mesh)
  {
    if (mesh.dim != setup_dim_)
      reader_or_own(type).reject("dim", std::to_string(mesh.dim), std::to_string(setup_dim_) + " (SETUP)");
    if (type == MessageType::mesh_update && mesh.epoch <= epoch_)
      reader_or_own(type).reject("epoch", std::to_string(mesh.epoch),
                                 "more than " + std::to_string(epoch_) + ", that of the last surface");
    dim_ = mesh.dim;
    epoch_ = mesh.epoch;
    count_rows(mesh);
  }

  void count_rows(const SurfaceMesh& mesh)
  {
    split_ = !mesh.owner.empty();
    const auto dim = static_cast<std::size_t>(mesh.dim);
    size_ = mesh.owner.empty() && rank_ == 0 ? static_cast<std::size_t>(mesh.n_nodes()) * dim
                                             : mesh.rows_of(rank_).size() * dim;
  }

  void learn(MessageType, const wire::MeshReply& reply) { mesh_accepted_ = reply.accepted; }
  void learn(MessageType, const Report& report) { surface_changed_ = report.surface_changed; }

  void learn(MessageType, const Window& window)
  {
    window_ = window;
    exchanges_ = window.fine && !window.flight ? window.steps : 1;
    exchange_ = 0;
  }

  /// Ends the treatment of a received message: its content counts from now on.
  template <class Content>
  void accept(MessageType type, const Content& content)
  {
    learn(type, content);
    advance(type);
  }

  void advance(MessageType type)
  {
    switch (type)
    {
    case MessageType::setup:
      state_ = sees_surface_ ? State::surface : State::mesh;
      break;
    case MessageType::surface:
      state_ = size_known_ ? State::mesh_update : State::mesh;
      break;
    case MessageType::mesh:
      size_known_ = true;
      state_ = State::mesh_reply;
      break;
    case MessageType::mesh_reply:
      state_ = !mesh_accepted_ ? State::closed : takes_forces_ ? State::motion : State::report;
      break;
    case MessageType::ready:
      state_ = !surface_changed_ ? State::window_or_bye : sees_surface_ ? State::surface : State::mesh_update;
      break;
    case MessageType::mesh_update: // beside the partner's surface; energies and stable step follow from it
      state_ = sees_surface_ ? State::report : State::window_or_bye;
      break;
    case MessageType::window:
      state_ = takes_forces_      ? State::link_force
               : window_.activate ? State::kinematics
                                  : State::free_velocity;
      break;
    case MessageType::checkpoint:
      state_ = State::checkpoint_done;
      break;
    case MessageType::checkpoint_done:
      state_ = State::window_or_bye;
      break;
    case MessageType::kinematics:
      state_ = State::activation;
      break;
    case MessageType::activation_impulse:
      state_ = State::free_velocity;
      break;
    case MessageType::free_velocity:
      state_ = window_.flight ? State::report : State::link_force;
      break;
    case MessageType::link_force:
      ++exchange_;
      state_ = takes_forces_ ? State::motion : exchange_ < exchanges_ ? State::free_velocity : State::report;
      break;
    case MessageType::motion:
      state_ = State::report;
      break;
    case MessageType::bye:
      state_ = State::bye_ack;
      break;
    case MessageType::bye_ack:
      state_ = State::closed;
      break;
    default:
      break; // PING, STOP_REQUEST: no influence
    }
    if (state_ == State::closed)
      end();
  }

  void ping()
  {
    const auto now = Clock::now();
    if (state_ == State::closed || now - last_sent_ < std::chrono::milliseconds(250))
      return;
    wire::begin(outgoing_);
    send_sealed(MessageType::ping);
  }

  void send_stop_request(const std::string& reason)
  {
    if (state_ == State::closed)
      return; // the run has ended anyway
    wire::begin(outgoing_);
    wire::Writer(outgoing_).string(reason);
    send_sealed(MessageType::stop_request);
  }

  void send_failure(int code, const std::string& text) noexcept
  {
    try
    {
      if (over_)
        return;
      wire::begin(outgoing_);
      wire::Writer writer(outgoing_);
      wire::write(writer, wire::Failed{.code = code, .text = text});
      send_sealed(MessageType::fail);
      end();
      if (end_ == End::participant)
        failure_announced = true;
    }
    catch (...)
    {
      // The partner is gone or the memory is full; the caller is about to end the program for a better
      // reason.
    }
  }

  std::size_t size() const { return size_; }
  const std::string& partner() const { return partner_; }
  bool stop_requested() const { return stop_requested_; }
  const std::string& stop_reason() const { return stop_reason_; }
  double wait_seconds() const { return std::chrono::duration<double>(waited_).count(); }

private:
  static std::string title(const Header& header)
  {
    std::string name = name_of(header.type);
    if (name == "UNKNOWN")
      name = "a message of unknown type " + std::to_string(static_cast<int>(header.type));
    return name + " #" + std::to_string(header.sequence);
  }

  /// Reader of the message received, or, when this end checks its own, one that names it.
  wire::Reader reader_or_own(MessageType type) const
  {
    if (turn(state_).speaker != end_)
      return reader();
    return wire::Reader({}, std::string(name_of(type)) + " to '" + partner_ + "'");
  }

  std::string place() const
  {
    if (window_.index < 0)
      return "before the first window";
    std::string text = "window " + std::to_string(window_.index);
    if (state_ == State::free_velocity || state_ == State::link_force)
      text += ", exchange " + std::to_string(exchange_ + 1) + " of " + std::to_string(exchanges_);
    return text;
  }

  std::string expected_text() const
  {
    if (state_ == State::closed)
      return "nothing, the conversation is over";
    const Turn now = turn(state_);
    std::string text = name_of(now.types[0]);
    for (const MessageType other : {now.types[1], now.types[2]})
      if (other != now.types[0])
        text += std::string(" or ") + name_of(other);
    return text + (now.speaker == End::coupler ? " of the coupler (" : " of the participant (") + place() +
           ")";
  }

  std::string silence_text(double seconds) const
  {
    std::string last = "It has not sent anything yet";
    if (last_in_.sequence > 0)
    {
      last = "Last: " + title(last_in_);
      if (last_in_.window >= 0)
        last += " (window " + std::to_string(last_in_.window) + ", t = " + number_text(last_in_.t) + " s)";
    }
    char duration[32];
    std::snprintf(duration, sizeof duration, seconds < 10.0 ? "%.2g" : "%.0f", seconds);
    return "'" + partner_ + "' has sent nothing for " + duration + " s.  " + last + "; expected " +
           expected_text() +
           "\n       it may be stuck, stopped or swapping; see its log. The limit is the stall time-out.";
  }

  /// Nothing more has to be said to the partner.
  void end()
  {
    over_ = true;
    channel_->on_early_end(nullptr);
  }

  [[noreturn]] void throw_failure()
  {
    end();
    const wire::Failed failed = wire::read_failed(reader());
    throw ProtocolError(code::partner_failed, "'" + partner_ + "' failed (exit code " +
                                                  std::to_string(failed.code) + "): " + failed.text);
  }

  void require_allowed(const Header& header) const
  {
    if (!turn(state_).allows(header.type))
      throw ProtocolError(code::message_out_of_order,
                          "'" + partner_ + "' sent " + title(header) + ", expected " + expected_text());
    // A WINDOW opens the window it carries; everything else belongs to the window in progress.
    if (header.type != MessageType::window && header.window != window_.index)
      throw ProtocolError(code::message_out_of_order, "'" + partner_ + "' sent " + title(header) +
                                                          " of window " + std::to_string(header.window) +
                                                          ", expected window " +
                                                          std::to_string(window_.index));
  }

  void require_my_turn(MessageType type) const
  {
    const Turn now = turn(state_);
    if (state_ == State::closed || now.speaker != end_ || !now.allows(type))
      throw ProtocolError(code::message_out_of_order, std::string(name_of(type)) + " cannot be sent to '" +
                                                          partner_ + "' now, expected " + expected_text());
  }

  void require_vector_size(MessageType type, std::size_t size) const
  {
    if (size != size_)
      throw ProtocolError(code::internal_error, std::string(name_of(type)) + " with '" + partner_ +
                                                    "': this program gave " + std::to_string(size) +
                                                    " numbers, expected " + std::to_string(size_) +
                                                    " (nodes x dim of the MESH)");
  }

  /// Time that a message of this state belongs to: step counts times dt, never a sum.
  double time() const
  {
    if (takes_forces_)
      return state_ == State::link_force ? window_.t_begin : window_.t_end;
    if (state_ == State::free_velocity || state_ == State::link_force)
      return exchange_ + 1 == exchanges_
                 ? window_.t_end
                 : window_.t_begin + static_cast<double>(exchange_ + 1) * window_.dt();
    return state_ == State::kinematics || state_ == State::activation ? window_.t_begin : window_.t_end;
  }

  void send_sealed(MessageType type)
  {
    wire::seal(outgoing_, Header{.type = type,
                                 .sequence = sequence_out_ + 1,
                                 .window = window_.index,
                                 .t = time(),
                                 .dt = window_.index < 0 ? 0.0 : window_.dt()});
    channel_->send(outgoing_);
    ++sequence_out_;
    last_sent_ = Clock::now();
    advance(type);
  }

  std::unique_ptr<Channel> channel_;
  End end_;
  std::string partner_;
  int rank_;

  bool over_ = false;    ///< by BYE or FAIL
  std::size_t size_ = 0; ///< numbers in a vector of the rows of this rank
  bool split_ = false;   ///< other ranks have rows too

  std::vector<std::byte> outgoing_;
  std::vector<std::byte> incoming_;
  Header last_in_;
  std::uint64_t sequence_out_ = 0;
  bool stop_requested_ = false;
  std::string stop_reason_;
  Clock::duration waited_{0};
  Clock::time_point last_sent_{};
};

} // namespace

struct SolverLink::Conversation : link::Conversation
{
  using link::Conversation::Conversation;
};

struct PartnerLink::Conversation : link::Conversation
{
  using link::Conversation::Conversation;
};

SolverLink::SolverLink(std::unique_ptr<Channel> channel, int rank)
    : conversation_(std::make_unique<Conversation>(std::move(channel), End::participant, "coupler", rank)),
      rank_(rank)
{
}
SolverLink::~SolverLink() = default;
SolverLink::SolverLink(SolverLink&&) noexcept = default;

Setup SolverLink::receive_setup()
{
  conversation_->receive(MessageType::setup);
  Setup setup = wire::read_setup(conversation_->reader());
  conversation_->accept(MessageType::setup, setup);
  return setup;
}

SurfaceMesh SolverLink::receive_surface()
{
  conversation_->receive(MessageType::surface);
  SurfaceMesh surface = wire::read_surface_mesh(conversation_->reader());
  conversation_->advance(MessageType::surface);
  return surface;
}

void SolverLink::hear(const Setup& setup) { conversation_->hear(MessageType::setup, setup); }
void SolverLink::hear(const SurfaceMesh& surface) { conversation_->hear(MessageType::surface, surface); }
void SolverLink::hear(const Window& window) { conversation_->hear(MessageType::window, window); }
void SolverLink::hear_end() { conversation_->hear_end(); }

void SolverLink::send_mesh(const SurfaceMesh& mesh)
{
  if (rank_ > 0)
  {
    conversation_->hear(MessageType::mesh, mesh);
    conversation_->hear(MessageType::mesh_reply, wire::MeshReply{}); // or rank 0 ends the program
    return;
  }
  conversation_->send_learning(MessageType::mesh, mesh);
  conversation_->receive(MessageType::mesh_reply);
  const wire::MeshReply reply = wire::read_mesh_reply(conversation_->reader());
  conversation_->accept(MessageType::mesh_reply, reply);
  if (!reply.accepted)
    throw ProtocolError(code::bad_input_file, "the coupler rejected the wet surface: " + reply.reason);
}

void SolverLink::send_report(const Report& report)
{
  if (rank_ > 0)
    conversation_->hear(MessageType::ready, report);
  else
    conversation_->send_learning(MessageType::ready, report);
}

void SolverLink::send_mesh_update(const SurfaceMesh& mesh)
{
  if (rank_ > 0)
    conversation_->hear(MessageType::mesh_update, mesh);
  else
    conversation_->send_learning(MessageType::mesh_update, mesh);
}

SolverLink::Order SolverLink::next_order()
{
  switch (conversation_->receive(MessageType::window))
  {
  case MessageType::bye:
    wire::read_reason(conversation_->reader());
    conversation_->advance(MessageType::bye);
    conversation_->send(MessageType::bye_ack, [](wire::Writer&) {});
    return {};
  case MessageType::checkpoint:
  {
    CheckpointOrder order = wire::read_checkpoint_order(conversation_->reader());
    conversation_->advance(MessageType::checkpoint);
    return order;
  }
  default:
    break;
  }
  const Window window = wire::read_window(conversation_->reader());
  conversation_->accept(MessageType::window, window);
  return window;
}

std::optional<Window> SolverLink::next_window()
{
  for (;;)
  {
    const Order order = next_order();
    if (const auto* checkpoint = std::get_if<CheckpointOrder>(&order))
      send_checkpoint_done(write_checkpoint_ ? write_checkpoint_(*checkpoint)
                                             : CheckpointDone{.reason = "this solver writes no checkpoints"});
    else if (const auto* window = std::get_if<Window>(&order))
      return *window;
    else
      return std::nullopt;
  }
}

void SolverLink::on_checkpoint(std::function<CheckpointDone(const CheckpointOrder&)> write)
{
  write_checkpoint_ = std::move(write);
}

void SolverLink::send_checkpoint_done(const CheckpointDone& done)
{
  conversation_->send(MessageType::checkpoint_done, [&](wire::Writer& out) { wire::write(out, done); });
}

void SolverLink::send_kinematics(const Kinematics& kinematics)
{
  if (conversation_->is_silent())
    conversation_->advance(MessageType::kinematics);
  else
    conversation_->send(MessageType::kinematics, [&](wire::Writer& out) { wire::write(out, kinematics); });
}

Activation SolverLink::receive_activation()
{
  if (conversation_->is_silent())
  {
    conversation_->advance(MessageType::activation_impulse);
    return {};
  }
  conversation_->receive(MessageType::activation_impulse);
  Activation activation = wire::read_activation(conversation_->reader(), conversation_->size());
  conversation_->advance(MessageType::activation_impulse);
  return activation;
}

void SolverLink::send_free_velocity(std::span<const double> v_free)
{
  if (conversation_->is_silent())
    conversation_->advance(MessageType::free_velocity);
  else
    conversation_->send_vector(MessageType::free_velocity, v_free);
}

void SolverLink::receive_link_force(std::span<double> f_link)
{
  if (conversation_->is_silent())
    conversation_->advance(MessageType::link_force);
  else
    conversation_->receive_vector(MessageType::link_force, f_link);
}

void SolverLink::send_motion(const Motion& motion)
{
  if (conversation_->is_silent())
    conversation_->advance(MessageType::motion);
  else
    conversation_->send(MessageType::motion, [&](wire::Writer& out) { wire::write(out, motion); });
}

void SolverLink::send_stop_request(const std::string& reason) { conversation_->send_stop_request(reason); }
void SolverLink::send_failure(int code, const std::string& text) noexcept
{
  conversation_->send_failure(code, text);
}
void SolverLink::ping() { conversation_->ping(); }
double SolverLink::wait_seconds() const { return conversation_->wait_seconds(); }

/// A rank of the participant that owns rows, or did.
struct PartnerLink::Path
{
  int rank;
  std::unique_ptr<Conversation> conversation; ///< null for rank 0, whose is PartnerLink's
  std::vector<std::int64_t> rows;
};

PartnerLink::PartnerLink(std::unique_ptr<Channel> channel, std::string role, PathMaker make_path)
    : conversation_(std::make_unique<Conversation>(std::move(channel), End::coupler, std::move(role))),
      make_path_(std::move(make_path))
{
}
PartnerLink::~PartnerLink() = default;
PartnerLink::PartnerLink(PartnerLink&&) noexcept = default;

void PartnerLink::send_setup(const Setup& setup) { conversation_->send_learning(MessageType::setup, setup); }

void PartnerLink::send_surface(const SurfaceMesh& surface)
{
  conversation_->send(MessageType::surface, [&](wire::Writer& out) { wire::write(out, surface); });
}

SurfaceMesh PartnerLink::receive_mesh() { return receive_surface_mesh(MessageType::mesh); }

SurfaceMesh PartnerLink::receive_surface_mesh(MessageType type)
{
  conversation_->receive(type);
  SurfaceMesh mesh = wire::read_surface_mesh(conversation_->reader());
  conversation_->accept(type, mesh);
  find_paths(mesh);
  mesh.owner.clear(); // nobody's concern but this link's
  return mesh;
}

/// From now on the rows are exchanged with their owners.
void PartnerLink::find_paths(const SurfaceMesh& mesh)
{
  dim_ = static_cast<std::size_t>(mesh.dim);
  if (mesh.owner.empty() && paths_.empty())
    return;
  if (!make_path_)
    conversation_->reader().reject("owner", "a list", "nothing: this coupler takes all rows from rank 0");
  if (paths_.empty())
    paths_.push_back({.rank = 0, .conversation = nullptr, .rows = {}});
  std::vector<std::int32_t> ranks = mesh.owner;
  std::sort(ranks.begin(), ranks.end());
  ranks.erase(std::unique(ranks.begin(), ranks.end()), ranks.end());
  for (const int rank : ranks)
    if (std::none_of(paths_.begin(), paths_.end(), [rank](const Path& p) { return p.rank == rank; }))
      paths_.push_back({.rank = rank,
                        .conversation = std::make_unique<Conversation>(
                            make_path_(rank), End::coupler, role() + " rank " + std::to_string(rank), rank),
                        .rows = {}});
  for (Path& path : paths_)
  {
    path.rows = mesh.rows_of(path.rank);
    if (path.conversation)
      path.conversation->follow(conversation_->progress(), mesh);
  }
}

/// talk(conversation, rows) with rank 0 and with each other rank that owns rows; all are as far as rank 0 is
/// now.
template <class Talk>
void PartnerLink::with_owners(Talk&& talk)
{
  const Progress now = conversation_->progress();
  for (Path& path : paths_)
    if (!path.conversation)
      talk(*conversation_, path.rows);
    else if (!path.rows.empty())
    {
      path.conversation->follow(now);
      talk(*path.conversation, path.rows);
    }
}

/// Rows of `mine` to their places in `all`, one row after the other.
void PartnerLink::place(std::span<const double> mine, const std::vector<std::int64_t>& rows,
                        std::span<double> all) const
{
  for (std::size_t k = 0; k < rows.size(); ++k)
    std::copy_n(mine.begin() + static_cast<std::ptrdiff_t>(k * dim_), dim_,
                all.begin() + rows[k] * static_cast<std::ptrdiff_t>(dim_));
}

/// Those rows of `all`.
std::vector<double> PartnerLink::pick(std::span<const double> all,
                                      const std::vector<std::int64_t>& rows) const
{
  std::vector<double> mine(rows.size() * dim_);
  for (std::size_t k = 0; k < rows.size(); ++k)
    std::copy_n(all.begin() + rows[k] * static_cast<std::ptrdiff_t>(dim_), dim_,
                mine.begin() + static_cast<std::ptrdiff_t>(k * dim_));
  return mine;
}

/// Numbers in a vector of all rows.
std::size_t PartnerLink::size() const
{
  std::size_t n = 0;
  for (const Path& path : paths_)
    n += path.rows.size();
  return n * dim_;
}

void PartnerLink::accept_mesh()
{
  const wire::MeshReply reply;
  conversation_->send_learning(MessageType::mesh_reply, reply);
}

void PartnerLink::reject_mesh(const std::string& reason)
{
  const wire::MeshReply reply{.accepted = false, .reason = reason};
  conversation_->send_learning(MessageType::mesh_reply, reply);
}

Report PartnerLink::receive_report()
{
  conversation_->receive(MessageType::ready);
  const Report report = wire::read_report(conversation_->reader());
  conversation_->accept(MessageType::ready, report);
  return report;
}

SurfaceMesh PartnerLink::receive_mesh_update() { return receive_surface_mesh(MessageType::mesh_update); }

void PartnerLink::send_window(const Window& window)
{
  conversation_->send_learning(MessageType::window, window);
}

void PartnerLink::send_checkpoint(const CheckpointOrder& order)
{
  conversation_->send(MessageType::checkpoint, [&](wire::Writer& out) { wire::write(out, order); });
}

CheckpointDone PartnerLink::receive_checkpoint_done()
{
  conversation_->receive(MessageType::checkpoint_done);
  CheckpointDone done = wire::read_checkpoint_done(conversation_->reader());
  conversation_->advance(MessageType::checkpoint_done);
  return done;
}

Kinematics PartnerLink::receive_kinematics()
{
  const auto receive_from = [](link::Conversation& from)
  {
    from.receive(MessageType::kinematics);
    Kinematics kinematics = wire::read_kinematics(from.reader(), from.size());
    from.advance(MessageType::kinematics);
    return kinematics;
  };
  if (paths_.empty())
    return receive_from(*conversation_);
  Kinematics all{.v = std::vector<double>(size()), .a_free = std::vector<double>(size())};
  with_owners(
      [&](link::Conversation& from, const std::vector<std::int64_t>& rows)
      {
        const Kinematics mine = receive_from(from);
        place(mine.v, rows, all.v);
        place(mine.a_free, rows, all.a_free);
      });
  return all;
}

void PartnerLink::send_activation(const Activation& activation)
{
  const auto send_to = [](link::Conversation& to, const Activation& mine)
  { to.send(MessageType::activation_impulse, [&](wire::Writer& out) { wire::write(out, mine); }); };
  if (paths_.empty())
    return send_to(*conversation_, activation);
  with_owners(
      [&](link::Conversation& to, const std::vector<std::int64_t>& rows)
      {
        send_to(to,
                {.impulse = pick(activation.impulse, rows), .link_force = pick(activation.link_force, rows)});
      });
}

void PartnerLink::receive_free_velocity(std::span<double> v_free)
{
  if (paths_.empty())
    return conversation_->receive_vector(MessageType::free_velocity, v_free);
  require_size(MessageType::free_velocity, v_free.size());
  with_owners(
      [&](link::Conversation& from, const std::vector<std::int64_t>& rows)
      {
        std::vector<double> mine(rows.size() * dim_);
        from.receive_vector(MessageType::free_velocity, mine);
        place(mine, rows, v_free);
      });
}

void PartnerLink::send_link_force(std::span<const double> f_link)
{
  if (paths_.empty())
    return conversation_->send_vector(MessageType::link_force, f_link);
  require_size(MessageType::link_force, f_link.size());
  with_owners([&](link::Conversation& to, const std::vector<std::int64_t>& rows)
              { to.send_vector(MessageType::link_force, pick(f_link, rows)); });
}

Motion PartnerLink::receive_motion()
{
  const auto receive_from = [](link::Conversation& from)
  {
    from.receive(MessageType::motion);
    Motion motion = wire::read_motion(from.reader(), from.size());
    from.advance(MessageType::motion);
    return motion;
  };
  if (paths_.empty())
    return receive_from(*conversation_);
  Motion all{.x = std::vector<double>(size()), .v = std::vector<double>(size())};
  with_owners(
      [&](link::Conversation& from, const std::vector<std::int64_t>& rows)
      {
        const Motion mine = receive_from(from);
        place(mine.x, rows, all.x);
        place(mine.v, rows, all.v);
      });
  return all;
}

void PartnerLink::require_size(MessageType type, std::size_t came) const
{
  if (came != size())
    throw ProtocolError(code::internal_error, std::string(name_of(type)) + " with '" + role() +
                                                  "': this program gave " + std::to_string(came) +
                                                  " numbers, expected " + std::to_string(size()) +
                                                  " (nodes x dim of the MESH)");
}

bool PartnerLink::stop_requested() const { return conversation_->stop_requested(); }
const std::string& PartnerLink::stop_reason() const { return conversation_->stop_reason(); }
void PartnerLink::ping()
{
  conversation_->ping();
  for (Path& path : paths_)
    if (path.conversation && !path.rows.empty())
      path.conversation->ping();
}

void PartnerLink::send_bye()
{
  conversation_->send(MessageType::bye, [](wire::Writer& out) { out.string(""); });
  conversation_->receive(MessageType::bye_ack);
  conversation_->reader().end();
  conversation_->advance(MessageType::bye_ack);
  end_paths();
}

void PartnerLink::end_paths() noexcept
{
  for (Path& path : paths_)
    if (path.conversation)
      path.conversation->hear_end();
}

void PartnerLink::send_failure(int code, const std::string& text) noexcept
{
  conversation_->send_failure(code, text);
  end_paths(); // the program ends as a whole
}
const std::string& PartnerLink::role() const { return conversation_->partner(); }
double PartnerLink::wait_seconds() const
{
  double sum = conversation_->wait_seconds();
  for (const Path& path : paths_)
    if (path.conversation)
      sum += path.conversation->wait_seconds();
  return sum;
}

} // namespace undine::link
