// The ranks of one program: reductions, gathers and sparse exchange, all with a deadline.
#pragma once

#include "common/parallel/exact_sum.hpp"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

namespace undine
{

/// A group of MPI ranks, or the only one. Functions marked collective must be called by all ranks of the
/// group in the same order; on one rank they return their argument and call no MPI. A rank that keeps another
/// waiting longer than the deadline is a Failure(partner_silent), so that nobody waits for ever.
class Ranks
{
public:
  /// One rank, without MPI.
  Ranks() = default;

  int rank() const { return rank_; }
  int size() const { return size_; }
  bool alone() const { return size_ == 1; }

  /// Largest of all ranks' values. Collective.
  double max(double value) const;
  /// Some rank says yes. Collective.
  bool any(bool value) const { return max(value ? 1.0 : 0.0) > 0.0; }
  /// Element by element. Collective.
  void max(std::span<double> values) const;
  void sum(std::span<std::int64_t> values) const;
  std::int64_t sum(std::int64_t value) const
  {
    sum(std::span(&value, 1));
    return value;
  }
  /// Sums over all terms of all ranks, the same bits however they are distributed. Collective.
  void sum(std::span<ExactSum* const> sums) const;
  void sum(std::initializer_list<ExactSum*> sums) const { sum(std::span(sums.begin(), sums.size())); }

  /// Everybody's rows of a field: rows [first[r], first[r + 1]) of `all` come from rank r. Collective.
  template <class T>
  void gather_rows(std::vector<T>& all, std::span<const std::int32_t> first) const
  {
    static_assert(std::is_trivially_copyable_v<T>);
    if (!alone())
      gather_rows(all.data(), sizeof(T), first);
  }
  /// The items of rank 0, on all ranks. Collective.
  template <class T>
  std::vector<T> of_first(const std::vector<T>& items) const
  {
    return gather(rank_ == 0 ? items : std::vector<T>{});
  }

  /// Everybody's items, rank by rank. Collective. `counts`, if given, gets how many came from each rank.
  template <class T>
  std::vector<T> gather(const std::vector<T>& mine, std::vector<std::size_t>* counts = nullptr) const
  {
    static_assert(std::is_trivially_copyable_v<T>);
    if (alone())
    {
      if (counts)
        *counts = {mine.size()};
      return mine;
    }
    std::vector<T> all;
    gather_bytes(mine.data(), mine.size(), sizeof(T), counts,
                 [&all](std::size_t total)
                 {
                   all.resize(total);
                   return static_cast<void*>(all.data());
                 });
    return all;
  }

  /// to[r] goes to rank r; returns what each rank sent here. What a rank keeps for itself is not copied if
  /// `to` is a temporary. Collective.
  template <class T>
  std::vector<std::vector<T>> exchange(std::vector<std::vector<T>> to) const
  {
    static_assert(std::is_trivially_copyable_v<T>);
    if (alone())
      return to;
    const auto me = static_cast<std::size_t>(rank());
    std::vector<std::vector<std::byte>> bytes(to.size());
    for (std::size_t r = 0; r < to.size(); ++r)
    {
      if (r == me)
        continue;
      const auto* first = reinterpret_cast<const std::byte*>(to[r].data());
      bytes[r].assign(first, first + to[r].size() * sizeof(T));
    }
    bytes = exchange_bytes(bytes);
    std::vector<std::vector<T>> from(to.size());
    from[me] = std::move(to[me]);
    for (std::size_t r = 0; r < to.size(); ++r)
    {
      if (r == me)
        continue;
      from[r].resize(bytes[r].size() / sizeof(T));
      if (!bytes[r].empty())
        std::memcpy(from[r].data(), bytes[r].data(), bytes[r].size());
    }
    return from;
  }

  /// A piece of memory that goes to or comes from a rank.
  struct Part
  {
    int rank;
    std::byte* data;
    std::size_t bytes;
  };
  /// Messages on their way; empty when they have arrived.
  struct Messages;
  /// Start to send and to receive; the memory must stay until wait(). Every send needs its receive on the
  /// other side; messages between two ranks arrive in the order they were sent.
  std::shared_ptr<Messages> start(std::span<const Part> sends, std::span<const Part> receives) const;
  /// @throws Failure(partner_silent)
  void wait(Messages& messages) const;

  /// What communication has taken on this rank since the start.
  struct Cost
  {
    double wall = 0.0, cpu = 0.0;                    ///< waiting for others [s]
    double halo = 0.0;                               ///< rows to and from messages, without waiting [s]
    double remesh = 0.0;                             ///< new meshes, without the two above [s]
    std::int64_t waits = 0, messages = 0, bytes = 0; ///< sent by start()
  };
  Cost cost() const;
  /// Books the time of a scope (on the wall) to a part of cost(), but for what is booked elsewhere meanwhile.
  /// Nothing on one rank.
  class Clock
  {
  public:
    Clock(const Ranks& ranks, double Cost::*part);
    ~Clock();
    Clock(const Clock&) = delete;
    Clock& operator=(const Clock&) = delete;

  private:
    Cost* cost_ = nullptr;
    double Cost::*part_;
    double booked_ = 0.0;
    std::chrono::steady_clock::time_point begin_;
  };

  struct Group; ///< of MPI; see mpi_ranks.hpp
  Ranks(std::shared_ptr<const Group> group, int rank, int size)
      : group_(std::move(group)), rank_(rank), size_(size)
  {
  }

private:
  template <class Allocate>
  void gather_bytes(const void* mine, std::size_t items, std::size_t item_bytes,
                    std::vector<std::size_t>* counts, Allocate&& allocate) const
  {
    const std::vector<std::size_t> n = gather_counts(items);
    std::size_t total = 0;
    for (const std::size_t k : n)
      total += k;
    gather_into(mine, n, item_bytes, allocate(total));
    if (counts)
      *counts = n;
  }
  void gather_rows(void* all, std::size_t row_bytes, std::span<const std::int32_t> first) const;
  std::vector<std::size_t> gather_counts(std::size_t items) const;
  void gather_into(const void* mine, const std::vector<std::size_t>& counts, std::size_t item_bytes,
                   void* all) const;
  std::vector<std::vector<std::byte>> exchange_bytes(const std::vector<std::vector<std::byte>>& to) const;

  std::shared_ptr<const Group> group_;
  int rank_ = 0, size_ = 1;
};

} // namespace undine
