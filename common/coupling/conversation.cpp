// Numbers, turns and checks of a conversation.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/conversation.hpp"

#include "common/coupling/exit_codes.hpp"
#include "common/coupling/failure.hpp"
#include "common/coupling/text.hpp"

#include <cstdio>
#include <cstring>
#include <exception>

namespace undine::link
{
namespace
{

using Clock = std::chrono::steady_clock;

/// "READY #3"
std::string title(const wire::Header& header)
{
  std::string name = name_of(header.type);
  if (name == "UNKNOWN")
    name = "a message of unknown type " + std::to_string(static_cast<int>(header.type));
  return name + " #" + std::to_string(header.sequence);
}

/// Adds the time of its life to a sum, also if an exception ends it.
struct Stopwatch
{
  explicit Stopwatch(Clock::duration& total) : sum(total) {}
  ~Stopwatch() { sum += Clock::now() - start; }

  Clock::duration& sum;
  Clock::time_point start = Clock::now();
};

} // namespace

Conversation::Conversation(std::unique_ptr<Channel> channel, End end, std::string partner, int rank)
    : channel_(std::move(channel)), end_(end), partner_(std::move(partner)), rank_(rank)
{
  if (!channel_)
    throw ProtocolError(code::internal_error,
                        "a link to '" + partner_ + "' needs a channel; only rank 0 of a role has one");
  channel_->describe_waiting([this](double seconds) { return silence_text(seconds); });
  channel_->on_early_end([this](const std::string& reason) { send_failure(code::internal_error, reason); });
}

Conversation::~Conversation()
{
  if (!over_ && std::uncaught_exceptions() == 0)
    send_failure(code::internal_error,
                 "it left in the middle of the conversation; next was " + progress_.expected());
}

void Conversation::send_vector(MessageType type, std::span<const double> values)
{
  require_my_turn(type);
  require_size(type, values.size(), size_);
  post(type, [values](wire::Writer& out) { out.bytes(values.data(), values.size_bytes()); });
}

MessageType Conversation::wait_for(MessageType wanted)
{
  if (progress_.speaker() == end_ || !progress_.allows(wanted))
    throw ProtocolError(code::internal_error, "this program waits for " + std::string(name_of(wanted)) +
                                                  " of '" + partner_ + "', but next comes " +
                                                  progress_.expected());
  for (;;)
  {
    {
      const Stopwatch waiting(waited_);
      channel_->receive(incoming_);
    }
    const wire::Header header = wire::open(incoming_, partner_, [this] { return progress_.expected(); });
    if (header.sequence != last_in_.sequence + 1)
      throw ProtocolError(code::message_out_of_order,
                          "'" + partner_ + "' sent " + title(header) + ", expected number " +
                              std::to_string(last_in_.sequence + 1) + " (" + progress_.expected() + ")");
    last_in_ = header;
    if (header.type == MessageType::ping)
      continue;
    if (header.type == MessageType::fail)
      throw_failure();
    if (header.type == MessageType::stop_request && end_ == End::coupler)
    {
      stop_reason_ = wire::read_reason(reader());
      stop_requested_ = true;
      continue;
    }
    require_allowed(header);
    return header.type;
  }
}

void Conversation::receive_vector(MessageType type, std::span<double> values)
{
  wait_for(type);
  require_size(type, values.size(), size_);
  const auto dim = static_cast<std::size_t>(progress_.dim());
  const auto payload = wire::payload(incoming_);
  if (payload.size() != values.size_bytes())
    reader().reject("payload", std::to_string(payload.size()) + " bytes",
                    std::to_string(values.size_bytes()) + " bytes (" + std::to_string(size_ / dim) +
                        " nodes of the MESH x " + std::to_string(dim) + ")");
  if (!values.empty())
    std::memcpy(values.data(), payload.data(), payload.size());
  if (const std::size_t bad = wire::first_not_finite(values); bad < values.size())
    reader().reject("component " + std::to_string(bad % dim) + " of node " + std::to_string(bad / dim) +
                        (split_ ? " of its own in the MESH" : " of the MESH"),
                    std::to_string(values[bad]), "a finite number (t = " + number_text(last_in_.t) + " s)");
  advance(type);
}

void Conversation::ping()
{
  if (!progress_.is_closed() && Clock::now() - last_sent_ >= std::chrono::milliseconds(250))
    post(MessageType::ping, [](wire::Writer&) {});
}

void Conversation::send_stop_request(const std::string& reason)
{
  if (!progress_.is_closed()) // or the run has ended anyway
    post(MessageType::stop_request, [&reason](wire::Writer& out) { wire::write(out, reason); });
}

void Conversation::send_failure(int code, const std::string& text) noexcept
{
  try
  {
    if (over_)
      return;
    post(MessageType::fail,
         [&](wire::Writer& out) { wire::write(out, wire::Failed{.code = code, .text = text}); });
    end();
    if (end_ == End::participant)
      failure_announced = true;
  }
  catch (...)
  {
    // The partner is gone or the memory is full; the caller is about to end the program for a better reason.
  }
}

void Conversation::hear_end()
{
  progress_.close();
  end();
}

bool Conversation::skips(MessageType type)
{
  const bool is_silent = rank_ > 0 && size_ == 0;
  if (is_silent)
    advance(type);
  return is_silent;
}

void Conversation::follow(const Progress& first, const SurfaceMesh& mesh)
{
  follow(first);
  count_rows(mesh);
}

wire::Reader Conversation::reader() const
{
  return wire::Reader(wire::payload(incoming_), title(last_in_) + " from '" + partner_ + "'");
}

void Conversation::learn(MessageType type, const SurfaceMesh& mesh)
{
  if (type == MessageType::surface)
    return; // the partner's
  if (mesh.dim != progress_.setup_dim())
    reader_or_own(type).reject("dim", std::to_string(mesh.dim),
                               std::to_string(progress_.setup_dim()) + " (SETUP)");
  if (type == MessageType::mesh_update && mesh.epoch <= progress_.epoch())
    reader_or_own(type).reject("epoch", std::to_string(mesh.epoch),
                               "more than " + std::to_string(progress_.epoch()) +
                                   ", that of the last surface");
  progress_.learn(mesh);
  count_rows(mesh);
}

void Conversation::count_rows(const SurfaceMesh& mesh)
{
  split_ = !mesh.owner.empty();
  const std::size_t rows = !split_ && rank_ == 0 ? mesh.node_id.size() : mesh.rows_of(rank_).size();
  size_ = rows * static_cast<std::size_t>(mesh.dim);
}

void Conversation::advance(MessageType type)
{
  progress_.advance(type);
  if (progress_.is_closed())
    end();
}

/// Nothing more has to be said to the partner.
void Conversation::end()
{
  over_ = true;
  channel_->on_early_end(nullptr);
}

void Conversation::post_sealed(MessageType type)
{
  const Window& window = progress_.window();
  wire::seal(outgoing_, wire::Header{.type = type,
                                     .sequence = sequence_out_ + 1,
                                     .window = window.index,
                                     .t = progress_.time(),
                                     .dt = window.index < 0 ? 0.0 : window.dt()});
  channel_->send(outgoing_);
  ++sequence_out_;
  last_sent_ = Clock::now();
  advance(type);
}

void Conversation::require_my_turn(MessageType type) const
{
  if (progress_.speaker() != end_ || !progress_.allows(type))
    throw ProtocolError(code::message_out_of_order, std::string(name_of(type)) + " cannot be sent to '" +
                                                        partner_ + "' now, expected " + progress_.expected());
}

void Conversation::require_news(MessageType type) const
{
  if (!progress_.allows(type))
    throw ProtocolError(code::internal_error, "rank " + std::to_string(rank_) + " heard of " + name_of(type) +
                                                  ", but next comes " + progress_.expected());
}

void Conversation::require_allowed(const wire::Header& header) const
{
  if (!progress_.allows(header.type))
    throw ProtocolError(code::message_out_of_order,
                        "'" + partner_ + "' sent " + title(header) + ", expected " + progress_.expected());
  // A WINDOW opens the window it carries; everything else belongs to the window in progress.
  const std::int64_t window = progress_.window().index;
  if (header.type != MessageType::window && header.window != window)
    throw ProtocolError(code::message_out_of_order, "'" + partner_ + "' sent " + title(header) +
                                                        " of window " + std::to_string(header.window) +
                                                        ", expected window " + std::to_string(window));
}

void Conversation::require_size(MessageType type, std::size_t given, std::size_t expected) const
{
  if (given != expected)
    throw ProtocolError(code::internal_error, std::string(name_of(type)) + " with '" + partner_ +
                                                  "': this program gave " + std::to_string(given) +
                                                  " numbers, expected " + std::to_string(expected) +
                                                  " (nodes x dim of the MESH)");
}

void Conversation::throw_failure()
{
  end();
  const wire::Failed failed = wire::read_failed(reader());
  throw ProtocolError(code::partner_failed, "'" + partner_ + "' failed (exit code " +
                                                std::to_string(failed.code) + "): " + failed.text);
}

/// Reader of the message received, or, when this end checks its own, one that names it.
wire::Reader Conversation::reader_or_own(MessageType type) const
{
  if (progress_.speaker() != end_)
    return reader();
  return wire::Reader({}, std::string(name_of(type)) + " to '" + partner_ + "'");
}

std::string Conversation::silence_text(double seconds) const
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
         progress_.expected() +
         "\n       it may be stuck, stopped or swapping; see its log. The limit is the stall time-out.";
}

} // namespace undine::link
