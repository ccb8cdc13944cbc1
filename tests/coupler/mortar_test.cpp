// Mortar projection: what must be exact on flat interfaces, and what stays exact on curved ones.
#include "common/error.hpp"
#include "coupler/mortar.hpp"

#include <Eigen/IterativeLinearSolvers>
#include <catch2/catch.hpp>
#include <fmt/format.h>

#include <cmath>
#include <ctime>
#include <functional>
#include <random>

using namespace undine;
using namespace undine::coupler;

namespace
{

/// Uneven positions 0 = s₀ < … < s_n = 1.
std::vector<double> uneven(int n, unsigned seed)
{
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> u(-0.3, 0.3);
  std::vector<double> s;
  for (int i = 0; i <= n; ++i)
    s.push_back((i + (i > 0 && i < n ? u(random) : 0.0)) / n);
  return s;
}

/// A curve (2-D) of n segments, or a surface (3-D) of n × n quads or 2 n × n triangles over the unit square,
/// y = shape(x, z). `up`: the body lies below (normal +y), otherwise above.
template <int dim>
InterfaceFaces<dim> sheet(int n, bool up, unsigned seed, const std::function<double(double, double)>& shape,
                          bool triangles)
{
  InterfaceFaces<dim> side;
  const auto s = uneven(n, seed);
  if constexpr (dim == 2)
  {
    for (const double x : s)
      side.x.push_back({{x, shape(x, 0.0)}});
    for (int i = 0; i < n; ++i) // body to the left of a → b
      side.faces.push_back(up ? std::vector<int>{i + 1, i} : std::vector<int>{i, i + 1});
  }
  else
  {
    const auto t = uneven(n, seed + 1);
    for (const double z : t)
      for (const double x : s)
        side.x.push_back({{x, shape(x, z), z}});
    const auto add = [&](std::vector<int> face)
    {
      if (!up)
        std::reverse(face.begin(), face.end());
      side.faces.push_back(face);
    };
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i)
      {
        const int a = j * (n + 1) + i, b = a + 1, c = b + n + 1, d = a + n + 1; // a d c b turns to +y
        if (triangles)
        {
          add({a, d, c});
          add({a, c, b});
        }
        else
          add({a, d, c, b});
      }
  }
  return side;
}

const auto flat = [](double, double) { return 0.0; };
const auto wave = [](double x, double z) { return 0.1 * std::sin(4.0 * x) + 0.05 * z * z; };

/// Consistent nodal areas ∫N of a side.
template <int dim>
std::vector<double> nodal_measure(const InterfaceFaces<dim>& side)
{
  // integrate the side against itself seen from the other face
  InterfaceFaces<dim> mirror = side;
  for (auto& f : mirror.faces)
    std::reverse(f.begin(), f.end());
  const auto m = integrate_mortar<dim>(side, mirror, 0.5);
  std::vector<double> A(side.x.size(), 0.0);
  for (std::size_t a = 0; a < m.D.size(); ++a)
    A[m.multiplier_node[a]] = m.D[a];
  return A;
}

template <int dim>
struct Transfer
{
  double worst_force_sum = 0.0, worst_row_sum = 0.0, patch = 0.0, moment = 0.0;
};

/// Traction p = 1 along +y carried by all multipliers: nodal forces on both sides.
template <int dim>
Transfer<dim> transfer(const InterfaceFaces<dim>& multiplier, const InterfaceFaces<dim>& other)
{
  const auto m = integrate_mortar<dim>(multiplier, other, 0.5);
  std::vector<double> on_multiplier(multiplier.x.size(), 0.0), on_other(other.x.size(), 0.0);
  Transfer<dim> result;
  double sum = 0.0, total = 0.0, moment = 0.0;
  for (std::size_t a = 0; a < m.D.size(); ++a)
  {
    on_multiplier[m.multiplier_node[a]] += m.D[a];
    double row = 0.0;
    for (const auto& [node, c] : m.C[a])
    {
      on_other[node] -= c;
      row += c;
    }
    result.worst_row_sum = std::max(result.worst_row_sum, std::abs(row / m.D[a] - 1.0));
  }
  for (std::size_t n = 0; n < on_multiplier.size(); ++n)
  {
    sum += on_multiplier[n];
    total += on_multiplier[n];
    moment += on_multiplier[n] * multiplier.x[n][0];
  }
  const auto A = nodal_measure<dim>(other);
  for (std::size_t n = 0; n < on_other.size(); ++n)
  {
    sum += on_other[n];
    moment += on_other[n] * other.x[n][0];
    result.patch = std::max(result.patch, std::abs(on_other[n] + A[n]));
  }
  result.worst_force_sum = std::abs(sum) / total;
  result.moment = std::abs(moment) / total;
  return result;
}

} // namespace

