// The coupler's other ranks help with the mortar integrals: the bits of one rank. Run by mpirun.
#include "coupler/helpers.hpp"
#include "coupler/mortar.hpp"

#include <catch2/catch.hpp>
#include <mpi.h>

#include <cmath>
#include <cstring>

using namespace undine;
using namespace undine::coupler;

namespace
{

/// A wavy sheet of n × n quadrilaterals over the unit square, facing up or down.
InterfaceFaces<3> sheet(int n, bool up)
{
  InterfaceFaces<3> side;
  const double h = 1.0 / n;
  for (int j = 0; j <= n; ++j)
    for (int i = 0; i <= n; ++i)
      side.x.push_back({{i * h, j * h, 0.01 * std::sin(5.0 * i * h) * std::cos(4.0 * j * h)}});
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i)
    {
      const int a = j * (n + 1) + i, b = a + 1, c = b + n + 1, d = a + n + 1;
      side.faces.push_back(up ? std::vector<int>{a, b, c, d} : std::vector<int>{a, d, c, b});
    }
  return side;
}

/// A wavy line of n edges from (0, 0) to (1, 0), facing up or down.
InterfaceFaces<2> line(int n, bool up)
{
  InterfaceFaces<2> side;
  for (int i = 0; i <= n; ++i)
    side.x.push_back({{double(i) / n, 0.01 * std::sin(5.0 * i / n)}});
  for (int i = 0; i < n; ++i)
    side.faces.push_back(up ? std::vector<int>{i + 1, i} : std::vector<int>{i, i + 1});
  return side;
}

template <int dim>
bool same(const Mortar<dim>& a, const Mortar<dim>& b)
{
  const auto equal = [](const auto& x, const auto& y)
  { return x.size() == y.size() && std::memcmp(x.data(), y.data(), x.size() * sizeof(x[0])) == 0; };
  return a.multiplier_node == b.multiplier_node && equal(a.normal, b.normal) && equal(a.D, b.D) &&
         a.C == b.C && a.covered == b.covered && a.largest_gap == b.largest_gap;
}

} // namespace

// Truth: rank 0 alone. 6400 faces over 5184 that do not match them, 6000 edges over 5500.
TEST_CASE("mortar integrals of several ranks have the bits of one", "[coupler][ranks]")
{
  const link::Team team(MPI_COMM_WORLD, 60.0);
  if (team.rank() > 0)
  {
    help(team);
    SUCCEED("dismissed");
    return;
  }
  const auto fine = sheet(80, true), coarse = sheet(72, false), few = sheet(12, false);
  REQUIRE(coarse.faces.size() >= faces_worth_sharing);
  REQUIRE(few.faces.size() < faces_worth_sharing);
  const auto alone = integrate_mortar<3>(fine, coarse, 0.02);
  CHECK(alone.covered[0] == Approx(1.0).epsilon(1e-3)); // curved sheets that differ by h²
  CHECK(same(integrate_mortar<3>(fine, coarse, 0.02, &team), alone));
  CHECK(same(integrate_mortar<3>(coarse, fine, 0.02, &team), integrate_mortar<3>(coarse, fine, 0.02)));
  CHECK(same(integrate_mortar<3>(few, fine, 0.02, &team), integrate_mortar<3>(few, fine, 0.02)));
  CHECK(same(integrate_mortar<3>(fine, coarse, 1e-9, &team), integrate_mortar<3>(fine, coarse, 1e-9)));
  const auto upper = line(6000, false), lower = line(5500, true);
  REQUIRE(lower.faces.size() >= faces_worth_sharing);
  CHECK(same(integrate_mortar<2>(upper, lower, 0.01, &team), integrate_mortar<2>(upper, lower, 0.01)));
  dismiss_helpers(team);
}
