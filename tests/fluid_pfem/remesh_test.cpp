// Delaunay, alpha shape, connectivity, and the remesh of a moving fluid.
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/remesh/alpha_shape.hpp"
#include "fluid_pfem/remesh/beside_solid.hpp"
#include "fluid_pfem/remesh/delaunay.hpp"
#include "fluid_pfem/remesh/local_delaunay.hpp"
#include "fluid_pfem/remesh/refine_coarsen.hpp"
#include "fluid_pfem/simplex.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <iterator>
#include <numeric>
#include <random>

using namespace undine;
using namespace undine::fluid;
using undine::test::box_config;

namespace
{

/// The simplices as sets of points, in the numbering of `id`.
template <int dim>
std::vector<Simplex<dim>> as_sets(std::vector<Simplex<dim>> simplices, const std::vector<index_t>& id)
{
  for (auto& s : simplices)
  {
    for (auto& n : s)
      n = id[static_cast<std::size_t>(n)];
    std::sort(s.begin(), s.end());
  }
  std::sort(simplices.begin(), simplices.end());
  return simplices;
}

template <int dim>
std::vector<Vec<dim>> points(bool lattice, std::mt19937& random)
{
  std::vector<Vec<dim>> x;
  const int n = dim == 2 ? 20 : 7;
  std::uniform_real_distribution<double> u(0.0, n - 1.0);
  const int total = dim == 2 ? n * n : n * n * n;
  for (int k = 0; k < total; ++k)
  {
    Vec<dim> p;
    int rest = k;
    for (int i = 0; i < dim; ++i, rest /= n)
      p[i] = lattice ? rest % n : u(random);
    x.push_back(p);
  }
  return x;
}

} // namespace

TEMPLATE_TEST_CASE_SIG(
    "the triangulation does not depend on the order of the points, cospherical lattices included",
    "[fluid][unit]", ((int dim), dim), 2, 3)
{
  std::mt19937 random(11);
  for (const bool lattice : {true, false})
  {
    const auto x = points<dim>(lattice, random);
    std::vector<index_t> identity(x.size());
    std::iota(identity.begin(), identity.end(), 0);
    const auto reference = as_sets<dim>(delaunay(x), identity);
    for (int shuffle = 0; shuffle < 8; ++shuffle)
    {
      auto order = identity;
      std::shuffle(order.begin(), order.end(), random);
      std::vector<Vec<dim>> y;
      for (const index_t n : order)
        y.push_back(x[static_cast<std::size_t>(n)]);
      CHECK(as_sets<dim>(delaunay(y), order) == reference);
    }
  }
}

// The Delaunay simplices of a convex set fill its hull: volumes add up to within one rounding each.
TEMPLATE_TEST_CASE_SIG("Delaunay simplices are positive and fill the hull", "[fluid][unit]", ((int dim), dim),
                       2, 3)
{
  std::mt19937 random(2);
  const auto x = points<dim>(true, random);
  const double side = dim == 2 ? 19.0 : 6.0;
  double volume = 0.0;
  for (const auto& s : delaunay(x))
  {
    std::array<Vec<dim>, dim + 1> corner;
    for (std::size_t a = 0; a < corner.size(); ++a)
      corner[a] = x[static_cast<std::size_t>(s[a])];
    const double V = signed_volume<dim, double>(corner);
    CHECK(V > 0.0);
    volume += V;
  }
  CHECK(volume == Approx(std::pow(side, dim)).epsilon(1e-12));
}

