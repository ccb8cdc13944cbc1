// Where the time of several ranks went.
#pragma once

#include "common/io/summary.hpp"
#include "common/parallel/ranks.hpp"

#include <chrono>
#include <string>
#include <vector>

namespace undine
{

/// What one rank did with its time on the wall [s]; the sum is all of it.
struct RankTime
{
  double compute = 0.0;   ///< all that is none of what follows, writing of files included
  double halo = 0.0;      ///< rows of ghosts to and from messages
  double remesh = 0.0;    ///< new meshes
  double imbalance = 0.0; ///< that the busiest rank had more of the three above
  double wait = 0.0;      ///< the rest of the waiting: for messages, for ranks that are late now and early
                          ///< another time, for other programs. The same on all ranks

  double busy() const { return compute + halo + remesh; }
};

/// Counts from where it is made.
class TimeSplit
{
public:
  explicit TimeSplit(const Ranks& ranks) : ranks_(ranks), begin_(ranks.cost()) {}
  /// Of each rank up to now. @param waited by this rank for other programs [s]. Collective.
  std::vector<RankTime> of_ranks(double waited) const;

private:
  Ranks ranks_;
  Ranks::Cost begin_;
  std::chrono::steady_clock::time_point begin_wall_ = std::chrono::steady_clock::now();
};

/// As `prefix`rank_time_s.compute and so on, a list with a number for each rank; parts that no rank has are
/// left out.
void write(Summary& summary, const std::string& prefix, const std::vector<RankTime>& times);

} // namespace undine
