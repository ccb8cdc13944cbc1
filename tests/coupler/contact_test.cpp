// Contact that opens and closes: momentum, complementarity, inelastic landing, free flight.
#include "coupler/contact.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <random>

using namespace undine;
using namespace undine::coupler;

namespace
{

/// n nodes on a line (2-D) or n × n on a square (3-D) of unit size at height y(x), faces upwards or none;
/// mass m per node.
template <int dim>
link::SurfaceMesh sheet(int n, const std::function<double(double)>& y, double m, bool faces)
{
  link::SurfaceMesh s;
  s.dim = dim;
  s.interfaces = {"wet"};
  const int rows = dim == 3 ? n : 1;
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < n; ++i)
    {
      s.node_id.push_back(j * n + i);
      const double x = static_cast<double>(i) / (n - 1);
      s.x.push_back(x);
      s.x.push_back(y(x));
      if (dim == 3)
        s.x.push_back(static_cast<double>(j) / (n - 1));
      for (int a = 0; a < dim; ++a)
        for (int b = 0; b < dim; ++b)
          s.inverse_mass.push_back(a == b ? 1.0 / m : 0.0);
    }
  if (faces)
    for (int j = 0; j + 1 < std::max(2, rows); ++j)
      for (int i = 0; i + 1 < n; ++i)
      {
        if (dim == 2) // the body is below: on the left when walked from right to left
          s.face_nodes.insert(s.face_nodes.end(), {i + 1, i});
        else
          s.face_nodes.insert(s.face_nodes.end(),
                              {j * n + i, (j + 1) * n + i, (j + 1) * n + i + 1, j * n + i + 1});
        s.face_offset.push_back(static_cast<std::int32_t>(s.face_nodes.size()));
        s.face_interface.push_back(0);
      }
  return s;
}

template <int dim>
Vec<3> sum_of(const std::vector<double>& f)
{
  Vec<3> sum{};
  for (std::size_t k = 0; k < f.size(); ++k)
    sum[static_cast<int>(k % dim)] += f[k];
  return sum;
}

/// Σ x × f.
template <int dim>
Vec<3> moment(const std::vector<double>& x, const std::vector<double>& f)
{
  Vec<3> sum{};
  for (std::size_t k = 0; k < f.size(); k += dim)
  {
    Vec<3> p{}, q{};
    for (std::size_t i = 0; i < dim; ++i)
    {
      p[static_cast<int>(i)] = x[k + i];
      q[static_cast<int>(i)] = f[k + i];
    }
    sum += cross(p, q);
  }
  return sum;
}

} // namespace