// Rows of C sum to D (Σ_c N_c = 1), so uniform velocity passes unchanged and forces cancel, with any mesh,
// flat or curved. Sums of about 100 terms: 1e-14.
TEMPLATE_TEST_CASE_SIG("forces cancel and rigid translation passes on any pair of meshes", "[coupler][unit]",
                       ((int dim), dim), 2, 3)
{
  const auto [n_m, n_o] = GENERATE(table<int, int>({{5, 8}, {8, 5}, {4, 13}, {6, 6}}));
  const bool curved = GENERATE(false, true), triangles = GENERATE(false, true);
  const std::function<double(double, double)> shape =
      curved ? std::function<double(double, double)>(wave) : flat;
  const auto t =
      transfer<dim>(sheet<dim>(n_m, true, 1, shape, triangles), sheet<dim>(n_o, false, 7, shape, !triangles));
  CAPTURE(n_m, n_o, curved, t.worst_force_sum, t.worst_row_sum);
  CHECK(t.worst_force_sum < 1e-14);
  CHECK(t.worst_row_sum < 1e-12); // D of a face that is hardly covered is small
}

// Patch test: a uniform traction on the multiplier side arrives as the consistent nodal forces ∫N of the
// other side, because Σ_a Ψ_a = 1 and the segmentation integrates piecewise polynomials of degree ≤ 4
// exactly.
TEMPLATE_TEST_CASE_SIG("flat non-matching meshes pass the patch test", "[coupler][unit]", ((int dim), dim), 2,
                       3)
{
  const auto [n_m, n_o] = GENERATE(table<int, int>({{5, 8}, {8, 5}, {4, 13}, {20, 33}}));
  if (dim == 3 && n_m > 10)
    return;
  const bool triangles = GENERATE(false, true);
  const auto t =
      transfer<dim>(sheet<dim>(n_m, true, 1, flat, triangles), sheet<dim>(n_o, false, 7, flat, !triangles));
  CAPTURE(n_m, n_o, t.patch, t.moment);
  CHECK(t.patch < 1e-12);
  CHECK(t.moment < 1e-12);
}

// On a curved interface the two polygons do not coincide: the force is exact, the moment is off by force ×
// gap² effects.
TEMPLATE_TEST_CASE_SIG("the moment across a curved interface is right to the gap between the polygons",
                       "[coupler][unit]", ((int dim), dim), 2, 3)
{
  const auto t = transfer<dim>(sheet<dim>(33, true, 1, wave, false), sheet<dim>(20, false, 7, wave, true));
  CAPTURE(t.moment);
  CHECK(t.moment < 1e-5);
}

/// The same sheet, nodes moved in its plane: no quadrilateral is a parallelogram. Its edge stays.
template <int dim>
InterfaceFaces<dim> warped(InterfaceFaces<dim> side)
{
  if constexpr (dim == 3)
    for (Vec<3>& x : side.x)
    {
      const double by = 0.08 * std::sin(3.14159265358979 * x[0]) * std::sin(3.14159265358979 * x[2]);
      x += {{by, 0.0, -0.7 * by}};
    }
  return side;
}

