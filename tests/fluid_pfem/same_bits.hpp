// The fluid on several ranks beside the fluid on one: ways to advance it, scenes, uneven cuts, and the
// comparison bit by bit.
#pragma once

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

namespace undine::test
{

using namespace fluid;

/// Steps of each comparison: 1000 in the validation run, fewer in every build.
inline std::int64_t steps_wanted(std::int64_t steps)
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

inline bool same(const FluidEnergy& a, const FluidEnergy& b)
{
  return a.kinetic == b.kinetic && a.internal == b.internal && a.potential == b.potential &&
         a.dissipated == b.dissipated && a.exchanged == b.exchanged && a.remesh_gain == b.remesh_gain &&
         a.remesh_loss == b.remesh_loss && a.interface_work == b.interface_work && a.openings == b.openings;
}

inline bool same(const FluidMass& a, const FluidMass& b)
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
                                             double&) = advance<dim>,
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
inline FluidConfig drop_over_pool(double h)
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
inline FluidConfig drop_in_space(double h)
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
inline FluidConfig film()
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
inline std::vector<Uneven> uneven_cuts(int ranks)
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

} // namespace undine::test
