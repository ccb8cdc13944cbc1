// Where the time of ranks went, run by mpirun on one to eight ranks.
#include "common/parallel/mpi_ranks.hpp"
#include "common/parallel/time_split.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

using namespace undine;

namespace
{

void sleep(int milliseconds) { std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds)); }

} // namespace

// Truth: a sleep takes at least its time, and the parts are all of the time on the wall. What a scope waits
// in it, or books to another part, is not its own.
TEST_CASE("time is booked once: to computing, halo, remesh or waiting, of which imbalance is a part",
          "[parallel]")
{
  const Ranks ranks = ranks_of(MPI_COMM_WORLD, 60.0);
  const auto seconds_since = [](auto begin)
  { return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count(); };
  ranks.any(false);
  const auto before = std::chrono::steady_clock::now();
  const TimeSplit split(ranks);
  const auto begin = std::chrono::steady_clock::now();
  {
    const Ranks::Clock remesh(ranks, &Ranks::Cost::remesh);
    if (ranks.rank() == 0)
      sleep(60);
    {
      const Ranks::Clock halo(ranks, &Ranks::Cost::halo);
      sleep(20);
      ranks.any(false); // the others wait for rank 0
    }
  }
  sleep(10);
  const double least = seconds_since(begin);
  const auto times = split.of_ranks(0.0);
  const double most = seconds_since(before);
  REQUIRE(times.size() == static_cast<std::size_t>(ranks.size()));
  const RankTime& mine = times[static_cast<std::size_t>(ranks.rank())];
  const double sum = mine.busy() + mine.imbalance + mine.wait;
  CHECK(sum >= least * (1.0 - 1e-12));
  CHECK(sum <= most * (1.0 + 1e-12));
  double least_imbalance = 1.0;
  for (const RankTime& rank : times)
  {
    CHECK(rank.compute >= 0.010);
    CHECK(rank.imbalance >= 0.0);
    CHECK(rank.wait >= 0.0);
    least_imbalance = std::min(least_imbalance, rank.imbalance);
  }
  CHECK(least_imbalance == 0.0); // of the busiest
  if (ranks.alone())
    return;
  CHECK(times[0].remesh >= 0.060);
  for (const RankTime& rank : times)
    CHECK(rank.halo >= 0.020);
  Summary summary;
  write(summary, "fluid.", times);
  CHECK(summary.json().find("\"rank_time_s\"") != std::string::npos);
}
