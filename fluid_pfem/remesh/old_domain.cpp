// Bin grid over the points that are asked for.
#include "fluid_pfem/remesh/old_domain.hpp"

#include "common/parallel/in_parts.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>

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
std::vector<char> inside(std::span<const Vec<dim>> x, std::span<const Simplex<dim>> elements,
                         std::span<const Vec<dim>> queries, double bin, const Period<dim>& period,
                         int threads)
{
  std::vector<char> found(queries.size(), 0);
  if (queries.empty())
    return found;
  Vec<dim> lower = queries[0], upper = queries[0];
  for (const auto& p : queries)
    for (int i = 0; i < dim; ++i)
    {
      lower[i] = std::min(lower[i], p[i]);
      upper[i] = std::max(upper[i], p[i]);
    }
  // Not more bins than a few per node, however far a drop has flown.
  double box = 1.0;
  for (int i = 0; i < dim; ++i)
    box *= (upper[i] - lower[i]) / bin + 1.0;
  bin *= std::max(1.0, std::pow(box / (4.0 * static_cast<double>(x.size()) + 64.0), 1.0 / dim));
  const double bins_per_length = 1.0 / bin;
  const auto cell_of = [&](const Vec<dim>& p)
  {
    std::array<long, dim> cell;
    for (std::size_t i = 0; i < dim; ++i)
      cell[i] = static_cast<long>(std::floor((p.c[i] - lower.c[i]) * bins_per_length));
    return cell;
  };
  std::array<long, dim> cells = cell_of(upper);
  std::size_t total = 1;
  for (long& count : cells)
    total *= static_cast<std::size_t>(++count);
  const auto bin_of = [&](const std::array<long, dim>& cell)
  {
    std::size_t b = 0;
    for (std::size_t i = 0; i < dim; ++i)
      b = b * static_cast<std::size_t>(cells[i]) + static_cast<std::size_t>(cell[i]);
    return b;
  };
  std::vector<index_t> begin(total + 1, 0), in_bin(queries.size());
  for (const auto& p : queries)
    ++begin[bin_of(cell_of(p)) + 1];
  for (std::size_t b = 0; b < total; ++b)
    begin[b + 1] += begin[b];
  std::vector<index_t> next(begin.begin(), begin.end() - 1);
  for (std::size_t q = 0; q < queries.size(); ++q)
    in_bin[static_cast<std::size_t>(next[bin_of(cell_of(queries[q]))]++)] = static_cast<index_t>(q);

  // Queries are near boundaries, most elements are not: where no query is within so many bins of its first
  // corner, an element that is no wider holds none.
  constexpr long wide = 2;
  std::vector<char> near(total, 0);
  const auto within = [&](std::array<long, dim> cell)
  {
    for (std::size_t i = 0; i < dim; ++i)
      cell[i] = std::clamp(cell[i], 0L, cells[i] - 1);
    return cell;
  };
  for (std::size_t b = 0; b < total; ++b)
    if (begin[b] < begin[b + 1])
    {
      std::array<long, dim>
          first = cell_of(queries[static_cast<std::size_t>(in_bin[static_cast<std::size_t>(begin[b])])]),
          last = first;
      for (std::size_t i = 0; i < dim; ++i)
      {
        first[i] -= wide + 1;
        last[i] += wide + 1;
      }
      for_each_cell<dim>(within(first), within(last), [&](const auto& cell) { near[bin_of(cell)] = 1; });
    }
  const auto is_far = [&](const std::array<Vec<dim>, dim + 1>& corner)
  {
    double width = 0.0;
    for (std::size_t a = 1; a <= dim; ++a)
      for (int i = 0; i < dim; ++i)
        width = std::max(width, std::abs(corner[a][i] - corner[0][i]));
    return width < wide * bin && !near[bin_of(within(cell_of(corner[0])))];
  };

  const auto look_at = [&](const std::array<Vec<dim>, dim + 1>& corner, std::vector<char>& seen)
  {
    if (is_far(corner))
      return;
    Vec<dim> low = corner[0], high = corner[0];
    for (const auto& p : corner)
      for (int i = 0; i < dim; ++i)
      {
        low[i] = std::min(low[i], p[i]);
        high[i] = std::max(high[i], p[i]);
      }
    // A point within round-off of the element counts: it must not matter where bins begin.
    for (int i = 0; i < dim; ++i)
    {
      const double margin = 1e-6 * (high[i] - low[i]) + 1e-9 * bin;
      low[i] -= margin;
      high[i] += margin;
      if (high[i] < lower[i] || low[i] > upper[i])
        return;
    }
    std::array<long, dim> first = cell_of(low), last = cell_of(high);
    bool beside = false;
    for (std::size_t i = 0; i < dim; ++i)
    {
      first[i] = std::max(first[i], 0L);
      last[i] = std::min(last[i], cells[i] - 1);
      beside = beside || first[i] > last[i];
    }
    if (beside)
      return;
    const double V = signed_volume<dim, double>(corner);
    if (!(V > 0.0))
      return;
    const double round_off = 1e-10 * V; // a point on the side of two elements lies in at least one
    for_each_cell<dim>(first, last,
                       [&](const auto& cell)
                       {
                         const std::size_t b = bin_of(cell);
                         for (index_t k = begin[b]; k < begin[b + 1]; ++k)
                         {
                           const auto q = static_cast<std::size_t>(in_bin[static_cast<std::size_t>(k)]);
                           bool within = !seen[q];
                           for (std::size_t a = 0; a <= dim && within; ++a)
                           {
                             auto moved = corner;
                             moved[a] = queries[q];
                             within = signed_volume<dim, double>(moved) >= -round_off;
                           }
                           if (within)
                             seen[q] = 1;
                         }
                       });
  };
  const auto shifts = period.shifts();
  std::vector<std::vector<char>> seen(static_cast<std::size_t>(threads));
  in_parts(threads, elements.size(),
           [&](int part, std::size_t first, std::size_t last)
           {
             auto& here = seen[static_cast<std::size_t>(part)];
             here.resize(queries.size(), 0);
             for (const auto& e : elements.subspan(first, last - first))
             {
               const auto corner = corners<dim>(x, e, period);
               for (const auto& shift : shifts) // the first is none
               {
                 auto image = corner;
                 for (auto& p : image)
                   p += shift;
                 look_at(image, here);
               }
             }
           });
  for (const auto& here : seen)
    for (std::size_t q = 0; q < here.size(); ++q)
      found[q] = static_cast<char>(found[q] | here[q]);
  return found;
}

