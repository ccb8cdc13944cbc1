// Numbers for places in space, near each other where the places are.
#pragma once

#include "common/tensor.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace undine::fluid
{

/// Recursive coordinate bisection (Berger & Bokhari 1987): boxes are cut across their longest side at the
/// median of the points in them, and numbered along. Ranges of the numbers are compact, so that ranks which
/// take ranges of nodes have short cuts however many ranks there are, while the order of the nodes knows
/// nothing of ranks. It depends on the set of points only, not on their order.
template <int dim>
class Bisection
{
public:
  /// @param x points [m]
  /// @param in_a_box so many at most
  void build(std::span<const Vec<dim>> x, std::size_t in_a_box = 16);
  /// Number of the box in which a point lies, any point: the outermost boxes have no end.
  std::int64_t box_of(const Vec<dim>& x) const;

  template <class Archive>
  void for_each_state(Archive& archive)
  {
    archive("levels", levels_);
    archive("axis", axis_);
    archive("at", at_);
  }

private:
  void cut(std::size_t box, int level, std::span<Vec<dim>> x);

  int levels_ = 0;
  std::vector<int> axis_;  ///< across which box k is cut; its halves are 2k + 1 and 2k + 2
  std::vector<double> at_; ///< where [m]; what lies there belongs to the second half
};

} // namespace undine::fluid
