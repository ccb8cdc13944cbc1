// Rigid walls without a mesh: unilateral sliding contact of fluid nodes with planes, polylines and triangles
// that may move.
//
// A node whose trial position at the end of a step lies behind a wall gets the normal velocity that puts it
// exactly on the wall. It slides freely and is free to leave. The impulse m Δv is the wall's reaction. This
// is the half-step multiplier of the coupling with a wall of infinite mass.
#pragma once

#include "common/parallel/ranks.hpp"
#include "common/tensor.hpp"
#include "common/types.hpp"
#include "fluid_pfem/wall_geometry.hpp"
#include "fluid_pfem/wall_piece.hpp"

#include <algorithm>
#include <array>
#include <functional>
#include <limits>
#include <span>
#include <vector>

namespace undine::fluid
{

template <int dim>
class Walls
{
public:
  Walls() = default;
  /// @throws InputError for a wall with fewer than two points
  Walls(const std::vector<WallGeometry>& geometry, double spacing, double t);

  bool empty() const { return geometry_.empty(); }
  bool moves() const
  {
    return std::any_of(geometry_.begin(), geometry_.end(),
                       [](const WallGeometry& wall) { return wall.motion.moves(); });
  }
  const std::vector<WallPiece<dim>>& pieces() const { return path_.back().pieces; }
  const std::vector<WallGeometry>& geometry() const { return geometry_; }

  /// Move all pieces to time t [s].
  void move_to(double t) { move_to(std::span<const double>(&t, 1)); }
  /// Move all pieces to one time after the other [s]; contact() may then be asked about each of these moves.
  void move_to(std::span<const double> times);

  /// Nodes near walls among [begin, end), as candidates for contact until something has moved by `margin`
  /// [m]: in blocks of consecutive nodes, each until one of its own has. What contact does to a node does not
  /// depend on when they were found.
  void find_candidates(std::span<const Vec<dim>> x, index_t begin, index_t end, double margin,
                       int threads = 1);
  /// Beside the nodes of find_candidates, more of them, before and behind: from `begin` to `end` in all. They
  /// get blocks of their own, until the next call of either.
  void surround(std::span<const Vec<dim>> x, index_t begin, index_t end);
  /// Nodes of a block, at most.
  static constexpr index_t block_size = 256;
  /// First and one behind the last of the blocks of find_candidates; those of surround lie around them.
  std::array<index_t, 2> own_blocks() const { return own_blocks_; }
  /// That of node n.
  index_t block_of(index_t n) const;
  /// Some of its nodes may touch a wall before something has moved by the margin.
  bool has_candidates(index_t block) const
  {
    return !blocks_[static_cast<std::size_t>(block)].candidates.empty();
  }
  index_t end_of(index_t block) const { return blocks_[static_cast<std::size_t>(block)].end; }
  /// The nodes up to `end` and the rest of the block of the last of them: one behind it. Of nodes without a
  /// block `end` itself.
  index_t end_of_block(index_t end) const
  {
    const bool inside = !blocks_.empty() && end > blocks_.front().begin && end <= blocks_.back().end;
    return inside ? end_of(block_of(end - 1)) : end;
  }
  /// Correct v of candidates so that x + Δt v is on or before every wall at the time of move_to(). Adds to
  /// impulse() and work().
  /// @param m mass of each node [kg]
  /// @param a acceleration of the last instant; gets the wall's part, so that it is what the node really does
  /// [m/s²]
  /// @param dt_before the step before this one [s]
  /// @param constrain takes off a velocity what the surfaces that node n stays in do not allow; empty: all is
  /// allowed
  void contact(double dt, std::span<const Vec<dim>> x, std::span<Vec<dim>> v, std::span<const double> m,
               std::span<Vec<dim>> a, double dt_before,
               const std::function<void(Vec<dim>&, index_t)>& constrain = {})
  {
    reaction_.corrections.clear();
    for (index_t block = own_blocks_[0]; block < own_blocks_[1]; ++block)
      contact(block, 0, dt, x, v, m, a, dt_before, constrain, reaction_);
  }
  struct Correction
  {
    index_t node;
    Vec<dim> dv; ///< [m/s]
  };
  /// What contact did: work on the fluid [J], impulse on each wall [N s], changes of velocities.
  struct Reaction
  {
    ExactSum work;
    std::vector<std::array<ExactSum, dim>> impulse;
    std::vector<Correction> corrections;

