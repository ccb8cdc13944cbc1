// Eight elements side by side.
#pragma once

#include "common/lanes.hpp"
#include "fluid_pfem/fluid_mesh.hpp"

#include <algorithm>
#include <array>

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

} // namespace undine::fluid