TEMPLATE_TEST_CASE_SIG(
    "Nodes that would cross the surface end the step on it; impulses and their moments cancel", "",
    ((int dim), dim), 2, 3)
{
  std::mt19937 random(3);
  std::uniform_real_distribution<double> jitter(-1.0, 1.0);
  // Light and heavy solids; the water's nodes do not match the solid's.
  for (const double solid_mass : {1e-3, 1.0, 1e3})
  {
    const auto solid = sheet<dim>(
        7, [](double x) { return 0.1 * std::sin(3.0 * x); }, solid_mass, true);
    auto fluid = sheet<dim>(
        10, [](double x) { return 0.1 * std::sin(3.0 * x) + 0.0012; }, 0.7, false);
    for (std::size_t k = 0; k < fluid.x.size(); ++k)
      fluid.x[k] += 0.0003 * jitter(random) + (k % dim == 1 ? 0.0 : 0.002 * (0.5 - fluid.x[k]));
    UnilateralContact<dim> contact(fluid, solid);
    const double dt = 0.001;
    std::array<std::vector<double>, 2> v, f;
    v[Side::fluid].resize(fluid.x.size());
    v[Side::solid].resize(solid.x.size());
    for (std::size_t k = 0; k < v[Side::fluid].size(); ++k)
      v[Side::fluid][k] = 0.3 * jitter(random) - (k % dim == 1 ? 2.0 : 0.0);
    for (double& w : v[Side::solid])
      w = 0.1 * jitter(random);
    contact.advance(dt, v, f);

    CHECK(contact.report().touching > 3);
    const double largest = *std::max_element(f[Side::fluid].begin(), f[Side::fluid].end());
    CHECK(norm(sum_of<dim>(f[0]) + sum_of<dim>(f[1])) <= 1e-12 * largest * contact.report().touching);
    // The pair of forces acts at one point at the step's end: positions there, gap closed to round-off.
    std::array<std::vector<double>, 2> x_end;
    for (const Side s : both_sides)
    {
      const auto& mesh = s == Side::fluid ? fluid : solid;
      x_end[s] = mesh.x;
      for (std::size_t k = 0; k < x_end[s].size(); ++k)
        x_end[s][k] += dt * (v[s][k] + dt * mesh.inverse_mass[0] * f[s][k]);
    }
    // Normals are those of the trial surface; the surface turns a little more by the impulses: second order
    // in the motion of the step, (2 m/s · 0.001 s)² over a face of 1/6 m.
    const double turned = 5e-5;
    CHECK(norm(moment<dim>(x_end[0], f[0]) + moment<dim>(x_end[1], f[1])) <=
          turned * largest * contact.report().touching);
    auto after = contact.solid();
    for (std::size_t k = 0; k < after.x.size(); ++k)
      CHECK(after.x[k] == Approx(x_end[Side::solid][k]).margin(1e-13));
    FacetSurface<dim> surface(
        [&]
        {
          std::vector<Vec<dim>> points(after.x.size() / dim);
          for (std::size_t k = 0; k < after.x.size(); ++k)
            points[k / dim][static_cast<int>(k % dim)] = after.x[k];
          return points;
        }(),
        after.face_offset, after.face_nodes);
    for (std::size_t n = 0; n < x_end[Side::fluid].size() / dim; ++n)
    {
      Vec<dim> p;
      for (int i = 0; i < dim; ++i)
        p[i] = x_end[Side::fluid][n * dim + static_cast<std::size_t>(i)];
      const auto near = surface.nearest(p, 1.0);
      if (!near.beside)
        CHECK(near.gap > -turned);
    }
  }
}

