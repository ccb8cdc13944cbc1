// METIS, on the graph in which the vertices that belong together are one.
#include "common/parallel/partition.hpp"

#include "common/error.hpp"

#include <metis.h>

#include <algorithm>
#include <cstdint>
#include <numeric>

namespace undine
{

namespace
{

constexpr int least_vertices = 8; ///< of a part; METIS is made for more, below it parts are stretches

/// A graph as METIS takes it.
struct Weighted
{
  std::vector<idx_t> offset{0}, neighbour, edge, work;
};

/// Vertices that are `one` become vertex 0 (if there are any), the others keep their order. new_number: of
/// each vertex.
Weighted joined(const Graph& graph, std::span<const char> one, std::vector<int>& new_number)
{
  const auto n = static_cast<std::size_t>(graph.size());
  new_number.assign(n, 0);
  const auto is_one = [&](std::size_t k) { return !one.empty() && one[k] != 0; };
  const bool any = std::any_of(one.begin(), one.end(), [](char c) { return c != 0; });
  int next = any ? 1 : 0;
  for (std::size_t k = 0; k < n; ++k)
    if (!is_one(k))
      new_number[k] = next++;

  Weighted result;
  result.work.assign(static_cast<std::size_t>(next), 0);
  std::vector<idx_t> of_one, weight_of_one; // neighbours of vertex 0
  std::vector<idx_t> rest, edges, ends;
  for (std::size_t k = 0; k < n; ++k)
  {
    result.work[static_cast<std::size_t>(new_number[k])] += graph.work[k];
    if (is_one(k))
      continue;
    idx_t to_one = 0;
    for (int j = graph.offset[k]; j < graph.offset[k + 1]; ++j)
    {
      const auto other = static_cast<std::size_t>(graph.neighbour[static_cast<std::size_t>(j)]);
      if (is_one(other))
        ++to_one;
      else
      {
        rest.push_back(new_number[other]);
        edges.push_back(1);
      }
    }
    if (to_one > 0)
    {
      rest.push_back(0);
      edges.push_back(to_one);
      of_one.push_back(new_number[k]);
      weight_of_one.push_back(to_one);
    }
    ends.push_back(static_cast<idx_t>(rest.size()));
  }
  result.neighbour = std::move(of_one);
  result.edge = std::move(weight_of_one);
  const auto shift = static_cast<idx_t>(result.neighbour.size());
  if (any)
    result.offset.push_back(shift);
  for (const idx_t end : ends)
    result.offset.push_back(shift + end);
  result.neighbour.insert(result.neighbour.end(), rest.begin(), rest.end());
  result.edge.insert(result.edge.end(), edges.begin(), edges.end());
  return result;
}

/// Part of each vertex.
std::vector<idx_t> parts_of(Weighted& graph, int parts)
{
  auto n = static_cast<idx_t>(graph.work.size());
  std::vector<idx_t> part(graph.work.size(), 0);
  if (parts == 1 || n == 0)
    return part;
  if (n < least_vertices * parts || graph.neighbour.empty())
  {
    for (idx_t k = 0; k < n; ++k)
      part[static_cast<std::size_t>(k)] = k * parts / std::max<idx_t>(n, parts);
    return part;
  }
  std::vector<idx_t> options(METIS_NOPTIONS);
  METIS_SetDefaultOptions(options.data());
  options[METIS_OPTION_SEED] = 1;
  idx_t constraints = 1, cut = 0, wanted = parts;
  const int answer = METIS_PartGraphKway(&n, &constraints, graph.offset.data(), graph.neighbour.data(),
                                         graph.work.data(), nullptr, graph.edge.data(), &wanted, nullptr,
                                         nullptr, options.data(), &cut, part.data());
  require(answer == METIS_OK, "METIS divides a graph");
  return part;
}

} // namespace

std::vector<int> partition(const Graph& graph, std::span<const char> together, int parts)
{
  require(together.empty() || together.size() == graph.work.size(), "a mark for each vertex");
  const auto n = graph.work.size();
  std::int64_t whole = 0, marked = 0;
  for (std::size_t k = 0; k < n; ++k)
  {
    whole += graph.work[k];
    marked += !together.empty() && together[k] != 0 ? graph.work[k] : 0;
  }
  std::vector<int> number, part(n, 0);
  auto weighted = joined(graph, together, number);
  if (marked == 0)
  {
    const auto found = parts_of(weighted, parts);
    std::copy(found.begin(), found.end(), part.begin());
    return part;
  }
  if (parts == 1)
    return part;
  if (marked * parts < whole)
  {
    const auto found = parts_of(weighted, parts);
    for (std::size_t k = 0; k < n; ++k) // that of vertex 0 becomes part 0
    {
      const auto p = found[static_cast<std::size_t>(number[k])];
      part[k] = static_cast<int>(p == found[0] ? 0 : p == 0 ? found[0] : p);
    }
    return part;
  }
  // Part 0 has enough: the others share the rest.
  Weighted rest;
  rest.work.assign(weighted.work.begin() + 1, weighted.work.end());
  for (std::size_t k = 1; k < weighted.work.size(); ++k)
  {
    for (idx_t j = weighted.offset[k]; j < weighted.offset[k + 1]; ++j)
      if (const idx_t other = weighted.neighbour[static_cast<std::size_t>(j)]; other > 0)
      {
        rest.neighbour.push_back(other - 1);
        rest.edge.push_back(1);
      }
    rest.offset.push_back(static_cast<idx_t>(rest.neighbour.size()));
  }
  const auto found = parts_of(rest, parts - 1);
  for (std::size_t k = 0; k < n; ++k)
    if (number[k] > 0)
      part[k] = 1 + static_cast<int>(found[static_cast<std::size_t>(number[k]) - 1]);
  return part;
}

} // namespace undine
