// The state of several ranks in one file, run by mpirun on one to eight: against the file of one rank, read
// on another number, and a rank that cannot write.
#include "common/error.hpp"
#include "common/io/state_archive.hpp"
#include "tests/common/parallel/shared_folder.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

using namespace undine;

namespace
{

constexpr std::size_t n_nodes = 5000, n_elements = 3001, width = 3;

double node_value(std::size_t n) { return std::sin(static_cast<double>(n)); }
double element_value(std::size_t e, std::size_t j) { return std::cos(static_cast<double>(width * e + j)); }

/// Nodes dealt out in sevens, with room for all; elements dealt out with three numbers each, of which a rank
/// holds its own and copies of every fifth of the others. Everything of other ranks is NaN.
struct State
{
  double t = 0.0;
  std::vector<std::array<double, 2>> x;
  std::vector<index_t> held;
  std::vector<double> history;
  std::vector<char> none;
  Ranks ranks;

  explicit State(const Ranks& r) : ranks(r)
  {
    x.assign(n_nodes, {NAN, NAN});
    for (std::size_t e = 0; e < n_elements; ++e)
      if (owns_element(e) || e % 5 == 0)
        held.push_back(static_cast<index_t>(e));
    history.assign(held.size() * width, NAN);
  }
  bool is(std::size_t rank) const { return rank == static_cast<std::size_t>(ranks.rank()); }
  bool owns_node(std::size_t n) const { return is(n / 7 % static_cast<std::size_t>(ranks.size())); }
  bool owns_element(std::size_t e) const { return is((e + e / 5) % static_cast<std::size_t>(ranks.size())); }

  void fill()
  {
    t = ranks.rank() == 0 ? 0.25 : NAN;
    for (std::size_t n = 0; n < n_nodes; ++n)
      if (owns_node(n))
        x[n] = {node_value(n), -node_value(n)};
    for (std::size_t k = 0; k < held.size(); ++k)
      for (std::size_t j = 0; j < width; ++j)
        if (const auto e = static_cast<std::size_t>(held[k]); owns_element(e))
          history[k * width + j] = element_value(e, j);
  }
  void for_each_state(StateArchive& archive)
  {
    archive("t", t);
    std::vector<index_t> own_nodes(n_nodes), elements = held;
    for (std::size_t n = 0; n < n_nodes; ++n)
      own_nodes[n] = owns_node(n) ? static_cast<index_t>(n) : -1;
    if (!archive.reading())
      for (index_t& e : elements)
        e = owns_element(static_cast<std::size_t>(e)) ? e : -1;
    archive.rows("x", x, runs_of(own_nodes));
    archive.part("history", history, n_elements * width, runs_of(elements, width));
    archive.rows("none", none, runs_of(own_nodes));
  }
  /// Entries that are not those of the whole state.
  std::size_t wrong() const
  {
    std::size_t count = t != 0.25 || x.size() != n_nodes;
    for (std::size_t n = 0; n < x.size(); ++n)
      count += x[n][0] != node_value(n) || x[n][1] != -node_value(n);
    for (std::size_t k = 0; k < history.size(); ++k)
      count += history[k] != element_value(static_cast<std::size_t>(held[k / width]), k % width);
    return count;
  }
};

void save(State& state, const std::string& path, const Ranks& ranks)
{
  StateArchive archive(path, ranks);
  archive("state", state);
  archive.save();
}

} // namespace

TEST_CASE("ranks that each write their rows make the state file of one rank, byte by byte")
{
  const Ranks ranks = all_ranks();
  const SharedFolder folder(ranks);
  State shared(ranks);
  shared.fill();
  save(shared, folder.path + "/shared.h5", ranks);
  if (ranks.rank() == 0)
  {
    State alone{Ranks()};
    alone.fill();
    save(alone, folder.path + "/alone.h5", {});
    const std::string one = content_of(folder.path + "/alone.h5");
    CHECK(one.size() > 8 * (2 * n_nodes + width * n_elements));
    CHECK(one == content_of(folder.path + "/shared.h5"));
    CHECK_FALSE(std::filesystem::exists(folder.path + "/shared.h5.new"));
    State read{Ranks()};
    StateArchive archive(folder.path + "/shared.h5");
    archive("state", read);
    CHECK(read.wrong() == 0);
  }
  ranks.any(false);
  State read(ranks);
  {
    StateArchive archive(folder.path + "/alone.h5");
    archive("state", read);
  }
  CHECK(read.wrong() == 0);
  {
    StateArchive archive(folder.path + "/alone.h5");
    CHECK_THROWS_AS(archive.part("state/history", read.history, n_elements, {}), Failure);
  }
  ranks.any(false);
}

TEST_CASE("a state in memory is that of the rank")
{
  State state(all_ranks()), read(all_ranks());
  state.fill();
  StateArchive archive;
  archive("state", state);
  archive.read_back();
  archive("state", read);
  CHECK(std::memcmp(read.x.data(), state.x.data(), n_nodes * sizeof(state.x[0])) == 0);
  CHECK(std::memcmp(read.history.data(), state.history.data(), state.history.size() * sizeof(double)) == 0);
}

TEST_CASE("a rank that cannot write leaves the state file of before, and all ranks say why")
{
  const Ranks ranks = all_ranks();
  const SharedFolder folder(ranks);
  const std::string path = folder.path + "/state.h5";
  State state(ranks);
  state.fill();
  save(state, path, ranks);
  const std::string before = content_of(path);
  const int last = ranks.size() - 1;
  for (const auto& [victim, bytes] : {std::pair{0, 4096}, {0, 200000}, {last, 4096}, {last, 140000}})
  {
    std::string reason;
    {
      const SmallDisk disk(ranks.rank() == victim, static_cast<rlim_t>(bytes));
      try
      {
        save(state, path, ranks);
      }
      catch (const Failure& failure)
      {
        CHECK(failure.code() == ExitCode::output_failed);
        reason = failure.what();
      }
    }
    CHECK(reason.find("state.h5: cannot be written: ") != std::string::npos);
    ranks.any(false);
    CHECK(content_of(path) == before);
    CHECK_FALSE(std::filesystem::exists(path + ".new"));
  }
  save(state, path, ranks); // there is room again
  CHECK(content_of(path) == before);
  ranks.any(false);
}
