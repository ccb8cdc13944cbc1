// The solid on several ranks has the bits of the solid on one. Run by mpirun; rank 0 also runs alone.
#include "common/error.hpp"
#include "common/parallel/mpi_ranks.hpp"
#include "common/parallel/partition.hpp"
#include "solid_fe/solid.hpp"
#include "solid_fe/solid_output.hpp"
#include "solid_fe/step_watch.hpp"
#include "tests/common/io/temporary_folder.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <optional>
#include <string>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

Ranks world() { return ranks_of(MPI_COMM_WORLD, 60.0); }

/// Steps of each comparison: 1000 in the validation run, fewer in every build.
int steps_wanted(int steps)
{
  const char* wanted = std::getenv("UNDINE_RANKS_TEST_STEPS");
  return wanted ? std::atoi(wanted) : steps;
}

/// One step as run_alone makes it, under a link force on the wet nodes that varies with place and time.
template <int dim>
void advance(Solid<dim>& solid, StepWatch<dim>& watch)
{
  const double dt = watch.limit(solid);
  solid.predict(dt);
  solid.solve_free_motion(dt);
  if (solid.n_wet_nodes() == 0)
    return;
  std::vector<double> f_link;
  solid.share().for_own(0, static_cast<std::size_t>(solid.n_wet_nodes()),
                        [&](std::size_t n)
                        {
                          for (int i = 0; i < dim; ++i)
                            f_link.push_back(std::sin(0.3 * static_cast<double>(n) + i +
                                                      0.02 * static_cast<double>(solid.steps())));
                        });
  solid.correct_with_link(f_link, dt);
}

template <class Field>
std::string bytes_of(const Field& field)
{
  return {reinterpret_cast<const char*>(field.data()), field.size() * sizeof(field.front())};
}

/// All that can be asked of a solid, as bytes under names. Collective.
template <int dim>
std::map<std::string, std::string> answers(Solid<dim>& solid)
{
  std::map<std::string, std::string> all;
  const auto keep = [&all](const char* name, double x)
  { all[name] = std::string(reinterpret_cast<const char*>(&x), sizeof x); };
  const auto e = solid.energies();
  keep("kinetic", e.kinetic);
  keep("strain", e.strain);
  keep("hourglass", e.hourglass);
  keep("plastic", e.plastic);
  keep("viscous", e.viscous);
  keep("contact", e.contact);
  keep("external", e.external);
  keep("interface", e.interface);
  keep("stable step", solid.critical_time_step());
  keep("mass", solid.mass());
  keep("elements", solid.n_elements());
  all["reaction"] = bytes_of(solid.reaction(solid.mesh().surfaces.at("left").node_set()).c);
  Vec<dim> middle, normal;
  middle[0] = 0.55;
  normal[0] = 1.0;
  const auto [force, moment] = solid.section_force(middle, normal);
  all["section"] = bytes_of(force.c) + bytes_of(moment.c);
  all["momentum"] = bytes_of(solid.linear_momentum().c) + bytes_of(solid.angular_momentum().c);
  const auto stress = cell_stress(solid);
  all["sigma"] = bytes_of(stress.sigma);
  all["plastic strain"] = bytes_of(stress.plastic_strain);
  solid.collect();
  all["u"] = bytes_of(solid.nodes().u);
  all["v"] = bytes_of(solid.nodes().v);
  all["a"] = bytes_of(solid.nodes().a);
  return all;
}

template <int dim>
void write_state(Solid<dim>& solid, const std::string& path, const Ranks& ranks)
{
  StateArchive archive(path, ranks);
  archive("solid", solid);
  archive.save();
}

/// Names of the answers that differ.
std::string differences(const std::map<std::string, std::string>& a,
                        const std::map<std::string, std::string>& b)
{
  std::string names;
  for (const auto& [name, bytes] : a)
    if (b.at(name) != bytes)
      names += " " + name;
  return names;
}