// With the compliance A of the rows the impulses change the energy by Σ Λ_k w_k − ½ ΛᵀAΛ, w_k the rate at
// which row k opens after them: at most 0 where a node lands (w_k Δt = −gap) or must not go deeper (w_k = 0),
// at most a push otherwise [22a].
TEMPLATE_TEST_CASE_SIG("Contact of random states adds no energy and lets no node go deeper", "",
                       ((int dim), dim), 2, 3)
{
  std::mt19937 random(11);
  std::uniform_real_distribution<double> jitter(-1.0, 1.0);
  const auto surface_of = [](const link::SurfaceMesh& s)
  {
    std::vector<Vec<dim>> points;
    for (std::size_t k = 0; k < s.x.size(); k += dim)
    {
      Vec<dim> p;
      for (int i = 0; i < dim; ++i)
        p[i] = s.x[k + static_cast<std::size_t>(i)];
      points.push_back(p);
    }
    return FacetSurface<dim>(points, s.face_offset, s.face_nodes);
  };
  int inside = 0, touching = 0;
  for (int scene = 0; scene < 60; ++scene)
  {
    const double dt = 0.001, height = 0.1 * jitter(random), mass = std::pow(10.0, 3.0 * jitter(random));
    const auto bent = [height](double x) { return height * std::sin(3.0 * x); };
    const auto solid = sheet<dim>(7, bent, mass, true);
    auto fluid = sheet<dim>(10, bent, 0.7, false);
    for (std::size_t k = 0; k < fluid.x.size(); ++k) // up to 4 mm inside, up to 4 mm away
      fluid.x[k] += k % dim == 1 ? 0.004 * jitter(random) : 0.1 * (0.5 - fluid.x[k]);
    std::array<std::vector<double>, 2> v, f;
    v[Side::fluid].resize(fluid.x.size());
    v[Side::solid].resize(solid.x.size());
    for (const Side s : both_sides)
      for (double& w : v[s])
        w = jitter(random);
    UnilateralContact<dim> contact(fluid, solid);
    const bool pushes = scene % 2 == 0; // nothing made so far; or all of it spent
    contact.balance().work[Side::fluid] = pushes ? 0.0 : 1.0;
    contact.advance(dt, v, f);
    touching += contact.report().touching;
    double made = 0.0, energy = 0.0, impulse = 0.0;
    auto x_end = fluid.x;
    for (const Side s : both_sides)
      for (std::size_t k = 0; k < v[s].size(); ++k)
      {
        const double w = s == Side::fluid ? 1.0 / 0.7 : 1.0 / mass, dv = dt * w * f[s][k];
        made += dt * f[s][k] * (v[s][k] + 0.5 * dv);
        energy += 0.5 * v[s][k] * v[s][k] / w;
        if (s == Side::fluid)
        {
          impulse += dt * std::abs(f[s][k]);
          x_end[k] += dt * (v[s][k] + dv);
        }
      }
    constexpr double facet = 0.2; // at most, with its slope
    CAPTURE(scene, mass, made, energy, pushes);
    CHECK(made < (pushes ? 2e-5 * facet / dt * impulse : 0.0) + 1e-12 * energy);

    // Depths before and after; 5e-5 m: the surface turns by the impulses and nodes slide to other places of
    // it, twice (2 m/s · 0.001 s)² over a face of 1/6 m.
    const auto before = surface_of(solid), after = surface_of(contact.solid());
    for (std::size_t k = 0; k < fluid.x.size(); k += dim)
    {
      Vec<dim> from, to;
      for (int i = 0; i < dim; ++i)
      {
        from[i] = fluid.x[k + static_cast<std::size_t>(i)];
        to[i] = x_end[k + static_cast<std::size_t>(i)];
      }
      const double deep = std::min(0.0, before.nearest(from, 0.1).gap), now = after.nearest(to, 0.1).gap;
      inside += deep < 0.0;
      CAPTURE(k, deep, now);
      CHECK(now > deep - 5e-5);
    }
  }
  CHECK(inside > 100);
  CHECK(touching > 100);
}

// A node 1 mm inside a heavy plate, pressed on it: what brings it out is the work Λ w of the push, and only
// while contact has taken that much before.
TEST_CASE("A node inside comes out by energy that contact took, and no deeper without")
{
  for (const double taken : {0.0, 1e-3, 1.0})
  {
    const auto solid = sheet<2>(
        7, [](double) { return 0.0; }, 1e12, true);
    auto fluid = sheet<2>(
        3, [](double) { return -1e-3; }, 0.7, false);
    UnilateralContact<2> contact(fluid, solid);
    const double dt = 1e-3, g = 10.0, all = 0.7 * g * 1e-3 * 3; // [J] to lift the three nodes by 1 mm
    std::array<std::vector<double>, 2> v{std::vector<double>(6), std::vector<double>(14)}, f;
    contact.balance().work[Side::fluid] = -taken;
    double depth = 1e-3, deepest = 0.0;
    for (int step = 0; step < 2000; ++step)
    {
      const auto before = v[0];
      for (std::size_t k = 1; k < 6; k += 2)
        v[0][k] -= dt * g;
      contact.advance(dt, v, f);
      double work = 0.0;
      for (std::size_t k = 0; k < 6; ++k)
      {
        v[0][k] += dt * f[0][k] / 0.7;
        work += dt * f[0][k] * 0.5 * (before[k] + v[0][k]);
      }
      contact.balance().work[Side::fluid] += work;
      depth -= dt * v[0][1];
      deepest = std::max(deepest, depth);
    }
    const double made = contact.balance().work[Side::fluid], of_a_step = 2e-5 / 6.0 / 1e-3 * all;
    CAPTURE(taken, made, depth, all);
    CHECK(deepest < 1e-3 + 1e-12);
    CHECK(made < 2.0 * of_a_step); // the ledger is looked at once per step
    CHECK(depth == Approx(std::max(0.0, 1e-3 * (1.0 - taken / all))).margin(2e-5));
  }
}

