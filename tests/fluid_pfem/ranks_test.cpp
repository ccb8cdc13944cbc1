// The fluid on several ranks has the bits of the fluid on one. Run by mpirun; rank 0 also runs alone.
#include "common/error.hpp"
#include "common/parallel/mpi_ranks.hpp"
#include "common/time/step_ladder.hpp"
#include "fluid_pfem/fluid.hpp"
#include "tests/common/io/temporary_folder.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <span>
#include <string>
#include <vector>
#ifdef __linux__
#include <sys/mman.h>
#include <unistd.h>
#endif

using namespace undine;
using namespace undine::fluid;

namespace
{

/// Steps of each comparison: 1000 in the validation run, fewer in every build.
std::int64_t steps_wanted(std::int64_t steps)
{
  const char* wanted = std::getenv("UNDINE_RANKS_TEST_STEPS");
  return wanted ? std::atoll(wanted) : steps;
}

/// What happens between two steps. @returns it remeshed
template <int dim>
bool look(Fluid<dim>& fluid, std::int64_t step, const StepLadder& ladder, double& dt)
{
  const bool remesh = step > 0 && step % 4 == 0 && fluid.is_distorted();
  if (remesh)
    fluid.remesh();
  if (remesh || step % 8 == 0)
    dt = ladder.next(dt, fluid.critical_time_step());
  return remesh;
}

/// One step as run_alone makes it. @returns it remeshed
template <int dim>
bool advance(Fluid<dim>& fluid, std::int64_t step, const StepLadder& ladder, double& dt)
{
  const bool remesh = look(fluid, step, ladder, dt);
  fluid.predict(dt);
  fluid.solve_free_motion(dt);
  return remesh;
}

std::int64_t steps_in_sweeps = 0; ///< of this rank, of advance_by_four

/// Four steps as run_alone makes them: alone one by one, ranks in one sweep where they can.
bool advance_by_four(Fluid<2>& fluid, std::int64_t step, const StepLadder& ladder, double& dt)
{
  if (step % 4 != 0)
    return false;
  const bool remesh = look(fluid, step, ladder, dt);
  if (fluid.ranks().alone())
    for (int k = 0; k < 4; ++k)
    {
      fluid.predict(dt);
      fluid.solve_free_motion(dt);
    }
  else
  {
    const int together = fluid.in_one_sweep(4);
    steps_in_sweeps += together > 1 ? together : 0;
    fluid.advance(dt, 4);
  }
  return remesh;
}

/// A force on each wet node of this rank, of its place and velocity: a coupler of springs and dashpots.
template <int dim>
std::vector<double> force_on_wet(const Fluid<dim>& fluid, std::span<const double> v)
{
  std::vector<double> f;
  const auto [begin, end] = fluid.wet_range();
  for (index_t n = begin; n < end; ++n)
    for (int k = 0; k < dim; ++k)
    {
      const auto i = static_cast<std::size_t>(n);
      const double x = fluid.nodes().x[i][k], w = v[static_cast<std::size_t>((n - begin) * dim + k)];
      f.push_back(fluid.nodes().inertia[i] * (3.0 * std::sin(7.0 * x + 20.0 * fluid.time()) - 5.0 * w));
    }
  return f;
}

/// One step as run_coupled makes it where the surfaces stay together.
template <int dim>
bool advance_coupled(Fluid<dim>& fluid, std::int64_t step, const StepLadder& ladder, double& dt)
{
  if (step == 0)
  {
    const link::Kinematics k = fluid.kinematics();
    link::Activation start{.impulse = force_on_wet(fluid, k.v), .link_force = force_on_wet(fluid, k.a_free)};
    for (double& j : start.impulse)
      j *= 0.01;
    fluid.apply_activation(start);
  }
  const bool remesh = look(fluid, step, ladder, dt);
  fluid.predict(dt);
  fluid.solve_free_motion_of_interface(dt);
  const auto v = fluid.interface_velocity();
  const std::vector<double> v_free(v.begin(), v.end()); // what travels meanwhile
  fluid.solve_free_motion_of_interior(dt);
  fluid.correct_with_link(force_on_wet<dim>(fluid, v_free), dt);
  return remesh;
}

/// The same in contact: the link pushes in the middle of the step.
template <int dim>
bool advance_in_contact(Fluid<dim>& fluid, std::int64_t step, const StepLadder& ladder, double& dt)
{
  const bool remesh = look(fluid, step, ladder, dt);
  fluid.predict_velocity(dt);
  fluid.push(force_on_wet<dim>(fluid, fluid.interface_velocity()), dt);
  fluid.predict_position(dt);
  fluid.solve_free_motion(dt);
  return remesh;
}

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

/// The surface of several ranks is that of one, and each row has its owner.
template <int dim>
std::string differences(const Fluid<dim>& part, const Fluid<dim>* alone)
{
  const link::SurfaceMesh of_part = part.wet_surface();
  std::string wrong;
  const auto [begin, end] = part.wet_range();
  const std::vector<std::int64_t> rows = of_part.rows_of(part.ranks().rank());
  if (rows.size() != static_cast<std::size_t>(end - begin) || (!rows.empty() && rows.front() != begin) ||
      (part.ranks().alone() != of_part.owner.empty() && part.n_wet() > 0))
    wrong += " owners";
  if (!alone)
    return wrong;
  const link::SurfaceMesh whole = alone->wet_surface();
  if (of_part.node_id != whole.node_id || of_part.x != whole.x ||
      of_part.inverse_mass != whole.inverse_mass || of_part.face_nodes != whole.face_nodes ||
      of_part.face_interface != whole.face_interface)
    wrong += " surface";
  return wrong;
}

/// Names of the fields that differ, and what else does.
template <int dim>
std::string differences(FluidNodes<dim> a, FluidNodes<dim> b, const FluidMesh<dim>& mesh_a,
                        const FluidMesh<dim>& mesh_b)
{
  std::string names;
  std::vector<std::string> of_a;
  const auto text_of = [](const auto& field)
  {
    const auto* bytes = reinterpret_cast<const char*>(field.data());
    return std::string(bytes, field.size() * sizeof(field.front()));
  };
  a.for_each_field([&](const char*, const auto& field) { of_a.push_back(text_of(field)); });
  std::size_t k = 0;
  b.for_each_field(
      [&](const char* name, const auto& field)
      {
        if (text_of(field) != of_a[k++])
          names += std::string(" ") + name;
      });
  if (mesh_a.elements != mesh_b.elements)
    names += " elements";
  return names;
}

bool same(const FluidEnergy& a, const FluidEnergy& b)
{
  return a.kinetic == b.kinetic && a.internal == b.internal && a.potential == b.potential &&
         a.dissipated == b.dissipated && a.exchanged == b.exchanged && a.remesh_gain == b.remesh_gain &&
         a.remesh_loss == b.remesh_loss && a.interface_work == b.interface_work && a.openings == b.openings;
}

bool same(const FluidMass& a, const FluidMass& b)
{
  return a.meshed == b.meshed && a.flying == b.flying && a.dynamic == b.dynamic && a.volume == b.volume &&
         a.inflow == b.inflow && a.outflow == b.outflow;
}

/// The file of the state, to which each rank gives its rows, is not that of one rank. Collective.
template <int dim>
bool state_differs(Fluid<dim>& part, std::optional<Fluid<dim>>& alone)
{
  const auto write = [](Fluid<dim>& fluid, const std::string& path)
  {
    StateArchive archive(path, fluid.ranks());
    archive("fluid", fluid);
    archive.save();
  };
  std::optional<TemporaryFolder> folder;
  if (alone)
    folder.emplace();
  write(part, alone ? *folder / "part.h5" : "");
  if (!alone)
    return false;
  write(*alone, *folder / "alone.h5");
  return content_of(*folder / "part.h5") != content_of(*folder / "alone.h5");
}

/// Rank 0 also runs alone, and compares the state at every fiftieth step, at every remesh and at the end.
/// @returns how many ranks had wet nodes at the end
template <int dim>
std::int64_t check_same_bits(const FluidConfig& config, std::int64_t steps, std::int64_t least_remeshes,
                             bool (*advance)(Fluid<dim>&, std::int64_t, const StepLadder&,
                                             double&) = ::advance<dim>,
                             const Cut& cut = even_cut)
{
  const Ranks ranks = ranks_of(MPI_COMM_WORLD, 60.0);
  const bool first = ranks.rank() == 0;
  Fluid<dim> part(config, ranks, cut);
  std::optional<Fluid<dim>> alone;
  if (first)
    alone.emplace(config);
  const StepLadder ladder;
  double dt_alone = 0.0, dt = 0.0;
  std::string wrong;
  std::int64_t step = 0;
  for (; step < steps; ++step)
  {
    const bool remesh = advance(part, step, ladder, dt);
    if (first && (advance(*alone, step, ladder, dt_alone) != remesh || dt != dt_alone))
      wrong += " decisions";
    if (!remesh && step % 50 != 0 && step + 1 != steps)
      continue;
    if (step + 1 == steps && state_differs(part, alone))
      wrong += " state file";
    const FluidEnergy energy = part.energy();
    const FluidMass mass = part.mass_by_state();
    wrong += differences<dim>(part, first ? &*alone : nullptr);
    part.collect();
    if (first)
    {
      if (!same(energy, alone->energy()) || energy.wall_work != alone->energy().wall_work)
        wrong += " energy";
      if (!same(mass, alone->mass_by_state()))
        wrong += " mass";
      wrong += differences<dim>(part.nodes(), alone->nodes(), part.mesh(), alone->mesh());
      if (!same(part.energy(), energy) || !same(part.mass_by_state(), mass))
        wrong += " collected_sums";
      if (part.walls().impulse() != alone->walls().impulse())
        wrong += " impulse";
    }
    if (ranks.any(!wrong.empty()))
      break;
  }
  INFO("rank " << ranks.rank() << " of " << ranks.size() << ", nodes " << part.nodes().x.size()
               << ", elements " << part.mesh().n_elements() << ", remeshes " << part.remeshes() << ", step "
               << step);
  CHECK(wrong == "");
  CHECK(part.remeshes() >= least_remeshes);
  const auto [begin, end] = part.wet_range();
  const std::int64_t with_wet_nodes = ranks.sum(std::int64_t{end > begin});
  if (!first)
    return with_wet_nodes;
  CHECK(part.ledger().merged == alone->ledger().merged);
  CHECK(part.ledger().split == alone->ledger().split);
  CHECK(part.ledger().created == alone->ledger().created);
  CHECK(part.ledger().dropped == alone->ledger().dropped);
  return with_wet_nodes;
}

/// A drop that falls into a pool.
FluidConfig drop_over_pool(double h)
{
  FluidConfig config = test::hydraulic(h, 30.0);
  config.size = {1.0, 0.4, 0.0};
  config.gravity = {0.0, -9.81, 0.0};
  config.contact_walls = {test::tank(1.0)};
  Body drop;
  drop.shape = Shape::ellipse;
  drop.origin = {0.3, 0.5, 0.0};
  drop.size = {0.3, 0.3, 0.0};
  drop.initial_velocity = {Expression("0.5", ""), Expression("-3", "")};
  config.more_bodies = {drop};
  return config;
}

/// A drop in space that falls onto a plane.
FluidConfig drop_in_space(double h)
{
  FluidConfig config = test::hydraulic(h, 20.0);
  config.dim = 3;
  config.shape = Shape::ellipse;
  config.size = {1.0, 1.0, 1.0};
  config.initial_velocity = {Expression("0.2", ""), Expression("0", ""), Expression("-2", "")};
  config.gravity = {0.0, 0.0, -9.81};
  WallGeometry floor;
  floor.name = "floor";
  floor.plane = true;
  floor.points = {{0.0, 0.0, -0.02}};
  floor.normal = {0.0, 0.0, 1.0};
  config.contact_walls = {floor};
  return config;
}

/// Three rows of 401 nodes, of which two are wet.
FluidConfig film()
{
  FluidConfig config = test::hydraulic(0.01, 30.0);
  config.size = {4.0, 0.02, 0.0};
  config.gravity = {0.0, -9.81, 0.0};
  config.initial_velocity = {Expression("0.3*sin(3*x)", ""), Expression("0", "")};
  config.interfaces = {{"below", "bottom"}, {"above", "top"}};
  config.remesh.only_if_moved = false;
  return config;
}

/// A cut that leaves most to one rank, or to another rank after every remesh.
struct Uneven
{
  std::string name;
  Cut cut;
  double largest; ///< part of all nodes that some rank has, at least
  bool wanders = false;
};

/// For more than one rank; there are as many shares as ranks.
std::vector<Uneven> uneven_cuts(int ranks)
{
  if (ranks == 1)
    return {};
  const auto nine_tenths = [](index_t heavy)
  {
    return [heavy](index_t blocks, index_t k, index_t shares)
    { return blocks * (k + (k > heavy ? 9 * (shares - 1) - 1 : 0)) / (10 * (shares - 1)); };
  };
  // Some 20 blocks: 90 % of them are 18 at least.
  return {{"rounded up",
           [](index_t blocks, index_t k, index_t shares) { return (blocks * k + shares - 1) / shares; }, 0.0},
          {"nine tenths on the first", nine_tenths(0), 0.85},
          {"nine tenths on the last", nine_tenths(ranks - 1), 0.85},
          {"all on the first", [](index_t blocks, index_t k, index_t) { return k > 0 ? blocks : 0; }, 1.0},
          {"nine tenths on another in every remesh",
           [nine_tenths, heavy = 0](index_t blocks, index_t k, index_t shares) mutable
           {
             heavy = k == 0 ? (heavy + 1) % shares : heavy;
             return nine_tenths(heavy)(blocks, k, shares);
           },
           0.85, true}};
}

} // namespace

