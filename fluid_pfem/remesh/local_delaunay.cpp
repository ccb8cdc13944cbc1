// A triangulation of its own for each rank.
#include "fluid_pfem/remesh/local_delaunay.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numeric>

namespace undine::fluid
{

template <int dim>
std::vector<index_t> points_near(std::span<const Vec<dim>> x, std::span<const char> mine, double reach,
                                 const std::vector<index_t>* among)
{
  std::vector<index_t> near;
  const std::size_t count_of_points = among ? among->size() : x.size();
  const auto number = [&](std::size_t k) { return among ? static_cast<std::size_t>((*among)[k]) : k; };
  if (count_of_points == 0)
    return near;
  Vec<dim> lower = x[number(0)], upper = lower;
  for (std::size_t k = 0; k < count_of_points; ++k)
    for (int i = 0; i < dim; ++i)
    {
      lower[i] = std::min(lower[i], x[number(k)][i]);
      upper[i] = std::max(upper[i], x[number(k)][i]);
    }
  // Cells a little larger than a quarter of the reach, so that rounding cannot put what is in reach into the
  // fifth; larger still if a drop has flown far.
  double cell = 0.25 * reach * (1.0 + 1e-9);
  std::array<std::size_t, dim> cells{};
  const auto count = [&]
  {
    double total = 1.0;
    for (int i = 0; i < dim; ++i)
      total *= std::floor((upper[i] - lower[i]) / cell) + 1.0;
    return total;
  };
  while (count() > 4.0 * static_cast<double>(count_of_points) + 64.0)
    cell *= 2.0;
  const auto rings = static_cast<std::size_t>(std::ceil(reach / cell));
  std::size_t total = 1;
  for (std::size_t i = 0; i < dim; ++i)
  {
    cells[i] = static_cast<std::size_t>(std::floor((upper.c[i] - lower.c[i]) / cell)) + 1;
    total *= cells[i];
  }
  const auto cell_of = [&](const Vec<dim>& p)
  {
    std::size_t c = 0;
    for (std::size_t i = 0; i < dim; ++i)
      c = c * cells[i] +
          std::min(cells[i] - 1, static_cast<std::size_t>(std::floor((p.c[i] - lower.c[i]) / cell)));
    return c;
  };
  std::vector<char> marked(total, 0), wider(total);
  Vec<dim> own_lower = upper, own_upper = lower;
  for (std::size_t l = 0; l < count_of_points; ++l)
    if (const std::size_t n = number(l); mine[n])
    {
      marked[cell_of(x[n])] = 1;
      for (int i = 0; i < dim; ++i)
      {
        own_lower[i] = std::min(own_lower[i], x[n][i]);
        own_upper[i] = std::max(own_upper[i], x[n][i]);
      }
    }
  for (std::size_t i = dim, stride = 1; i-- > 0; stride *= cells[i])
  {
    std::fill(wider.begin(), wider.end(), 0);
    for (std::size_t c = 0; c < total; ++c)
      if (marked[c])
      {
        const std::size_t k = c / stride % cells[i];
        for (std::size_t l = k - std::min(k, rings); l <= std::min(k + rings, cells[i] - 1); ++l)
          wider[c + l * stride - k * stride] = 1;
      }
    marked.swap(wider);
  }
  const double margin = (static_cast<double>(rings) + 1.0) * cell; // beyond it nothing is marked
  const auto far = [&](const Vec<dim>& p)
  {
    bool outside = false;
    for (int i = 0; i < dim; ++i)
      outside = outside || p[i] < own_lower[i] - margin || p[i] > own_upper[i] + margin;
    return outside;
  };
  for (std::size_t l = 0; l < count_of_points; ++l)
    if (const std::size_t n = number(l); mine[n] || (!far(x[n]) && marked[cell_of(x[n])]))
      near.push_back(static_cast<index_t>(n));
  return near;
}

namespace
{

template <class T>
std::vector<T> rows_of(std::span<const T> field, const std::vector<index_t>& numbers)
{
  std::vector<T> rows;
  rows.reserve(numbers.size());
  for (const index_t n : numbers)
    rows.push_back(field[static_cast<std::size_t>(n)]);
  return rows;
}

} // namespace

template <int dim>
void LocalDelaunay<dim>::update(std::span<const Vec<dim>> x, std::span<const char> mine, double reach,
                                const std::vector<index_t>* among)
{
  if (mine.empty())
  {
    if (!whole_)
      forget();
    whole_ = true;
    return delaunay_.update(x, 2.0 * reach);
  }
  if constexpr (dim == 2)
  {
    const std::vector<index_t> needed = points_near<dim>(x, mine, reach, among);
    place_.resize(x.size(), -1);
    if (among && !whole_)
      leave_to(*among);
    if (whole_ || std::any_of(needed.begin(), needed.end(), [this](index_t n) { return here(n) < 0; }))
    {
      delaunay_.forget();
      whole_ = false;
      number_ = points_near<dim>(x, mine, spare * reach, among);
      place_.assign(x.size(), -1);
      for (std::size_t k = 0; k < number_.size(); ++k)
        place_[static_cast<std::size_t>(number_[k])] = static_cast<index_t>(k);
    }
    delaunay_.update(rows_of(x, number_), 2.0 * reach);
  }
  else // nothing is kept: no places
  {
    whole_ = false;
    number_ = points_near<dim>(x, mine, reach, among);
    delaunay_.update_around(rows_of(x, number_), rows_of(mine, number_), reach);
  }
}

/// Points that are not among these go: few, at the rim of what was taken before.
template <int dim>
void LocalDelaunay<dim>::leave_to(const std::vector<index_t>& among)
{
  std::vector<index_t> lost;
  std::set_difference(number_.begin(), number_.end(), among.begin(), among.end(), std::back_inserter(lost));
  if (lost.empty())
    return;
  std::vector<index_t> new_number(place_.size());
  std::iota(new_number.begin(), new_number.end(), 0);
  for (const index_t n : lost)
  {
    remove(n);
    new_number[static_cast<std::size_t>(n)] = -1;
  }
  renumber(new_number);
}

template <int dim>
std::vector<Simplex<dim>> LocalDelaunay<dim>::simplices(std::span<const char> mine) const
{
  std::vector<Simplex<dim>> simplices = delaunay_.simplices();
  if (whole_)
    return simplices;
  std::size_t kept = 0;
  for (Simplex<dim> e : simplices)
  {
    for (index_t& n : e)
      n = number_[static_cast<std::size_t>(n)];
    if (mine[static_cast<std::size_t>(*std::min_element(e.begin(), e.end()))])
      simplices[kept++] = canonical<dim>(e);
  }
  simplices.resize(kept);
  return simplices;
}

template <int dim>
void LocalDelaunay<dim>::forget()
{
  delaunay_.forget();
  number_ = std::vector<index_t>();
  place_ = std::vector<index_t>();
}

template <int dim>
void LocalDelaunay<dim>::merge(index_t kept, index_t gone)
{
  if (here(gone) >= 0)
    here(kept) >= 0 ? delaunay_.merge(here(kept), here(gone)) : delaunay_.remove(here(gone));
}

template <int dim>
void LocalDelaunay<dim>::split(index_t i, index_t j, index_t added)
{
  if (whole_)
    return delaunay_.split(i, j, added);
  if (here(i) < 0 || here(j) < 0)
    return;
  place_.resize(static_cast<std::size_t>(added) + 1, -1);
  const auto place = static_cast<index_t>(number_.size());
  number_.push_back(added);
  place_[static_cast<std::size_t>(added)] = place;
  delaunay_.split(here(i), here(j), place);
}

template <int dim>
void LocalDelaunay<dim>::remove(index_t gone)
{
  if (here(gone) >= 0)
    delaunay_.remove(here(gone));
}

template <int dim>
void LocalDelaunay<dim>::renumber(std::span<const index_t> new_number)
{
  if (whole_)
    return delaunay_.renumber(new_number);
  if (place_.empty())
    return;
  // Places stay in the order of the numbers: of points that coincide the one of the lowest number counts.
  place_.assign(new_number.size(), -1);
  for (std::size_t k = 0; k < number_.size(); ++k) // the old ones first
    if (const index_t n = new_number[static_cast<std::size_t>(number_[k])]; n >= 0)
      place_[static_cast<std::size_t>(n)] = static_cast<index_t>(k);
  std::vector<index_t> new_place(number_.size(), -1);
  number_.clear();
  for (std::size_t n = 0; n < place_.size(); ++n)
    if (index_t& k = place_[n]; k >= 0)
    {
      const auto now = static_cast<index_t>(number_.size());
      new_place[static_cast<std::size_t>(k)] = now;
      k = now;
      number_.push_back(static_cast<index_t>(n));
    }
  delaunay_.renumber(new_place);
}

template std::vector<index_t> points_near<2>(std::span<const Vec<2>>, std::span<const char>, double,
                                             const std::vector<index_t>*);
template std::vector<index_t> points_near<3>(std::span<const Vec<3>>, std::span<const char>, double,
                                             const std::vector<index_t>*);
template class LocalDelaunay<2>;
template class LocalDelaunay<3>;

} // namespace undine::fluid