// Linear fields are in both trace spaces, so the dual projection reproduces them: D v_mult = C v_other at
// every multiplier, whatever the quadrature.
TEMPLATE_TEST_CASE_SIG("a linear velocity field passes exactly through flat non-matching meshes",
                       "[coupler][unit]", ((int dim), dim), 2, 3)
{
  const bool triangles = GENERATE(true, false);
  const auto a = warped<dim>(sheet<dim>(7, true, 1, flat, triangles)),
             b = warped<dim>(sheet<dim>(11, false, 7, flat, false));
  const auto m = integrate_mortar<dim>(a, b, 0.5);
  const auto field = [](const Vec<dim>& x) { return 0.3 + 1.7 * x[0] - 0.9 * x[dim - 1]; };
  for (std::size_t k = 0; k < m.D.size(); ++k)
  {
    double other = 0.0;
    for (const auto& [node, c] : m.C[k])
      other += c * field(b.x[node]);
    CHECK(other / m.D[k] == Approx(field(a.x[m.multiplier_node[k]])).margin(1e-11));
  }
  CHECK(m.covered[0] == Approx(1.0).epsilon(1e-12));
  CHECK(m.covered[1] == Approx(1.0).epsilon(1e-12));
}

// A closed polygon under uniform pressure: with nodal normals of slip and D n as forces, the other side gets
// −C n; the sum of both vanishes identically, and so does each by itself for a closed curve whose nodal
// normals are symmetric.
TEST_CASE("uniform pressure on a closed curved interface gives no net force", "[coupler][unit]")
{
  const auto ring = [](int n, bool outward, double phase)
  {
    InterfaceFaces<2> side;
    for (int i = 0; i < n; ++i)
    {
      const double t = 2.0 * std::acos(-1.0) * (i + phase) / n;
      side.x.push_back({{std::cos(t), std::sin(t)}});
    }
    for (int i = 0; i < n; ++i)
      side.faces.push_back(outward ? std::vector<int>{i, (i + 1) % n} : std::vector<int>{(i + 1) % n, i});
    return side;
  };
  const auto inner = ring(48, true, 0.0), outer = ring(30, false, 0.37);
  const auto m = integrate_mortar<2>(inner, outer, 0.3);
  Vec<2> on_inner{}, both{};
  double moment = 0.0;
  for (std::size_t a = 0; a < m.D.size(); ++a)
  {
    const Vec<2> f = m.D[a] * m.normal[a];
    on_inner += f;
    both += f;
    const Vec<2>& x = inner.x[m.multiplier_node[a]];
    moment += x[0] * f[1] - x[1] * f[0];
    for (const auto& [node, c] : m.C[a])
    {
      const Vec<2> g = -c * m.normal[a];
      both += g;
      moment += outer.x[node][0] * g[1] - outer.x[node][1] * g[0];
    }
  }
  CHECK(norm(on_inner) < 1e-12);
  CHECK(norm(both) < 1e-12);
  CHECK(std::abs(moment) < 1e-5);
  CHECK(m.covered[0] == Approx(1.0).epsilon(1e-9));
}

TEST_CASE("coverage and gap are reported, and faces that look the same way do not meet", "[coupler][unit]")
{
  auto a = sheet<2>(10, true, 1, flat, false), b = sheet<2>(7, false, 7, flat, false);
  for (auto& x : b.x)
    x = {{0.5 * x[0], x[1] + 0.01}};
  const auto half = integrate_mortar<2>(a, b, 0.1);
  CHECK(half.covered[0] == Approx(0.5).epsilon(1e-12));
  CHECK(half.covered[1] == Approx(1.0).epsilon(1e-12));
  CHECK(half.largest_gap == Approx(0.01).epsilon(1e-12));
  CHECK(integrate_mortar<2>(a, b, 0.005).D.empty());
  for (auto& f : b.faces)
    std::reverse(f.begin(), f.end());
  CHECK(integrate_mortar<2>(a, b, 0.1).D.empty());
}