TEST_CASE("a dam break has the same bits on any number of ranks", "[ranks]")
{
  check_same_bits<2>(test::dam_break_config(0.146 / 24.0), steps_wanted(400), 5);
}

// Truth: the bits of single steps. Nodes of other ranks that a rank takes into a sweep are no more than a
// tenth of its own: with three ranks those in the middle have room for three steps.
TEST_CASE("several steps in one sweep on each rank have the same bits", "[ranks]")
{
  FluidConfig config = test::dam_break_config(0.146 / 24.0);
  config.size = {0.06, 4.8};
  config.remesh.every = 20;
  config.remesh.only_if_moved = false;
  const auto column = [&]
  {
    steps_in_sweeps = 0;
    check_same_bits<2>(config, steps_wanted(200), 5, advance_by_four);
    const int size = ranks_of(MPI_COMM_WORLD, 60.0).size();
    if (size == 2 || size == 3)
      CHECK(steps_in_sweeps >= 100);
  };
  SECTION("a column that collapses") { column(); }
  SECTION("of threads that share it")
  {
    config.threads = 2;
    column();
  }
  SECTION("with viscosity and without stabilisers")
  {
    config.terms = {.mu = 1e-3};
    column();
  }
  SECTION("in a tank that rolls") // by less than a spacing in a step: so far candidates reach
  {
    config.contact_walls.front().motion.angle = Expression("0.002*sin(300*t)", "roll");
    column();
  }
  SECTION("in a ramp of gravity, without tension")
  {
    config.gravity_ramp = 0.01;
    config.surface_tension_allowed = false;
    column();
  }
}