TEST_CASE("A node that leaves is not held, and a solid far from the water is left alone")
{
  const auto solid = sheet<2>(
      5, [](double) { return 0.0; }, 1.0, true);
  const auto fluid = sheet<2>(
      5, [](double) { return 0.0; }, 1.0, false);
  UnilateralContact<2> contact(fluid, solid);
  std::array<std::vector<double>, 2> v{std::vector<double>(10, 0.0), std::vector<double>(10, 0.0)}, f;
  for (std::size_t n = 0; n < 5; ++n)
    v[Side::fluid][2 * n + 1] = 1.0; // upwards, away
  contact.advance(0.01, v, f);
  CHECK(contact.report().touching == 0);
  CHECK(std::all_of(f[0].begin(), f[0].end(), [](double x) { return x == 0.0; }));

  const auto high = sheet<2>(
      5, [](double) { return 10.0; }, 1.0, false);
  UnilateralContact<2> apart(high, solid);
  for (int step = 0; step < 20; ++step)
    apart.advance(0.01, v, f);
  CHECK(apart.report().solves == 0);
}

TEST_CASE(
    "Landing is inelastic: common velocity, momentum kept, the loss is that of a perfectly plastic impact")
{
  // One node of mass m on the middle of one segment with end masses M: effective mass of the segment at its
  // middle 2M (weights ½, ½: 1/(½²/M + ½²/M)).
  const double m = 0.3, M = 0.8, u = -1.7, dt = 1e-3;
  const auto solid = sheet<2>(
      2, [](double) { return 0.0; }, M, true);
  auto fluid = sheet<2>(
      2, [](double) { return 1e-9; }, m, false);
  fluid.x = {0.5, 1e-12, 0.5, 5.0};
  UnilateralContact<2> contact(fluid, solid);
  std::array<std::vector<double>, 2> v{std::vector<double>{0.0, u, 0.0, 0.0}, std::vector<double>(4, 0.0)}, f;
  contact.advance(dt, v, f);
  const double common = m * u / (m + 2.0 * M);
  CHECK(u + dt * f[Side::fluid][1] / m ==
        Approx(common).epsilon(1e-8)); // the gap of 1e-12 over the step is 1e-9 m/s
  CHECK(dt * f[Side::solid][1] / M == Approx(common).epsilon(1e-8));
  CHECK(dt * f[Side::solid][3] / M == Approx(common).epsilon(1e-8));
}

// As above, in both components; a node that leaves is not held back along the surface either.
TEST_CASE("Without slip a node that lands goes with the surface, one that leaves is free")
{
  const double m = 0.3, M = 0.8, dt = 1e-3;
  const auto solid = sheet<2>(
      2, [](double) { return 0.0; }, M, true);
  auto fluid = sheet<2>(
      2, [](double) { return 1e-9; }, m, false);
  fluid.x = {0.5 - 0.4 * dt, 1e-12, 0.25, 1e-12}; // ends the step in the middle
  UnilateralContact<2> contact(fluid, solid, {"wet"});
  std::array<std::vector<double>, 2> v{std::vector<double>{0.4, -1.7, 0.4, 3.0}, std::vector<double>(4, 0.0)},
      f;
  contact.advance(dt, v, f);
  for (std::size_t i = 0; i < 2; ++i)
  {
    const double common = m * v[Side::fluid][i] / (m + 2.0 * M);
    CHECK(v[Side::fluid][i] + dt * f[Side::fluid][i] / m == Approx(common).epsilon(1e-8));
    CHECK(dt * f[Side::solid][i] / M == Approx(common).epsilon(1e-8));
    CHECK(f[Side::fluid][2 + i] == 0.0);
  }
  // in space, onto a sheet that is as good as fixed
  const auto floor = sheet<3>(
      3, [](double) { return 0.0; }, 1e12, true);
  auto drop = sheet<3>(
      2, [](double) { return 1e-12; }, m, false);
  UnilateralContact<3> in_space(drop, floor, {"wet"});
  std::array<std::vector<double>, 2> w{std::vector<double>(12, 0.0), std::vector<double>(27, 0.0)}, g;
  for (std::size_t n = 0; n < 4; ++n)
  {
    drop.x[3 * n] = 0.3 + 0.1 * static_cast<double>(n);
    drop.x[3 * n + 2] = 0.4;
    w[Side::fluid][3 * n] = 0.7;
    w[Side::fluid][3 * n + 1] = -1.0;
    w[Side::fluid][3 * n + 2] = -0.2;
  }
  in_space.replace_fluid(drop);
  in_space.advance(dt, w, g);
  for (std::size_t k = 0; k < 12; ++k)
    CHECK(w[Side::fluid][k] + dt * g[Side::fluid][k] / m == Approx(0.0).margin(1e-8));
}

