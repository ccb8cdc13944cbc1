// Collectives and messages without blocking calls, so that every wait has a deadline.
#include "common/parallel/mpi_ranks.hpp"

#include "common/error.hpp"

#include <fmt/format.h>
#include <sched.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <limits>
#include <numeric>

namespace undine
{

struct Ranks::Group
{
  MPI_Comm comm = MPI_COMM_NULL;
  double deadline = 0.0;
  mutable Ranks::Cost cost{};
};

struct Ranks::Messages
{
  std::vector<MPI_Request> requests;
  std::vector<int> rank; ///< at the other end of each
};

namespace
{

constexpr int tag = 71;

int count_of(std::size_t n)
{
  require(n <= static_cast<std::size_t>(std::numeric_limits<int>::max()), "a message fits MPI's count");
  return static_cast<int>(n);
}

double cpu_seconds()
{
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double seconds_since(std::chrono::steady_clock::time_point begin)
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

/// Time on the wall that some part of it has [s].
double booked(const Ranks::Cost& cost) { return cost.wall + cost.halo + cost.remesh; }

/// Wait for all requests. @param others ranks at the other end, to name the silent one; may be empty
void complete(std::vector<MPI_Request>& requests, const std::vector<int>& others, const Ranks::Group& group)
{
  struct Clocks // around the whole wait
  {
    Ranks::Cost& cost;
    std::chrono::steady_clock::time_point wall = std::chrono::steady_clock::now();
    double cpu = cpu_seconds();
    ~Clocks()
    {
      cost.wall += seconds_since(wall);
      cost.cpu += cpu_seconds() - cpu;
      ++cost.waits;
    }
  } const clocks{group.cost};
  const double deadline = group.deadline;
  using Clock = std::chrono::steady_clock;
  auto last = Clock::now();
  double waited = 0.0;
  for (std::int64_t turn = 0;; ++turn)
  {
    int done = 0;
    MPI_Testall(static_cast<int>(requests.size()), requests.data(), &done, MPI_STATUSES_IGNORE);
    if (done)
      return;
    if (turn < 1000)
      continue;
    sched_yield();
    const auto now = Clock::now();
    waited += std::min(1.0, std::chrono::duration<double>(now - last).count()); // less if we were suspended
    last = now;
    if (deadline > 0.0 && waited > deadline)
    {
      std::vector<int> silent;
      for (std::size_t k = 0; k < others.size(); ++k)
        if (requests[k] != MPI_REQUEST_NULL)
          silent.push_back(others[k]);
      throw Failure(
          ExitCode::partner_silent,
          fmt::format("rank{} {} of this program kept another waiting for {:.3g} s "
                      "(run.rank_timeout; coupled: twice coupling.stall_timeout)",
                      silent.size() == 1 ? "" : "s",
                      silent.empty() ? std::string("unknown") : fmt::format("{}", fmt::join(silent, ", ")),
                      deadline));
    }
  }
}

void complete(MPI_Request request, const Ranks::Group& group)
{
  std::vector<MPI_Request> one{request};
  complete(one, {}, group);
}

} // namespace

Ranks ranks_of(MPI_Comm comm, double deadline)
{
  int rank = 0, size = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &size);
  if (size == 1)
    return {};
  return {std::make_shared<const Ranks::Group>(Ranks::Group{comm, deadline, {}}), rank, size};
}

Ranks::Cost Ranks::cost() const { return group_ ? group_->cost : Cost{}; }

Ranks::Clock::Clock(const Ranks& ranks, double Cost::*part) : part_(part)
{
  if (ranks.alone())
    return;
  cost_ = &ranks.group_->cost;
  booked_ = booked(*cost_);
  begin_ = std::chrono::steady_clock::now();
}

Ranks::Clock::~Clock()
{
  if (cost_)
    cost_->*part_ += seconds_since(begin_) - (booked(*cost_) - booked_);
}

void Ranks::max(std::span<double> values) const
{
  if (alone())
    return;
  MPI_Request request = MPI_REQUEST_NULL;
  MPI_Iallreduce(MPI_IN_PLACE, values.data(), count_of(values.size()), MPI_DOUBLE, MPI_MAX, group_->comm,
                 &request);
  complete(request, *group_);
}

double Ranks::max(double value) const
{
  max(std::span(&value, 1));
  return value;
}

void Ranks::sum(std::span<std::int64_t> values) const
{
  if (alone())
    return;
  MPI_Request request = MPI_REQUEST_NULL;
  MPI_Iallreduce(MPI_IN_PLACE, values.data(), count_of(values.size()), MPI_INT64_T, MPI_SUM, group_->comm,
                 &request);
  complete(request, *group_);
}

void Ranks::sum(std::span<ExactSum* const> sums) const
{
  if (alone())
    return;
  std::vector<std::int64_t> digits;
  for (ExactSum* s : sums)
    digits.insert(digits.end(), s->raw().begin(), s->raw().end());
  sum(digits);
  auto from = digits.begin();
  for (ExactSum* s : sums)
  {
    std::copy_n(from, ExactSum::digits, s->raw().begin());
    from += static_cast<std::ptrdiff_t>(ExactSum::digits);
  }
}

std::vector<std::size_t> Ranks::gather_counts(std::size_t items) const
{
  std::vector<std::size_t> counts(static_cast<std::size_t>(size_));
  static_assert(sizeof(std::size_t) == sizeof(std::uint64_t));
  MPI_Request request = MPI_REQUEST_NULL;
  MPI_Iallgather(&items, 1, MPI_UINT64_T, counts.data(), 1, MPI_UINT64_T, group_->comm, &request);
  complete(request, *group_);
  return counts;
}

void Ranks::gather_into(const void* mine, const std::vector<std::size_t>& counts, std::size_t item_bytes,
                        void* all) const
{
  std::vector<int> bytes, begin;
  std::size_t total = 0;
  for (const std::size_t n : counts)
  {
    begin.push_back(count_of(total));
    bytes.push_back(count_of(n * item_bytes));
    total += n * item_bytes;
  }
  count_of(total);
  MPI_Request request = MPI_REQUEST_NULL;
  MPI_Iallgatherv(mine, bytes[static_cast<std::size_t>(rank_)], MPI_BYTE, all, bytes.data(), begin.data(),
                  MPI_BYTE, group_->comm, &request);
  complete(request, *group_);
}

void Ranks::gather_rows(void* all, std::size_t row_bytes, std::span<const std::int32_t> first) const
{
  require(first.size() == static_cast<std::size_t>(size_) + 1, "a range of rows for each rank");
  std::vector<int> bytes, begin;
  for (std::size_t r = 0; r + 1 < first.size(); ++r)
  {
    begin.push_back(count_of(static_cast<std::size_t>(first[r]) * row_bytes));
    bytes.push_back(count_of(static_cast<std::size_t>(first[r + 1] - first[r]) * row_bytes));
  }
  MPI_Request request = MPI_REQUEST_NULL;
  MPI_Iallgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, all, bytes.data(), begin.data(), MPI_BYTE, group_->comm,
                  &request);
  complete(request, *group_);
}

