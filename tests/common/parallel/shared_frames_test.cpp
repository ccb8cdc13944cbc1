// Frames that several ranks write, run by mpirun on one to eight: against the file of one rank, and a rank
// that cannot write.
#include "common/error.hpp"
#include "common/io/frames.hpp"
#include "tests/common/parallel/shared_folder.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <span>
#include <string>
#include <vector>

using namespace undine;

namespace
{

/// n × n squares with a vector on nodes and a scalar on cells.
struct Squares
{
  std::size_t n = 40;
  std::vector<double> x, v, c;
  std::vector<index_t> quads;
  Squares()
  {
    for (std::size_t j = 0; j <= n; ++j)
      for (std::size_t i = 0; i <= n; ++i)
      {
        x.insert(x.end(), {static_cast<double>(i), static_cast<double>(j)});
        v.insert(v.end(), {1.0 / static_cast<double>(i + 1), 1.0 / static_cast<double>(j + 1)});
      }
    for (std::size_t j = 0; j < n; ++j)
      for (std::size_t i = 0; i < n; ++i)
      {
        const auto k = static_cast<index_t>(j * (n + 1) + i), up = static_cast<index_t>(n + 1);
        quads.insert(quads.end(), {k, k + 1, k + up + 1, k + up});
        c.push_back(static_cast<double>(i * j));
      }
  }
};

template <class T>
std::vector<T> rows_of(const std::vector<T>& all, std::span<const index_t> rows, std::size_t width)
{
  std::vector<T> out;
  for (const index_t r : rows)
    out.insert(out.end(), all.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(r) * width),
               all.begin() + static_cast<std::ptrdiff_t>((static_cast<std::size_t>(r) + 1) * width));
  return out;
}

void write_whole(FrameWriter& writer, const Squares& s, double t)
{
  writer.write(t, {.dim = 2, .x = s.x, .blocks = {{ElementType::quadrilateral4, s.quads}}},
               {{.name = "velocity", .unit = "m/s", .components = 2, .values = s.v},
                {.name = "number", .unit = "", .components = 1, .values = s.c, .on_cells = true}});
}

/// Nodes dealt out like cards, cells in ranges, the first rank's without any; numbers on cells come from all
/// ranks that have the cell, as at a cut.
void write_shared(FrameWriter& writer, const Squares& s, double t, const Ranks& ranks)
{
  const auto size = static_cast<std::size_t>(ranks.size()), me = static_cast<std::size_t>(ranks.rank());
  const std::size_t n_nodes = s.x.size() / 2, n_cells = s.c.size();
  std::vector<index_t> nodes, cells, range;
  for (std::size_t k = 0; k < n_nodes; ++k)
    if (k / 3 % size == me)
      nodes.push_back(static_cast<index_t>(k));
  for (std::size_t k = 0; k < n_cells; ++k)
  {
    if (k % size == me || k % 7 == 0)
      cells.push_back(static_cast<index_t>(k));
    if (size == 1 || (me > 0 && k * (size - 1) / n_cells == me - 1))
      range.push_back(static_cast<index_t>(k));
  }
  const auto x = rows_of(s.x, nodes, 2), v = rows_of(s.v, nodes, 2), c = rows_of(s.c, cells, 1);
  const auto quads = rows_of(s.quads, range, 4);
  const std::size_t first = range.empty() ? 0 : static_cast<std::size_t>(range.front());
  writer.write(t,
               {.dim = 2,
                .x = x,
                .blocks = {{ElementType::quadrilateral4, quads}},
                .nodes = {.total = n_nodes, .places = nodes},
                .cells = {.total = n_cells, .places = cells},
                .blocks_are = {.total = n_cells, .first = first}},
               {{.name = "velocity", .unit = "m/s", .components = 2, .values = v},
                {.name = "number", .unit = "", .components = 1, .values = c, .on_cells = true}});
}

} // namespace

TEST_CASE("ranks that each write their rows make the file of one rank, byte by byte")
{
  const Ranks ranks = all_ranks();
  const SharedFolder folder(ranks);
  const Squares squares;
  {
    FrameWriter writer(folder.path, "shared", ranks);
    for (const double t : {0.0, 0.5})
      write_shared(writer, squares, t, ranks);
  }
  ranks.any(false); // all have written
  if (ranks.rank() == 0)
  {
    FrameWriter writer(folder.path + "/alone", "shared");
    for (const double t : {0.0, 0.5})
      write_whole(writer, squares, t);
    for (const std::string name : {"shared.h5", "shared.xdmf"})
    {
      const std::string one = content_of(folder.path + "/alone/" + name);
      CHECK(one.size() > (name == "shared.h5" ? 2 * 4 * 6 * squares.x.size() / 2 : 500));
      CHECK(one == content_of(folder.path + "/" + name));
    }
  }
  ranks.any(false);
}

TEST_CASE("a rank that cannot write ends the frame on all ranks, in its words, and earlier frames stay")
{
  const Ranks ranks = all_ranks();
  const SharedFolder folder(ranks);
  const Squares squares;
  FrameWriter writer(folder.path, "shared", ranks);
  write_shared(writer, squares, 0.0, ranks);

  std::string reason;
  {
    const SmallDisk disk(ranks.rank() == ranks.size() - 1 && !ranks.alone());
    try
    {
      write_shared(writer, squares, 0.5, ranks);
    }
    catch (const Failure& failure)
    {
      CHECK(failure.code() == ExitCode::output_failed);
      reason = failure.what();
    }
  }
  if (ranks.alone())
  {
    CHECK(reason.empty());
    return;
  }
  CHECK(reason.find("shared.h5: cannot be written: File too large") != std::string::npos);
  if (ranks.rank() == 0)
  {
    CHECK(writer.frames() == 1);
    CHECK(content_of(folder.path + "/shared.xdmf").find("frames/000001") == std::string::npos);
  }
  write_shared(writer, squares, 1.0, ranks); // there is room again
  ranks.any(false);
  if (ranks.rank() == 0)
    CHECK(writer.frames() == 2);
  ranks.any(false);
}
