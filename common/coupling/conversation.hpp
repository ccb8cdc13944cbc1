// One end's conversation over a channel: what is sent and received is checked, numbered and in turn.
// SPDX-License-Identifier: BSD-3-Clause
//
// What SolverLink and PartnerLink share. Errors are those of link.hpp.
#pragma once

#include "common/coupling/channel.hpp"
#include "common/coupling/messages.hpp"
#include "common/coupling/progress.hpp"
#include "common/coupling/wire.hpp"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace undine::link
{

/// With another rank of a participant than 0 only the vectors of its rows are exchanged; of the other
/// messages this end hears from its program.
class Conversation
{
public:
  /// rank: of the participant
  Conversation(std::unique_ptr<Channel> channel, End end, std::string partner, int rank = 0);
  /// A program that drops its link in the middle of the conversation tells the partner. While an exception
  /// unwinds it does not: main() knows the reason and will say it.
  ~Conversation();
  Conversation(const Conversation&) = delete;
  Conversation& operator=(const Conversation&) = delete;

  /// Sends the content, if the type has any. What follows from it counts at once: the header of WINDOW
  /// already speaks of that window.
  template <class... Content>
  void send(MessageType type, const Content&... content)
  {
    require_my_turn(type);
    (learn(type, content), ...);
    post(type, [&](wire::Writer& out) { (wire::write(out, content), ...); });
  }
  /// From rank 0; another rank takes note.
  template <class Content>
  void send_by_first(MessageType type, const Content& content)
  {
    if (rank_ > 0)
      hear(type, content);
    else
      send(type, content);
  }
  void send_vector(MessageType type, std::span<const double> values);

  /// Waits for `wanted` or what else may come in its place (BYE for WINDOW), to be read by take().
  MessageType wait_for(MessageType wanted);
  /// Content of the message that wait_for has returned, by read(Reader, sizes...); it counts from now on.
  template <class Read, class... Size>
  auto take(MessageType type, Read&& read, Size... sizes)
  {
    auto content = read(reader(), sizes...);
    accept(type, content);
    return content;
  }
  template <class Read, class... Size>
  auto receive(MessageType type, Read&& read, Size... sizes)
  {
    wait_for(type);
    return take(type, read, sizes...);
  }
  void receive_vector(MessageType type, std::span<double> values);

  // At any time.
  void ping(); ///< at most four times a second
  void send_stop_request(const std::string& reason);
  void send_failure(int code, const std::string& text) noexcept;

  // On other ranks than 0, and towards them.
  int rank() const { return rank_; }
  /// Take note of what rank 0 has sent or received.
  template <class Content>
  void hear(MessageType type, const Content& content)
  {
    require_news(type);
    accept(type, content);
  }
  void hear_end(); ///< the conversation of rank 0 has ended
  /// A rank without rows, other than 0, neither sends nor receives vectors. Steps over the message if so.
  bool skips(MessageType type);
  const Progress& progress() const { return progress_; }
  /// Be as far as the conversation with rank 0.
  void follow(const Progress& first) { progress_ = first; }
  /// The same, with a new surface.
  void follow(const Progress& first, const SurfaceMesh& mesh);

  std::size_t size() const { return size_; } ///< numbers in a vector of the rows of this rank
  const std::string& partner() const { return partner_; }
  bool stop_requested() const { return stop_requested_; }
  const std::string& stop_reason() const { return stop_reason_; }
  double wait_seconds() const { return std::chrono::duration<double>(waited_).count(); }
  /// Of the message received last, with its name for errors.
  wire::Reader reader() const;
  /// @throws ProtocolError(1) if this program gave a vector of another size than `expected`
  void require_size(MessageType type, std::size_t given, std::size_t expected) const;

private:
  using Clock = std::chrono::steady_clock;

  void learn(MessageType type, const SurfaceMesh& mesh);
  template <class Content>
  void learn(MessageType, const Content& content)
  {
    progress_.learn(content);
  }
  void count_rows(const SurfaceMesh& mesh);
  template <class Content>
  void accept(MessageType type, const Content& content)
  {
    learn(type, content);
    advance(type);
  }
  void advance(MessageType type);
  void end();

  template <class Fill>
  void post(MessageType type, Fill&& fill)
  {
    wire::begin(outgoing_);
    wire::Writer out(outgoing_);
    fill(out);
    post_sealed(type);
  }
  void post_sealed(MessageType type);

  void require_my_turn(MessageType type) const;
  void require_news(MessageType type) const;
  void require_allowed(const wire::Header& header) const;
  [[noreturn]] void throw_failure();
  wire::Reader reader_or_own(MessageType type) const;
  std::string silence_text(double seconds) const;

  std::unique_ptr<Channel> channel_;
  End end_;
  std::string partner_;
  int rank_;

  Progress progress_;
  bool over_ = false; ///< by BYE or FAIL
  std::size_t size_ = 0;
  bool split_ = false; ///< other ranks have rows too

  std::vector<std::byte> outgoing_;
  std::vector<std::byte> incoming_;
  wire::Header last_in_;
  std::uint64_t sequence_out_ = 0;
  bool stop_requested_ = false;
  std::string stop_reason_;
  Clock::duration waited_{0};
  Clock::time_point last_sent_{};
};

} // namespace undine::link