std::vector<std::vector<std::byte>> Ranks::exchange_bytes(const std::vector<std::vector<std::byte>>& to) const
{
  require(to.size() == static_cast<std::size_t>(size_), "one list for each rank");
  std::vector<std::uint64_t> sent, received(to.size());
  for (const auto& list : to)
    sent.push_back(list.size());
  MPI_Request request = MPI_REQUEST_NULL;
  MPI_Ialltoall(sent.data(), 1, MPI_UINT64_T, received.data(), 1, MPI_UINT64_T, group_->comm, &request);
  complete(request, *group_);
  std::vector<std::vector<std::byte>> from(to.size());
  std::vector<Part> sends, receives;
  for (std::size_t r = 0; r < to.size(); ++r)
  {
    from[r].resize(received[r]);
    if (received[r] > 0)
      receives.push_back({static_cast<int>(r), from[r].data(), received[r]});
    if (sent[r] > 0) // MPI does not write to what it sends
      sends.push_back({static_cast<int>(r), const_cast<std::byte*>(to[r].data()), sent[r]});
  }
  wait(*start(sends, receives));
  return from;
}

std::shared_ptr<Ranks::Messages> Ranks::start(std::span<const Part> sends,
                                              std::span<const Part> receives) const
{
  auto messages = std::make_shared<Messages>();
  messages->requests.reserve(sends.size() + receives.size());
  for (const Part& part : receives)
  {
    messages->rank.push_back(part.rank);
    MPI_Irecv(part.data, count_of(part.bytes), MPI_BYTE, part.rank, tag, group_->comm,
              &messages->requests.emplace_back());
  }
  for (const Part& part : sends)
  {
    messages->rank.push_back(part.rank);
    ++group_->cost.messages;
    group_->cost.bytes += static_cast<std::int64_t>(part.bytes);
    MPI_Isend(part.data, count_of(part.bytes), MPI_BYTE, part.rank, tag, group_->comm,
              &messages->requests.emplace_back());
  }
  return messages;
}

void Ranks::wait(Messages& messages) const
{
  complete(messages.requests, messages.rank, *group_);
  messages.requests.clear();
  messages.rank.clear();
}

} // namespace undine
