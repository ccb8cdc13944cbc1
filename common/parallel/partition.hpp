// Parts of a graph with like work and short borders.
#pragma once

#include <span>
#include <vector>

namespace undine
{

/// A graph without loops: the neighbours of vertex k are neighbour[offset[k]] … neighbour[offset[k + 1] − 1],
/// and every edge is there from both of its ends.
struct Graph
{
  std::vector<int> offset{0}; ///< size vertices + 1
  std::vector<int> neighbour;
  std::vector<int> work; ///< of each vertex, positive

  int size() const { return static_cast<int>(work.size()); }
};

/// Part 0 … parts − 1 of each vertex, so that parts have like work and few edges between them (METIS, k-way,
/// always from the same seed). All vertices that are marked in `together` (size of the graph, or empty) go to
/// part 0, with as many others as fit. There may be parts without vertices.
std::vector<int> partition(const Graph& graph, std::span<const char> together, int parts);

} // namespace undine
