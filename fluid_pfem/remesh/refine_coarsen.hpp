// Merging nodes that come too close and splitting edges that grow too long, at constant mass and momentum.
#pragma once

#include "common/parallel/ranks.hpp"
#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/fluid_nodes.hpp"

#include <array>
#include <functional>
#include <span>
#include <vector>

namespace undine::fluid
{

/// Lengths in units of the wanted spacing.
struct SpacingRules
{
  double merge = 0.45;     ///< edges shorter than this lose a node
  double split = 1.7;      ///< inner edges longer than this get one
  double split_wall = 1.6; ///< the same for edges on a wall
};

struct SpacingReport
{
  index_t merged = 0, split = 0;
  double kinetic_lost = 0.0;                  ///< by merging velocities [J]
  std::vector<std::array<index_t, 2>> merges; ///< kept, gone; in the numbers before the change
  std::vector<std::array<index_t, 3>> splits; ///< the ends of the edge, the new node; likewise
  std::vector<index_t>
      involved; ///< likewise: nodes that may take part in a change, in order; empty if all are known
  std::vector<index_t> new_number; ///< −1: gone; empty if numbers stay
};

/// What one of several ranks looks at.
template <int dim>
struct ShareOfRank
{
  Ranks ranks;
  std::span<const Simplex<dim>> elements; ///< whose edges it measures; those of all ranks are the mesh's
  index_t node_begin = 0, node_end = 0;   ///< its nodes: their rows are right here,
  const std::vector<index_t>* known =
      nullptr; ///< and those of these, in order, its own among them; null: all
  int threads = 1;
};

/// Change the node set; the mesh is out of date afterwards. A merged node carries the sum of particle masses
/// and the mean momentum; a new node takes a third of the particle mass of each end of its edge. Wall nodes
/// are never merged into others; wet nodes (`n_wet` first) are left alone; an edge with both ends on the free
/// surface is not split. Each node takes part in one change at most.
/// Collective: every rank makes all changes; the rows of all `involved` nodes are right afterwards.
/// @param wall_pieces for each node the wall pieces it lies on; extended for new nodes
/// @param next_id next free node identifier
/// @param taken places where no node of the given spacing may be put: an edge with its middle there is not
/// split
template <int dim>
SpacingReport refine_and_coarsen(FluidNodes<dim>& nodes, const FluidMesh<dim>& mesh,
                                 std::vector<std::array<int, 3>>& wall_pieces, index_t n_wet,
                                 const SpacingRules& rules, global_index_t& next_id,
                                 const std::function<bool(const Vec<dim>&, double)>& taken = {},
                                 const ShareOfRank<dim>& share = {});

} // namespace undine::fluid
