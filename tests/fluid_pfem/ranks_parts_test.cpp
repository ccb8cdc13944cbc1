// The same whatever the parts of the ranks are: order of nodes, cuts, ghosts, memory.
#include "tests/fluid_pfem/same_bits.hpp"

#ifdef __linux__
#include <sys/mman.h>
#include <unistd.h>
#endif

using namespace undine;
using namespace undine::fluid;
using namespace undine::test;

TEST_CASE("the other order of the nodes has the same bits on any number of ranks too", "[ranks]")
{
  SECTION("boxes in the plane")
  {
    FluidConfig config = drop_over_pool(1.0 / 220.0); // two boxes
    config.order = NodeOrder::boxes;
    config.remesh.only_if_moved = false;
    config.remesh.every = 12; // steps
    check_same_bits<2>(config, 60, 4);
    config.threads = 2;
    config.interfaces = {{"below", "bottom"}};
    config.contact_walls.clear();
    check_same_bits<2>(config, 30, 1, advance_coupled<2>);
  }
  SECTION("rows in space")
  {
    FluidConfig config = drop_in_space(1.0 / 11.0);
    config.order = NodeOrder::rows;
    check_same_bits<3>(config, 30, 1);
  }
}

// Truth: the cuts of a square of n x n nodes. Four ranks: two cuts of n edges instead of three; eight: n, n
// and four of n/2 instead of seven. Columns stand 0.87 spacings apart, so that cuts of one direction
// have 1.15 times as many nodes; a tenth more where cuts cross and parts end at whole blocks of elements.
TEST_CASE("many ranks of boxes have fewer ghosts than many of rows", "[ranks]")
{
  const Ranks ranks = ranks_of(MPI_COMM_WORLD, 60.0);
  FluidConfig config = test::hydraulic(1.0 / 250.0, 30.0);
  config.size = {1.0, 1.0, 0.0};
  const auto bytes_of = [&](NodeOrder order)
  {
    config.order = order;
    Fluid<2> fluid(config, ranks);
    const double dt = fluid.critical_time_step();
    const auto before = ranks.cost().bytes;
    fluid.predict(dt);
    fluid.solve_free_motion(dt);
    return static_cast<double>(ranks.sum(ranks.cost().bytes - before));
  };
  const double rows = bytes_of(NodeOrder::rows), boxes = bytes_of(NodeOrder::boxes);
  CAPTURE(rows, boxes);
  if (ranks.size() == 4)
    CHECK(boxes < 1.25 * 2.0 / 3.0 * rows);
  if (ranks.size() == 8)
    CHECK(boxes < 1.25 * 4.0 / 7.0 * rows);
}

#ifdef __linux__
// Truth: the kernel's account of pages. Around its nodes a rank has ghosts, in rows two spacings high, of
// which a column h wide has 2 W / h nodes; two rows on each side hold the neighbours, and rows nearer than
// 1024 to one that is needed may stay.
TEST_CASE("after a remesh rows of nodes that are not around a rank's own take no memory", "[ranks]")
{
  const Ranks ranks = ranks_of(MPI_COMM_WORLD, 60.0);
  constexpr double over_width = 120.0;
  FluidConfig config = test::dam_break_config(0.146 / over_width);
  config.remesh.only_if_moved = false;
  Fluid<2> fluid(config, ranks);
  const auto pages_of =
      [](const auto& field, index_t begin, index_t end) // in memory, of those that lie within
  {
    const auto size = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
    const auto first = (reinterpret_cast<std::uintptr_t>(field.data() + begin) + size - 1) / size * size,
               last = reinterpret_cast<std::uintptr_t>(field.data() + end) / size * size;
    std::vector<unsigned char> pages(first < last ? (last - first) / size : 0);
    if (!pages.empty())
      mincore(reinterpret_cast<void*>(first), last - first, pages.data());
    return std::count_if(pages.begin(), pages.end(), [](unsigned char page) { return (page & 1U) != 0; });
  };
  const auto others_that_take_memory = [&]
  {
    constexpr index_t around = 4 * static_cast<index_t>(1.25 * over_width) + 1024;
    const auto [begin, end] = fluid.node_range();
    FluidNodes<2>& nodes = const_cast<FluidNodes<2>&>(fluid.nodes()); // the visitor may change them
    const index_t lower = std::max(0, begin - around), upper = std::min(nodes.size(), end + around);
    std::ptrdiff_t found = 0;
    nodes.for_each_field_of_owners(
        [&](const char*, const auto& field)
        { found += pages_of(field, 0, lower) + pages_of(field, upper, nodes.size()); });
    return found;
  };
  CAPTURE(ranks.rank(), ranks.size(), fluid.nodes().x.size());
  CHECK(others_that_take_memory() == 0);
  for (int remeshes = 0; remeshes < 3; ++remeshes)
  {
    fluid.advance(1e-7, 20);
    fluid.remesh();
    CHECK(others_that_take_memory() == 0);
  }
  const double mass = fluid.mass();
  fluid.collect(); // all rows come, and go with the next remesh
  CHECK(fluid.mass() == mass);
  fluid.remesh();
  CHECK(others_that_take_memory() == 0);
}
#endif