/// Runs on all ranks and, on rank 0, alone; compares at the start, every fifty steps and at the end. In the
/// middle the state goes through a file: that of several ranks continues on one, and the other way round.
/// @param rank_of of node n of so many, if the cut is not to be METIS's
template <int dim>
void check_same_bits(const SolidConfig& config, const Mesh<dim>& mesh, int steps = 100,
                     int (*rank_of)(index_t n, index_t nodes, int ranks) = nullptr)
{
  steps = steps_wanted(steps);
  const Ranks ranks = world();
  const bool first = ranks.rank() == 0;
  const auto distribute = [&](Solid<dim>& solid)
  {
    if (!rank_of)
      return solid.distribute(ranks);
    std::vector<int> owner;
    for (index_t n = 0; n < mesh.n_nodes(); ++n)
      owner.push_back(rank_of(n, mesh.n_nodes(), ranks.size()));
    solid.distribute(ranks, std::move(owner));
  };
  Solid<dim> part(config, mesh);
  distribute(part);
  StepWatch<dim> watch, watch_alone;
  std::optional<Solid<dim>> alone;
  if (first)
    alone.emplace(config, mesh);
  std::string wrong;
  int step = 0;
  for (; step <= steps && !ranks.any(!wrong.empty()); ++step)
  {
    if (step % 50 == 0 || step == steps)
    {
      const auto found = answers(part);
      if (first)
        wrong = differences(answers(*alone), found);
    }
    if (step == steps / 2)
    {
      const std::string folder = std::filesystem::temp_directory_path().string() + "/solid_ranks_test_" +
                                 std::to_string(ranks.size());
      if (first)
        std::filesystem::create_directories(folder);
      write_state(part, folder + "/part.h5", ranks);
      if (first)
      {
        write_state(*alone, folder + "/alone.h5", {});
        CHECK(content_of(folder + "/part.h5") == content_of(folder + "/alone.h5"));
      }
      if (first)
      {
        alone.emplace(config, mesh);
        StateArchive from(folder + "/part.h5");
        from("solid", *alone);
      }
      ranks.any(false); // the files are there
      part = Solid<dim>(config, mesh);
      distribute(part);
      {
        StateArchive from(folder + "/alone.h5");
        from("solid", part);
      }
      ranks.any(false);
      if (first)
        std::filesystem::remove_all(folder);
    }
    advance(part, watch);
    if (first)
      advance(*alone, watch_alone);
  }
  INFO("rank " << ranks.rank() << " of " << ranks.size() << ", nodes " << part.nodes().X.size()
               << " of which " << part.share().n_own() << " here, step " << step);
  CHECK(wrong == "");
  const auto e = part.energies();
  CHECK((part.contact() == nullptr || e.contact != 0.0)); // there was something to compare
  CHECK((config.material.law != "j2" || e.plastic > 0.0));
  CHECK((ranks.alone() || part.beam() != nullptr || rank_of || part.share().n_own() < part.nodes().X.size()));
}

/// Fixed on the left, pushed along the other sides, damped in every way, under gravity.
template <int dim>
SolidConfig loaded(const std::string& law)
{
  auto config = soft_config(dim, law);
  const auto along = [](double x, double y)
  {
    std::vector<double> all(dim, 0.0);
    all[0] = x;
    all[1] = y;
    return all;
  };
  config.gravity = along(0.0, -9.81);
  config.fix = {{.on = "left", .components = {"x", "y"}}};
  config.traction = {{.on = "right", .value = along(0.0, -1e4), .ramp = 0.02}};
  config.pressure = {{.on = "top", .function = "2e4*sin(200*t)"}};
  config.body_force_function = std::vector<std::string>(dim, "5*x*cos(100*t)");
  config.material.mass_damping = 3.0;
  config.material.stiffness_damping = 1e-5;
  return config;
}

/// The same of metal that flows, without viscosity.
template <int dim>
SolidConfig flowing()
{
  auto config = loaded<dim>("j2");
  config.material.yield_stress = 5e4;
  config.material.hardening_modulus = 2e5;
  config.material.mass_damping = config.material.stiffness_damping = 0.0;
  return config;
}

} // namespace

// Truth: the same program on one rank. Every sum over elements has one order and every other sum none.
TEST_CASE("a loaded block in the plane has the bits of one rank", "[solid][ranks]")
{
  for (const auto type : element_types<2>())
    for (const auto form : {Formulation::full, Formulation::locking_free})
    {
      auto config = loaded<2>("neo_hookean_ln");
      config.formulation = form;
      check_same_bits<2>(config, distorted_box<2>(type, 14));
    }
}