// 40 faces of water on a slope; one node leaves, and its two faces with it. The rows of its surroundings are
// integrated anew, those of the others stay: the forces are those of a contact that begins at this moment and
// integrates all.
TEST_CASE("Mortar rows are integrated where faces have come or gone, with the same forces")
{
  const auto slope = [](double x) { return -0.3 * x; };
  const double m = 0.5, dt = 1e-3;
  const auto solid = sheet<2>(11, slope, 2e6, true);
  auto fluid = sheet<2>(41, slope, m, true);
  for (std::size_t f = 0; f + 1 < fluid.face_nodes.size(); f += 2)
    std::swap(fluid.face_nodes[f], fluid.face_nodes[f + 1]); // the water is above
  UnilateralContact<2> contact(fluid, solid);
  std::array<std::vector<double>, 2> v{std::vector<double>(82, 0.0), std::vector<double>(22, 0.0)}, f, g;
  for (std::size_t k = 0; k < 41; ++k)
    for (std::size_t i = 0; i < 2; ++i) // into the slope, nothing along it
      v[Side::fluid][2 * k + i] = -1e-3 * (1.0 + 0.1 * static_cast<double>(k % 3)) * (i == 0 ? 0.3 : 1.0);
  auto at = contact.solid();
  for (int step = 0; step < 3; ++step)
  {
    contact.advance(dt, v, f);
    for (std::size_t k = 0; k < fluid.x.size(); ++k)
      fluid.x[k] += dt * (v[Side::fluid][k] + dt * f[Side::fluid][k] / m);
    at = contact.solid();
  }
  CHECK(contact.report().integrated == 40);
  v[Side::fluid][2 * 20 + 1] = 10.0;
  UnilateralContact<2> fresh(fluid, at);
  contact.advance(dt, v, f);
  fresh.advance(dt, v, g);
  CHECK(fresh.report().integrated == 38);
  CHECK(contact.report().integrated <= 40 + 8);
  double largest = 0.0;
  for (const Side s : both_sides)
    for (std::size_t k = 0; k < f[s].size(); ++k)
      largest = std::max(largest, std::abs(g[s][k]));
  for (const Side s : both_sides)
    for (std::size_t k = 0; k < f[s].size(); ++k)
      CHECK(std::abs(f[s][k] - g[s][k]) < 1e-6 * largest); // gaps are closed to 1e-12 of a facet
}

TEST_CASE("Sustained contact does no work and makes no gap: a node slides down a tilted free-falling plate "
          "for 1000 steps")
{
  const auto slope = [](double x) { return -0.5 * x; };
  const auto solid = sheet<2>(4, slope, 1e9, true); // as good as fixed
  auto fluid = sheet<2>(2, slope, 1.0, false);
  fluid.x = {0.05, slope(0.05), 0.9, 50.0};
  UnilateralContact<2> contact(fluid, solid);
  const double dt = 1e-4, g = 9.81, angle = std::atan(0.5);
  std::array<std::vector<double>, 2> v{std::vector<double>(4, 0.0), std::vector<double>(8, 0.0)}, f;
  double x = 0.05, y = slope(x), vx = 0.0, vy = 0.0;
  for (int step = 0; step < 1000; ++step)
  {
    vy -= g * (step == 0 ? 0.5 : 1.0) * dt; // leap-frog from rest
    v[Side::fluid] = {vx, vy, 0.0, 0.0};
    contact.advance(dt, v, f);
    vx += dt * f[Side::fluid][0];
    vy += dt * f[Side::fluid][1];
    x += dt * vx;
    y += dt * vy;
    REQUIRE(std::abs(y - slope(x)) < 1e-12);
  }
  // Uniform acceleration g sin(angle) along the slope; leap-frog is exact for it.
  const double t = 1000 * dt, s = 0.5 * g * std::sin(angle) * t * t;
  CHECK(x - 0.05 == Approx(s * std::cos(angle)).epsilon(1e-9));
}