TEST_CASE("a drop that falls into a pool, leaving the part of its rank, has the same bits", "[ranks]")
{
  FluidConfig config = drop_over_pool(1.0 / 40.0);
  config.terms.mu = 1.0;
  config.terms.bulk_quadratic = 1.0;
  config.surface_tension_allowed = false;
  check_same_bits<2>(config, steps_wanted(400), 5);
}

// The front meets the obstacle at once; nodes behind its faces are taken out, others fly and are deleted.
TEST_CASE("a spacing that varies, an obstacle and deleted nodes leave the same bits", "[ranks]")
{
  FluidConfig config = test::dam_break_config(0.146 / 14.0);
  WallGeometry obstacle;
  obstacle.name = "obstacle";
  obstacle.points = {{0.15, 0.0, 0.0}, {0.15, 0.04, 0.0}, {0.2, 0.04, 0.0}, {0.2, 0.0, 0.0}};
  obstacle.closed = true;
  config.contact_walls.push_back(obstacle);
  SizeZone zone;
  zone.lower = {0.1, 0.0, 0.0};
  zone.upper = {0.2, 0.1, 0.0};
  config.spacing = {zone};
  config.remesh.delete_isolated_after = 2;
  check_same_bits<2>(config, steps_wanted(300), 5);
}