// The repaired triangulation is the one CGAL makes of the same points: all triangles that the far square
// cannot touch, as sets of nodes. A vortex shears the points by up to 0.1 h between two triangulations, some
// of them stand on a straight wall, three are random drops; lattice rows keep cocircular points throughout.
TEST_CASE("flips give the triangulation that CGAL gives, in 2000 states of moving points", "[fluid][unit]")
{
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  std::int64_t repairs = 0, rebuilds = 0, flips = 0, states = 0;
  for (const bool lattice : {true, false})
    for (const double speed : {0.02, 0.1})
    {
      constexpr int n = 16;
      std::vector<Vec<2>> x;
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i)
        {
          const double s = lattice || i == 0 || j == 0 ? 0.0 : 0.2;
          x.push_back({{i + s * u(random), j + s * u(random)}});
        }
      for (int k = 0; k < 3; ++k)
        x.push_back({{8.0 + 12.0 * u(random), 30.0 + 5.0 * u(random)}});
      MovingDelaunay<2> moving;
      const int steps = 500;
      for (int step = 0; step < steps; ++step, ++states)
      {
        moving.update(x);
        const auto small = [&](const std::vector<Simplex<2>>& all)
        {
          std::vector<Simplex<2>> kept;
          for (auto s : all)
          {
            std::sort(s.begin(), s.end());
            std::array<Vec<2>, 3> corner;
            for (std::size_t a = 0; a < 3; ++a)
              corner[a] = x[static_cast<std::size_t>(s[a])];
            if (circumradius<2>(corner) < 30.0)
              kept.push_back(s);
          }
          std::sort(kept.begin(), kept.end());
          return kept;
        };
        REQUIRE((small(moving.simplices()) == small(delaunay(x))));
        // still for a while, so that cocircular points are met again; nodes of the left column stay on the
        // wall
        if (step % 4 == 3)
          continue;
        for (auto& p : x)
        {
          const Vec<2> r{{(p[0] - 7.5) / 7.5, (p[1] - 7.5) / 7.5}};
          const double decay = std::exp(-norm_squared(r));
          if (p[0] != 0.0)
            p[0] -= speed * decay * r[1] * 4.0;
          p[1] += speed * (decay * r[0] * 4.0 - (p[1] > 20.0 ? 0.3 : 0.0));
        }
      }
      repairs += moving.count().repairs;
      rebuilds += moving.count().rebuilds;
      flips += moving.count().flips;
    }
  CAPTURE(states, repairs, rebuilds, flips);
  CHECK(states == 2000);
  CHECK(rebuilds < states / 10);
  CHECK(flips > 2000);
}

// Single points jump through their neighbours: triangles turn over, and flips mend them or give up.
TEST_CASE("flips mend triangles that were turned over, or all is made anew", "[fluid][unit]")
{
  std::mt19937 random(7);
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  constexpr int n = 20;
  std::vector<Vec<2>> x;
  for (int k = 0; k < n * n; ++k)
    x.push_back({{k % n + 0.3 * u(random), k / n + 0.3 * u(random)}});
  MovingDelaunay<2> moving;
  std::int64_t wrong = 0;
  for (int state = 0; state < 1500; ++state)
  {
    moving.update(x);
    std::vector<Simplex<2>> ours = moving.simplices(), theirs = delaunay(x);
    for (auto* all : {&ours, &theirs})
    {
      std::erase_if(*all,
                    [&x](const Simplex<2>& e)
                    {
                      std::array<Vec<2>, 3> corner;
                      for (std::size_t a = 0; a < 3; ++a)
                        corner[a] = x[static_cast<std::size_t>(e[a])];
                      return circumradius<2>(corner) > 30.0;
                    });
      for (auto& e : *all)
        std::sort(e.begin(), e.end());
      std::sort(all->begin(), all->end());
    }
    wrong += ours != theirs;
    for (int jump = 0; jump < 3; ++jump)
    {
      auto& p = x[static_cast<std::size_t>(random() % x.size())];
      p += Vec<2>{{1.2 * u(random), 1.2 * u(random)}};
      for (int i = 0; i < 2; ++i)
        p[i] = std::clamp(p[i], 0.1 * u(random), n - 1.0 + 0.1 * u(random));
    }
  }
  CAPTURE(moving.count().repairs, moving.count().rebuilds, moving.count().flips);
  CHECK(wrong == 0);
  CHECK(moving.count().repairs > 300);
}

