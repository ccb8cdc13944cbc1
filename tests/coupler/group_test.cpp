// Several solids as one side of the interface, and the stop of a run whose interface makes energy.
#include "common/error.hpp"
#include "coupler/coupler_output.hpp"
#include "coupler/group.hpp"

#include <catch2/catch.hpp>
#include <unistd.h>

#include <filesystem>

using namespace undine;

namespace
{

link::SurfaceMesh line(double x0, std::int64_t first_id, const std::string& interface)
{
  link::SurfaceMesh s;
  s.epoch = 3;
  s.interfaces = {interface};
  s.node_id = {first_id, first_id + 1, first_id + 2};
  s.x = {x0, 0.0, x0 + 1.0, 0.0, x0 + 2.0, 0.0};
  s.inverse_mass.assign(12, x0);
  s.face_offset = {0, 2, 4};
  s.face_nodes = {0, 1, 1, 2};
  s.face_interface = {0, 0};
  s.coupled_nodes = {0, 2};
  s.coupled_inverse_mass.assign(4, x0);
  return s;
}

} // namespace

// Exact: integers and copies.
TEST_CASE("joined surfaces keep nodes, faces, interfaces and coupled nodes apart", "[coupler][unit]")
{
  const std::vector<link::SurfaceMesh> two{line(0.0, 5, "left"), line(10.0, 0, "right")};
  const link::SurfaceMesh all = coupler::join(two);
  CHECK(all.n_nodes() == 6);
  CHECK(all.n_faces() == 4);
  CHECK(all.epoch == 6);
  CHECK(all.node_id == std::vector<std::int64_t>{5, 6, 7, 8, 9, 10});
  CHECK(all.face_nodes == std::vector<std::int32_t>{0, 1, 1, 2, 3, 4, 4, 5});
  CHECK(all.face_offset == std::vector<std::int32_t>{0, 2, 4, 6, 8});
  CHECK(all.interfaces == std::vector<std::string>{"left", "right"});
  CHECK(all.face_interface == std::vector<std::int32_t>{0, 0, 1, 1});
  CHECK(all.coupled_nodes == std::vector<std::int32_t>{0, 2, 3, 5});
  CHECK(all.x[6] == 10.0);
  CHECK(all.inverse_mass.size() == 24);
  CHECK(all.coupled_inverse_mass == std::vector<double>{0, 0, 0, 0, 10, 10, 10, 10});
  const std::vector<link::SurfaceMesh> one{two[0]};
  CHECK(coupler::join(one).node_id == two[0].node_id);
}

TEST_CASE("several reports are one: sums, the smallest step, any change", "[coupler][unit]")
{
  const std::vector<link::Report> two{
      {.stable_dt = 2.0, .kinetic_energy = 1.0, .internal_energy = 4.0, .mass = 3.0, .compute_seconds = 1.0},
      {.stable_dt = 1.0,
       .kinetic_energy = 5.0,
       .internal_energy = 0.5,
       .mass = 4.0,
       .compute_seconds = 2.0,
       .surface_changed = true}};
  const link::Report all = coupler::join(two);
  CHECK(all.stable_dt == 1.0);
  CHECK(all.kinetic_energy == 6.0);
  CHECK(all.internal_energy == 4.5);
  CHECK(all.mass == 7.0);
  CHECK(all.compute_seconds == 2.0);
  CHECK(all.surface_changed);
}

// The link of a participant with wrong masses would make energy: the limit is a fraction of the largest
// energy in motion so far, here 5 % of 100 J. What the interface loses is no reason to stop.
TEST_CASE("a run whose interface makes energy beyond coupling.energy_limit stops and says so",
          "[coupler][unit]")
{
  const auto folder =
      std::filesystem::temp_directory_path() / ("undine_energy_limit_" + std::to_string(getpid()));
  std::filesystem::create_directories(folder / "history");
  coupler::CouplerConfig config;
  config.run.t_end = 10.0;
  config.coupling.interfaces = {{"wet", "bottom", "top", "slip", false, "finer"}};
  config.coupling.energy_limit = 0.05;
  coupler::CouplerOutput output(OutputConfig{.dir = folder.string()}, config);
  const link::SurfaceMesh surface = line(0.0, 0, "wet");
  const std::vector<double> force(6, 0.0);
  link::Report fluid{.stable_dt = 1.0, .kinetic_energy = 100.0}, solid{.stable_dt = 1.0};
  coupler::WindowPlanner::Plan plan;
  coupler::InterfaceBalance balance;
  const auto observe = [&](double made)
  {
    plan.t_begin = plan.t_end;
    plan.t_end += 0.1;
    ++plan.index;
    plan.steps.coarse_dt = 0.1;
    balance.work = {7.0, made - 7.0};
    output.observe({plan, fluid, solid, balance, {}, surface, force, 0, 0, 0, 0.0});
  };
  balance.work = {0.0, 0.0};
  output.observe({plan, fluid, solid, balance, {}, surface, force, 0, 0, 0, 0.0}); // the start
  observe(-30.0);
  observe(4.9);
  CHECK_THROWS_AS(observe(5.1), NumericalError);
  try
  {
    observe(6.0);
  }
  catch (const NumericalError& error)
  {
    CHECK(std::string(error.what()).find("the interface has made 6 J") != std::string::npos);
    CHECK(std::string(error.what()).find("coupling.energy_limit = 0.05") != std::string::npos);
  }
  std::filesystem::remove_all(folder);
}
