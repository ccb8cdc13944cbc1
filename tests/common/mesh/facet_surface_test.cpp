// The nearest point of a box's surface is known for every point.
#include "common/mesh/facet_surface.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

using namespace undine;

namespace
{

/// The boundary of [0, a] × [0, b] (× [0, c]) in n pieces per side.
template <int dim>
FacetSurface<dim> box(const Vec<dim>& size, int n)
{
  std::vector<Vec<dim>> x;
  std::vector<std::int32_t> offset{0}, nodes;
  const auto node = [&](const Vec<dim>& p)
  {
    for (std::size_t k = 0; k < x.size(); ++k)
      if (norm(x[k] - p) < 1e-12)
        return static_cast<std::int32_t>(k);
    x.push_back(p);
    return static_cast<std::int32_t>(x.size() - 1);
  };
  for (int axis = 0; axis < dim; ++axis)
    for (int end = 0; end < 2; ++end)
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < (dim == 3 ? n : 1); ++j)
        {
          const auto at = [&](int u, int w)
          {
            Vec<dim> p;
            p[axis] = end * size[axis];
            const int s = (axis + 1) % dim, t = (axis + 2) % dim;
            p[s] = size[s] * u / n;
            if constexpr (dim == 3)
              p[t] = size[t] * w / n;
            return node(p);
          };
          std::vector<std::int32_t> face;
          if constexpr (dim == 2)
            face = {at(i, 0),
                    at(i + 1, 0)}; // body on the left for the axis-0 far side and the axis-1 near side
          else
            face = {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)};
          const bool outward = dim == 3 ? end == 1 : (axis == 0) == (end == 1);
          if (!outward)
            std::reverse(face.begin(), face.end());
          nodes.insert(nodes.end(), face.begin(), face.end());
          offset.push_back(static_cast<std::int32_t>(nodes.size()));
        }
  return {x, offset, nodes};
}

/// Signed distance to a box, negative inside.
template <int dim>
double exact(const Vec<dim>& p, const Vec<dim>& size)
{
  double outside = 0.0, inside = 1e300;
  for (int i = 0; i < dim; ++i)
  {
    const double over = std::max(-p[i], p[i] - size[i]);
    outside += over > 0.0 ? over * over : 0.0;
    inside = std::min(inside, -over);
  }
  return outside > 0.0 ? std::sqrt(outside) : -inside;
}

} // namespace

TEMPLATE_TEST_CASE_SIG(
    "The gap of a box is its signed distance, with unit normals and weights that sum to one", "",
    ((int dim), dim), 2, 3)
{
  Vec<dim> size;
  for (int i = 0; i < dim; ++i)
    size[i] = 1.0 + 0.3 * i;
  const auto surface = box<dim>(size, 4);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> anywhere(-0.5, 2.1);
  for (int k = 0; k < 2000; ++k)
  {
    Vec<dim> p;
    for (int i = 0; i < dim; ++i)
      p[i] = anywhere(random);
    const auto near = surface.nearest(p, 3.0);
    REQUIRE(near.facet >= 0);
    CHECK(near.gap == Approx(exact<dim>(p, size)).margin(1e-12)); // closed forms on both sides: round-off
    CHECK(norm(near.normal) == Approx(1.0));
    CHECK(std::accumulate(near.weight.begin(), near.weight.end(), 0.0) == Approx(1.0));
    CHECK_FALSE(near.beside);
  }
}

TEMPLATE_TEST_CASE_SIG("Facets within reach are found through the bins", "", ((int dim), dim), 2, 3)
{
  Vec<dim> size;
  for (int i = 0; i < dim; ++i)
    size[i] = 1.0;
  const auto surface = box<dim>(size, 5);
  std::mt19937 random(2);
  std::uniform_real_distribution<double> anywhere(-0.3, 1.3);
  for (int k = 0; k < 500; ++k)
  {
    Vec<dim> p;
    for (int i = 0; i < dim; ++i)
      p[i] = anywhere(random);
    std::vector<index_t> all(surface.facets().size());
    std::iota(all.begin(), all.end(), 0);
    const double gap = surface.nearest(p, all).gap;
    const auto within = surface.nearest(p, 0.25);
    if (std::abs(gap) < 0.25)
      CHECK(within.gap == Approx(gap).margin(1e-14));
    else if (std::abs(gap) > 0.25 * (1.0 + 1e-12))
      CHECK(within.facet < 0);
  }
}

TEMPLATE_TEST_CASE_SIG("A box has as many smooth sides as faces", "", ((int dim), dim), 2, 3)
{
  Vec<dim> size;
  for (int i = 0; i < dim; ++i)
    size[i] = 1.0;
  const auto patch = box<dim>(size, 3).patches(0.7);
  CHECK(*std::max_element(patch.begin(), patch.end()) + 1 == 2 * dim);
}

TEST_CASE("Beyond the rim of an open surface there is no contact")
{
  const FacetSurface<2> line({{{0.0, 0.0}}, {{1.0, 0.0}}, {{2.0, 0.0}}}, std::vector<std::int32_t>{0, 2, 4},
                             std::vector<std::int32_t>{0, 1, 1, 2});
  CHECK(line.nearest({{2.5, 0.1}}, 1.0).beside);
  CHECK(line.nearest({{-0.5, 0.1}}, 1.0).beside);
  CHECK_FALSE(line.nearest({{1.0, 0.1}}, 1.0).beside);
  CHECK_FALSE(line.nearest({{-1e-15, 0.1}}, 1.0).beside);     // on the rim up to round-off
  CHECK(line.nearest({{1.0, -0.1}}, 1.0).gap == Approx(0.1)); // walked from left to right, the body is above
}

TEST_CASE("The convex corners of an L are five of its six")
{
  const std::vector<Vec<2>> x{{{0.0, 0.0}}, {{1.0, 0.0}}, {{2.0, 0.0}}, {{2.0, 1.0}},
                              {{1.0, 1.0}}, {{1.0, 2.0}}, {{0.0, 2.0}}};
  std::vector<std::int32_t> offset{0}, nodes;
  for (int k = 0; k < 7; ++k)
  {
    nodes.insert(nodes.end(), {k, (k + 1) % 7});
    offset.push_back(2 * (k + 1));
  }
  const FacetSurface<2> surface(x, offset, nodes);
  std::vector<index_t> corners;
  for (const auto& [before, after] : surface.convex_corners(surface.patches(0.7)))
  {
    corners.push_back(surface.facets()[static_cast<std::size_t>(before)][1]);
    CHECK(surface.facets()[static_cast<std::size_t>(after)][0] == corners.back());
  }
  std::sort(corners.begin(), corners.end());
  CHECK(corners == std::vector<index_t>{0, 2, 3, 5, 6});
}