namespace
{

/// Simplices with circumradii up to `largest` whose lowest corner is marked, or all, in canonical form,
/// sorted.
template <int dim>
std::vector<Simplex<dim>> small_ones(const std::vector<Vec<dim>>& x, std::vector<Simplex<dim>> all,
                                     double largest, const std::vector<char>& mine = {})
{
  for (auto& e : all)
    e = canonical<dim>(e);
  std::erase_if(all,
                [&](Simplex<dim> e)
                {
                  if (!mine.empty() && !mine[static_cast<std::size_t>(e[0])])
                    return true;
                  std::sort(e.begin(), e.end());
                  std::array<Vec<dim>, dim + 1> corner;
                  for (std::size_t a = 0; a <= dim; ++a)
                    corner[a] = x[static_cast<std::size_t>(e[a])];
                  return !(circumradius<dim>(corner) <= largest);
                });
  std::sort(all.begin(), all.end());
  return all;
}

/// Points on a lattice of spacing 1 (square or cubic: cocircular everywhere), or pushed off it.
template <int dim>
std::vector<Vec<dim>> points_of_lattice(int n, double push, std::mt19937& random)
{
  std::uniform_real_distribution<double> u(-push, push);
  std::vector<Vec<dim>> x;
  for (int k = 0; k < (dim == 3 ? n : 1); ++k)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i)
      {
        Vec<dim> p;
        p[0] = i + u(random);
        p[1] = j + u(random);
        if constexpr (dim == 3)
          p[2] = k + u(random);
        x.push_back(p);
      }
  return x;
}

/// In space, whatever is around a part: a lattice, on and off its places, with a free surface in waves, a
/// cavity, a drop that has left it, and a film above it.
std::vector<Vec<3>> points_of_splash(int n, double push, std::mt19937& random)
{
  std::vector<Vec<3>> x;
  for (const Vec<3>& p : points_of_lattice<3>(n, push, random))
  {
    const double middle = 0.5 * n, surface = 0.7 * n + 1.5 * std::sin(0.9 * p[0]) * std::cos(0.7 * p[1]);
    const Vec<3> hole{{middle, middle, 0.3 * n}}, flown{{0.3 * n, 0.4 * n, n - 2.0}};
    const bool cavity = norm(p - hole) < 2.6;
    const bool drop = norm(p - flown) < 1.6;
    const bool film = p[2] > n - 0.5 - push;
    if ((p[2] < surface && !cavity) || drop || film)
      x.push_back(p);
  }
  return x;
}

/// Of three ranges of numbers: simplices that a triangulation of each with its halo lacks or has too many.
template <int dim>
std::size_t wrong_simplices(const std::vector<Vec<dim>>& x, double largest, double halo)
{
  std::vector<Simplex<dim>> found;
  for (std::size_t part = 0; part < 3; ++part)
  {
    std::vector<char> mine(x.size(), 0);
    std::fill(mine.begin() + static_cast<std::ptrdiff_t>(part * x.size() / 3),
              mine.begin() + static_cast<std::ptrdiff_t>((part + 1) * x.size() / 3), 1);
    std::vector<index_t> number;
    std::vector<Vec<dim>> near;
    for (std::size_t n = 0; n < x.size(); ++n)
    {
      bool in_halo = false;
      for (std::size_t m = 0; m < x.size() && !in_halo; ++m)
        in_halo = mine[m] && norm(x[n] - x[m]) <= halo * (1.0 + 1e-9);
      if (!in_halo)
        continue;
      number.push_back(static_cast<index_t>(n));
      near.push_back(x[n]);
    }
    auto simplices = delaunay(near);
    for (auto& e : simplices)
      for (index_t& n : e)
        n = number[static_cast<std::size_t>(n)];
    const auto small = small_ones<dim>(x, simplices, largest, mine);
    found.insert(found.end(), small.begin(), small.end());
  }
  std::sort(found.begin(), found.end());
  const auto truth = small_ones<dim>(x, delaunay(x), largest);
  std::vector<Simplex<dim>> wrong;
  std::set_symmetric_difference(found.begin(), found.end(), truth.begin(), truth.end(),
                                std::back_inserter(wrong));
  return wrong.size();
}

template <int dim>
void check_halo(int n)
{
  std::mt19937 random(6);
  std::size_t wrong_if_half = 0;
  for (const double push : {0.0, 0.1, 0.3})
  {
    const auto x = points_of_lattice<dim>(n, push, random);
    for (const double alpha : {1.0, 1.3})
    {
      CHECK(wrong_simplices<dim>(x, alpha, 2.0 * alpha) == 0);
      wrong_if_half += wrong_simplices<dim>(x, alpha, alpha);
    }
  }
  CAPTURE(wrong_if_half);
  CHECK(wrong_if_half > 10);
}

} // namespace

