// In which order the nodes are numbered, and with them the sums.
#include "fluid_pfem/fluid.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace undine::fluid
{

namespace
{

/// Rows from the one of number `sorted` on, taken in the order of `tail`, come to lie before the rows
/// `place`, which do not descend.
template <class T>
void merge_tail(std::vector<T>& field, std::ptrdiff_t sorted, const std::vector<index_t>& tail,
                const std::vector<index_t>& place)
{
  std::vector<T> added;
  for (const index_t n : tail)
    added.push_back(field[static_cast<std::size_t>(n)]);
  auto end = field.begin() + sorted; // of what has still to move
  for (auto k = static_cast<std::ptrdiff_t>(tail.size()); k-- > 0;)
  {
    const auto from = field.begin() + place[static_cast<std::size_t>(k)];
    std::move_backward(from, end, end + k + 1);
    end = from;
    end[k] = added[static_cast<std::size_t>(k)];
  }
}

template <class T>
void permute(std::vector<T>& field, const std::vector<index_t>& old_of_new)
{
  std::vector<T> result;
  result.reserve(field.size());
  for (const index_t n : old_of_new)
    result.push_back(field[static_cast<std::size_t>(n)]);
  field = std::move(result);
}

} // namespace

/// Nodes of a box of the order, at most. In the plane a step goes along rows: in boxes of 4096 it takes 1.15
/// times as long, in boxes of 64 1.9 times.
template <int dim>
constexpr std::size_t in_a_box = dim == 2 ? 16384 : 16;

/// The axis along which the fluid extends furthest; another one than now only if it is clearly longer. Rows
/// across it are short, and so are the cuts between ranks. Collective, unless held is null.
/// @param held as of order_nodes
template <int dim>
void Fluid<dim>::choose_slow_axis(const std::vector<index_t>* held)
{
  const auto sums_over_nodes = [&](auto&& terms) // a sum of all nodes for each axis
  {
    std::array<ExactSum, dim> sums;
    const auto add = [&](index_t n)
    {
      if (n < 0)
        return;
      const Vec<dim> term = terms(nodes_.x[static_cast<std::size_t>(n)]);
      for (std::size_t i = 0; i < dim; ++i)
        sums[i].add(term.c[i]);
    };
    if (held)
      std::for_each(held->begin(), held->end(), add);
    else
      for (index_t n = 0; n < nodes_.size(); ++n)
        add(n);
    Vec<dim> values;
    for (int i = 0; i < dim; ++i)
    {
      if (held)
        ranks().sum({&sums[static_cast<std::size_t>(i)]});
      values[i] = sums[static_cast<std::size_t>(i)].value();
    }
    return values;
  };
  const Vec<dim> mean =
      (1.0 / static_cast<double>(nodes_.size())) * sums_over_nodes([](const Vec<dim>& x) { return x; });
  const Vec<dim> square = sums_over_nodes(
      [&mean](const Vec<dim>& x)
      {
        Vec<dim> off = x - mean;
        for (int i = 0; i < dim; ++i)
          off[i] *= off[i];
        return off;
      });
  for (int i = 0; i < dim; ++i)
    if (square[i] > 1.5 * square[slow_axis_])
      slow_axis_ = i;
}

/// Rows of two spacings, the longest axis slowest: short to look up, and in the plane up to eight ranks with
/// cuts as short as any. Or boxes, whose ranges stay compact (docs/benchmarks/scaling.md): in space of few
/// nodes, in the plane of many, in rows.
template <int dim>
std::int64_t Fluid<dim>::row_of(const Vec<dim>& x) const
{
  std::int64_t row = in_boxes() ? boxes_.box_of(x) : 0;
  if (dim == 3 && in_boxes())
    return row;
  for (int k = 0; k < dim; ++k)
  {
    const int i = (slow_axis_ + dim - k) % dim;
    constexpr double most = 1 << 19; // 20 bits per axis
    const double place = std::floor(x[i] / (2.0 * config_.element_size));
    row = (row << 20) + static_cast<std::int64_t>(std::clamp(place, -most, most - 1.0));
  }
  return row;
}

/// All nodes get rows anew, from where they are. Collective.
/// @param held as of order_nodes
template <int dim>
void Fluid<dim>::renew_rows(const std::vector<index_t>* held)
{
  const auto of_all = [&](auto&& value) // of each node, from whoever has its row
  {
    std::vector<decltype(value(0))> values(nodes_.x.size()), known;
    if (!held)
    {
      for (std::size_t n = 0; n < values.size(); ++n)
        values[n] = value(n);
      return values;
    }
    std::vector<index_t> numbers;
    for (const index_t n : *held)
      if (n >= 0)
      {
        numbers.push_back(n);
        known.push_back(value(static_cast<std::size_t>(n)));
      }
    numbers = ranks().gather(numbers);
    known = ranks().gather(known);
    for (std::size_t k = 0; k < numbers.size(); ++k)
      values[static_cast<std::size_t>(numbers[k])] = known[k];
    return values;
  };
  choose_slow_axis(held);
  if (in_boxes())
    boxes_.build(of_all([this](std::size_t n) { return nodes_.x[n]; }), in_a_box<dim>);
  nodes_.row = of_all([this](std::size_t n) { return row_of(nodes_.x[n]); });
}

/// Wet nodes first, then their neighbours, then the rest; inside each group by row_of, then by identifier.
/// Rows are those of a node's birth or of the last time that all were renewed: neighbours in space should be
/// neighbours in memory, but need not be every time. The order is
/// one of the nodes, whoever holds them, and with it the order in which elements are summed. Collective.
/// @param elements of this rank
/// @param held numbers of nodes whose rows are right here: those of all ranks are all nodes; −1: deleted;
/// null: all
/// @returns the new number of each node, empty if numbers stay
template <int dim>
std::vector<index_t> Fluid<dim>::order_nodes(std::vector<Simplex<dim>>& elements,
                                             const std::vector<index_t>* held)
{
  const auto n_nodes = static_cast<std::size_t>(nodes_.size());
  const bool renew = rows_are_due();
  if (renew)
    renew_rows(held);
  const std::vector<char> group = wet_groups(elements, held);
  index_t sorted = nodes_.size(); // those before it are in order, unless all rows are new or groups may be
  while (sorted > 0 && nodes_.row[static_cast<std::size_t>(sorted - 1)] == no_row)
    --sorted;
  const bool tail_only = !renew && group.empty();
  for (auto n = static_cast<std::size_t>(tail_only ? sorted : 0); n < n_nodes; ++n)
    if (nodes_.row[n] == no_row)
      nodes_.row[n] = row_of(nodes_.x[n]);

  const auto before = [&](index_t a, index_t b)
  {
    const auto n = static_cast<std::size_t>(a), m = static_cast<std::size_t>(b);
    if (!group.empty() && group[n] != group[m])
      return group[n] < group[m];
    return nodes_.row[n] != nodes_.row[m] ? nodes_.row[n] < nodes_.row[m] : nodes_.id[n] < nodes_.id[m];
  };
  if (!tail_only)
  {
    sorted = 1;
    while (sorted < nodes_.size() && !before(sorted, sorted - 1))
      ++sorted;
  }
  if (sorted >= nodes_.size())
    return {};
  std::vector<index_t> new_of_old(n_nodes);
  const auto take_numbers = [&]
  {
    delaunay_.renumber(new_of_old);
    for (auto& e : elements)
      for (index_t& n : e)
        n = new_of_old[static_cast<std::size_t>(n)];
    return new_of_old;
  };
  const auto move_rows = [&](auto&& move) // of fields of owners, only those that are right here
  {
    nodes_.for_each_field_of_all([&](const char*, auto& field) { move(field); });
    nodes_.for_each_field_of_owners(
        [&](const char*, auto& field)
        {
          if (held)
            renumber_rows(field, *held, new_of_old, n_nodes);
          else if (!field.empty()) // as some are until there is a mesh
            move(field);
        });
  };
  if (tail_only)
  {
    std::vector<index_t> tail(n_nodes - static_cast<std::size_t>(sorted)),
        all(static_cast<std::size_t>(sorted)), place;
    std::iota(tail.begin(), tail.end(), sorted);
    std::sort(tail.begin(), tail.end(), before);
    std::iota(all.begin(), all.end(), 0);
    for (const index_t n : tail)
      place.push_back(
          static_cast<index_t>(std::upper_bound(all.begin(), all.end(), n, before) - all.begin()));
    for (std::size_t k = 0, n = 0; n < all.size() || k < tail.size();)
      if (k < tail.size() && static_cast<std::size_t>(place[k]) == n)
      {
        new_of_old[static_cast<std::size_t>(tail[k])] = static_cast<index_t>(n + k);
        ++k;
      }
      else
      {
        new_of_old[n] = static_cast<index_t>(n + k);
        ++n;
      }
    move_rows([&](auto& field) { merge_tail(field, sorted, tail, place); });
    return take_numbers();
  }
  std::vector<index_t> old_of_new(n_nodes);
  std::iota(old_of_new.begin(), old_of_new.end(), 0);
  std::sort(old_of_new.begin() + sorted, old_of_new.end(), before);
  std::inplace_merge(old_of_new.begin(), old_of_new.begin() + sorted, old_of_new.end(), before);
  for (std::size_t n = 0; n < n_nodes; ++n)
    new_of_old[static_cast<std::size_t>(old_of_new[n])] = static_cast<index_t>(n);
  move_rows([&](auto& field) { permute(field, old_of_new); });
  return take_numbers();
}

/// 0 for wet nodes, 1 for their neighbours, 2 for the rest; empty where there can be no wet ones. Collective.
/// @param elements, held as of order_nodes
template <int dim>
std::vector<char> Fluid<dim>::wet_groups(const std::vector<Simplex<dim>>& elements,
                                         const std::vector<index_t>* held)
{
  n_wet_ = n_layer_ = 0;
  travel_ = 0.0;
  if (wet_mask_ == 0 && solid_.empty())
    return {};
  const auto n_nodes = nodes_.x.size();
  std::vector<char> group(n_nodes, 2);
  // Nodes that an element of some rank finds, each once from every rank.
  const auto put = [&](char found, auto&& finds)
  {
    std::vector<index_t> nodes;
    for (const auto& e : elements)
      for (const index_t n : e)
        if (char& g = group[static_cast<std::size_t>(n)]; g > found && finds(e, n))
        {
          g = found;
          nodes.push_back(n);
        }
    for (const index_t n : ranks().gather(nodes))
      group[static_cast<std::size_t>(n)] = std::min(group[static_cast<std::size_t>(n)], found);
  };
  put(0, [&](const Simplex<dim>&, index_t n)
      { return (nodes_.surface[static_cast<std::size_t>(n)] & wet_mask_) != 0; });
  std::vector<index_t> near;
  const auto look_at = [&](index_t n)
  {
    if (n >= 0 && solid_.is_near(nodes_.x[static_cast<std::size_t>(n)], contact_reach * config_.element_size))
      near.push_back(n);
  };
  if (held)
    std::for_each(held->begin(), held->end(), look_at);
  else
    for (index_t n = 0; n < nodes_.size(); ++n)
      look_at(n);
  for (const index_t n : held ? ranks().gather(near) : near)
    group[static_cast<std::size_t>(n)] = 0;
  put(1,
      [&](const Simplex<dim>& e, index_t)
      {
        return std::any_of(e.begin(), e.end(),
                           [&](index_t n) { return group[static_cast<std::size_t>(n)] == 0; });
      });
  for (const char g : group)
  {
    n_wet_ += g == 0;
    n_layer_ += g <= 1;
  }
  return group;
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
