// Conjugate gradients for the multipliers: the answer of the factor, the bits of one rank. Run by mpirun.
#include "common/error.hpp"
#include "coupler/helpers.hpp"
#include "coupler/interface_operator.hpp"
#include "coupler/mortar.hpp"

#include <catch2/catch.hpp>
#include <mpi.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

using namespace undine;
using namespace undine::coupler;

namespace
{

/// A wavy line or sheet of n cells per direction over the unit interval or square; `up` turns the faces.
template <int dim>
InterfaceFaces<dim> wavy(int n, bool up, double height, double waves)
{
  InterfaceFaces<dim> side;
  const double h = 1.0 / n;
  for (int j = 0; j <= (dim == 3 ? n : 0); ++j)
    for (int i = 0; i <= n; ++i)
    {
      const double z = height * std::sin(waves * i * h) * std::cos(0.7 * waves * j * h);
      if constexpr (dim == 2)
        side.x.push_back({{i * h, z}});
      else
        side.x.push_back({{i * h, j * h, z}});
    }
  for (int j = 0; j < (dim == 3 ? n : 1); ++j)
    for (int i = 0; i < n; ++i)
    {
      const int a = j * (n + 1) + i, b = a + 1, c = b + n + 1, d = a + n + 1;
      if constexpr (dim == 2)
        side.faces.push_back(up ? std::vector<int>{b, a} : std::vector<int>{a, b});
      else
        side.faces.push_back(up ? std::vector<int>{a, b, c, d} : std::vector<int>{a, d, c, b});
    }
  return side;
}

/// Two wavy surfaces that do not match, every node with a mass of its own, full blocks, some nodes held, and
/// pairs of neighbours that move each other.
template <int dim>
std::array<InterfaceSide, 2> random_sides(int fine, int coarse, InterfaceKind kind, std::mt19937& random)
{
  std::uniform_real_distribution<double> any(0.0, 1.0);
  const double height = 0.02 * any(random), waves = 3.0 + 4.0 * any(random);
  const std::array<InterfaceFaces<dim>, 2> faces{wavy<dim>(fine, true, height, waves),
                                                 wavy<dim>(coarse, false, height, waves)};
  ConstraintRows rows;
  append_constraints<dim>(integrate_mortar<dim>(faces[0], faces[1], 0.5 / coarse), Side::fluid, kind, rows);
  std::array<InterfaceSide, 2> side;
  for (const Side s : both_sides)
  {
    const auto nodes = static_cast<int>(faces[s].x.size());
    side[s].L = SparseMatrix(rows.count, dim * nodes);
    side[s].L.setFromTriplets(rows.entries[s].begin(), rows.entries[s].end());
    std::vector<Eigen::Triplet<double>> entries;
    for (int n = 0; n < nodes; ++n)
    {
      if (any(random) < 0.05)
        continue;
      const double w = std::pow(fine, dim) * (0.5 + any(random));
      for (int i = 0; i < dim; ++i)
        for (int j = 0; j < dim; ++j)
          entries.emplace_back(dim * n + i, dim * n + j, i == j ? w : 0.2 * w);
      if (n % 7 == 1) // with the node before, by less than either alone
        for (int i = 0; i < dim; ++i)
        {
          entries.emplace_back(dim * n + i, dim * n + i, w);
          entries.emplace_back(dim * (n - 1) + i, dim * (n - 1) + i, w);
          entries.emplace_back(dim * n + i, dim * (n - 1) + i, 0.5 * w);
          entries.emplace_back(dim * (n - 1) + i, dim * n + i, 0.5 * w);
        }
    }
    side[s].inverse_mass = SparseMatrix(dim * nodes, dim * nodes);
    side[s].inverse_mass.setFromTriplets(entries.begin(), entries.end());
  }
  return side;
}

Vector random_vector(Eigen::Index n, std::mt19937& random)
{
  std::normal_distribution<double> any;
  Vector v(n);
  for (double& value : v)
    value = any(random);
  return v;
}

/// Largest eigenvalue of what `apply` is, similar to a symmetric matrix.
double largest_eigenvalue(Eigen::Index n, const auto& apply)
{
  std::mt19937 random(3);
  Vector x = random_vector(n, random);
  double largest = 0.0;
  for (int k = 0; k < 100; ++k)
  {
    x = apply(Vector(x / x.norm()));
    largest = x.norm();
  }
  return largest;
}

bool same_bits(const Vector& a, const Vector& b)
{
  return a.size() == b.size() &&
         std::memcmp(a.data(), b.data(), static_cast<std::size_t>(a.size()) * sizeof(double)) == 0;
}

template <int dim>
void compare(int fine, int coarse, InterfaceKind kind, const link::Team& team, std::mt19937& random)
{
  const auto side = random_sides<dim>(fine, coarse, kind, random);
  InterfaceOperator factor(side[0], side[1]), alone(side[0], side[1], Solver::gradients),
      shared(side[0], side[1], Solver::gradients, &team);
  const Eigen::Index n = factor.n_multipliers();
  for (const double ratio : {1.0, 0.05, 20.0})
  {
    const double alpha = 1e-4;
    const Vector rhs = factor.product(Side::solid, random_vector(n, random)); // zero in rows that are held
    const Vector truth = factor.solve(alpha, ratio * alpha, rhs);
    const Vector found = alone.solve(alpha, ratio * alpha, rhs);
    const SparseMatrix H = factor.assemble(alpha, ratio * alpha);
    const Vector D = H.diagonal();
    const double condition =
        largest_eigenvalue(n, [&](const Vector& x) { return Vector((H * x).cwiseQuotient(D)); }) *
        largest_eigenvalue(n, [&](const Vector& x)
                           { return factor.solve(alpha, ratio * alpha, x.cwiseProduct(D)); });
    // |e|_H <= sqrt(condition) tolerance |lambda|_H (coupler/gradients.hpp), and the round-off of either way.
    const double bound = std::sqrt(condition) * Gradients::tolerance +
                         100.0 * condition * std::numeric_limits<double>::epsilon();
    const Vector e = found - truth;
    CAPTURE(dim, n, ratio, condition);
    CHECK(std::sqrt(e.dot(H * e)) <= bound * std::sqrt(truth.dot(H * truth)));
    CHECK(same_bits(shared.solve(alpha, ratio * alpha, rhs), found));
    // From a neighbour, from the answer itself, and from far away.
    const Vector near = truth + 1e-3 * random_vector(n, random).cwiseProduct(truth);
    const auto steps = [&](const Vector& start)
    {
      const auto before = alone.iterations();
      const Vector again = alone.solve(alpha, ratio * alpha, rhs, start);
      CHECK(same_bits(shared.solve(alpha, ratio * alpha, rhs, start), again));
      const Vector rest = again - truth;
      CHECK(std::sqrt(rest.dot(H * rest)) <= bound * std::sqrt(truth.dot(H * truth)));
      return alone.iterations() - before;
    };
    const auto from_zero = steps({});
    CHECK(steps(near) < from_zero);
    CHECK(steps(1e9 * truth) == from_zero);
    CHECK(steps(found) <= 2);
  }
}

} // namespace