// A roof with its ridge at x = 0.5, and three nodes of the water on it with their two faces. The node on the
// ridge meets the solid's node there as two masses in a perfectly plastic impact, whichever way it goes; when
// less presses it than would turn it around, here v²/r with v = 0.9 m/s of its neighbours 0.7 m away, it is
// held for one more step.
TEST_CASE("A node on a sharp corner with water on both sides is held there while the water presses it enough")
{
  const auto roof = [](double x) { return -std::abs(x - 0.5); };
  const double m = 0.3, M = 0.8, dt = 1e-3;
  const auto solid = sheet<2>(3, roof, M, true);
  auto fluid = sheet<2>(3, roof, m, true);
  fluid.face_nodes = {0, 1, 1, 2}; // the water above is on their left
  UnilateralContact<2> contact(fluid, solid);
  std::array<std::vector<double>, 2> v{std::vector<double>{0.0, 0.9, 0.4, -0.3, 0.0, 0.9},
                                       std::vector<double>(6, 0.0)},
      f;
  const auto step = [&](double vx, double vy)
  {
    v[Side::fluid][2] = vx;
    v[Side::fluid][3] = vy;
    contact.advance(dt, v, f);
    for (int i = 0; i < 2; ++i)
      v[Side::solid][2 + static_cast<std::size_t>(i)] +=
          dt * f[Side::solid][2 + static_cast<std::size_t>(i)] / M;
  };
  const auto expect_common = [&](double vx, double vy, double Vx, double Vy)
  {
    CHECK(v[Side::solid][2] == Approx((m * vx + M * Vx) / (m + M)));
    CHECK(v[Side::solid][3] == Approx((m * vy + M * Vy) / (m + M)));
    CHECK(vx + dt * f[Side::fluid][2] / m == Approx(v[Side::solid][2]));
    CHECK(vy + dt * f[Side::fluid][3] / m == Approx(v[Side::solid][3]));
  };
  step(0.4, -0.3);
  expect_common(0.4, -0.3, 0.0, 0.0);
  double Vx = v[Side::solid][2], Vy = v[Side::solid][3];
  // Pressed with (v - v_common)/dt: 1.4 m/s² would turn it, here it is 1 m/s².
  step(-0.2, Vy - 0.001 * (m + M) / M);
  expect_common(-0.2, Vy - 0.001 * (m + M) / M, Vx, Vy);
  step(-0.2, 1.0);
  CHECK(f[Side::fluid][2] == 0.0);
  CHECK(f[Side::fluid][3] == 0.0);
}

