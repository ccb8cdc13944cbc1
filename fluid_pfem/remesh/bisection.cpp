// Recursive coordinate bisection.
#include "fluid_pfem/remesh/bisection.hpp"

#include <algorithm>

namespace undine::fluid
{

template <int dim>
void Bisection<dim>::build(std::span<const Vec<dim>> x, std::size_t in_a_box)
{
  levels_ = 0;
  while ((x.size() >> levels_) > in_a_box)
    ++levels_;
  const std::size_t cuts = (std::size_t{1} << levels_) - 1;
  axis_.assign(cuts, 0);
  at_.assign(cuts, 0.0);
  std::vector<Vec<dim>> points(x.begin(), x.end());
  cut(0, 0, points);
}

template <int dim>
void Bisection<dim>::cut(std::size_t box, int level, std::span<Vec<dim>> x)
{
  if (level == levels_ || x.empty())
    return;
  Vec<dim> low = x[0], high = x[0];
  for (const Vec<dim>& p : x)
    for (int i = 0; i < dim; ++i)
    {
      low[i] = std::min(low[i], p[i]);
      high[i] = std::max(high[i], p[i]);
    }
  int axis = 0;
  for (int i = 1; i < dim; ++i)
    if (high[i] - low[i] > high[axis] - low[axis])
      axis = i;
  const auto middle = x.begin() + static_cast<std::ptrdiff_t>(x.size() / 2);
  std::nth_element(x.begin(), middle, x.end(),
                   [axis](const Vec<dim>& p, const Vec<dim>& q) { return p[axis] < q[axis]; });
  const double at = (*middle)[axis];
  const auto second =
      std::partition(x.begin(), middle, [axis, at](const Vec<dim>& p) { return p[axis] < at; });
  axis_[box] = axis;
  at_[box] = at;
  cut(2 * box + 1, level + 1, {x.begin(), second});
  cut(2 * box + 2, level + 1, {second, x.end()});
}

template <int dim>
std::int64_t Bisection<dim>::box_of(const Vec<dim>& x) const
{
  std::size_t box = 0;
  for (int level = 0; level < levels_; ++level)
    box = 2 * box + (x[axis_[box]] < at_[box] ? 1 : 2);
  return static_cast<std::int64_t>(box + 1 - (std::size_t{1} << levels_));
}

template class Bisection<2>;
template class Bisection<3>;

} // namespace undine::fluid