// A simplex of circumradius R lies with its ball within 2R of each corner: what is further away cannot change
// it (method: every kept simplex that touches a node is decided within 2 alpha h of it).
TEST_CASE("points within two largest circumradii decide which simplices are kept; within one they do not",
          "[fluid][unit]")
{
  check_halo<2>(18);
  check_halo<3>(7);
}

// Most simplices are small, so that a part needs little of what is around it. What it sees further it must
// find: beside a cavity and a free surface balls are large, on a flat face of a lattice they are half spaces
// with many points on their planes.
TEST_CASE("in space the points that a part of them asks for decide its simplices as all do", "[fluid][unit]")
{
  std::mt19937 random(7);
  constexpr int n = 14;
  for (const double largest : {1.5, 3.0, 6.0})
    for (const double push : {0.0, 1e-9, 0.05, 0.3, -1.0})
    {
      auto x = points_of_splash(n, std::max(push, 0.0), random);
      for (auto& p : x)
        if (push < 0.0) // on its places, but all planes inclined, hence off them by rounding
          p = {{0.8 * p[0] - 0.6 * p[1], 0.48 * p[0] + 0.64 * p[1] - 0.6 * p[2],
                0.36 * p[0] + 0.48 * p[1] + 0.8 * p[2]}};
      const auto truth = small_ones<3>(x, delaunay(x), largest);
      std::vector<Simplex<3>> found;
      for (int part = 0; part < 4; ++part)
      {
        std::vector<char> mine;
        for (const auto& p : x)
          mine.push_back((p[0] > 0.5 * n) + 2 * (p[1] > 0.4 * n) == part);
        LocalDelaunay<3> local;
        local.update(x, mine, 2.0 * largest);
        const auto small = small_ones<3>(x, local.simplices(mine), largest, mine);
        found.insert(found.end(), small.begin(), small.end());
      }
      std::sort(found.begin(), found.end());
      CAPTURE(largest, push, x.size(), truth.size(), found.size());
      CHECK((found == truth));
    }
}

// The parts are Lagrangian: they mix a little as the vortex shears them, points are merged and split on both
// sides of a cut, and the numbers are given anew.
TEST_CASE("parts that are triangulated alone have the simplices of the whole while points move, come and go",
          "[fluid][unit]")
{
  std::mt19937 random(5);
  constexpr double largest = 1.5;
  constexpr std::size_t parts = 3;
  std::vector<Vec<2>> x = points_of_lattice<2>(36, 0.0, random);
  std::vector<std::size_t> part_of;
  for (std::size_t n = 0; n < x.size(); ++n)
    part_of.push_back(n * parts / x.size());
  std::array<LocalDelaunay<2>, parts> local;
  std::size_t taken = 0;
  for (int step = 0; step < 150; ++step)
  {
    std::vector<Simplex<2>> found;
    for (std::size_t part = 0; part < parts; ++part)
    {
      std::vector<char> mine;
      for (const std::size_t p : part_of)
        mine.push_back(p == part);
      local[part].update(x, mine, 2.0 * largest);
      const auto small = small_ones<2>(x, local[part].simplices(mine), largest);
      found.insert(found.end(), small.begin(), small.end());
      taken += local[part].size();
    }
    std::sort(found.begin(), found.end());
    REQUIRE((found == small_ones<2>(x, delaunay(x), largest)));
    for (auto& p : x)
    {
      const Vec<2> r{{(p[0] - 17.5) / 17.5, (p[1] - 17.5) / 17.5}};
      const double speed = 0.4 * std::exp(-norm_squared(r));
      p[0] -= speed * r[1];
      p[1] += speed * r[0];
    }
    const auto e = found[random() % found.size()];
    const auto i = static_cast<std::size_t>(e[0]), j = static_cast<std::size_t>(e[1]);
    std::vector<index_t> number(x.size());
    if (step % 2 == 0)
    {
      for (auto& part : local)
        part.split(e[0], e[1], static_cast<index_t>(x.size()));
      x.push_back(0.5 * (x[i] + x[j]));
      part_of.push_back(part_of[i]);
      number.resize(x.size());
      std::iota(number.begin(), number.end(), 0);
      std::shuffle(number.begin(), number.end(), random);
      std::vector<Vec<2>> x_before = x;
      std::vector<std::size_t> part_before = part_of;
      for (std::size_t n = 0; n < x.size(); ++n)
      {
        x[static_cast<std::size_t>(number[n])] = x_before[n];
        part_of[static_cast<std::size_t>(number[n])] = part_before[n];
      }
    }
    else
    {
      for (auto& part : local)
        part.merge(e[0], e[1]);
      x[i] = 0.5 * (x[i] + x[j]);
      for (std::size_t n = 0; n < x.size(); ++n)
        number[n] = n == j ? -1 : static_cast<index_t>(n - (n > j));
      x.erase(x.begin() + e[1]);
      part_of.erase(part_of.begin() + e[1]);
    }
    for (auto& part : local)
      part.renumber(number);
  }
  std::int64_t repairs = 0, rebuilds = 0;
  for (const auto& part : local)
  {
    repairs += part.count().repairs;
    rebuilds += part.count().rebuilds;
  }
  CAPTURE(repairs, rebuilds, taken);
  CHECK(repairs > 2 * rebuilds);
  CHECK(taken < 2UL * 150 * 36 * 36);
}