TEST_CASE("The impulses solve the complementarity problem of many rows on a light solid")
{
  const auto solid = sheet<2>(
      11, [](double) { return 0.0; }, 0.01, true);
  const auto fluid = sheet<2>(
      26, [](double) { return 0.0; }, 1.0, false);
  UnilateralContact<2> contact(fluid, solid);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  std::array<std::vector<double>, 2> v{std::vector<double>(52), std::vector<double>(22)}, f;
  for (const Side s : both_sides)
    for (double& w : v[s])
      w = any(random);
  for (std::size_t k = 0; k < v[0].size(); k += 2)
    v[0][k] = 0.0;
  for (std::size_t k = 0; k < v[1].size(); k += 2)
    v[1][k] = 0.0;
  const double dt = 1e-9; // the surface stays flat and the normals vertical
  contact.advance(dt, v, f);
  for (std::size_t n = 0; n < 26; ++n)
  {
    // Position of the node in the segments of length 0.1.
    const double x = static_cast<double>(n) / 25.0, s = std::min(x * 10.0, 10.0 - 1e-12);
    const auto a = static_cast<std::size_t>(s);
    const double w = s - static_cast<double>(a);
    const auto v_solid = [&](std::size_t c) { return v[1][2 * c + 1] + dt * f[1][2 * c + 1] / 0.01; };
    const double relative = v[0][2 * n + 1] + dt * f[0][2 * n + 1] - (1.0 - w) * v_solid(a) -
                            w * v_solid(std::min<std::size_t>(a + 1, 10));
    const double impulse = dt * f[0][2 * n + 1];
    CHECK(impulse >= 0.0);
    CHECK(relative >= -1e-4);          // the residual gap of 1e-12 reach over dt = 1e-9 s
    CHECK(impulse * relative <= 1e-4); // complementary
  }
}

// Without slip the rows close the velocities that move the positions, so that nothing is left to add up, but
// that the foot of a node is looked for at its trial position, Δt² a away from where it ends: the surface
// there moves by Δt³ a V' otherwise, V' the rate of its stretching, together T Δt² a V'. The surface goes 1.2
// m to and fro and stretches by a tenth meanwhile.
TEMPLATE_TEST_CASE_SIG("A pressed node keeps its material point over 1e4 steps of shear", "",
                       ((int dim), dim), 2, 3)
{
  constexpr int steps = 10000;
  constexpr double dt = 1e-3, mass = 0.7, shear = 2.0, weight = 10.0, pi = 3.14159265358979323846;
  const auto flat = [](double) { return 0.0; };
  const auto solid = sheet<dim>(7, flat, 1e12, true);
  auto fluid = sheet<dim>(dim == 2 ? 10 : 4, flat, mass, false);
  for (double& x : fluid.x)
    x = 0.8 * x + 0.1;
  for (std::size_t k = 1; k < fluid.x.size(); k += dim)
    fluid.x[k] = 0.0;
  UnilateralContact<dim> contact(fluid, solid, {"wet"});
  const auto stretch = [](double t) { return 0.1 * std::sin(2.0 * pi * t / 5.0); };
  const auto material = [&](double X, std::size_t i, double t) // of component i
  { return i == 1 ? X : X * (1.0 + stretch(t)) + (i == 0 ? 0.3 * std::sin(2.0 * pi * t / 10.0) : 0.0); };
  std::array<std::vector<double>, 2> v, f;
  std::vector<double> x = fluid.x, u(x.size());
  for (std::size_t k = 0; k < u.size(); ++k) // with the surface
    u[k] = (material(fluid.x[k], k % dim, dt) - fluid.x[k]) / dt;
  v[Side::solid].resize(solid.x.size());
  double slip = 0.0, deep = 0.0;
  for (int n = 0; n < steps; ++n)
  {
    const double t = n * dt;
    for (std::size_t k = 0; k < solid.x.size(); ++k)
      v[Side::solid][k] = (material(solid.x[k], k % dim, t + dt) - material(solid.x[k], k % dim, t)) / dt;
    v[Side::fluid] = u;
    for (std::size_t k = 0; k < u.size(); k += dim)
    {
      v[Side::fluid][k] += dt * shear;
      v[Side::fluid][k + 1] -= dt * weight;
    }
    contact.advance(dt, v, f);
    for (std::size_t k = 0; k < u.size(); ++k)
    {
      u[k] = v[Side::fluid][k] + dt / mass * f[Side::fluid][k];
      x[k] += dt * u[k];
      double& worst = k % dim == 1 ? deep : slip;
      worst = std::max(worst, std::abs(x[k] - material(fluid.x[k], k % dim, t + dt)));
    }
  }
  const double rate = 0.1 * 2.0 * pi / 5.0, bound = steps * dt * dt * dt * shear * rate;
  CAPTURE(slip, deep, bound);
  CHECK(slip < bound);
  CHECK(deep < 1e-12);
}
