// Points in nested boxes, to ask for the nearest one in some region.
#pragma once

#include "common/tensor.hpp"
#include "common/types.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <span>
#include <utility>
#include <vector>

namespace undine::fluid
{

/// Boxes that are halved across their longest side down to a few points, and points that may be taken out.
template <int dim>
class NestedBoxes
{
public:
  /// @param numbers of those of the points `x` that are put in; `x` must stay where it is
  NestedBoxes(std::span<const Vec<dim>> x, std::vector<index_t> numbers) : x_(x), numbers_(std::move(numbers))
  {
    if (!numbers_.empty())
      build(0, numbers_.size());
  }

  /// The nearest of the points for which `is_in(point)`, not further from a place than `reach` [m]; −1: none.
  /// @param may_meet (lower, upper) says no of boxes without such points
  template <class MayMeet, class IsIn>
  index_t nearest(const Vec<dim>& place, double reach, MayMeet&& may_meet, IsIn&& is_in) const
  {
    Found found{.square = reach * reach * (1.0 + 1e-12)};
    if (!boxes_.empty())
      look(0, place, found, may_meet, is_in);
    return found.slot < 0 ? -1 : numbers_[static_cast<std::size_t>(found.slot)];
  }

  void take_out(index_t n)
  {
    taken_.resize(x_.size(), 0);
    taken_[static_cast<std::size_t>(n)] = 1;
  }

private:
  static constexpr std::size_t few = 8; ///< points of a box that is not halved

  struct Box
  {
    Vec<dim> lower, upper;
    index_t begin, end;  ///< of its points, among the numbers
    index_t second = -1; ///< half; the first follows the box itself; −1: not halved
  };
  struct Found
  {
    double square; ///< of the distance [m²]
    index_t slot = -1;
  };

  const Vec<dim>& at(index_t slot) const
  {
    return x_[static_cast<std::size_t>(numbers_[static_cast<std::size_t>(slot)])];
  }

  void build(std::size_t begin, std::size_t end)
  {
    const std::size_t here = boxes_.size();
    Box box{.lower = at(static_cast<index_t>(begin)),
            .upper = at(static_cast<index_t>(begin)),
            .begin = static_cast<index_t>(begin),
            .end = static_cast<index_t>(end)};
    for (index_t k = box.begin; k < box.end; ++k)
      for (int i = 0; i < dim; ++i)
      {
        box.lower[i] = std::min(box.lower[i], at(k)[i]);
        box.upper[i] = std::max(box.upper[i], at(k)[i]);
      }
    boxes_.push_back(box);
    if (end - begin <= few)
      return;
    int longest = 0;
    for (int i = 1; i < dim; ++i)
      if (box.upper[i] - box.lower[i] > box.upper[longest] - box.lower[longest])
        longest = i;
    const std::size_t middle = begin + (end - begin) / 2;
    const auto number = [this](std::size_t k) { return numbers_.begin() + static_cast<std::ptrdiff_t>(k); };
    std::nth_element(
        number(begin), number(middle), number(end),
        [&](index_t a, index_t b)
        { return x_[static_cast<std::size_t>(a)][longest] < x_[static_cast<std::size_t>(b)][longest]; });
    build(begin, middle);
    boxes_[here].second = static_cast<index_t>(boxes_.size());
    build(middle, end);
  }

  double square_to(index_t b, const Vec<dim>& place) const
  {
    const Box& box = boxes_[static_cast<std::size_t>(b)];
    double square = 0.0;
    for (int i = 0; i < dim; ++i)
    {
      const double off = place[i] - std::clamp(place[i], box.lower[i], box.upper[i]);
      square += off * off;
    }
    return square;
  }

  template <class MayMeet, class IsIn>
  void look(index_t b, const Vec<dim>& place, Found& found, MayMeet& may_meet, IsIn& is_in) const
  {
    const Box& box = boxes_[static_cast<std::size_t>(b)];
    if (square_to(b, place) > found.square || !may_meet(box.lower, box.upper))
      return;
    if (box.second >= 0)
    {
      std::array<index_t, 2> half{b + 1, box.second};
      if (square_to(half[1], place) < square_to(half[0], place))
        std::swap(half[0], half[1]);
      for (const index_t h : half)
        look(h, place, found, may_meet, is_in);
      return;
    }
    for (index_t k = box.begin; k < box.end; ++k)
      if (const double square = norm_squared(at(k) - place);
          square <= found.square && !is_out(k) && may_meet(at(k), at(k)) && is_in(at(k)))
        found = {square, k};
  }
  bool is_out(index_t slot) const
  {
    return !taken_.empty() && taken_[static_cast<std::size_t>(numbers_[static_cast<std::size_t>(slot)])] != 0;
  }

  std::span<const Vec<dim>> x_;
  std::vector<index_t> numbers_;
  std::vector<Box> boxes_;
  std::vector<char> taken_; ///< of each point; empty: none
};

} // namespace undine::fluid