// A cut has moved, and what lies beyond it is seen less far: the points that are no longer seen go.
TEST_CASE("a part that sees fewer points than it has taken is repaired, not made anew", "[fluid][unit]")
{
  std::mt19937 random(6);
  constexpr double largest = 1.5, reach = 2.0 * largest, seen = LocalDelaunay<2>::spare * reach;
  std::vector<Vec<2>> x = points_of_lattice<2>(36, 0.1, random);
  LocalDelaunay<2> local;
  std::size_t taken = x.size();
  for (const double cut : {18.0, 16.0, 14.0})
  {
    std::vector<char> mine;
    std::vector<index_t> among;
    for (std::size_t n = 0; n < x.size(); ++n)
    {
      x[n][1] *= 1.02;
      mine.push_back(x[n][0] < cut);
      if (x[n][0] < cut + seen)
        among.push_back(static_cast<index_t>(n));
    }
    local.update(x, mine, reach, &among);
    CHECK(local.size() < taken);
    taken = local.size();
    CHECK((small_ones<2>(x, local.simplices(mine), largest) == small_ones<2>(x, delaunay(x), largest, mine)));
  }
  CHECK(local.count().rebuilds == 1);
  CHECK(local.count().repairs == 2);
}

// Merging, splitting and removing points ends in the same triangulation as well.
TEST_CASE("points may come and go between two triangulations", "[fluid][unit]")
{
  std::mt19937 random(4);
  std::uniform_real_distribution<double> u(0.0, 12.0);
  std::vector<Vec<2>> x;
  for (int k = 0; k < 150; ++k)
    x.push_back({{u(random), u(random)}});
  MovingDelaunay<2> moving;
  moving.update(x);
  for (int change = 0; change < 200; ++change)
  {
    const auto s = moving.simplices()[random() % moving.simplices().size()];
    const auto i = static_cast<std::size_t>(s[0]), j = static_cast<std::size_t>(s[1]);
    if (change % 3 == 0)
    {
      moving.split(s[0], s[1], static_cast<index_t>(x.size()));
      x.push_back(0.5 * (x[i] + x[j]));
    }
    else
    {
      if (change % 3 == 1)
      {
        moving.merge(s[0], s[1]);
        x[i] = 0.5 * (x[i] + x[j]);
      }
      else
        moving.remove(s[1]);
      std::vector<index_t> number(x.size());
      for (std::size_t n = 0; n < x.size(); ++n)
        number[n] = static_cast<index_t>(n) - (n > j);
      number[j] = -1;
      moving.renumber(number);
      x.erase(x.begin() + s[1]);
    }
    moving.update(x);
    std::vector<index_t> identity(x.size());
    std::iota(identity.begin(), identity.end(), 0);
    const auto small = [&](const std::vector<Simplex<2>>& all)
    { return as_sets<2>(alpha_shape<2>(x, std::vector<double>(x.size(), 1.0), 20.0, all), identity); };
    REQUIRE((small(moving.simplices()) == small(delaunay(x))));
  }
  CAPTURE(moving.count().rebuilds, moving.count().flips);
  CHECK(moving.count().rebuilds < 20);
}

