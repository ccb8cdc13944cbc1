// Adjacency of simplices.
#include "fluid_pfem/fluid_mesh.hpp"

#include "common/parallel/in_parts.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <limits>
#include <utility>

namespace undine::fluid
{

template <>
Simplex<3> canonical<3>(const Simplex<3>& e)
{
  const int first = static_cast<int>(std::min_element(e.begin(), e.end()) - e.begin());
  const auto order = even_order<3>(first);
  Simplex<3> c;
  for (std::size_t k = 0; k < c.size(); ++k)
    c[k] = e[static_cast<std::size_t>(order[k])];
  while (c[1] > c[2] || c[1] > c[3]) // the three others may still be rotated
    c = {c[0], c[2], c[3], c[1]};
  return c;
}

namespace
{

/// In the order in which corner a and it are positively oriented: its normal points away from the corner.
template <int dim>
Facet<dim> facet_opposite(const Simplex<dim>& nodes, int a)
{
  const auto order = even_order<dim>(a);
  Facet<dim> facet;
  for (std::size_t k = 0; k < dim; ++k)
    facet[k] = nodes[static_cast<std::size_t>(order[k + 1])];
  return facet;
}

template <int dim>
std::span<const FanEntry<dim>> stored_fan(const FluidMesh<dim>& mesh, index_t n)
{
  const auto k = static_cast<std::size_t>(n - mesh.first_with_fan);
  return {mesh.fans.data() + mesh.fan_begin[k], mesh.fans.data() + mesh.fan_begin[k + 1]};
}

/// From the first entry on, each is followed by one that begins where it ends, as far as there is one.
void follow(std::span<FanEntry<2>> fan)
{
  for (std::size_t k = 0; k + 1 < fan.size(); ++k)
    for (std::size_t l = k + 1; l < fan.size(); ++l)
      if (fan[l].opposite[0] == fan[k].opposite[1])
      {
        std::swap(fan[k + 1], fan[l]);
        break;
      }
}

/// Chain the entries of a plane fan counter-clockwise: the end of one is the begin of the next, as far as
/// that is possible.
void chain(std::span<FanEntry<2>> fan)
{
  // Around most nodes the chain closes wherever it begins. An open fan begins where no other entry ends.
  if (constexpr std::size_t few = 12; fan.size() <= few)
  {
    std::array<FanEntry<2>, few> trial;
    std::copy(fan.begin(), fan.end(), trial.begin());
    const std::span<FanEntry<2>> closed(trial.data(), fan.size());
    follow(closed);
    if (is_closed(closed))
      return static_cast<void>(std::copy(closed.begin(), closed.end(), fan.begin()));
  }
  for (std::size_t k = 0; k < fan.size(); ++k)
  {
    const bool follows = std::any_of(fan.begin(), fan.end(),
                                     [&](const auto& f) { return f.opposite[1] == fan[k].opposite[0]; });
    if (!follows)
    {
      std::swap(fan[0], fan[k]);
      break;
    }
  }
  follow(fan);
}

/// Of a mesh whose fans are chained.
void find_rings(FluidMesh<2>& mesh, int threads)
{
  const auto n_nodes = static_cast<std::size_t>(mesh.end_with_fan() - mesh.first_with_fan);
  const std::size_t groups = (n_nodes + Lanes::size - 1) / Lanes::size;
  const auto each_neighbour = [&mesh](std::size_t k, auto&& visit)
  {
    const index_t n = mesh.first_with_fan + static_cast<index_t>(k);
    const auto fan = stored_fan(mesh, n);
    for (std::size_t f = 0; f < fan.size(); ++f)
    {
      visit(fan[f].opposite[0]);
      if (fan[f + 1 == fan.size() ? 0 : f + 1].opposite[0] != fan[f].opposite[1])
      {
        visit(fan[f].opposite[1]);
        visit(n);
      }
    }
    if (fan.empty())
      visit(n);
  };
  const auto each_node = [&](auto&& visit) // visit(k), the nodes of a group in one part
  {
    in_parts(threads, n_nodes, Lanes::size,
             [&](int, std::size_t begin, std::size_t end)
             {
               for (std::size_t k = begin; k < end; ++k)
                 visit(k);
             });
  };
  Rings& rings = mesh.rings;
  rings.begin.assign(groups + 1, 0);
  each_node(
      [&](std::size_t k)
      {
        index_t neighbours = 0;
        each_neighbour(k, [&neighbours](index_t) { ++neighbours; });
        index_t& most = rings.begin[k / Lanes::size + 1];
        most = std::max(most, neighbours);
      });
  for (std::size_t g = 0; g < groups; ++g)
    rings.begin[g + 1] += rings.begin[g];
  rings.row = UnwrittenRows<Rings::Row>();
  rings.row.resize(static_cast<std::size_t>(rings.begin.back()));
  if (groups > 0) // of which some may be no nodes
    std::fill(rings.row.begin() + rings.begin[groups - 1], rings.row.end(), Rings::Row{});
  each_node(
      [&](std::size_t k)
      {
        const std::size_t g = k / Lanes::size, lane = k % Lanes::size;
        auto row = static_cast<std::size_t>(rings.begin[g]);
        const std::size_t first = row, end = static_cast<std::size_t>(rings.begin[g + 1]);
        each_neighbour(k, [&](index_t j) { rings.row[row++][lane] = 2 * j; });
        for (; row < end; ++row)
          rings.row[row][lane] = rings.row[first][lane];
      });
}

/// Facets without a neighbour. In the plane the edge n → opposite[0] is one if no entry of n's fan ends where
/// it begins; in space facets are matched by sorting.
template <int dim>
std::vector<Facet<dim>> boundary_of(const FluidMesh<dim>& mesh, index_t begin, index_t end, int threads)
{
  std::vector<Facet<dim>> boundary;
  if constexpr (dim == 2)
  {
    const auto look_at = [&mesh](index_t n, std::vector<Facet<2>>& list)
    {
      const auto fan = stored_fan(mesh, n);
      for (std::size_t k = 0; k < fan.size(); ++k)
      {
        const std::size_t before =
            k == 0 ? fan.size() - 1 : k - 1; // chained fans: the neighbour is mostly here
        const bool has_neighbour =
            fan[before].opposite[1] == fan[k].opposite[0] ||
            std::any_of(fan.begin(), fan.end(),
                        [&](const auto& f) { return f.opposite[1] == fan[k].opposite[0]; });
        if (!has_neighbour)
          list.push_back({n, fan[k].opposite[0]});
      }
    };
    boundary = list_in_parts<Facet<2>>(threads, static_cast<std::size_t>(end - begin), 0,
                                       [&](std::vector<Facet<2>>& list, std::size_t low, std::size_t high)
                                       {
                                         for (std::size_t k = low; k < high; ++k)
                                           look_at(begin + static_cast<index_t>(k), list);
                                       });
  }
  else
  {
    struct OrientedFacet
    {
      Facet<dim> sorted, outward;
    };
    std::vector<OrientedFacet> facets;
    facets.reserve(mesh.fans.size());
    for (index_t n = begin; n < end; ++n)
      for (const auto& entry : mesh.fan(n))
      {
        const Simplex<dim> nodes =
            canonical<dim>({n, entry.opposite[0], entry.opposite[1], entry.opposite[2]});
        for (int a = 0; a <= dim; ++a)
        {
          const Facet<dim> facet = facet_opposite<dim>(nodes, a);
          if (nodes[static_cast<std::size_t>(a)] == n || *std::min_element(facet.begin(), facet.end()) != n)
            continue;
          facets.push_back({facet, facet});
          std::sort(facets.back().sorted.begin(), facets.back().sorted.end());
        }
      }
    std::sort(facets.begin(), facets.end(), [](const auto& f, const auto& g) { return f.sorted < g.sorted; });
    for (std::size_t f = 0; f < facets.size(); ++f)
    {
      const bool shared_before = f > 0 && facets[f - 1].sorted == facets[f].sorted;
      const bool shared_after = f + 1 < facets.size() && facets[f + 1].sorted == facets[f].sorted;
      if (!shared_before && !shared_after)
        boundary.push_back(facets[f].outward);
    }
  }
  return boundary;
}

} // namespace

template <int dim>
std::vector<Simplex<dim>> sorted_elements(std::vector<Simplex<dim>> elements, int threads)
{
  if (elements.empty())
    return elements;
  struct Range
  {
    index_t lowest = std::numeric_limits<index_t>::max(), highest = std::numeric_limits<index_t>::min();
  };
  std::vector<Range> range(static_cast<std::size_t>(threads)); // of the first corners, part by part
  const auto in_each_part = [&](auto&& act)
  {
    in_parts(threads, elements.size(),
             [&](int part, std::size_t begin, std::size_t end)
             { act(static_cast<std::size_t>(part), std::span(elements).subspan(begin, end - begin)); });
  };
  in_each_part(
      [&](std::size_t part, std::span<Simplex<dim>> these)
      {
        Range here;
        for (auto& e : these)
        {
          e = canonical<dim>(e);
          here.lowest = std::min(here.lowest, e[0]);
          here.highest = std::max(here.highest, e[0]);
        }
        range[part] = here;
      });
  Range all;
  for (const Range& here : range)
    all = {std::min(all.lowest, here.lowest), std::max(all.highest, here.highest)};
  // By the first corner with a count, then the few that share it.
  const auto keys = static_cast<std::size_t>(all.highest - all.lowest) + 1;
  const auto key = [&all](const Simplex<dim>& e) { return static_cast<std::size_t>(e[0] - all.lowest); };
  std::vector<std::vector<index_t>> next(range.size()); // place of the next element of a part with that key
  in_each_part(
      [&](std::size_t part, std::span<const Simplex<dim>> these)
      {
        next[part].resize(keys, 0);
        for (const auto& e : these)
          ++next[part][key(e)];
      });
  std::erase_if(next, [](const auto& counts) { return counts.empty(); });
  for (std::size_t k = 0, place = 0; k < keys; ++k)
    for (auto& counts : next)
      place += static_cast<std::size_t>(std::exchange(counts[k], static_cast<index_t>(place)));
  std::vector<Simplex<dim>> sorted(elements.size());
  in_each_part(
      [&](std::size_t part, std::span<const Simplex<dim>> these)
      {
        for (const auto& e : these)
          sorted[static_cast<std::size_t>(next[part][key(e)]++)] = e;
      });
  const auto& end_of = next.back(); // now of each key
  in_parts(threads, keys,
           [&](int, std::size_t begin, std::size_t end)
           {
             const auto first = sorted.begin() + (begin == 0 ? 0 : end_of[begin - 1]),
                        last = sorted.begin() + end_of[end - 1];
             for (auto it = first; it != last; ++it) // by insertion: not far
               for (auto at = it; at != first && *at < *(at - 1); --at)
                 std::iter_swap(at, at - 1);
           });
  return sorted;
}

std::array<std::size_t, 2> rows_of_rank(std::size_t n, const Ranks& ranks)
{
  const auto rank = static_cast<std::size_t>(ranks.rank()), size = static_cast<std::size_t>(ranks.size());
  return {n * rank / size, n * (rank + 1) / size};
}

template <int dim>
std::vector<Simplex<dim>> sorted_over_ranks(std::vector<Simplex<dim>> sorted, const Ranks& ranks)
{
  if (ranks.alone())
    return sorted;
  const auto size = static_cast<std::size_t>(ranks.size());
  constexpr std::size_t samples = 64; // of each rank
  std::vector<index_t> sample;
  for (std::size_t k = 0; k < samples && !sorted.empty(); ++k)
    sample.push_back(sorted[k * sorted.size() / samples][0]);
  sample = ranks.gather(sample);
  std::sort(sample.begin(), sample.end());
  std::vector<std::vector<Simplex<dim>>> parts(size);
  auto end = sorted.begin();
  for (std::size_t r = 0; r < size; ++r)
  {
    const auto begin = end;
    end = r + 1 == size || sample.empty()
              ? sorted.end()
              : sorted.begin() + first_element_from<dim>(sorted, sample[(r + 1) * sample.size() / size]);
    end = std::max(begin, end);
    parts[r].assign(begin, end);
  }
  parts = ranks.exchange(std::move(parts));
  sorted.clear();
  for (auto& part : parts)
  {
    if (sorted.empty())
    {
      sorted = std::move(part);
      continue;
    }
    // Mostly parts follow each other: only where they overlap there is something to merge.
    const auto middle = static_cast<std::ptrdiff_t>(sorted.size());
    sorted.insert(sorted.end(), part.begin(), part.end());
    if (const auto it = sorted.begin() + middle; it != sorted.end())
      std::inplace_merge(std::upper_bound(sorted.begin(), it, *it), it,
                         std::lower_bound(it, sorted.end(), *(it - 1)));
  }
  return sorted;
}

template <int dim>
index_t first_element_from(std::span<const Simplex<dim>> sorted, index_t n)
{
  return static_cast<index_t>(
      std::partition_point(sorted.begin(), sorted.end(), [n](const Simplex<dim>& e) { return e[0] < n; }) -
      sorted.begin());
}

template <int dim>
void find_fans(FluidMesh<dim>& mesh, index_t begin, index_t end, std::span<const index_t> earlier,
               index_t e_begin, index_t e_end, int threads)
{
  const std::span<const Simplex<dim>> elements(mesh.elements.data() + e_begin, mesh.elements.data() + e_end);
  const index_t reach = threads > 1 ? widest<dim>(elements) : 0; // of a node to the lowest one beside it
  const auto each_corner = [&](auto&& visit)                     // that is one of the nodes
  {
    in_parts(threads, static_cast<std::size_t>(end - begin),
             [&](int, std::size_t first, std::size_t last)
             {
               const index_t low = begin + static_cast<index_t>(first),
                             high = begin + static_cast<index_t>(last);
               const auto look = [&](index_t e)
               {
                 const auto& nodes = mesh.elements[static_cast<std::size_t>(e)];
                 for (int a = 0; a <= dim; ++a)
                   if (const index_t n = nodes[static_cast<std::size_t>(a)]; n >= low && n < high)
                     visit(e, a, static_cast<std::size_t>(n - begin));
               };
               std::for_each(earlier.begin(), earlier.end(), look);
               const index_t from = low > begin ? first_element_from<dim>(elements, low - reach) : 0,
                             to = high < end ? first_element_from<dim>(elements, high)
                                             : static_cast<index_t>(elements.size());
               for (index_t e = e_begin + from; e < e_begin + to; ++e)
                 look(e);
             });
  };
  mesh.first_with_fan = begin;
  auto& first = mesh.fan_begin;
  first.assign(static_cast<std::size_t>(end - begin) + 1, 0);
  each_corner([&](index_t, int, std::size_t k) { ++first[k + 1]; });
  for (std::size_t k = 1; k < first.size(); ++k)
    first[k] += first[k - 1];
  mesh.fans = UnwrittenRows<FanEntry<dim>>();
  mesh.fans.resize(static_cast<std::size_t>(first.back()));
  std::vector<index_t> next(first.begin(), first.end() - 1);
  each_corner(
      [&](index_t e, int a, std::size_t k)
      {
        mesh.fans[static_cast<std::size_t>(next[k]++)] = {
            facet_opposite<dim>(mesh.elements[static_cast<std::size_t>(e)], a)};
      });
  if constexpr (dim == 2)
  {
    in_parts(threads, next.size(),
             [&](int, std::size_t low, std::size_t high)
             {
               for (std::size_t k = low; k < high; ++k)
                 chain({mesh.fans.data() + first[k], mesh.fans.data() + first[k + 1]});
             });
    find_rings(mesh, threads);
  }
  mesh.boundary = boundary_of(mesh, begin, end, threads);
  if constexpr (dim == 2)
    mesh.fans = UnwrittenRows<FanEntry<dim>>();
}

template <int dim>
FluidMesh<dim> connect(index_t n_nodes, std::vector<Simplex<dim>> elements)
{
  FluidMesh<dim> mesh;
  mesh.elements = sorted_elements<dim>(std::move(elements));
  find_fans<dim>(mesh, 0, n_nodes, {}, 0, mesh.n_elements());
  return mesh;
}

template void find_fans<2>(FluidMesh<2>&, index_t, index_t, std::span<const index_t>, index_t, index_t, int);
template void find_fans<3>(FluidMesh<3>&, index_t, index_t, std::span<const index_t>, index_t, index_t, int);
template std::vector<Simplex<2>> sorted_elements<2>(std::vector<Simplex<2>>, int);
template std::vector<Simplex<3>> sorted_elements<3>(std::vector<Simplex<3>>, int);
template index_t first_element_from<2>(std::span<const Simplex<2>>, index_t);
template index_t first_element_from<3>(std::span<const Simplex<3>>, index_t);
template std::vector<Simplex<2>> sorted_over_ranks<2>(std::vector<Simplex<2>>, const Ranks&);
template std::vector<Simplex<3>> sorted_over_ranks<3>(std::vector<Simplex<3>>, const Ranks&);
template FluidMesh<2> connect<2>(index_t, std::vector<Simplex<2>>);
template FluidMesh<3> connect<3>(index_t, std::vector<Simplex<3>>);

} // namespace undine::fluid