template <int dim>
std::vector<char> inside(std::span<const Vec<dim>> x, std::span<const Simplex<dim>> elements,
                         std::span<const Vec<dim>> queries, double bin, const Period<dim>& period,
                         const Ranks& ranks, int threads)
{
  if (ranks.alone())
    return inside<dim>(x, elements, queries, bin, period, threads);
  struct Box
  {
    bool any = false;
    Vec<dim> lower, upper;
    bool holds(const Vec<dim>& p) const
    {
      bool within = any;
      for (int i = 0; i < dim; ++i)
        within = within && p[i] >= lower[i] && p[i] <= upper[i];
      return within;
    }
  };
  Box own;
  for (const auto& e : elements)
    for (const index_t n : e)
    {
      const Vec<dim>& p = x[static_cast<std::size_t>(n)];
      for (int i = 0; i < dim; ++i)
      {
        own.lower[i] = own.any ? std::min(own.lower[i], p[i]) : p[i];
        own.upper[i] = own.any ? std::max(own.upper[i], p[i]) : p[i];
      }
      own.any = true;
    }
  for (int i = 0; i < dim; ++i) // more than what counts as round-off
  {
    const double margin = 1e-3 * bin + 1e-5 * (own.upper[i] - own.lower[i]);
    own.lower[i] -= margin;
    own.upper[i] += margin;
  }
  const std::vector<Box> boxes = ranks.gather(std::vector{own});
  std::vector<std::vector<Vec<dim>>> asked(boxes.size());
  std::vector<std::vector<std::size_t>> number(boxes.size());
  for (std::size_t r = 0; r < boxes.size(); ++r)
    for (std::size_t q = 0; q < queries.size(); ++q)
      if (period.any() || boxes[r].holds(queries[q]))
      {
        asked[r].push_back(queries[q]);
        number[r].push_back(q);
      }
  asked = ranks.exchange(std::move(asked));
  std::vector<Vec<dim>> all;
  for (const auto& points : asked)
    all.insert(all.end(), points.begin(), points.end());
  const std::vector<char> answer = inside<dim>(x, elements, all, bin, period, threads);
  std::vector<std::vector<char>> answers(boxes.size());
  auto from = answer.begin();
  for (std::size_t r = 0; r < boxes.size(); ++r)
  {
    const auto end = from + static_cast<std::ptrdiff_t>(asked[r].size());
    answers[r].assign(from, end);
    from = end;
  }
  answers = ranks.exchange(std::move(answers));
  std::vector<char> found(queries.size(), 0);
  for (std::size_t r = 0; r < boxes.size(); ++r)
    for (std::size_t k = 0; k < number[r].size(); ++k)
      found[number[r][k]] = static_cast<char>(found[number[r][k]] | answers[r][k]);
  return found;
}

template std::vector<char> inside<2>(std::span<const Vec<2>>, std::span<const Simplex<2>>,
                                     std::span<const Vec<2>>, double, const Period<2>&, int);
template std::vector<char> inside<2>(std::span<const Vec<2>>, std::span<const Simplex<2>>,
                                     std::span<const Vec<2>>, double, const Period<2>&, const Ranks&, int);
template std::vector<char> inside<3>(std::span<const Vec<3>>, std::span<const Simplex<3>>,
                                     std::span<const Vec<3>>, double, const Period<3>&, const Ranks&, int);
template std::vector<char> inside<3>(std::span<const Vec<3>>, std::span<const Simplex<3>>,
                                     std::span<const Vec<3>>, double, const Period<3>&, int);

} // namespace undine::fluid