// Both sides held in x at the ends of an interface: those rows carry no constraint, and no entry of either
// condensed operator tells so.
TEST_CASE("an interface whose ends are held on both sides has a positive definite operator",
          "[coupler][unit]")
{
  const auto a = sheet<2>(2, true, 1, flat, false), b = sheet<2>(1, false, 7, flat, false);
  ConstraintRows rows;
  append_constraints<2>(integrate_mortar<2>(a, b, 0.5), Side::solid, InterfaceKind::no_slip, rows);
  std::array<InterfaceSide, 2> side;
  for (const Side s : both_sides)
  {
    const int n = s == Side::solid ? 3 : 2;
    side[s].L = SparseMatrix(rows.count, 2 * n);
    side[s].L.setFromTriplets(rows.entries[s].begin(), rows.entries[s].end());
    side[s].inverse_mass = SparseMatrix(2 * n, 2 * n);
    for (int k = 0; k < n; ++k)
    {
      if (k > 0 && k + 1 < n)
        side[s].inverse_mass.insert(2 * k, 2 * k) = 2.0;
      side[s].inverse_mass.insert(2 * k + 1, 2 * k + 1) = 2.0;
    }
  }
  InterfaceOperator H(side[Side::fluid], side[Side::solid]);
  const Vector lambda = H.solve(0.1, 0.2, Vector::Ones(rows.count));
  CHECK(lambda.allFinite());
  CHECK(lambda[0] == 0.0); // x of the first end
  CHECK(lambda[4] == 0.0); // x of the last end
  CHECK(lambda[2] != 0.0);
}

// H_L − H is positive semi-definite where multipliers are dual and on the finer side: the theorem asks it of
// any vector, so it is asked of a hundred. On the coarser side the row sums are too small, and lumping is
// refused.
TEST_CASE("the lumped operator is no smaller than the exact one, or refused", "[coupler][unit]")
{
  const auto lower = sheet<2>(9, true, 1, flat, false), upper = sheet<2>(4, false, 7, flat, false);
  const auto sides = [&](bool on_finer)
  {
    ConstraintRows rows;
    append_constraints<2>(on_finer ? integrate_mortar<2>(lower, upper, 0.5)
                                   : integrate_mortar<2>(upper, lower, 0.5),
                          on_finer ? Side::fluid : Side::solid, InterfaceKind::no_slip, rows);
    std::array<InterfaceSide, 2> side;
    for (const Side s : both_sides)
    {
      const auto& sheet = s == Side::fluid ? lower : upper;
      const auto A = nodal_measure<2>(sheet);
      const auto n = static_cast<Eigen::Index>(2 * A.size());
      side[s].L = SparseMatrix(rows.count, n);
      side[s].L.setFromTriplets(rows.entries[s].begin(), rows.entries[s].end());
      side[s].inverse_mass = SparseMatrix(n, n);
      for (Eigen::Index k = 0; k < n; ++k)
        side[s].inverse_mass.insert(k, k) = 1.0 / A[static_cast<std::size_t>(k / 2)];
    }
    return side;
  };
  const auto side = sides(true);
  InterfaceOperator exact(side[0], side[1]), lumped(side[0], side[1], Solver::row_sums);
  const SparseMatrix H = exact.assemble(0.3, 2.0);
  Vector inverse = lumped.solve(0.3, 2.0, Vector::Ones(H.rows())); // of the diagonal H_L
  std::mt19937 random(4);
  std::normal_distribution<double> any;
  for (int k = 0; k < 100; ++k)
  {
    Vector x(H.rows());
    for (double& value : x)
      value = any(random);
    const double bound = (x.array().square() / inverse.array()).sum();
    CHECK(x.dot(H * x) <= bound * (1.0 + 1e-12));
  }
  // The same answer for what all multipliers say alike: a uniform jump.
  CHECK((H * Vector::Ones(H.rows()) - inverse.cwiseInverse()).norm() < 1e-12 * inverse.cwiseInverse().norm());
  CHECK(lumped.factorisations() == 0);
  const auto coarse = sides(false);
  CHECK_THROWS_AS(InterfaceOperator(coarse[0], coarse[1], Solver::row_sums), InputError);
}