// Two unit squares of points five apart: plain Delaunay bridges the gap, the alpha shape does not. R of a
// bridging triangle exceeds half the gap, 2 h > 1.3 h.
TEST_CASE("the alpha shape of two drops is two drops", "[fluid][unit]")
{
  std::vector<Vec<2>> x;
  for (int drop = 0; drop < 2; ++drop)
    for (int i = 0; i <= 4; ++i)
      for (int j = 0; j <= 4; ++j)
        x.push_back({{i + 8.0 * drop, double(j)}});
  const std::vector<double> h(x.size(), 1.0);
  const auto mesh = connect<2>(static_cast<index_t>(x.size()), alpha_shape<2>(x, h, 1.3, delaunay(x)));
  CHECK(mesh.n_elements() == 2 * 4 * 4 * 2);
  CHECK(mesh.boundary.size() == 2 * 16);
  // the boundary is closed and outward: ∮ n = 0 and ∮ x·n = 2 · area
  Vec<2> closed{};
  double twice_area = 0.0;
  for (const auto& f : mesh.boundary)
  {
    const Vec<2> n = right_normal(x[f[1]] - x[f[0]]);
    closed += n;
    twice_area += dot(n, 0.5 * (x[f[0]] + x[f[1]]));
  }
  CHECK(norm(closed) == 0.0);
  CHECK(twice_area == 2.0 * 32.0);
}

// A remesh at a synchronised time changes connectivity only: p, ρ, v and x of every node keep their bits, and
// mass follows the new nodal volumes, whose sum is the unchanged area of the body.
TEMPLATE_TEST_CASE_SIG("a remesh keeps the pressure field, velocities and the volume", "[fluid][unit]",
                       ((int dim), dim), 2, 3)
{
  FluidConfig config = box_config<dim>(dim == 2 ? 0.1 : 0.2);
  config.seeding.jitter = 0.3;
  config.remesh.spacing = {.merge = 0.0, .split = 1e9, .split_wall = 1e9}; // connectivity only
  config.gravity = {0.0, -9.81, 0.0};
  config.initial_pressure = InitialPressure::hydrostatic;
  for (const char* wall : {"left", "right", "bottom"})
    config.walls.push_back({wall, WallKind::slip});
  if (dim == 3)
    for (const char* wall : {"back", "front"})
      config.walls.push_back({wall, WallKind::slip});
  Fluid<dim> fluid(config);
  std::vector<Vec<dim>> v;
  for (const auto& x : fluid.nodes().x)
  {
    Vec<dim> w{};
    w[0] = 0.3 * std::sin(3.0 * x[0]) * std::cos(2.0 * x[1]);
    w[1] = -0.2 * x[1];
    v.push_back(w);
  }
  fluid.set_velocity(v);
  const double dt = fluid.critical_time_step();
  for (int step = 0; step < 200; ++step)
  {
    fluid.predict(dt);
    fluid.solve_free_motion(dt);
  }
  const auto by_id = [](const FluidNodes<dim>& n)
  {
    std::vector<std::tuple<global_index_t, double, double, double, double>> rows;
    for (std::size_t i = 0; i < n.x.size(); ++i)
      rows.emplace_back(n.id[i], n.p[i], n.rho[i], n.v[i][0], n.x[i][dim - 1]);
    std::sort(rows.begin(), rows.end());
    return rows;
  };
  const auto volume = [](const FluidNodes<dim>& n) { return std::accumulate(n.V.begin(), n.V.end(), 0.0); };
  const auto before = by_id(fluid.nodes());
  const double V = volume(fluid.nodes()), mass = fluid.mass();
  fluid.remesh();
  CHECK((by_id(fluid.nodes()) == before));
  CAPTURE(volume(fluid.nodes()) / V - 1.0, fluid.mass() / mass - 1.0);
  // the outline of a nearly still box hardly moves in 200 steps: what the alpha shape adds or drops there is
  // below 1e-4
  CHECK(std::abs(volume(fluid.nodes()) / V - 1.0) < 1e-4);
  CHECK(std::abs(fluid.mass() / mass - 1.0) < 1e-4);
}

