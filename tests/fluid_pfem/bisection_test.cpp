// The order of nodes in space: recursive coordinate bisection.
#include "fluid_pfem/remesh/bisection.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <limits>
#include <random>
#include <vector>

using namespace undine;
using namespace undine::fluid;

namespace
{

/// side^dim points, in any order.
template <int dim>
std::vector<Vec<dim>> lattice(int side, std::mt19937& random)
{
  std::vector<Vec<dim>> x{Vec<dim>{}};
  for (int i = 0; i < dim; ++i)
  {
    std::vector<Vec<dim>> more;
    for (const Vec<dim>& p : x)
      for (int k = 0; k < side; ++k)
      {
        more.push_back(p);
        more.back()[i] = k;
      }
    x = std::move(more);
  }
  std::shuffle(x.begin(), x.end(), random);
  return x;
}

} // namespace

TEMPLATE_TEST_CASE_SIG("Ranges of the numbers of a bisection are compact and depend on the points alone", "",
                       ((int dim), dim), 2, 3)
{
  std::mt19937 random(3);
  auto x = lattice<dim>(16, random);
  Bisection<dim> boxes, again;
  boxes.build(x);
  std::shuffle(x.begin(), x.end(), random);
  again.build(x);
  for (const auto& p : x)
    REQUIRE(boxes.box_of(p) == again.box_of(p));

  // Powers of two are cut in halves: one of 2^dim equal ranges is a square or cube of half the side.
  std::sort(x.begin(), x.end(),
            [&](const auto& p, const auto& q) { return boxes.box_of(p) < boxes.box_of(q); });
  const std::size_t part = x.size() >> dim;
  for (std::size_t begin = 0; begin < x.size(); begin += part)
  {
    Vec<dim> low = x[begin], high = low;
    for (std::size_t n = begin; n < begin + part; ++n)
      for (int i = 0; i < dim; ++i)
      {
        low[i] = std::min(low[i], x[n][i]);
        high[i] = std::max(high[i], x[n][i]);
      }
    for (int i = 0; i < dim; ++i)
      CHECK(high[i] - low[i] == 7.0);
  }
}

TEMPLATE_TEST_CASE_SIG("A bisection takes points that coincide, none, and points outside of all", "",
                       ((int dim), dim), 2, 3)
{
  Bisection<dim> boxes;
  CHECK(boxes.box_of(Vec<dim>{}) == 0); // not built
  boxes.build(std::vector<Vec<dim>>(1000));
  Vec<dim> far{};
  far[0] = std::numeric_limits<double>::max();
  CHECK(boxes.box_of(far) == boxes.box_of(Vec<dim>{})); // where all are
  far[0] = -far[0];
  CHECK(boxes.box_of(far) == 0);
  boxes.build(std::vector<Vec<dim>>{});
  CHECK(boxes.box_of(far) == 0);
}