TEST_CASE("a block in space has the bits of one rank", "[solid][ranks]")
{
  for (const auto type : element_types<3>())
    for (const auto form : {Formulation::full, Formulation::locking_free})
    {
      auto config = loaded<3>("neo_hookean_ln");
      config.formulation = form;
      check_same_bits<3>(config, distorted_box<3>(type, 6), 60);
    }
}

TEST_CASE("metal that flows has the bits of one rank", "[solid][ranks]")
{
  for (const auto type : element_types<2>())
    for (const auto form : {Formulation::one_point, Formulation::locking_free})
    {
      auto config = flowing<2>();
      config.formulation = form;
      config.hourglass_viscosity = form == Formulation::one_point ? 0.05 : 0.0;
      config.velocity = {
          {.on = "bottom", .value = {}, .components = {"y"}, .function = {"0", "0.4*sin(60*t)"}}};
      config.pressure = {};
      config.fix = {{.on = "left", .components = {"x"}}};
      check_same_bits<2>(config, distorted_box<2>(type, 14));
    }
  auto config = flowing<3>();
  config.formulation = Formulation::one_point;
  check_same_bits<3>(config, distorted_box<3>(ElementType::hexahedron8, 6), 60);
}

// Wet nodes are where their elements are.
TEST_CASE("a wet block has the bits of one rank", "[solid][ranks]")
{
  auto config = loaded<2>("neo_hookean_ln");
  config.wet = {{.interface = "water", .surface = "top"}, {.interface = "water", .surface = "right"}};
  config.velocity = {{.on = "bottom", .value = {0.1, 0.0}, .components = {"x"}}};
  config.fix = {};
  check_same_bits<2>(config, distorted_box<2>(ElementType::quadrilateral4, 14));
  config.wet.push_back({.interface = "water", .surface = "left"});
  config.wet.push_back({.interface = "water", .surface = "bottom"});
  check_same_bits<2>(config, distorted_box<2>(ElementType::quadrilateral4, 5));
}

// METIS would not cut so: nearly all on one rank, all on one, and neighbours never together, so that every
// element is computed by as many ranks as it has corners.
TEST_CASE("however uneven the parts of the ranks, the bits are those of one", "[solid][ranks]")
{
  using RankOf = int (*)(index_t, index_t, int);
  const std::array<RankOf, 5> cuts{
      [](index_t n, index_t nodes, int ranks) { return 10 * n < 9 * nodes ? 0 : 1 + n % (ranks - 1); },
      [](index_t n, index_t nodes, int ranks) { return 10 * n < nodes ? n % (ranks - 1) : ranks - 1; },
      [](index_t, index_t, int) { return 0; }, [](index_t, index_t, int ranks) { return ranks - 1; },
      [](index_t n, index_t, int ranks) { return n % ranks; }};
  if (world().alone())
    return;
  for (const RankOf rank_of : cuts)
  {
    auto config = loaded<2>("neo_hookean_ln");
    config.formulation = Formulation::locking_free;
    check_same_bits<2>(config, distorted_box<2>(ElementType::triangle3, 10), 60, rank_of);
    config.wet = {{.interface = "water", .surface = "top"}, {.interface = "water", .surface = "right"}};
    config.formulation = Formulation::full;
    check_same_bits<2>(config, distorted_box<2>(ElementType::quadrilateral4, 10), 60, rank_of);
    check_same_bits<3>(loaded<3>("neo_hookean_ln"), distorted_box<3>(ElementType::hexahedron8, 4), 40,
                       rank_of);
  }
}

TEST_CASE("what must be rank 0's can be nobody else's", "[solid][ranks]")
{
  const Ranks ranks = world();
  auto config = loaded<2>("neo_hookean_ln");
  config.contact = {{.nodes = "left", .surface = "left", .friction = 0.1}};
  const auto mesh = distorted_box<2>(ElementType::quadrilateral4, 4);
  Solid<2> solid(config, mesh);
  std::vector<int> owner(static_cast<std::size_t>(mesh.n_nodes()), ranks.size() - 1);
  if (!ranks.alone())
    CHECK_THROWS_AS(solid.distribute(ranks, owner), InternalError);
}

