// Periodic directions: the triangulated torus, conservation, channel flow and vortices.
#include "fluid_pfem/mass_conservation.hpp"
#include "fluid_pfem/remesh/delaunay.hpp"
#include "fluid_pfem/run.hpp"
#include "fluid_pfem/simplex.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <random>

using namespace undine;
using namespace undine::fluid;
using undine::test::hydraulic;

namespace
{

template <int dim>
double volume_of(const std::vector<Vec<dim>>& x, const std::vector<Simplex<dim>>& simplices,
                 const Period<dim>& period)
{
  double V = 0.0;
  for (const auto& e : simplices)
    V += signed_volume<dim, double>(corners<dim>(x, e, period));
  return V;
}

/// Relative L2 error of the velocity after a run.
template <class Exact>
double velocity_error(const FluidConfig& config, double t, Exact&& exact)
{
  Fluid<2> fluid(config);
  const double mass = fluid.mass();
  run_alone<2>(fluid, {.t_end = t}, 0.0, [](double, const Fluid<2>&, bool) {});
  CHECK(fluid.remeshes() > 0);
  CHECK(fluid.mass() == Approx(mass).epsilon(1e-12));
  CHECK(fluid.mass_by_state().volume == Approx(config.size[0] * config.size[1]).epsilon(1e-12));
  const auto& nodes = fluid.nodes();
  double error = 0.0, scale = 0.0;
  for (std::size_t i = 0; i < nodes.x.size(); ++i)
  {
    const Vec<2> v = exact(nodes.x[i]);
    error += nodes.V[i] * norm_squared(nodes.v[i] - v);
    scale += nodes.V[i] * norm_squared(v);
  }
  return std::sqrt(error / scale);
}

} // namespace

// Truth: Euler's formula on the torus, two triangles per point, and the area of the cell. The lattice of
// spacing 0.1 is full of cocircular points: both ends of the cell must break their ties alike.
TEST_CASE("the triangulation of a periodic cell covers it once", "[fluid][unit]")
{
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const Period<2> both({{-0.3, 0.1}}, {{1.7, 2.1}});
  std::vector<Vec<2>> scattered, lattice;
  for (int k = 0; k < 500; ++k)
    scattered.push_back({{-0.3 + 1.7 * uniform(random), 0.1 + 2.1 * uniform(random)}});
  for (int i = 0; i < 17; ++i)
    for (int j = 0; j < 21; ++j)
      lattice.push_back({{-0.3 + 0.1 * i, 0.1 + 0.1 * j}});
  for (const auto& x : {scattered, lattice})
  {
    const auto simplices = periodic_delaunay<2>(x, both);
    CHECK(simplices.size() == 2 * x.size());
    CHECK(volume_of<2>(x, simplices, both) == Approx(1.7 * 2.1).epsilon(1e-12));
    CHECK(connect<2>(static_cast<index_t>(x.size()), simplices).boundary.empty());
  }
  const Period<3> space({{0.0, 0.0, 0.0}}, {{1.0, 1.1, 1.3}});
  std::vector<Vec<3>> points;
  for (int k = 0; k < 1500; ++k)
    points.push_back({{uniform(random), 1.1 * uniform(random), 1.3 * uniform(random)}});
  const auto simplices = periodic_delaunay<3>(points, space);
  CHECK(volume_of<3>(points, simplices, space) == Approx(1.43).epsilon(1e-12));
  CHECK(connect<3>(1500, simplices).boundary.empty());
}

