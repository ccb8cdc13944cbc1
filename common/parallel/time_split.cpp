// Waiting divided into imbalance and the rest.
#include "common/parallel/time_split.hpp"

#include <algorithm>
#include <utility>

namespace undine
{

std::vector<RankTime> TimeSplit::of_ranks(double waited) const
{
  const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_wall_).count();
  const Ranks::Cost cost = ranks_.cost();
  RankTime mine{.halo = cost.halo - begin_.halo,
                .remesh = cost.remesh - begin_.remesh,
                .wait = cost.wall - begin_.wall + waited};
  mine.compute = wall - mine.halo - mine.remesh - mine.wait;
  std::vector<RankTime> times = ranks_.gather(std::vector{mine});
  double busiest = 0.0;
  for (const RankTime& rank : times)
    busiest = std::max(busiest, rank.busy());
  for (RankTime& rank : times)
  {
    rank.imbalance = std::min(busiest - rank.busy(), rank.wait); // clocks of ranks start microseconds apart
    rank.wait -= rank.imbalance;
  }
  return times;
}

void write(Summary& summary, const std::string& prefix, const std::vector<RankTime>& times)
{
  for (const auto& [name, part] : {std::pair{"compute", &RankTime::compute},
                                   {"halo", &RankTime::halo},
                                   {"remesh", &RankTime::remesh},
                                   {"imbalance", &RankTime::imbalance},
                                   {"wait", &RankTime::wait}})
  {
    std::vector<double> of_ranks;
    for (const RankTime& rank : times)
      of_ranks.push_back(rank.*part);
    if (std::any_of(of_ranks.begin(), of_ranks.end(), [](double t) { return t != 0.0; }))
      summary.set(prefix + "rank_time_s." + name, of_ranks);
  }
}

} // namespace undine
