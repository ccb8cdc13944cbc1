// How bytes travel between the coupler and one participant.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace undine::link
{

/// Something is wrong with the partner or with what it says; `code` is an exit code of common/error.hpp.
class ProtocolError : public std::runtime_error
{
public:
  ProtocolError(int code, const std::string& text) : std::runtime_error(text), code_(code) {}
  int code() const { return code_; }

private:
  int code_;
};

/// An ordered, reliable, two-way stream of whole messages.
class Channel
{
public:
  virtual ~Channel() = default;
  /// Start sending; the bytes may be reused when the call returns.
  virtual void send(std::span<const std::byte> message) = 0;
  /// Wait for the next message (back-off sleep, so that a waiting process does not steal the core of a
  /// computing one).
  /// @throws ProtocolError(36) when nothing came for the stall limit; the text says how long and comes from
  /// describe_waiting
  virtual void receive(std::vector<std::byte>& message) = 0;

  /// One sentence or more about who is silent and what came last, given the seconds waited so far.
  using Description = std::function<std::string(double seconds)>;
  /// Words for the warning at half the stall limit and for the error at its end.
  void describe_waiting(Description description) { description_ = std::move(description); }

  /// What to say when the program leaves while the conversation is in progress; an empty function once it is
  /// over.
  using Farewell = std::function<void(const std::string& reason)>;
  void on_early_end(Farewell farewell) { farewell_ = std::move(farewell); }

protected:
  /// Calls what on_early_end was given, once. Returns whether there was something to say.
  bool say_farewell(const std::string& reason)
  {
    const Farewell farewell = std::exchange(farewell_, nullptr);
    if (farewell)
      farewell(reason);
    return static_cast<bool>(farewell);
  }

  /// The words set by describe_waiting, or plain ones.
  std::string waiting_text(double seconds) const
  {
    return description_ ? description_(seconds)
                        : "the partner has sent nothing for " + std::to_string(seconds) + " s";
  }

private:
  Description description_;
  Farewell farewell_;
};

/// Two connected ends inside one process (two threads): for tests and small problems.
/// `stall_seconds` ≤ 0 waits for ever. An end that is destroyed makes the other's receive throw
/// ProtocolError(36).
std::pair<std::unique_ptr<Channel>, std::unique_ptr<Channel>> memory_channel(double stall_seconds = 30.0);

} // namespace undine::link