// Truth: the triangulation of all points. A rank knows nothing of points further from its own, images
// included, than twice the largest circumradius; within one it does not know enough. The lattice has ties
// everywhere.
TEST_CASE("parts of a periodic cell have the simplices of the whole", "[fluid][unit]")
{
  std::mt19937_64 random(8);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const Period<2> cell({{0.0, -1.0}}, {{4.0, 3.0}});
  constexpr double h = 0.1, largest = 1.3 * h;
  std::vector<Vec<2>> scattered, lattice;
  for (int i = 0; i < 40; ++i)
    for (int j = 0; j < 30; ++j)
    {
      lattice.push_back({{h * i, h * j - 1.0}});
      scattered.push_back({{h * (i + 0.6 * uniform(random)), h * (j + 0.6 * uniform(random)) - 1.0}});
    }
  const auto small = [&](const std::vector<Vec<2>>& x, std::vector<Simplex<2>> simplices)
  {
    std::erase_if(simplices,
                  [&](Simplex<2> e)
                  {
                    std::sort(e.begin(), e.end());
                    return circumradius<2>(corners<2>(x, e, cell)) > largest;
                  });
    return sorted_elements<2>(std::move(simplices));
  };
  for (const auto& x : {scattered, lattice})
    for (const double reach : {2.0 * largest, largest})
    {
      std::vector<Simplex<2>> found;
      for (int part = 0; part < 3; ++part)
      {
        std::vector<char> mine;
        for (std::size_t n = 0; n < x.size(); ++n)
          mine.push_back(3 * n / x.size() == static_cast<std::size_t>(part));
        std::vector<index_t> near; // exactly those within reach
        for (std::size_t n = 0; n < x.size(); ++n)
        {
          bool is_near = false;
          for (std::size_t m = 0; m < x.size() && !is_near; ++m)
            is_near = mine[m] && norm(cell.near(x[m], x[n]) - x[m]) <= reach * (1.0 + 1e-9);
          if (is_near)
            near.push_back(static_cast<index_t>(n));
        }
        CHECK(near.size() < x.size());
        const auto of_part = small(
            x, periodic_delaunay<2>(x, cell, {.mine = mine, .reach = reach, .among = &near, .extent = 4.0}));
        found.insert(found.end(), of_part.begin(), of_part.end());
      }
      const bool same = sorted_elements<2>(std::move(found)) == small(x, periodic_delaunay<2>(x, cell));
      CHECK(same == (reach > largest));
    }
}

// Truth: the sum of V_e/3 over the elements of a node, whatever it is in: closed fans, open ones, several,
// none. A quarter of the triangles are taken away, the points are moved so far that some turn over, and two
// ranges of nodes meet within a group of eight. Round-off: some twenty products of lengths of a ring,
// three spacings, with coordinates ten times as large where the next cell begins, 2⁻⁵³ each.
TEST_CASE("rings give the volumes that elements give", "[fluid][unit]")
{
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  FluidNodes<2> nodes;
  nodes.period = Period<2>({{-0.3, 0.1}}, {{1.7, 2.1}});
  for (int k = 0; k < 501; ++k)
    nodes.x.push_back({{-0.3 + 1.7 * uniform(random), 0.1 + 2.1 * uniform(random)}});
  auto triangles = periodic_delaunay<2>(nodes.x, nodes.period);
  std::erase_if(triangles, [&](const auto&) { return uniform(random) < 0.25; });
  std::erase_if(triangles, [](const auto& e) { return std::count(e.begin(), e.end(), 17) > 0; });
  const FluidMesh<2> mesh = connect<2>(nodes.size(), triangles);
  for (auto& x : nodes.x)
    for (int i = 0; i < 2; ++i)
      x[i] += 0.03 * (uniform(random) - 0.5);
  nodes.V.resize(nodes.x.size());
  FluidNodes<2> other = nodes;
  update_nodal_volumes<2>(mesh, nodes);
  update_nodal_volumes(mesh, 0, 101, other);
  update_nodal_volumes(mesh, 101, 501, other);
  const double regular = 1.7 * 2.1 / 501, longest = 9.0 * regular; // squared: rings are some 3 spacings wide
  int turned = 0, alone = 0, inner = 0;
  for (index_t n = 0; n < nodes.size(); ++n)
  {
    const auto i = static_cast<std::size_t>(n);
    const auto fan = mesh.fan(n);
    turned += nodes.V[i] < 0.0;
    alone += fan.empty();
    inner += !fan.empty() && fan.back().opposite[1] == fan.front().opposite[0];
    CAPTURE(n, fan.size());
    CHECK(other.V[i] == Approx(nodes.V[i]).epsilon(0.0).margin(20.0 * 0x1p-53 * 10.0 * longest));
  }
  CHECK(alone > 0);
  CHECK(inner > 50);
  CHECK(inner < 300);
  for (const Simplex<2>& e : mesh.elements)
    turned += signed_volume<2, double>(corners<2>(nodes.x, e, nodes.period)) < 0.0;
  CHECK(turned > 0);
}