TEST_CASE("a drop in space has the same bits on any number of ranks", "[ranks]")
{
  check_same_bits<3>(drop_in_space(1.0 / 11.0), steps_wanted(60), 1);
}

TEST_CASE("ranks and threads together have the same bits, with a force that varies", "[ranks]")
{
  FluidConfig config = test::dam_break_config(0.146 / 24.0);
  config.threads = 2;
  config.body_force = {Expression("3*sin(20*t)", ""), Expression("y", "")};
  check_same_bits<2>(config, 40, 0);
}

TEST_CASE("a periodic space has the same bits", "[ranks]")
{
  FluidConfig config = test::hydraulic(1.0 / 36.0, 30.0);
  config.size = {1.0, 1.0, 0.0};
  config.period = {1.0, 1.0, 0.0};
  config.initial_velocity = {Expression("sin(2*pi*y)", ""), Expression("-sin(2*pi*x)", "")};
  check_same_bits<2>(config, steps_wanted(200), 1);
}

// Water that moves through a periodic channel on a floor: the ends of the channel are on different ranks, and
// what is beyond an end belongs to the halo of the other.
TEST_CASE("a periodic channel whose ends are on different ranks has the same bits", "[ranks]")
{
  FluidConfig config = test::hydraulic(1.0 / 40.0, 30.0);
  config.size = {4.0, 0.3, 0.0};
  config.period = {4.0, 0.0, 0.0};
  config.gravity = {0.0, -9.81, 0.0};
  config.initial_velocity = {Expression("1.5+0.5*sin(pi*x)", ""), Expression("0.5*cos(pi*x)", "")};
  WallGeometry floor;
  floor.name = "floor";
  floor.plane = true;
  floor.points = {{0.0, 0.0, 0.0}};
  floor.normal = {0.0, 1.0, 0.0};
  config.contact_walls = {floor};
  config.remesh.only_if_moved = false;
  check_same_bits<2>(config, steps_wanted(200), 5);
}