// What a solution for the multipliers costs, and which way pays: a table, not a claim. Right-hand sides turn
// slowly, as from one sub-step to the next; the conjugate gradients start from the last solution.
// docs/benchmarks/interface_solver.md.
TEMPLATE_TEST_CASE_SIG("cost of solving for the multipliers", "[.][benchmark]", ((int dim), dim), 2, 3)
{
  const auto microseconds = [](std::clock_t begin) // of this process: others may use the machine
  { return 1e6 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC; };
  for (const int n : dim == 2 ? std::vector{100, 300, 1000, 5000} : std::vector{16, 32, 70})
  {
    const auto fine = sheet<dim>(n, true, 1, wave, false),
               coarse = sheet<dim>(n * 3 / 5, false, 7, wave, false);
    auto begin = std::clock();
    const auto mortar = integrate_mortar<dim>(fine, coarse, 1.0 / n);
    const double mortar_time = microseconds(begin);
    ConstraintRows rows;
    append_constraints<dim>(mortar, Side::fluid, InterfaceKind::slip, rows);
    std::array<InterfaceSide, 2> side;
    for (const Side s : both_sides)
    {
      const auto& of = s == Side::fluid ? fine : coarse;
      const auto A = nodal_measure<dim>(of);
      const auto size = static_cast<Eigen::Index>(dim * A.size());
      side[s].L = SparseMatrix(rows.count, size);
      side[s].L.setFromTriplets(rows.entries[s].begin(), rows.entries[s].end());
      side[s].inverse_mass = SparseMatrix(size, size);
      for (Eigen::Index k = 0; k < size; ++k) // densities 1000 and 2700 kg/m3, depth of a face
        side[s].inverse_mass.insert(k, k) =
            n / ((s == Side::fluid ? 1000.0 : 4500.0) * A[static_cast<std::size_t>(k / dim)]);
    }
    InterfaceOperator H(side[0], side[1]);
    for (const double ratio : {1.0, 20.0}) // coarse step over fine step
    {
      const SparseMatrix matrix = H.assemble(1.0, ratio);
      Eigen::SimplicialLDLT<SparseMatrix> direct;
      begin = std::clock();
      direct.analyzePattern(matrix);
      const double analysis = microseconds(begin);
      begin = std::clock();
      direct.factorize(matrix);
      const double factor = microseconds(begin);
      Eigen::ConjugateGradient<SparseMatrix, Eigen::Lower | Eigen::Upper> iterative(matrix);
      iterative.setTolerance(1e-8);
      constexpr int times = 50;
      const auto right_side = [&](int k)
      {
        Vector b(matrix.rows());
        for (Eigen::Index i = 0; i < b.size(); ++i)
          b[i] = std::sin(20.0 * static_cast<double>(i) / static_cast<double>(b.size()) + 0.02 * k);
        return b;
      };
      std::vector<Vector> b;
      for (int k = 0; k < times; ++k)
        b.push_back(right_side(k));
      Vector x = iterative.solve(right_side(-1)), y;
      Eigen::Index iterations = 0;
      begin = std::clock();
      for (const Vector& right : b)
        y = direct.solve(right);
      const double solve = microseconds(begin) / times;
      begin = std::clock();
      for (const Vector& right : b)
      {
        x = iterative.solveWithGuess(right, x);
        iterations += iterative.iterations();
      }
      const double iterate = microseconds(begin) / times;
      CHECK((x - y).norm() < 1e-4 * y.norm()); // residual 1e-8 times the condition of H
      fmt::print("| {} | {} | {:.0f} | {:.0f} | {:.0f} | {:.0f} | {:.1f} | {:.1f} | {:.1f} | {} |\n",
                 dim == 2 ? "curve" : "surface", matrix.rows(), ratio, mortar_time, analysis, factor, solve,
                 iterate, static_cast<double>(iterations) / times,
                 iterate > solve ? fmt::format("{:.0f}", factor / (iterate - solve)) : "never");
    }
  }
}
