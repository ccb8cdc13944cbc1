// The same for a fluid that is coupled: wet nodes, activation, contact.
#include "tests/fluid_pfem/same_bits.hpp"

using namespace undine;
using namespace undine::fluid;
using namespace undine::test;

namespace
{

/// A plate half a spacing thick and 60 long that leans over and swings, through the water's middle, over a
/// step of it: the corners of its head are sharp.
link::SurfaceMesh plate_at(double angle, double h, const Vec<2>& foot)
{
  const double lean = 0.15 + 0.1 * std::sin(angle);
  const Vec<2> along{{std::sin(lean), std::cos(lean)}}, across{{along[1], -along[0]}};
  link::SurfaceMesh plate;
  plate.dim = 2;
  const auto add = [&](double s, double d)
  {
    const Vec<2> x = foot + (s * h) * along + (d * h) * across;
    plate.node_id.push_back(static_cast<std::int64_t>(plate.node_id.size()));
    plate.x.insert(plate.x.end(), x.c.begin(), x.c.end());
  };
  for (int k = 0; k <= 60; ++k)
    add(k, 0.5);
  for (int k = 60; k >= 0; --k)
    add(k, 0.0);
  const auto n = static_cast<std::int32_t>(plate.node_id.size());
  plate.face_offset = {0};
  for (std::int32_t k = 0; k < n; ++k)
  {
    plate.face_nodes.insert(plate.face_nodes.end(), {k, (k + 1) % n}); // the body on the left
    plate.face_offset.push_back(2 * k + 2);
  }
  return plate;
}

/// Beside the plate, which the water meets and leaves: it swings at so many 1/s and is shown every fourth
/// step.
template <int rate>
bool advance_beside_plate(Fluid<2>& fluid, std::int64_t step, const StepLadder& ladder, double& dt)
{
  const double h = fluid.config().element_size;
  if (step % 4 == 0)
    fluid.meet_solid(plate_at(rate * fluid.time(), h, {{0.5 * fluid.config().size[0], 2.0 * h}}));
  return advance_in_contact<2>(fluid, step, ladder, dt);
}

} // namespace

// A hole along the plate crosses the cuts between the ranks, and nodes of any rank come to the corners of its
// head: the cuts are elsewhere after every remesh.
TEST_CASE("water beside a plate that it meets and leaves has the same bits", "[ranks]")
{
  FluidConfig config = test::dam_break_config(0.146 / 36.0);
  config.interfaces = {{"plate", InterfaceConfig::whole_boundary}};
  const Cut wandering = [remesh = 0](index_t blocks, index_t k, index_t shares) mutable
  {
    remesh += k == 0;
    const index_t width = std::max(1, blocks / shares), at = even_cut(blocks, k, shares);
    return k == 0 || k == shares ? at : at - 3 * remesh % width;
  };
  check_same_bits<2>(config, steps_wanted(400), 10, advance_beside_plate<50>, wandering);
  // So fast that nodes come near it sooner than the mesh gets bad: the same elements, in another order.
  check_same_bits<2>(config, steps_wanted(400), 5, advance_beside_plate<200>, wandering);
}

// A mesh of one block of elements is not cut: the last rank has it, the others have nothing.
TEST_CASE("all nodes on one rank, beside an interface", "[ranks]")
{
  FluidConfig config = test::hydraulic(0.1, 30.0);
  config.size = {2.0, 0.2, 0.0};
  config.gravity = {0.0, -9.81, 0.0};
  config.initial_velocity = {Expression("0.3*sin(3*x)", ""), Expression("0", "")};
  config.interfaces = {{"wet", "bottom"}};
  config.remesh.only_if_moved = false;
  check_same_bits<2>(config, 100, 1);
  CHECK(check_same_bits<2>(config, 40, 1, advance_coupled<2>) == 1);
}

// As many ranks as there are blocks of elements have wet nodes, and pass to each other what forces on them
// need.
TEST_CASE("a film between two interfaces: all ranks have wet nodes", "[ranks]")
{
  FluidConfig config = film();
  const int size = ranks_of(MPI_COMM_WORLD, 60.0).size();
  SECTION("that stay") { CHECK(check_same_bits<2>(config, 60, 1, advance_coupled<2>) >= std::min(size, 6)); }
  SECTION("with threads")
  {
    config.threads = 2;
    CHECK(check_same_bits<2>(config, 30, 1, advance_coupled<2>) >= std::min(size, 6));
  }
  SECTION("that push, in a tank")
  {
    config.contact_walls = {test::tank(4.0)};
    CHECK(check_same_bits<2>(config, 60, 1, advance_in_contact<2>) >= std::min(size, 6));
  }
}

TEST_CASE("a slab in space on a wet floor", "[ranks]")
{
  FluidConfig config = test::hydraulic(0.1, 20.0);
  config.dim = 3;
  config.size = {1.2, 0.3, 1.2};
  config.gravity = {0.0, -9.81, 0.0};
  config.initial_velocity = {Expression("0.2*sin(3*x)", ""), Expression("0", ""), Expression("0", "")};
  config.interfaces = {{"wet", "bottom"}};
  config.remesh.only_if_moved = false;
  const int size = ranks_of(MPI_COMM_WORLD, 60.0).size();
  CHECK(check_same_bits<3>(config, 24, 1, advance_coupled<3>) >= std::min((size + 1) / 2, 2));
}