TEST_CASE("a periodic space that is larger than what a rank sees of it, in the plane and in space", "[ranks]")
{
  FluidConfig config = test::hydraulic(1.0 / 72.0, 30.0);
  config.size = {1.0, 1.0, 0.0};
  config.period = {1.0, 1.0, 0.0};
  config.initial_velocity = {Expression("2*sin(2*pi*y)", ""), Expression("-sin(2*pi*x)", "")};
  config.remesh.only_if_moved = false;
  check_same_bits<2>(config, steps_wanted(60), 2);
  FluidConfig rod = test::hydraulic(0.1, 20.0);
  rod.dim = 3;
  rod.size = {3.0, 0.3, 0.3};
  rod.period = {3.0, 0.0, 0.0};
  rod.initial_velocity = {Expression("1+0.2*sin(2*pi*x/3)", ""), Expression("0", ""), Expression("0", "")};
  rod.remesh.only_if_moved = false;
  check_same_bits<3>(rod, 24, 1);
}

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

// New nodes have their numbers from one count, whoever has the opening; the ledger of openings has the order
// of one rank.
TEST_CASE("inlets, outlets and impedance boundaries have the same bits on any number of ranks", "[ranks]")
{
  SECTION("a jet into an outlet, over a plate that it meets")
  {
    FluidConfig config = test::hydraulic(0.02, 20.0);
    config.gravity = {0.0, -9.81, 0.0};
    config.shape = Shape::none;
    config.inlets.push_back({.name = "inlet", .a = {0.0, 0.3, 0.0}, .b = {0.0, 0.0, 0.0}, .speed = {}});
    config.inlets[0].speed.emplace_back("2.0+sin(10*t)", "test");
    config.inlets.push_back({.name = "other", .a = {1.5, 0.0, 0.0}, .b = {1.5, 0.2, 0.0}, .speed = {}});
    config.inlets[1].speed.emplace_back("1.5", "test");
    config.outlets.push_back({.lower = {0.5, -2.0, 0.0}, .upper = {1.0, 2.0, 0.0}});
    check_same_bits<2>(config, steps_wanted(1000), 10);
    for (const Uneven& uneven : uneven_cuts(ranks_of(MPI_COMM_WORLD, 60.0).size()))
      check_same_bits<2>(config, steps_wanted(300), 3, advance<2>, uneven.cut);
  }
  SECTION("a tank with a hole")
  {
    FluidConfig config = test::dam_break_config(0.146 / 24.0);
    config.outlets.push_back({.lower = {0.2, 0.0, 0.0}, .upper = {0.3, 0.1, 0.0}});
    config.threads = 2;
    check_same_bits<2>(config, steps_wanted(400), 5);
  }
  SECTION("in space")
  {
    FluidConfig config = test::hydraulic(0.1, 20.0);
    config.dim = 3;
    config.shape = Shape::none;
    config.inlets.push_back(
        {.name = "inlet", .a = {}, .b = {0.5, 0.0, 0.0}, .c = {0.0, 0.4, 0.0}, .speed = {}});
    config.inlets[0].speed.emplace_back("2.0", "test");
    config.outlets.push_back({.lower = {-1.0, -1.0, 0.5}, .upper = {2.0, 2.0, 2.0}});
    check_same_bits<3>(config, 120, 3);
  }
  SECTION("waves that leave through the ends of a tank under gravity, in plane and space")
  {
    const auto channel = [](FluidConfig config)
    {
      config.gravity = {0.0, -9.81, 0.0};
      config.initial_pressure = InitialPressure::hydrostatic;
      config.walls = {{"bottom"}, {"left", WallKind::impedance}, {"right", WallKind::impedance}};
      config.initial_velocity = {Expression("0.5*sin(3*x)", ""), Expression("0", "")};
      config.remesh.only_if_moved = false;
      return config;
    };
    FluidConfig config = channel(test::hydraulic(0.02, 20.0));
    config.size = {2.0, 0.4, 0.0};
    check_same_bits<2>(config, steps_wanted(100), 3);
    FluidConfig slab = test::hydraulic(0.1, 20.0);
    slab.dim = 3;
    slab.size = {1.2, 0.3, 0.8};
    slab = channel(slab);
    slab.initial_velocity.emplace_back("0", "");
    check_same_bits<3>(slab, 40, 1);
  }
}