// What merging, splitting and new connectivity move of momentum and angular momentum they give back: sums are
// those of before up to round-off of n nodes, and no kinetic energy is made. Where nodes of an edge of the
// box merge, the box loses volume: the mass M that m = rho V lacks then is spread at the velocities of the
// nodes, and has that of any other node at most. The velocity turns, shears and is rough; no step is taken,
// so it is also that of the half step.
TEMPLATE_TEST_CASE_SIG("merging and splitting keep mass, momentum and angular momentum", "[fluid][unit]",
                       ((int dim), dim), 2, 3)
{
  FluidConfig config = box_config<dim>(dim == 2 ? 0.05 : 0.2);
  config.seeding.jitter = 0.4;
  config.remesh.every = 1;
  config.remesh.only_if_moved = false;
  config.remesh.spacing = {.merge = 0.6, .split = 1.4, .split_wall = 1.4};
  Fluid<dim> fluid(config);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  std::vector<Vec<dim>> v;
  for (const auto& x : fluid.nodes().x)
  {
    Vec<dim> w{};
    w[0] = 3.0 - 5.0 * x[1] + u(random);
    w[1] = 5.0 * x[0] + std::sin(7.0 * x[1]) + u(random);
    w[dim - 1] += 2.0 * x[0];
    v.push_back(w);
  }
  fluid.set_velocity(v);
  fluid.predict(1e-30);
  fluid.solve_free_motion(1e-30);
  const auto sums = [&]
  {
    MassesInMotion<dim> all;
    for (std::size_t n = 0; n < fluid.nodes().x.size(); ++n)
      all.add(fluid.nodes().M[n], fluid.nodes().x[n], fluid.nodes().v[n]);
    return all;
  };
  const MassesInMotion<dim> before = sums();
  const std::vector<Vec<dim>> x = fluid.nodes().x;
  fluid.remesh();
  const MassesInMotion<dim> after = sums();
  CAPTURE(fluid.ledger().merged, fluid.ledger().split);
  CHECK(fluid.ledger().merged > 5);
  CHECK(fluid.ledger().split > 5);
  CHECK(after.mass == Approx(before.mass).epsilon(1e-13));
  double fastest = 0.0, farthest = 0.0;
  for (std::size_t n = 0; n < v.size(); ++n)
  {
    fastest = std::max(fastest, norm(v[n]));
    farthest = std::max(farthest, norm(x[n]));
  }
  const auto mass = fluid.mass_by_state();
  const double spread = 2.0 * fastest * std::abs(mass.meshed - mass.dynamic);
  CAPTURE(spread);
  CHECK(norm(after.momentum - before.momentum) < spread + 1e-12 * norm(before.momentum));
  CHECK(norm(after.angular - before.angular) < farthest * spread + 1e-12 * norm(before.angular));
  CHECK(after.kinetic < (1.0 + 1e-12) * before.kinetic);
}

namespace
{

/// A solid that covers [0, 1]².
SolidSurface<2> unit_square()
{
  link::SurfaceMesh square;
  square.dim = 2;
  square.node_id = {0, 1, 2, 3};
  square.x = {0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0};
  square.face_nodes = {0, 1, 1, 2, 2, 3, 3, 0}; // the body on the left of its faces
  square.face_offset = {0, 2, 4, 6, 8};
  SolidSurface<2> solid;
  solid.show(square, 0.0);
  return solid;
}

} // namespace

