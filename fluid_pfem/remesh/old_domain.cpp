// Bin grid over elements.
#include "fluid_pfem/remesh/old_domain.hpp"

#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace undine::fluid
{

namespace
{

template <int dim, class Visit>
void for_each_cell(const std::array<long, dim>& lower, const std::array<long, dim>& upper, Visit&& visit)
{
  std::array<long, dim> cell = lower;
  for (;;)
  {
    visit(cell);
    int i = 0;
    while (i < dim && ++cell[static_cast<std::size_t>(i)] > upper[static_cast<std::size_t>(i)])
    {
      cell[static_cast<std::size_t>(i)] = lower[static_cast<std::size_t>(i)];
      ++i;
    }
    if (i == dim)
      return;
  }
}

} // namespace

template <int dim>
OldDomain<dim>::OldDomain(std::span<const Vec<dim>> x, std::span<const Simplex<dim>> elements, double bin)
{
  Vec<dim> lower, upper;
  for (int i = 0; i < dim; ++i)
  {
    lower[i] = std::numeric_limits<double>::max();
    upper[i] = std::numeric_limits<double>::lowest();
  }
  for (const auto& e : elements)
  {
    std::array<Vec<dim>, dim + 1> corner;
    for (std::size_t a = 0; a < corner.size(); ++a)
      corner[a] = x[static_cast<std::size_t>(e[a])];
    const double V = signed_volume<dim, double>(corner);
    volume_ += V;
    if (!(V > 0.0))
      continue;
    elements_.push_back(corner);
    for (const auto& p : corner)
      for (int i = 0; i < dim; ++i)
      {
        lower[i] = std::min(lower[i], p[i]);
        upper[i] = std::max(upper[i], p[i]);
      }
  }
  if (elements_.empty())
    return;

  // Not more bins than a few per element, however far a drop has flown.
  double box = 1.0;
  for (int i = 0; i < dim; ++i)
    box *= std::max(upper[i] - lower[i], bin) / bin + 1.0;
  bin_ = bin * std::max(1.0, std::pow(box / (4.0 * static_cast<double>(elements_.size()) + 64.0), 1.0 / dim));
  origin_ = lower;
  std::size_t total = 1;
  for (int i = 0; i < dim; ++i)
  {
    cells_[static_cast<std::size_t>(i)] = static_cast<long>((upper[i] - lower[i]) / bin_) + 1;
    total *= static_cast<std::size_t>(cells_[static_cast<std::size_t>(i)]);
  }
  const auto range = [&](const std::array<Vec<dim>, dim + 1>& corner)
  {
    std::array<long, dim> first, last;
    for (int i = 0; i < dim; ++i)
    {
      double low = corner[0][i], high = corner[0][i];
      for (const auto& p : corner)
      {
        low = std::min(low, p[i]);
        high = std::max(high, p[i]);
      }
      const auto k = static_cast<std::size_t>(i);
      first[k] = std::clamp(static_cast<long>((low - origin_[i]) / bin_), 0L, cells_[k] - 1);
      last[k] = std::clamp(static_cast<long>((high - origin_[i]) / bin_), 0L, cells_[k] - 1);
    }
    return std::pair{first, last};
  };
  begin_.assign(total + 1, 0);
  for (const auto& corner : elements_)
  {
    const auto [first, last] = range(corner);
    for_each_cell<dim>(first, last, [&](const auto& cell) { ++begin_[bin_of(cell) + 1]; });
  }
  for (std::size_t b = 0; b < total; ++b)
    begin_[b + 1] += begin_[b];
  in_bin_.resize(static_cast<std::size_t>(begin_.back()));
  std::vector<index_t> next(begin_.begin(), begin_.end() - 1);
  for (std::size_t e = 0; e < elements_.size(); ++e)
  {
    const auto [first, last] = range(elements_[e]);
    for_each_cell<dim>(first, last,
                       [&](const auto& cell) {
                         in_bin_[static_cast<std::size_t>(next[bin_of(cell)]++)] = static_cast<index_t>(e);
                       });
  }
}

template <int dim>
std::size_t OldDomain<dim>::bin_of(const std::array<long, dim>& cell) const
{
  std::size_t b = 0;
  for (std::size_t i = 0; i < dim; ++i)
    b = b * static_cast<std::size_t>(cells_[i]) + static_cast<std::size_t>(cell[i]);
  return b;
}

template <int dim>
bool OldDomain<dim>::contains(const Vec<dim>& p) const
{
  if (elements_.empty())
    return false;
  std::array<long, dim> cell;
  for (int i = 0; i < dim; ++i)
  {
    const double s = (p[i] - origin_[i]) / bin_;
    const auto k = static_cast<std::size_t>(i);
    if (!(s >= 0.0) || s >= static_cast<double>(cells_[k]))
      return false;
    cell[k] = static_cast<long>(s);
  }
  const std::size_t b = bin_of(cell);
  for (index_t k = begin_[b]; k < begin_[b + 1]; ++k)
  {
    const auto& corner = elements_[static_cast<std::size_t>(in_bin_[static_cast<std::size_t>(k)])];
    bool inside = true;
    for (int a = 0; a <= dim && inside; ++a)
    {
      auto moved = corner;
      moved[static_cast<std::size_t>(a)] = p;
      inside = signed_volume<dim, double>(moved) >= 0.0;
    }
    if (inside)
      return true;
  }
  return false;
}

template class OldDomain<2>;
template class OldDomain<3>;

} // namespace undine::fluid
