// Eight elements side by side.
#pragma once

#include "common/lanes.hpp"
#include "fluid_pfem/fluid_mesh.hpp"

#include <algorithm>
#include <array>
#include <span>

namespace undine::fluid
{

/// Simplices list[first] … of a list that ends at `end` (null: first …); the last is repeated.
template <int dim>
class EightElements
{
public:
  EightElements(std::span<const Simplex<dim>> simplices, const index_t* list, index_t first, index_t end)
      : at_(simplices.data() + first)
  {
    if (list == nullptr && first + Lanes::size <= end)
      return;
    for (index_t l = 0; l < Lanes::size; ++l)
    {
      const index_t k = std::min(first + l, end - 1);
      copy_[static_cast<std::size_t>(l)] = simplices[static_cast<std::size_t>(list == nullptr ? k : list[k])];
    }
    at_ = copy_.data();
  }
  EightElements(const EightElements&) = delete;
  EightElements& operator=(const EightElements&) = delete;

  const Simplex<dim>& operator[](std::size_t l) const { return at_[l]; }

private:
  const Simplex<dim>* at_;
  std::array<Simplex<dim>, Lanes::size> copy_;
};

/// The same elements, of which the compiler knows nothing: it loads their numbers once more where they are
/// used next, instead of keeping them on the stack for branches that are seldom taken.
template <int dim>
const Simplex<dim>* once_more(const EightElements<dim>& elements)
{
  const Simplex<dim>* at = &elements[0];
  asm("" : "+r"(at));
  return at;
}

/// Where one corner of each of the eight is.
template <int dim>
void load_points(const Vec<dim>* x, const EightElements<dim>& element, std::size_t corner,
                 Vec<dim, Lanes>& points)
{
  if constexpr (dim == 2)
  {
    const double* row[Lanes::size];
    for (std::size_t l = 0; l < Lanes::size; ++l)
      row[l] = x[element[l][corner]].c.data();
    load_pairs(row, points[0], points[1]);
  }
  else
    for (std::size_t l = 0; l < Lanes::size; ++l)
      for (int i = 0; i < dim; ++i)
        points[i].set(static_cast<int>(l), x[element[l][corner]][i]);
}

/// The corners of each of the eight, in a periodic space the images next to the first.
template <int dim>
std::array<Vec<dim, Lanes>, dim + 1> corners(const Vec<dim>* x, const EightElements<dim>& element,
                                             const Period<dim>& period)
{
  std::array<Vec<dim, Lanes>, dim + 1> corner;
  for (std::size_t a = 0; a <= dim; ++a)
    load_points(x, element, a, corner[a]);
  period.join(corner);
  return corner;
}

/// Eight vectors whose numbers lie side by side: one after the other in the lanes of `rows`.
template <int dim>
Vec<dim, Lanes> columns_of(const std::array<Lanes, dim>& rows)
{
  Vec<dim, Lanes> column;
  if constexpr (dim == 2)
  {
    const Lanes::Numbers &first = rows[0].numbers(), &second = rows[1].numbers();
    column[0] = Lanes::Numbers(__builtin_shufflevector(first, second, 0, 2, 4, 6, 8, 10, 12, 14));
    column[1] = Lanes::Numbers(__builtin_shufflevector(first, second, 1, 3, 5, 7, 9, 11, 13, 15));
  }
  else
    for (int l = 0; l < Lanes::size; ++l)
      for (int i = 0; i < dim; ++i)
      {
        const int k = dim * l + i;
        column[i].set(l, rows[static_cast<std::size_t>(k / Lanes::size)][k % Lanes::size]);
      }
  return column;
}

/// The smallest and the largest of some numbers.
inline std::array<double, 2> range_of(std::span<const double> numbers)
{
  Lanes low(numbers.empty() ? 0.0 : numbers[0]), high = low;
  for (std::size_t k = 0; k < numbers.size(); k += Lanes::size)
  {
    const Lanes here =
        load_lanes(&numbers[k], static_cast<int>(std::min<std::size_t>(Lanes::size, numbers.size() - k)));
    low = min(low, here);
    high = max(high, here);
  }
  std::array<double, 2> range{low[0], high[0]};
  for (int l = 1; l < Lanes::size; ++l)
    range = {std::min(range[0], low[l]), std::max(range[1], high[l])};
  return range;
}

} // namespace undine::fluid