// Truth: a uniform stream stays one; nothing tells where the cell ends. Nodes cross its ends in both
// directions, and are triangulated again.
TEMPLATE_TEST_CASE_SIG("a uniform stream passes the ends of a periodic cell", "[fluid][unit]",
                       ((int dim), dim), 2, 3)
{
  FluidConfig config = undine::test::box_config<dim>(1.0 / 13.0);
  config.period = config.size;
  config.seeding.jitter = 0.05; // no edge is split or merged
  config.terms.bulk_linear = 0.05;
  config.terms.residual = 0.1;
  config.feedback_time = 100.0;
  config.remesh.only_if_moved = false;
  const double c = config.tait.sound_speed(1000.0);
  const Vec<dim> stream = leading<dim>({900.0, -500.0, 300.0});
  for (const double v : stream.c)
    config.initial_velocity.emplace_back(std::to_string(v), "test");
  Fluid<dim> fluid(config);
  const double mass = fluid.mass();
  run_alone<dim>(fluid, {.t_end = 2.0 / c}, 0.0, [](double, const Fluid<dim>&, bool) {});
  CHECK(fluid.remeshes() > 0);
  CHECK(fluid.mesh().boundary.empty());
  CHECK(fluid.mass() == Approx(mass).epsilon(1e-12));
  CHECK(fluid.mass_by_state().volume == Approx(1.0).epsilon(1e-12));
  double uneven = 0.0; // round-off of the pressure, a few 1e-16 K, by step and spacing: 1e-9 m/s
  for (const auto& v : fluid.nodes().v)
    uneven = std::max(uneven, norm(v - stream));
  CHECK(uneven < 1e-7);
}

// Truth: the start of plane Poiseuille flow under a constant force, as a series; the flow has gone several
// cells far at the end of the run, sheared and triangulated again all the time. Linear triangles: order 2.
TEST_CASE("channel flow starts as in theory, with order 2", "[fluid][verification]")
{
  const double pi = std::acos(-1.0), nu = 0.05, f = 0.4, t = 1.0;
  const auto error = [&](int n)
  {
    FluidConfig config = hydraulic(1.0 / n, 10.0);
    config.terms.mu = 1000.0 * nu;
    config.period = {1.0, 0.0, 0.0};
    config.walls = {{"bottom", WallKind::no_slip}, {"top", WallKind::no_slip}};
    for (const char* b : {"0.4", "0"})
      config.body_force.emplace_back(b, "test");
    return velocity_error(config, t,
                          [&](const Vec<2>& x)
                          {
                            double u = 0.5 * f / nu * x[1] * (1.0 - x[1]);
                            for (int k = 1; k < 40; k += 2)
                              u -= 4.0 * f / (nu * std::pow(k * pi, 3)) * std::sin(k * pi * x[1]) *
                                   std::exp(-k * k * pi * pi * nu * t);
                            return Vec<2>{{u, 0.0}};
                          });
  };
  const double coarse = error(13), fine = error(26);
  CAPTURE(coarse, fine);
  CHECK(std::log2(coarse / fine) > 1.8);
  CHECK(fine < 0.01);
}

// Truth: Taylor's vortices, with u = U sin 2πx cos 2πy − …, decay as exp(−8π²νt), and a stream that carries
// them along changes nothing (u/c = 2e-3, so that compressibility is no part of the error).
TEST_CASE("vortices in a periodic cell decay at the rate of theory, with order 2", "[fluid][verification]")
{
  const double pi = std::acos(-1.0), nu = 0.05, t = 0.2;
  const auto error = [&](int n, double stream)
  {
    FluidConfig config = hydraulic(1.0 / n, 10.0);
    config.terms.mu = 1000.0 * nu;
    config.period = config.size;
    config.remesh.only_if_moved = false;
    const std::string u = std::to_string(stream);
    config.initial_velocity.emplace_back(u + "+0.02*sin(2*_pi*x)*cos(2*_pi*y)", "test");
    config.initial_velocity.emplace_back("-0.02*cos(2*_pi*x)*sin(2*_pi*y)", "test");
    const double U = 0.02 * std::exp(-8.0 * pi * pi * nu * t);
    double e = velocity_error(
        config, t,
        [&](const Vec<2>& x)
        {
          const double X = 2.0 * pi * (x[0] - stream * t), Y = 2.0 * pi * x[1];
          return Vec<2>{{stream + U * std::sin(X) * std::cos(Y), -U * std::cos(X) * std::sin(Y)}};
        });
    // over the velocity of the vortices, whose mean square is U²/2
    return stream == 0.0 ? e : e * std::sqrt(stream * stream + 0.5 * U * U) / (std::sqrt(0.5) * U);
  };
  const double coarse = error(16, 0.0), middle = error(32, 0.0), fine = error(64, 0.0),
               carried = error(32, 3.0);
  CAPTURE(coarse, middle, fine, carried);
  CHECK(std::log2(coarse / middle) > 1.8);
  CHECK(std::log2(middle / fine) > 1.8);
  CHECK(fine < 2e-3);
  CHECK(carried == Approx(middle).epsilon(0.1));
}