TEST_CASE("fewer nodes than ranks: some have nothing to do", "[ranks]")
{
  FluidConfig config = test::hydraulic(1.0, 30.0);
  config.gravity = {0.0, -9.81, 0.0};
  config.contact_walls = {test::tank(2.0)};
  check_same_bits<2>(config, steps_wanted(200), 0);
}

// Truth: one rank, as everywhere here. Where most is one rank's the cut lies in other rows than an even one,
// and the other ranks have a block each or none; where it changes from remesh to remesh most nodes move from
// rank to rank, with all that is kept of them.
TEST_CASE("however uneven the parts of the ranks, the bits are the same", "[ranks]")
{
  const auto often = [](FluidConfig config)
  {
    config.remesh.only_if_moved = false;
    config.remesh.every = 12; // steps
    return config;
  };
  const FluidConfig column = often(test::dam_break_config(0.146 / 36.0)),
                    drop = often(drop_over_pool(1.0 / 60.0)), in_space = often(drop_in_space(1.0 / 11.0)),
                    wet = often(film());
  for (const Uneven& uneven : uneven_cuts(ranks_of(MPI_COMM_WORLD, 60.0).size()))
    DYNAMIC_SECTION(uneven.name)
    {
      check_same_bits<2>(column, steps_wanted(60), 4, advance<2>, uneven.cut);
      check_same_bits<2>(drop, steps_wanted(60), 4, advance<2>, uneven.cut);
      check_same_bits<3>(in_space, 30, 2, advance<3>, uneven.cut);
      check_same_bits<2>(wet, 60, 4, advance_coupled<2>, uneven.cut);
    }
}

// The test above is worth what its parts are uneven.
TEST_CASE("the mesh is cut where it is to be cut, in every remesh", "[ranks]")
{
  const Ranks ranks = ranks_of(MPI_COMM_WORLD, 60.0);
  for (const auto& [name, cut, largest, wanders] : uneven_cuts(ranks.size()))
  {
    INFO(name);
    Fluid<2> fluid(test::dam_break_config(0.146 / 36.0), ranks, cut);
    std::int64_t had_most = -1;
    for (int remeshes = 0; remeshes < 4; ++remeshes)
    {
      const std::vector<index_t> first = ranks.gather(std::vector{fluid.node_range()[0]});
      std::vector<index_t> count;
      for (std::size_t r = 0; r < first.size(); ++r)
        count.push_back((r + 1 < first.size() ? first[r + 1] : fluid.nodes().size()) - first[r]);
      const auto most = std::max_element(count.begin(), count.end());
      CHECK(*most >= largest * fluid.nodes().size());
      CHECK((!wanders || most - count.begin() != had_most));
      had_most = most - count.begin();
      fluid.remesh();
    }
  }
}
