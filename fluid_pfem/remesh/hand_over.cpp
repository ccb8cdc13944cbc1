// Where particle mass goes when a remesh moves volume from node to node.
#include "fluid_pfem/fluid.hpp"

#include "common/parallel/in_parts.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace undine::fluid
{

namespace
{

/// Patches of elements: nodes that share an element belong together.
template <int dim>
Patches patches_of(std::size_t n_nodes, const std::vector<Simplex<dim>>& elements)
{
  std::vector<index_t> leader(n_nodes, -1);
  const auto leader_of = [&](index_t n)
  {
    for (index_t up; (up = leader[static_cast<std::size_t>(n)]) != n; n = up)
      leader[static_cast<std::size_t>(n)] = leader[static_cast<std::size_t>(up)];
    return n;
  };
  for (const auto& e : elements)
  {
    index_t first = -1;
    for (const index_t n : e)
      if (n >= 0)
      {
        if (leader[static_cast<std::size_t>(n)] < 0)
          leader[static_cast<std::size_t>(n)] = n;
        const index_t root = leader_of(n);
        if (first >= 0) // the smaller number leads, so that the order does not matter
          leader[static_cast<std::size_t>(std::max(first, root))] = std::min(first, root);
        first = first < 0 ? root : std::min(first, root);
      }
  }
  Patches patches{.of = std::vector<index_t>(n_nodes, -1), .first = {}, .nodes = {}};
  for (std::size_t n = 0; n < n_nodes; ++n)
    if (leader[n] >= 0)
    {
      patches.nodes.push_back(static_cast<index_t>(n));
      const auto root = static_cast<std::size_t>(leader_of(static_cast<index_t>(n)));
      if (root == n)
      {
        patches.of[n] = static_cast<index_t>(patches.first.size());
        patches.first.push_back(static_cast<index_t>(n));
      }
      else
        patches.of[n] = patches.of[root];
    }
  return patches;
}

} // namespace

/// Elements that the old or the new mesh has alone, or that have been deformed by the remesh. Each rank looks
/// at those of which it has the lowest node. Collective.
/// @param old of this rank before the remesh, in the old numbers
/// @param moved by the remesh: of this rank's nodes and ghosts
/// @param number present number of each old node, −1: deleted
template <int dim>
std::vector<Simplex<dim>> Fluid<dim>::changed_elements(std::vector<Simplex<dim>> old,
                                                       std::span<const char> moved,
                                                       std::span<const index_t> number) const
{
  const int threads = team_.threads();
  bool same_numbers = openings_.empty(); // elements of an inlet are in no order
  for (std::size_t n = 0; n < number.size() && same_numbers; ++n)
    same_numbers = number[n] == static_cast<index_t>(n);
  if (!same_numbers)
    in_parts(threads, old.size(),
             [&](int, std::size_t begin, std::size_t end)
             {
               for (auto& e : std::span(old).subspan(begin, end - begin))
                 for (index_t& n : e)
                   n = number[static_cast<std::size_t>(n)];
             });
  std::span<const Simplex<dim>> now = mesh_.elements;
  std::vector<Simplex<dim>> earlier; // and before them
  if (!ranks().alone())
  {
    std::vector<std::vector<Simplex<dim>>> to(static_cast<std::size_t>(ranks().size()));
    const auto first = team_.nodes_of_ranks();
    std::size_t kept = 0;
    for (const auto& e : old)
    {
      const index_t lowest = std::max(0, *std::min_element(e.begin(), e.end())); // what is gone is rank 0's
      if (team_.owns(lowest))
        old[kept++] = e;
      else
        to[static_cast<std::size_t>(owner(first, lowest))].push_back(e);
    }
    old.resize(kept);
    const auto me = static_cast<std::ptrdiff_t>(ranks().rank());
    const auto parts = ranks().exchange(std::move(to));
    for (auto part = parts.begin(); part != parts.end(); ++part) // in the order of the ranks
      old.insert(part < parts.begin() + me ? old.end() - static_cast<std::ptrdiff_t>(kept) : old.end(),
                 part->begin(), part->end());
    for (const index_t e : team_.earlier())
      if (mesh_.elements[static_cast<std::size_t>(e)][0] >= team_.node_begin())
        earlier.push_back(mesh_.elements[static_cast<std::size_t>(e)]);
    now = own_elements();
    now = now.first(static_cast<std::size_t>(first_element_from<dim>(now, team_.node_end())));
  }
  if (!same_numbers)
    old = sorted_elements<dim>(std::move(old), threads);
  const auto has_moved = [&](index_t n) { return moved[static_cast<std::size_t>(n)] != 0; };
  const auto compare = [&](std::span<const Simplex<dim>> before, std::span<const Simplex<dim>> after,
                           std::vector<Simplex<dim>>& list)
  {
    auto o = before.begin();
    for (const auto& e : after)
    {
      while (o != before.end() && *o < e)
        list.push_back(*o++);
      const bool new_here = o == before.end() || e < *o;
      if (new_here || std::any_of(e.begin(), e.end(), has_moved))
        list.push_back(e);
      o += !new_here;
    }
    list.insert(list.end(), o, before.end());
  };
  const auto place = [&](const Simplex<dim>& e) // among the old ones
  { return static_cast<std::size_t>(std::lower_bound(old.begin(), old.end(), e) - old.begin()); };
  const std::size_t begin_of_now = earlier.empty() ? 0 : now.empty() ? old.size() : place(now.front());
  std::vector<Simplex<dim>> changed;
  compare(std::span(old).first(begin_of_now), earlier, changed);
  const auto later = list_in_parts<Simplex<dim>>(
      threads, now.size(), 0,
      [&](std::vector<Simplex<dim>>& list, std::size_t begin, std::size_t end)
      {
        const std::size_t from = begin == 0 ? begin_of_now : place(now[begin]),
                          to = end == now.size() ? old.size() : place(now[end]);
        compare(std::span(old).subspan(from, to - from), now.subspan(begin, end - begin), list);
      });
  changed.insert(changed.end(), later.begin(), later.end());
  return ranks().gather(changed);
}

/// Present nodes that are not where the remesh found them, among those that this rank had; with a node that
/// was merged, all ranks know. Collective.
/// @param number present number of each old node
template <int dim>
std::vector<index_t> Fluid<dim>::moved_nodes(const Particles<dim>& before, std::span<const index_t> number,
                                             const SpacingReport& spacing) const
{
  std::vector<index_t> moved;
  const auto has_moved = [&](index_t old)
  {
    const auto k = static_cast<std::size_t>(old - before.begin);
    return nodes_.x[static_cast<std::size_t>(number[static_cast<std::size_t>(old)])] != before.x[k];
  };
  const index_t end = before.begin + static_cast<index_t>(before.x.size());
  for (index_t old = before.begin; old < end; ++old)
    if (has_moved(old))
      moved.push_back(number[static_cast<std::size_t>(old)]);
  if (spacing.merges.empty())
    return moved;
  std::vector<index_t> merged;
  for (const auto& [kept, gone] : spacing.merges)
    if (gone >= before.begin && gone < end && has_moved(gone))
      merged.push_back(number[static_cast<std::size_t>(gone)]);
  merged = ranks().gather(merged);
  moved.insert(moved.end(), merged.begin(), merged.end());
  return moved;
}

/// New connectivity hands volume from node to node; particle mass goes with it, so that a remesh of quiet
/// fluid leaves no defect M − m. Nodes that share changed elements form a patch; what its losers lose goes to
/// its gainers. Only volume that the patch as a whole gained or lost is a defect: that was created or dropped
/// by decision. A node that flies or flew keeps its mass. Patches keep their momenta.
/// @param changed elements of the old or the new mesh that the other does not have, in the present numbers
/// @param before the remesh, those of this rank
/// @param number present number of each old node, −1: deleted
/// @param V_before of each node of this rank before new connectivity [m^dim]
/// @param v_half velocity of the half step, whose momenta and energy count [m/s]
template <int dim>
void Fluid<dim>::hand_over_mass(const std::vector<Simplex<dim>>& changed, const Particles<dim>& before,
                                std::span<const index_t> number, std::span<const double> V_before,
                                std::vector<Vec<dim>>& v_half)
{
  const auto n_nodes = static_cast<std::size_t>(nodes_.size());
  const Patches patches = patches_of<dim>(n_nodes, changed);
  const std::vector<double> V_was = gather_patches(patches, V_before, v_half);
  struct Volumes
  {
    double gain = 0.0, loss = 0.0; ///< [m^dim]
    double mass = 0.0;             ///< that changes hands [kg]
  };
  std::vector<Volumes> volumes(patches.first.size());
  const auto volumes_at = [&](std::size_t n) -> Volumes&
  { return volumes[static_cast<std::size_t>(patches.of[n])]; };
  const auto for_each_gain = [&](auto&& visit)
  {
    for (std::size_t k = 0; k < V_was.size(); ++k)
    {
      const auto n = static_cast<std::size_t>(patches.nodes[k]);
      const bool flies = V_was[k] == 0.0 || (nodes_.flag[n] & isolated_node);
      if (const double gain = flies ? 0.0 : nodes_.V[n] - V_was[k]; gain != 0.0)
        visit(n, gain, volumes_at(n));
    }
  };
  for_each_gain([](std::size_t, double gain, Volumes& p)
                { (gain > 0.0 ? p.gain : p.loss) += std::abs(gain); });
  for_each_gain(
      [&](std::size_t n, double gain, Volumes& p)
      {
        if (gain > 0.0)
          return;
        const double given = nodes_.rho[n] * -gain * std::min(1.0, p.gain / p.loss);
        nodes_.M[n] -= given;
        p.mass += given;
      });
  for_each_gain(
      [&](std::size_t n, double gain, Volumes& p)
      {
        if (gain > 0.0)
          nodes_.M[n] += p.mass * gain / p.gain;
      });

  struct Particle
  {
    index_t patch;
    double M;
    Vec<dim> x, v;
  };
  std::vector<Particle> particles; // those that are now nodes of patches
  for (std::size_t k = 0; k < before.x.size(); ++k)
    if (const index_t n = number[static_cast<std::size_t>(before.begin) + k]; n >= 0)
      if (const index_t patch = patches.of[static_cast<std::size_t>(n)]; patch >= 0)
        particles.push_back({patch, before.M[k], before.x[k], before.v[k]});
  std::vector<MassesInMotion<dim>> had(patches.first.size());
  for (const auto& [patch, M, x, v] : ranks().gather(particles))
    had[static_cast<std::size_t>(patch)].add(M, from_first(patches, patch, x), v);
  keep_momenta(patches, had, v_half);
}

/// The rows of the nodes of patches come from the ranks that have them. Collective.
/// @returns of each of these nodes its volume before new connectivity [m^dim]
template <int dim>
std::vector<double> Fluid<dim>::gather_patches(const Patches& patches, std::span<const double> V_before,
                                               std::span<Vec<dim>> v_half)
{
  struct Row
  {
    double V_before, V, M, rho, h;
    Vec<dim> x, v_half;
    std::uint8_t flag;
  };
  std::vector<double> V_was;
  std::vector<Row> rows;
  for (const index_t n : patches.nodes)
    if (team_.owns(n))
    {
      const auto i = static_cast<std::size_t>(n);
      V_was.push_back(V_before[static_cast<std::size_t>(n - team_.node_begin())]);
      if (!ranks().alone())
        rows.push_back({V_was.back(), nodes_.V[i], nodes_.M[i], nodes_.rho[i], nodes_.h[i], nodes_.x[i],
                        v_half[i], nodes_.flag[i]});
    }
  if (ranks().alone())
    return V_was;
  V_was.clear();
  rows = ranks().gather(rows); // ranks have consecutive nodes
  for (std::size_t k = 0; k < rows.size(); ++k)
  {
    const auto i = static_cast<std::size_t>(patches.nodes[k]);
    V_was.push_back(rows[k].V_before);
    std::tie(nodes_.V[i], nodes_.M[i], nodes_.rho[i], nodes_.h[i], nodes_.x[i], v_half[i], nodes_.flag[i]) =
        std::tie(rows[k].V, rows[k].M, rows[k].rho, rows[k].h, rows[k].x, rows[k].v_half, rows[k].flag);
  }
  return V_was;
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