TEST_CASE("contact, rigid parts and idle elements have the bits of one rank", "[solid][ranks]")
{
  for (const auto method : {ContactMethod::penalty, ContactMethod::impulse})
  {
    auto config = loaded<2>("neo_hookean_ln");
    config.fix = {};
    config.initial_velocity = {0.5, -3.0};
    config.wall = {{.point = {0.0, -0.01}, .normal = {0.0, 1.0}, .friction = 0.3, .on = "bottom"}};
    config.contact = {{.nodes = "left", .surface = "left", .friction = 0.1}};
    config.contact_method = method;
    check_same_bits<2>(config, distorted_box<2>(ElementType::quadrilateral4, 14));
  }
  auto config = loaded<2>("neo_hookean_ln");
  auto mesh = distorted_box<2>(ElementType::quadrilateral4, 14);
  for (index_t n = 0; n < mesh.n_nodes(); ++n)
    if (mesh.x[static_cast<std::size_t>(n)][0] > 0.7)
      mesh.node_sets["hammer"].push_back(n);
  config.rigid = {"hammer"};
  check_same_bits<2>(config, mesh);
}

TEST_CASE("a measured step and added mass have the bits of one rank", "[solid][ranks]")
{
  auto config = loaded<2>("svk");
  config.measures_frequency = true;
  config.scaled_step = 3e-3;
  check_same_bits<2>(config, distorted_box<2>(ElementType::triangle3, 10));
}

// Ranks without nodes have nothing to do and say nothing wrong.
TEST_CASE("fewer nodes than ranks", "[solid][ranks]")
{
  const auto config = loaded<2>("neo_hookean_ln");
  check_same_bits<2>(config, box_mesh<2>({}, {{1.0, 0.5}}, {1, 1}, ElementType::quadrilateral4), 50);
  check_same_bits<2>(config, box_mesh<2>({}, {{1.0, 0.5}}, {3, 1}, ElementType::triangle3), 50);
}

TEST_CASE("a wet beam under gravity has the bits of one rank", "[solid][ranks]")
{
  auto config = soft_config(2, "linear");
  config.formulation = Formulation::beam;
  config.gravity = {0.3, -9.81};
  config.wet.push_back({.interface = "water", .surface = "top"});
  check_same_bits<2>(config, box_mesh<2>({}, {{1.0, 0.1}}, {10, 1}, ElementType::quadrilateral4));
}

// Parts have like work: METIS allows 3 %, and vertices are whole.
TEST_CASE("parts of a lattice have like work, and what belongs together is in the first", "[ranks]")
{
  constexpr int n = 30;
  Graph graph;
  for (int k = 0; k < n * n; ++k)
  {
    const int i = k % n, j = k / n;
    for (const auto& [di, dj] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}})
      if (i + di >= 0 && i + di < n && j + dj >= 0 && j + dj < n)
        graph.neighbour.push_back(k + di + n * dj);
    graph.offset.push_back(static_cast<int>(graph.neighbour.size()));
    graph.work.push_back(1);
  }
  for (const int parts : {1, 2, 3, 8})
    for (const int rows : {0, 1, 20})
    {
      std::vector<char> together(n * n, 0);
      std::fill_n(together.begin(), n * rows, 1);
      const auto part = partition(graph, together, parts);
      CHECK(part == partition(graph, together, parts));
      std::vector<int> size(static_cast<std::size_t>(parts), 0);
      for (int k = 0; k < n * n; ++k)
      {
        ++size[static_cast<std::size_t>(part[static_cast<std::size_t>(k)])];
        if (together[static_cast<std::size_t>(k)] != 0)
          CHECK(part[static_cast<std::size_t>(k)] == 0);
      }
      const int marked = n * rows, mean = n * n / parts;
      const bool first_has_enough = parts > 1 && marked > mean;
      const double fair = first_has_enough ? (n * n - marked) / (parts - 1.0) : mean;
      for (int p = first_has_enough ? 1 : 0; p < parts; ++p)
        CHECK(size[static_cast<std::size_t>(p)] <= 1.03 * fair + 2.0);
      if (first_has_enough)
        CHECK(size[0] == marked);
    }
  CHECK(partition({.offset = {0, 0}, .neighbour = {}, .work = {1}}, {}, 4) == std::vector{0});
}
