// Two ends of a conversation between two threads of one process.
// SPDX-License-Identifier: BSD-3-Clause
#include "common/coupling/channel.hpp"
#include "common/coupling/exit_codes.hpp"

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <mutex>
#include <thread>

namespace undine::link
{
namespace
{

using Clock = std::chrono::steady_clock;

/// One direction: a ring of messages. Buffers go round between the ring and the receiver, so nothing is
/// allocated once every buffer has grown to the size of the messages.
class Pipe
{
public:
  void push(std::span<const std::byte> message)
  {
    {
      const std::lock_guard lock(mutex_);
      if (size_ == ring_.size())
        grow();
      ring_[(first_ + size_) % ring_.size()].assign(message.begin(), message.end());
      ++size_;
      arrived_.fetch_add(1, std::memory_order_release);
    }
    changed_.notify_one();
  }

  void close()
  {
    {
      const std::lock_guard lock(mutex_);
      closed_ = true;
      arrived_.fetch_add(1, std::memory_order_release);
    }
    changed_.notify_one();
  }

  enum class Result
  {
    message,
    closed,
    timeout
  };

  Result pop(std::vector<std::byte>& message, Clock::time_point limit, bool limited)
  {
    // A partner that answers at once is met here, without the price of sleeping and waking (some 50 µs); the
    // number of turns is small because there may be more threads than cores.
    for (int i = 0; i < spins && arrived_.load(std::memory_order_acquire) == taken_; ++i)
      if (i % 64 == 63)
        std::this_thread::yield();

    std::unique_lock lock(mutex_);
    const auto ready = [this] { return size_ > 0 || closed_; };
    if (!limited)
      changed_.wait(lock, ready);
    else if (!changed_.wait_until(lock, limit, ready))
      return Result::timeout;
    if (size_ == 0)
      return Result::closed;
    message.swap(ring_[first_]);
    first_ = (first_ + 1) % ring_.size();
    --size_;
    ++taken_;
    return Result::message;
  }

private:
  static constexpr int spins = 2000;

  void grow()
  {
    std::vector<std::vector<std::byte>> larger(2 * ring_.size());
    for (std::size_t i = 0; i < size_; ++i)
      larger[i].swap(ring_[(first_ + i) % ring_.size()]);
    ring_.swap(larger);
    first_ = 0;
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::vector<std::byte>> ring_ = std::vector<std::vector<std::byte>>(4);
  std::size_t first_ = 0;
  std::size_t size_ = 0;
  bool closed_ = false;
  std::atomic<std::uint64_t> arrived_{0};
  std::uint64_t taken_ = 0; ///< by the receiving thread only
};

struct Pipes
{
  std::array<Pipe, 2> direction;
};

class MemoryChannel final : public Channel
{
public:
  MemoryChannel(std::shared_ptr<Pipes> pipes, int out, double stall_seconds)
      : pipes_(std::move(pipes)), out_(pipes_->direction[static_cast<std::size_t>(out)]),
        in_(pipes_->direction[static_cast<std::size_t>(1 - out)]), stall_(stall_seconds)
  {
  }

  ~MemoryChannel() override { out_.close(); }

  void send(std::span<const std::byte> message) override { out_.push(message); }

  void receive(std::vector<std::byte>& message) override
  {
    const auto start = Clock::now();
    const auto after = [start](double seconds)
    { return start + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds)); };
    const bool limited = stall_ > 0.0;

    Pipe::Result result = in_.pop(message, after(0.5 * stall_), limited);
    if (result == Pipe::Result::timeout)
    {
      std::fprintf(stderr, "warning: %s\n", waiting_text(0.5 * stall_).c_str());
      result = in_.pop(message, after(stall_), limited);
    }
    const double waited = std::chrono::duration<double>(Clock::now() - start).count();
    if (result == Pipe::Result::closed)
      throw ProtocolError(code::partner_silent, "the partner has closed the link.  " + waiting_text(waited));
    if (result == Pipe::Result::timeout)
      throw ProtocolError(code::partner_silent, waiting_text(waited));
  }

private:
  std::shared_ptr<Pipes> pipes_;
  Pipe& out_;
  Pipe& in_;
  double stall_;
};

} // namespace

std::pair<std::unique_ptr<Channel>, std::unique_ptr<Channel>> memory_channel(double stall_seconds)
{
  auto pipes = std::make_shared<Pipes>();
  return {std::make_unique<MemoryChannel>(pipes, 0, stall_seconds),
          std::make_unique<MemoryChannel>(pipes, 1, stall_seconds)};
}

} // namespace undine::link