// Truth: the factor, and the gradients of rank 0 alone. 729 to 901 rows are three and four blocks of sums.
TEST_CASE("conjugate gradients have the factor's answer, and the bits of one rank", "[coupler][ranks]")
{
  const link::Team team(MPI_COMM_WORLD, 60.0);
  if (team.rank() > 0)
  {
    help(team);
    SUCCEED("dismissed");
    return;
  }
  std::mt19937 random(12);
  compare<3>(26, 20, InterfaceKind::slip, team, random);
  compare<3>(16, 19, InterfaceKind::no_slip, team, random); // multipliers on the coarser side
  compare<2>(900, 650, InterfaceKind::slip, team, random);
  compare<2>(400, 450, InterfaceKind::no_slip, team, random);
  compare<3>(4, 3, InterfaceKind::slip, team, random); // ranks without a row
  dismiss_helpers(team);
}

// Truth: a multiplier that is there twice has no unique value, and one without a movable mass is zero.
TEST_CASE("gradients say so where H has no inverse", "[coupler][ranks]")
{
  const link::Team team(MPI_COMM_WORLD, 60.0);
  if (team.rank() > 0)
  {
    help(team);
    SUCCEED("dismissed");
    return;
  }
  // Rows 0 and 1 say the same, row 2 moves nothing.
  InterfaceSide side{.L = SparseMatrix(3, 2), .inverse_mass = SparseMatrix(2, 2)};
  side.L.insert(0, 0) = 1.0;
  side.L.insert(1, 0) = 1.0;
  side.L.insert(2, 1) = 1.0;
  side.inverse_mass.insert(0, 0) = 2.0;
  side.L.makeCompressed();
  side.inverse_mass.makeCompressed();
  InterfaceOperator H(side, side, Solver::gradients, &team);
  CHECK_THROWS_AS(H.solve(1.0, 1.0, Vector{{1.0, -1.0, 0.0}}), NumericalError);
  const Vector half = H.solve(1.0, 1.0, Vector{{4.0, 4.0, 5.0}}); // consistent: half each
  CHECK((half - Vector{{0.5, 0.5, 0.0}}).norm() < 1e-15);
  CHECK(H.solve(1.0, 1.0, Vector::Zero(3), Vector::Ones(3)) == Vector::Zero(3));
  CHECK(std::isnan(H.solve(1.0, 1.0, Vector::Constant(3, std::nan("")))[0]));
  dismiss_helpers(team);
}
