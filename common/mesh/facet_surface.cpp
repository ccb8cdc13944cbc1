// Nearest points on faceted surfaces.
#include "common/mesh/facet_surface.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace undine
{

namespace
{

/// Facets at the rim of an open surface reach on by this part of their size: a node in the corner between the
/// surface and a rigid wall lies on the rim up to round-off.
constexpr double rim_extension = 0.25;

/// The sub-facet opposite of corner `a`, as sorted node numbers: what two neighbours share.
template <int dim>
std::array<index_t, dim - 1> opposite(const std::array<index_t, dim>& facet, std::size_t a)
{
  std::array<index_t, dim - 1> rest{};
  std::size_t k = 0;
  for (std::size_t b = 0; b < dim; ++b)
    if (b != a)
      rest[k++] = facet[b];
  std::sort(rest.begin(), rest.end());
  return rest;
}

} // namespace

template <int dim>
FacetSurface<dim>::FacetSurface(std::vector<Vec<dim>> x, std::span<const std::int32_t> face_offset,
                                std::span<const std::int32_t> face_nodes)
    : x_(std::move(x))
{
  for (std::size_t f = 0; f + 1 < face_offset.size(); ++f)
  {
    const auto nodes = face_nodes.subspan(static_cast<std::size_t>(face_offset[f]),
                                          static_cast<std::size_t>(face_offset[f + 1] - face_offset[f]));
    if constexpr (dim == 2)
    {
      require(nodes.size() == 2, "a face in the plane has two nodes");
      facets_.push_back({nodes[0], nodes[1]});
    }
    else
    {
      require(nodes.size() == 3 || nodes.size() == 4, "a face in space has three or four nodes");
      facets_.push_back({nodes[0], nodes[1], nodes[2]});
      if (nodes.size() == 4)
        facets_.push_back({nodes[0], nodes[2], nodes[3]});
    }
  }
  std::map<std::array<index_t, dim - 1>, int> shared;
  for (const Facet& f : facets_)
    for (std::size_t a = 0; a < dim; ++a)
      ++shared[opposite<dim>(f, a)];
  rim_.resize(facets_.size());
  for (std::size_t k = 0; k < facets_.size(); ++k)
    for (std::size_t a = 0; a < dim; ++a)
      // In the plane node a is opposite of the other one: its own rim is what node 1 − a is opposite of.
      rim_[k][dim == 2 ? 1 - a : a] = shared[opposite<dim>(facets_[k], a)] == 1;
  sort_bins();
}

template <int dim>
Vec<dim> FacetSurface<dim>::normal_of(index_t facet) const
{
  const Facet& f = facets_[static_cast<std::size_t>(facet)];
  const auto at = [&](std::size_t a) { return x_[static_cast<std::size_t>(f[a])]; };
  Vec<dim> n;
  if constexpr (dim == 2)
    n = right_normal(at(1) - at(0)); // faces run with the body on their left
  else
    n = cross(at(1) - at(0), at(2) - at(0));
  return (1.0 / norm(n)) * n;
}

template <int dim>
double FacetSurface<dim>::facet_size() const
{
  double sum = 0.0;
  for (const Facet& f : facets_)
  {
    const auto at = [&](std::size_t a) { return x_[static_cast<std::size_t>(f[a])]; };
    if constexpr (dim == 2)
      sum += norm(at(1) - at(0));
    else
      sum += norm(cross(at(1) - at(0), at(2) - at(0)));
  }
  const double mean = facets_.empty() ? 0.0 : sum / static_cast<double>(facets_.size());
  return dim == 2 ? mean : std::sqrt(mean);
}

template <int dim>
std::vector<int> FacetSurface<dim>::patches(double angle) const
{
  std::map<std::array<index_t, dim - 1>, std::vector<index_t>> around;
  for (std::size_t k = 0; k < facets_.size(); ++k)
    for (std::size_t a = 0; a < dim; ++a)
      around[opposite<dim>(facets_[k], a)].push_back(static_cast<index_t>(k));
  std::vector<int> patch(facets_.size(), -1);
  int count = 0;
  for (std::size_t seed = 0; seed < facets_.size(); ++seed)
  {
    if (patch[seed] >= 0)
      continue;
    std::vector<index_t> front{static_cast<index_t>(seed)};
    patch[seed] = count;
    while (!front.empty())
    {
      const index_t k = front.back();
      front.pop_back();
      for (std::size_t a = 0; a < dim; ++a)
        for (const index_t l : around[opposite<dim>(facets_[static_cast<std::size_t>(k)], a)])
          if (patch[static_cast<std::size_t>(l)] < 0 && dot(normal_of(k), normal_of(l)) > std::cos(angle))
          {
            patch[static_cast<std::size_t>(l)] = count;
            front.push_back(l);
          }
    }
    ++count;
  }
  return patch;
}

template <int dim>
std::vector<std::array<index_t, 2>> FacetSurface<dim>::convex_corners(std::span<const int> patch) const
{
  std::vector<std::array<index_t, 2>> corners;
  if constexpr (dim == 2)
  {
    std::vector<index_t> begins(x_.size(), -1); // the facet that begins at a node
    for (std::size_t f = 0; f < facets_.size(); ++f)
      begins[static_cast<std::size_t>(facets_[f][0])] = static_cast<index_t>(f);
    for (std::size_t f = 0; f < facets_.size(); ++f)
    {
      const index_t next = begins[static_cast<std::size_t>(facets_[f][1])];
      if (next < 0 || patch[f] == patch[static_cast<std::size_t>(next)])
        continue;
      const Vec<dim> before = normal_of(static_cast<index_t>(f)), after = normal_of(next);
      if (before[0] * after[1] - before[1] * after[0] > 0.0)
        corners.push_back({static_cast<index_t>(f), next});
    }
  }
  return corners;
}

template <int dim>
typename FacetSurface<dim>::Bin FacetSurface<dim>::bin_of(const Vec<dim>& p) const
{
  Bin bin;
  for (int i = 0; i < dim; ++i)
    bin[static_cast<std::size_t>(i)] = std::lround(std::floor(p[i] / bin_size_));
  return bin;
}

template <int dim>
template <class Act>
void FacetSurface<dim>::each_bin(const Bin& first, const Bin& last, Act&& act)
{
  for (Bin bin = first;;)
  {
    act(bin);
    std::size_t i = 0;
    for (; i < dim && bin[i] >= last[i]; ++i)
      bin[i] = first[i];
    if (i == dim)
      return;
    ++bin[i];
  }
}

template <int dim>
void FacetSurface<dim>::sort_bins()
{
  bins_.clear();
  bin_size_ = std::max(2.0 * facet_size(), std::numeric_limits<double>::min());
  for (std::size_t k = 0; k < facets_.size(); ++k)
  {
    Vec<dim> low = x_[static_cast<std::size_t>(facets_[k][0])], high = low;
    for (const index_t n : facets_[k])
      for (int i = 0; i < dim; ++i)
      {
        low[i] = std::min(low[i], x_[static_cast<std::size_t>(n)][i]);
        high[i] = std::max(high[i], x_[static_cast<std::size_t>(n)][i]);
      }
    each_bin(bin_of(low), bin_of(high),
             [&](const Bin& bin) { bins_.emplace_back(bin, static_cast<index_t>(k)); });
  }
  std::sort(bins_.begin(), bins_.end());
}

template <int dim>
void FacetSurface<dim>::within(const Vec<dim>& p, double reach, std::vector<index_t>& found) const
{
  if (empty())
    return;
  const std::size_t begin = found.size();
  Vec<dim> margin;
  for (int i = 0; i < dim; ++i)
    margin[i] = reach;
  const Bin first = bin_of(p - margin), last = bin_of(p + margin);
  Bin last_of_rows = last; // bins that differ in the last index only follow each other
  last_of_rows[dim - 1] = first[dim - 1];
  each_bin(first, last_of_rows,
           [&](const Bin& bin)
           {
             Bin end = bin;
             end[dim - 1] = last[dim - 1];
             for (auto it = std::lower_bound(bins_.begin(), bins_.end(), std::pair{bin, index_t{0}});
                  it != bins_.end() && !(end < it->first); ++it)
               found.push_back(it->second);
           });
  std::sort(found.begin() + static_cast<std::ptrdiff_t>(begin), found.end());
  found.erase(std::unique(found.begin() + static_cast<std::ptrdiff_t>(begin), found.end()), found.end());
  found.erase(std::remove_if(found.begin() + static_cast<std::ptrdiff_t>(begin), found.end(),
                             [&](index_t k) { return project(p, k).distance > reach; }),
              found.end());
}

template <int dim>
typename FacetSurface<dim>::Projection FacetSurface<dim>::project(const Vec<dim>& p, index_t facet) const
{
  const Facet& f = facets_[static_cast<std::size_t>(facet)];
  const auto& rim = rim_[static_cast<std::size_t>(facet)];
  const auto at = [&](std::size_t a) -> const Vec<dim>& { return x_[static_cast<std::size_t>(f[a])]; };
  Projection q{};
  q.normal = normal_of(facet);
  q.height = dot(q.normal, p - at(0));
  if constexpr (dim == 2)
  {
    const Vec<2> t = at(1) - at(0);
    const double s = dot(p - at(0), t) / norm_squared(t), c = std::clamp(s, 0.0, 1.0);
    q.interior = s >= (rim[0] ? -rim_extension : 0.0) && s <= 1.0 + (rim[1] ? rim_extension : 0.0);
    const double w = q.interior ? s : c;
    q.weight = {1.0 - w, w};
    q.on_rim = !q.interior && rim[s < 0.0 ? 0 : 1];
    q.distance = norm(p - at(0) - c * t);
  }
  else
  {
    // Barycentric coordinates of the projection; outside, the nearest point of the edges (Ericson
    // 2004, 5.1.5).
    const Vec<3> e0 = at(1) - at(0), e1 = at(2) - at(0), w = p - at(0);
    const double a = dot(e0, e0), b = dot(e0, e1), c = dot(e1, e1), d = dot(e0, w), e = dot(e1, w);
    const double det = a * c - b * b, s = (c * d - b * e) / det, t = (a * e - b * d) / det;
    const auto least = [&](std::size_t k) { return rim[k] ? -rim_extension : 0.0; };
    if (1.0 - s - t >= least(0) && s >= least(1) && t >= least(2))
    {
      q.weight = {1.0 - s - t, s, t};
      q.interior = true;
      q.distance = std::abs(q.height);
      return q;
    }
    q.distance = std::numeric_limits<double>::max();
    for (std::size_t k = 0; k < 3; ++k) // edge opposite of corner k
    {
      const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
      const Vec<3> edge = at(j) - at(i);
      const double r = std::clamp(dot(p - at(i), edge) / norm_squared(edge), 0.0, 1.0);
      const double distance = norm(p - at(i) - r * edge);
      if (distance < q.distance)
      {
        q.distance = distance;
        q.weight = {};
        q.weight[i] = 1.0 - r;
        q.weight[j] = r;
        q.on_rim = rim[k];
      }
    }
  }
  return q;
}

template <int dim>
typename FacetSurface<dim>::Near FacetSurface<dim>::nearest(const Vec<dim>& p,
                                                            std::span<const index_t> candidates) const
{
  return nearest_of(p, candidates).first;
}

template <int dim>
std::pair<typename FacetSurface<dim>::Near, double>
FacetSurface<dim>::nearest_of(const Vec<dim>& p, std::span<const index_t> candidates) const
{
  Near near;
  Projection best{};
  best.distance = std::numeric_limits<double>::infinity();
  for (const index_t k : candidates)
  {
    const Projection q = project(p, k);
    const bool as_near =
        near.facet >= 0 && std::abs(q.distance - best.distance) <= 1e-9 * best.distance + 1e-14 * bin_size_;
    if (near.facet < 0 || (as_near ? std::abs(q.height) > std::abs(best.height) : q.distance < best.distance))
    {
      best = q;
      near.facet = k;
    }
  }
  if (near.facet < 0)
    return {near, best.distance};
  near.weight = best.weight;
  near.normal = best.normal;
  near.beside = best.on_rim;
  // Inside the facet's shadow the gap is the height; past an edge the distance, with the sign of the height.
  near.gap = best.interior ? best.height : std::copysign(best.distance, best.height);
  return {near, best.distance};
}

template <int dim>
typename FacetSurface<dim>::Near FacetSurface<dim>::nearest(const Vec<dim>& p, double reach) const
{
  if (empty())
    return {};
  // Far or near, only what is about as near as the nearest counts: looked for in ever larger circles.
  constexpr double surely = 1.0 - 1e-6; // what is as near as this up to round-off is in the circle too
  std::vector<index_t> candidates;
  for (double r = std::min(0.5 * bin_size_, reach);; r = std::min(4.0 * r, reach))
  {
    candidates.clear();
    within(p, r, candidates);
    const auto [near, distance] = nearest_of(p, candidates);
    if (distance < surely * r || r >= reach)
      return near;
  }
}

template class FacetSurface<2>;
template class FacetSurface<3>;

} // namespace undine