TEST_CASE("A sharp corner that a facet of the water cuts off gets the facet's nearer node")
{
  const SolidSurface<2> solid = unit_square();
  const std::vector<Facet<2>> facet{
      {0, 1}};        // from the bottom to the left side, the water below and left of it
  double speed = 0.9; // of 1 m/s, at which rho v^2 = p
  const auto ends = [&](const Vec<2>& on_bottom, const Vec<2>& on_left)
  {
    FluidNodes<2> nodes;
    nodes.x = {on_bottom, on_left};
    nodes.v.assign(2, {{0.0, speed}});
    nodes.rho.assign(2, 1000.0);
    nodes.p.assign(2, 1000.0);
    nodes.h.assign(2, 0.1);
    cling_to_corners<2>(solid, facet, 0.45, nodes);
    return nodes.x;
  };
  CHECK(ends({{0.1, 0.0}}, {{0.0, 0.03}})[1] == Vec<2>{{0.0, 0.0}});
  CHECK(ends({{0.04, 0.0}}, {{0.0, 0.09}})[0] == Vec<2>{{0.0, 0.0}});
  CHECK(ends({{0.1, 0.0}}, {{-0.03, -0.001}})[1] == Vec<2>{{-0.03, -0.001}}); // passes before the corner
  CHECK(ends({{0.1, 0.0}}, {{0.0, 0.0005}})[1] == Vec<2>{{0.0, 0.0005}});     // hardly in it
  CHECK(ends({{0.06, 0.0}}, {{0.0, 0.06}})[0] == Vec<2>{{0.06, 0.0}});        // both too far
  speed = 1.1;                                                                // too fast for the turn
  CHECK(ends({{0.1, 0.0}}, {{0.0, 0.03}})[1] == Vec<2>{{0.0, 0.03}});
}

TEST_CASE("A triangle that does not meet the surface is blocked where its centroid is inside the solid")
{
  const SolidSurface<2> solid = unit_square();
  const auto distance = [](const Vec<2>& x) // signed, negative inside
  {
    const double dx = std::abs(x[0] - 0.5) - 0.5, dy = std::abs(x[1] - 0.5) - 0.5;
    return dx > 0.0 && dy > 0.0 ? std::hypot(dx, dy) : std::max(dx, dy);
  };
  constexpr double h = 0.2, covered = 0.2 * h; // the centre of the square is less than 4 h deep
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-0.8, 1.8), side(-h, h);
  std::array<int, 2> met{};
  for (int trial = 0; trial < 20000; ++trial)
  {
    const Vec<2> at{{place(random), place(random)}};
    std::array<Vec<2>, 3> corner;
    Vec<2> centroid{};
    for (Vec<2>& x : corner)
    {
      x = at + Vec<2>{{side(random), side(random)}};
      centroid += (1.0 / 3.0) * x;
    }
    double nearest =
        1.0; // the distance changes by no more than the way: points 1/20 of an edge apart bound it
    for (std::size_t a = 0; a < 3; ++a)
      for (int k = 0; k < 20; ++k)
        nearest =
            std::min(nearest, std::abs(distance(corner[a] + (0.05 * k) * (corner[(a + 1) % 3] - corner[a]))));
    if (nearest < 0.05 * 3.0 * h || std::abs(distance(centroid) + covered) < 1e-9)
      continue;
    const bool inside = distance(centroid) < -covered;
    ++met[inside];
    REQUIRE(solid.blocks(corner, h) == inside);
  }
  CHECK(met[0] > 1000);
  CHECK(met[1] > 1000);
}

TEST_CASE("A long edge past a corner of the solid gets no node where it would lie deep inside")
{
  const SolidSurface<2> solid = unit_square();
  CHECK(solid.depth({{0.03, 0.5}}, 0.1) == Approx(0.03));
  CHECK(solid.depth({{0.3, 0.5}}, 0.1) == 0.0); // deeper than it looks
  CHECK(solid.depth({{-0.03, 0.5}}, 0.1) == 0.0);
  // A triangle around the corner at (0, 0), spacing 0.05: its long edge has its middle inside by s/2.
  const auto split = [&](double s)
  {
    FluidNodes<2> nodes;
    nodes.for_each_field([](const char*, auto& field) { field.resize(3); });
    nodes.x = {{{s, 0.0}}, {{0.0, s}}, {{0.0, 0.0}}};
    nodes.h.assign(3, 0.05);
    nodes.M = nodes.m = {1.0, 1.0, 1.0};
    nodes.id = {0, 1, 2};
    std::vector<std::array<int, 3>> walls(3, {-1, -1, -1});
    global_index_t next_id = 3;
    return refine_and_coarsen<2>(nodes, connect<2>(3, {{0, 1, 2}}), walls, 0, SpacingRules{}, next_id,
                                 [&](const Vec<2>& x, double h) { return solid.depth(x, h) > 0.3 * h; })
        .split;
  };
  CHECK(split(0.07) == 0);  // middle 0.7 of the spacing inside
  CHECK(split(-0.07) == 1); // outside
}