    Reaction& operator+=(const Reaction& other); ///< but for corrections
  };
  /// The same for the nodes of one block in one move of the last move_to(). Adds to `reaction`.
  void contact(index_t block, std::size_t move, double dt, std::span<const Vec<dim>> x, std::span<Vec<dim>> v,
               std::span<const double> m, std::span<Vec<dim>> a, double dt_before,
               const std::function<void(Vec<dim>&, index_t)>& constrain, Reaction& reaction) const;
  /// Of all contact since the start, but for corrections: those of whoever used it last.
  Reaction& reaction() { return reaction_; }
  /// For what is nobody's to count.
  Reaction no_reaction() const
  {
    Reaction none;
    none.impulse.resize(geometry_.size());
    return none;
  }
  /// Report the largest distance [m] that a node of the block moved meanwhile: its candidates are found anew,
  /// at the places `x`, when they are due.
  void has_moved(index_t block, std::size_t move, double distance, std::span<const Vec<dim>> x)
  {
    Block& b = blocks_[static_cast<std::size_t>(block)];
    b.moved += distance;
    if (b.moved > margin_ || after(move).moved - b.walls_moved > margin_)
      find_candidates(b, after(move), x);
  }

  /// Move points that are in a wall with a convex corner (an open wall: by less than a third of a spacing)
  /// onto it: what merging and splitting do to nodes there.
  void settle(std::span<Vec<dim>> x) const;

  /// There is a corner that the fluid can be around.
  bool has_convex() const { return has_convex_; }
  /// The centroid or the middle of an edge of the simplex is deeper than `depth` [m] in a wall.
  bool blocks(const std::array<Vec<dim>, dim + 1>& x, double depth) const;

  /// Pieces (flat faces in 3-D) on which x lies within `tolerance`, at most three.
  std::array<int, 3> pieces_at(const Vec<dim>& x, double tolerance) const;
  /// Part of `w` that points into walls which `x` lies on, within `tolerance` [m].
  Vec<dim> into_walls(const Vec<dim>& x, double tolerance, const Vec<dim>& w) const;

  /// Work of contact on the fluid [J] and impulse on each wall [N s] since the start: sums without an order,
  /// the second over all ranks. Collective.
  const ExactSum& work() const { return reaction_.work; }
  std::vector<Vec<dim>> impulse(const Ranks& ranks = {}) const;
  /// All sums, to be added up over ranks.
  std::vector<ExactSum*> sums();
  template <class Archive>
  void for_each_state(Archive& archive)
  {
    path_.erase(path_.begin(), path_.end() - 2);
    archive("pieces", path_.back().pieces);
    archive("before", path_.front().pieces);
    for (ExactSum* sum : sums())
      sum->normalise();
    archive("work", reaction_.work);
    archive("impulse", reaction_.impulse);
  }

private:
  double depth_in(int wall, const Vec<dim>& x) const;
  bool is_solid(int wall, const Vec<dim>& x) const;

  struct Candidate
  {
    index_t node;
    int piece;
  };
  std::vector<WallGeometry> geometry_;
  /// Where the walls are at some time.
  struct Placement
  {
    std::vector<WallPiece<dim>> pieces;
    double moved = 0.0; ///< by the fastest corners until then [m]
  };
  void move(double t, const Placement& from, Placement& to) const;
  /// What a node crosses least in a move; no distance is above `none`: it crosses nothing.
  struct Crossing
  {
    static constexpr double none = std::numeric_limits<double>::lowest();
    std::size_t piece = 0;
    double distance = none; ///< at the end [m]
    double allowed = 0.0;   ///< [m]
  };
  Crossing least_crossed(std::span<const Candidate> candidates, const Placement& was, const Placement& now,
                         const Vec<dim>& x, const Vec<dim>& x_end) const;
  /// Before and after one of the moves of the last move_to().
  const Placement& before(std::size_t move) const { return path_[std::min(move, path_.size() - 2)]; }
  const Placement& after(std::size_t move) const { return path_[std::min(move + 1, path_.size() - 1)]; }
  std::vector<WallPiece<dim>> reference_; ///< as in the case
  /// At the begin of the last move_to() and after each of its moves; twice the same if they stand still.
  std::vector<Placement> path_ = std::vector<Placement>(2);
  struct Block
  {
    index_t begin = 0, end = 0;        ///< its nodes
    double moved = 0.0;                ///< by the fastest of them since their candidates were found [m]
    double walls_moved = 0.0;          ///< until then [m]
    std::vector<Candidate> candidates; ///< those of one node are adjacent
  };
  void find_candidates(Block& block, const Placement& walls, std::span<const Vec<dim>> x) const;
  void add_blocks(std::span<const Vec<dim>> x, index_t begin, index_t end, int threads = 1);
  std::vector<Block> blocks_;
  std::array<index_t, 2> own_blocks_{};
  Reaction reaction_;
  bool has_convex_ = false;
  double spacing_ = 0.0, margin_ = 0.0;
};

} // namespace undine::fluid
