// Advancing front and spring relaxation.
#include "fluid_pfem/fill.hpp"

#include "fluid_pfem/remesh/delaunay.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <unordered_map>
#include <utility>

namespace undine::fluid
{

namespace
{

/// Points by size class and cell: a query looks at its own class and the two neighbouring ones, which is
/// enough because the spacing changes slowly.
template <int dim>
class Neighbourhood
{
public:
  void add(const Vec<dim>& x, double h) { cells_[key(x, level(h))].push_back(x); }
  /// A point nearer than r (≤ h) to x.
  bool crowded(const Vec<dim>& x, double h, double r) const
  {
    for (int l = level(h) - 1; l <= level(h) + 1; ++l)
    {
      const double size = std::ldexp(1.0, l);
      std::array<long, dim> first, last;
      for (std::size_t i = 0; i < dim; ++i)
      {
        first[i] = std::lround(std::floor((x.c[i] - r) / size));
        last[i] = std::lround(std::floor((x.c[i] + r) / size));
      }
      auto cell = first;
      for (std::size_t i = 0; i < dim;)
      {
        if (const auto it = cells_.find(pack(cell, l)); it != cells_.end())
          for (const auto& p : it->second)
            if (norm_squared(p - x) < r * r)
              return true;
        for (i = 0; i < dim && ++cell[i] > last[i]; ++i)
          cell[i] = first[i];
      }
    }
    return false;
  }

private:
  static int level(double h) { return static_cast<int>(std::floor(std::log2(h))); }
  static std::uint64_t pack(const std::array<long, dim>& cell, int l)
  {
    std::uint64_t key = static_cast<std::uint64_t>(l + 64);
    for (const long c : cell)
      key = key * 0x9E3779B97F4A7C15ULL + static_cast<std::uint64_t>(c);
    return key;
  }
  static std::uint64_t key(const Vec<dim>& x, int l)
  {
    std::array<long, dim> cell;
    for (std::size_t i = 0; i < dim; ++i)
      cell[i] = std::lround(std::floor(x.c[i] / std::ldexp(1.0, l)));
    return pack(cell, l);
  }
  std::unordered_map<std::uint64_t, std::vector<Vec<dim>>> cells_;
};

/// Unit vectors spread over the circle or the sphere, the first one at random.
template <int dim>
std::vector<Vec<dim>> directions(std::mt19937_64& random)
{
  const double pi = std::acos(-1.0);
  std::uniform_real_distribution<double> angle(0.0, 2.0 * pi);
  std::vector<Vec<dim>> result;
  const double turn = angle(random);
  if constexpr (dim == 2)
    for (int k = 0; k < 18; ++k)
      result.push_back({{std::cos(turn + k * pi / 9.0), std::sin(turn + k * pi / 9.0)}});
  else
  {
    constexpr int n = 50;
    for (int k = 0; k < n; ++k)
    {
      const double y = 1.0 - 2.0 * (k + 0.5) / n, r = std::sqrt(1.0 - y * y), a = turn + 2.39996322972865 * k;
      result.push_back({{r * std::cos(a), y, r * std::sin(a)}});
    }
  }
  return result;
}

template <int dim>
void relax(std::vector<Vec<dim>>& x, std::size_t fixed, const std::function<double(const Vec<dim>&)>& depth,
           const std::function<double(const Vec<dim>&)>& spacing)
{
  constexpr int sweeps = dim == 2 ? 40 : 15;
  for (int sweep = 0; sweep < sweeps; ++sweep)
  {
    std::vector<std::pair<index_t, index_t>> edges;
    for (const auto& e : delaunay(x))
    {
      Vec<dim> centroid{};
      for (const index_t n : e)
        centroid += (1.0 / (dim + 1)) * x[static_cast<std::size_t>(n)];
      if (depth(centroid) < 0.0)
        continue;
      for (std::size_t a = 0; a <= dim; ++a)
        for (std::size_t b = a + 1; b <= dim; ++b)
          edges.emplace_back(std::min(e[a], e[b]), std::max(e[a], e[b]));
    }
    std::sort(edges.begin(), edges.end());
    edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
    std::vector<double> wanted(edges.size());
    double is = 0.0, ought = 0.0;
    for (std::size_t k = 0; k < edges.size(); ++k)
    {
      const auto &p = x[static_cast<std::size_t>(edges[k].first)],
                 &q = x[static_cast<std::size_t>(edges[k].second)];
      wanted[k] = spacing(0.5 * (p + q));
      is += std::pow(norm(p - q), dim);
      ought += std::pow(wanted[k], dim);
    }
    const double scale = 1.15 * std::pow(is / ought, 1.0 / dim);
    std::vector<Vec<dim>> push(x.size());
    for (std::size_t k = 0; k < edges.size(); ++k)
    {
      const auto i = static_cast<std::size_t>(edges[k].first), j = static_cast<std::size_t>(edges[k].second);
      const Vec<dim> d = x[j] - x[i];
      const double length = norm(d), short_by = scale * wanted[k] - length;
      if (short_by <= 0.0)
        continue;
      push[i] -= (short_by / length) * d;
      push[j] += (short_by / length) * d;
    }
    for (std::size_t n = fixed; n < x.size(); ++n)
    {
      const Vec<dim> moved = x[n] + 0.2 * push[n];
      if (depth(moved) > 0.5 * spacing(moved))
        x[n] = moved;
    }
  }
}

} // namespace

template <int dim>
std::vector<Vec<dim>> fill(const std::vector<Vec<dim>>& boundary,
                           const std::function<double(const Vec<dim>&)>& depth,
                           const std::function<double(const Vec<dim>&)>& spacing, std::uint64_t seed)
{
  // Tuned on a unit square and cube of uniform spacing: the number of points of the regular lattice.
  constexpr double exclusion = dim == 2 ? 0.88 : 0.90;
  std::mt19937_64 random(seed);
  Neighbourhood<dim> placed;
  for (const auto& p : boundary)
    placed.add(p, spacing(p));
  std::vector<Vec<dim>> x = boundary;
  for (std::size_t front = 0; front < x.size(); ++front)
  {
    const double h = spacing(x[front]);
    const auto around = directions<dim>(random);
    for (const auto& direction : around)
    {
      const Vec<dim> candidate = x[front] + (1.02 * exclusion * h) * direction;
      const double wanted = spacing(candidate);
      if (depth(candidate) < 0.6 * wanted || placed.crowded(candidate, wanted, exclusion * wanted))
        continue;
      placed.add(candidate, wanted);
      x.push_back(candidate);
    }
  }
  relax<dim>(x, boundary.size(), depth, spacing);
  return x;
}

template <int dim>
std::vector<Vec<dim>> divide(const Vec<dim>& a, const Vec<dim>& b,
                             const std::function<double(const Vec<dim>&)>& spacing)
{
  // ∫ds/h along the line by the midpoint rule, fine against the change of h.
  constexpr int fine = 2000;
  const double length = norm(b - a);
  std::vector<double> count{0.0};
  for (int k = 0; k < fine; ++k)
    count.push_back(count.back() + length / fine / spacing(a + ((k + 0.5) / fine) * (b - a)));
  const int intervals = std::max(1, static_cast<int>(std::lround(count.back())));
  std::vector<Vec<dim>> points;
  std::size_t f = 0;
  for (int k = 0; k < intervals; ++k)
  {
    const double wanted = count.back() * k / intervals;
    while (count[f + 1] < wanted)
      ++f;
    const double s = (static_cast<double>(f) + (wanted - count[f]) / (count[f + 1] - count[f])) / fine;
    points.push_back(a + s * (b - a));
  }
  return points;
}

template std::vector<Vec<2>> fill<2>(const std::vector<Vec<2>>&, const std::function<double(const Vec<2>&)>&,
                                     const std::function<double(const Vec<2>&)>&, std::uint64_t);
template std::vector<Vec<3>> fill<3>(const std::vector<Vec<3>>&, const std::function<double(const Vec<3>&)>&,
                                     const std::function<double(const Vec<3>&)>&, std::uint64_t);
template std::vector<Vec<2>> divide<2>(const Vec<2>&, const Vec<2>&,
                                       const std::function<double(const Vec<2>&)>&);
template std::vector<Vec<3>> divide<3>(const Vec<3>&, const Vec<3>&,
                                       const std::function<double(const Vec<3>&)>&);

} // namespace undine::fluid
