// Which elements and nodes a remesh lets go, and nodes that come and go at openings.
#include "common/parallel/exact_sum.hpp"
#include "common/parallel/in_parts.hpp"
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/mass_conservation.hpp"
#include "fluid_pfem/remesh/alpha_shape.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <unordered_map>
#include <utility>

namespace undine::fluid
{

namespace
{

/// Numbers that look random, each another (finaliser of splitmix64).
std::uint64_t mixed(std::uint64_t z)
{
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

} // namespace

/// One or two elements that hang together with no others are spray: as fluid they would be a spring between
/// few nodes that snaps. Their nodes fly. Elements decide by what is at their nodes: where three meet in a
/// node, or one meets two others, the group is large enough, and the neighbours of such elements belong to
/// it. Each rank decides on the elements it has chosen. Where three of these meet, three meet; of the few
/// others all ranks know all. Collective.
template <int dim>
void Fluid<dim>::drop_fragments(ShapeChoice<dim>& choice) const
{
  const auto n_nodes = nodes_.x.size();
  const auto count_elements = [&](std::size_t begin, std::size_t end) // of each node; three stand for many
  {
    std::vector<std::uint8_t> count(n_nodes, 0);
    for (const auto& e : std::span(choice.elements).subspan(begin, end - begin))
      for (const index_t n : e)
        if (auto& c = count[static_cast<std::size_t>(n)]; c < 3)
          ++c;
    return count;
  };
  std::vector<std::vector<std::uint8_t>> counts(static_cast<std::size_t>(team_.threads()));
  const int parts = in_parts(team_.threads(), choice.elements.size(),
                             [&](int part, std::size_t begin, std::size_t end)
                             { counts[static_cast<std::size_t>(part)] = count_elements(begin, end); });
  auto& count = counts.front();
  for (int part = 1; part < parts; ++part)
    std::transform(count.begin(), count.end(), counts[static_cast<std::size_t>(part)].begin(), count.begin(),
                   [](std::uint8_t a, std::uint8_t b) { return std::min<std::uint8_t>(a + b, 3); });
  const auto crowded = [&](const Simplex<dim>& e)
  {
    return std::any_of(e.begin(), e.end(), [&](index_t n) { return count[static_cast<std::size_t>(n)] > 2; });
  };
  auto few = list_in_parts<Simplex<dim>>( // that may not be crowded
      team_.threads(), choice.elements.size(), 0,
      [&](std::vector<Simplex<dim>>& list, std::size_t begin, std::size_t end)
      {
        for (const auto& e : std::span(choice.elements).subspan(begin, end - begin))
          if (!crowded(e))
            list.push_back(e);
      });
  few = ranks().gather(few);
  if (few.empty())
    return;
  std::vector<char> large(n_nodes, 0); // a node of an element that hangs together with enough others
  for (const auto& e : choice.elements)
    if (crowded(e))
      for (const index_t n : e)
        large[static_cast<std::size_t>(n)] = 1;
  if (!ranks().alone()) // of the nodes of the few, what all ranks have there
  {
    std::vector<index_t> nodes;
    for (const auto& e : few)
      nodes.insert(nodes.end(), e.begin(), e.end());
    std::sort(nodes.begin(), nodes.end());
    nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
    std::vector<std::int64_t> there;
    for (const index_t n : nodes)
      there.insert(there.end(), {count[static_cast<std::size_t>(n)], large[static_cast<std::size_t>(n)]});
    ranks().sum(there);
    for (std::size_t k = 0; k < nodes.size(); ++k)
    {
      count[static_cast<std::size_t>(nodes[k])] =
          static_cast<std::uint8_t>(std::min<std::int64_t>(there[2 * k], 3));
      large[static_cast<std::size_t>(nodes[k])] = there[2 * k + 1] > 0;
    }
  }
  const auto name = [&](const Simplex<dim>& e)
  {
    std::uint64_t sum = 0; // of mixed identifiers: no order
    for (const index_t n : e)
      sum += mixed(static_cast<std::uint64_t>(nodes_.id[static_cast<std::size_t>(n)]));
    return mixed(sum);
  };
  std::unordered_map<std::size_t, std::uint64_t> names; // of the elements at a node, combined
  for (const auto& e : few)
    if (!crowded(e))
      for (const index_t n : e)
        names[static_cast<std::size_t>(n)] ^= name(e);
  const auto is_large = [&](const Simplex<dim>& e)
  {
    if (crowded(e))
      return true;
    std::uint64_t other = 0;
    for (const index_t n : e)
      if (count[static_cast<std::size_t>(n)] == 2)
      {
        const std::uint64_t here = names[static_cast<std::size_t>(n)] ^ name(e);
        if (here == 0 || (other != 0 && here != other)) // 0: the other one is crowded
          return true;
        other = here;
      }
    return false;
  };
  for (const auto& e : few)
    if (is_large(e))
      for (const index_t n : e)
        large[static_cast<std::size_t>(n)] = 1;
  const SurfaceMask kept = wet_mask_ | openings_.driven_mask();
  std::erase_if(choice.elements,
                [&](const Simplex<dim>& e)
                {
                  const bool stays = std::any_of(e.begin(), e.end(),
                                                 [&](index_t n)
                                                 {
                                                   const auto i = static_cast<std::size_t>(n);
                                                   return large[i] || (nodes_.surface[i] & kept) != 0;
                                                 });
                  if (!stays)
                    choice.dropped.add(
                        std::abs(signed_volume<dim, double>(corners<dim>(nodes_.x, e, nodes_.period))));
                  return !stays;
                });
}

/// Collective.
/// @param elements of this rank
/// @param held nodes whose rows this rank has; null: all
/// @returns the new number of each node, empty if numbers stay
template <int dim>
std::vector<index_t> Fluid<dim>::delete_isolated_nodes(std::vector<Simplex<dim>>& elements,
                                                       const std::vector<index_t>* held)
{
  if (config_.remesh.delete_isolated_after == 0)
    return {};
  const auto long_alone = [this](std::size_t n)
  { return nodes_.alone[n] >= config_.remesh.delete_isolated_after; };
  std::vector<char> used(nodes_.x.size(), 0);
  std::vector<index_t> again;
  for (const auto& e : elements)
    for (const index_t n : e)
      if (long_alone(static_cast<std::size_t>(n)))
        again.push_back(n);
  for (const index_t n : ranks().gather(again))
    used[static_cast<std::size_t>(n)] = 1;
  struct Lost
  {
    index_t node;
    double M;
  };
  std::vector<Lost> lost;
  const auto look_at = [&](index_t node)
  {
    if (const auto n = static_cast<std::size_t>(node); long_alone(n) && !used[n])
      lost.push_back({node, nodes_.M[n]});
  };
  if (held)
    std::for_each(held->begin(), held->end(), look_at);
  else
    for (index_t n = 0; n < nodes_.size(); ++n)
      look_at(n);
  lost = ranks().gather(lost);
  if (lost.empty())
    return {};
  std::sort(lost.begin(), lost.end(), [](const Lost& a, const Lost& b) { return a.node < b.node; });
  std::vector<char>& gone = used;
  std::fill(gone.begin(), gone.end(), 0);
  for (const Lost& node : lost)
  {
    gone[static_cast<std::size_t>(node.node)] = 1;
    ++ledger_.deleted_nodes;
    ledger_.deleted_mass += node.M;
  }
  return erase_nodes(gone, elements, held);
}

/// @param held as of delete_isolated_nodes
/// @returns the new number of each node, empty if numbers stay
template <int dim>
std::vector<index_t> Fluid<dim>::erase_nodes(const std::vector<char>& gone,
                                             std::vector<Simplex<dim>>& elements,
                                             const std::vector<index_t>* held)
{
  std::vector<index_t> new_number(nodes_.x.size(), -1);
  index_t kept = 0;
  for (std::size_t n = 0; n < new_number.size(); ++n)
    if (!gone[n])
      new_number[n] = kept++;
    else
      delaunay_.remove(static_cast<index_t>(n));
  if (kept == nodes_.size())
    return {};
  delaunay_.renumber(new_number);
  const auto compress = [&](const char*, auto& field)
  {
    for (std::size_t n = 0; n < new_number.size(); ++n)
      if (new_number[n] >= 0)
        field[static_cast<std::size_t>(new_number[n])] = field[n];
    field.resize(static_cast<std::size_t>(kept));
  };
  if (held)
  {
    std::vector<index_t> moved = *held;
    for (index_t n = 0; n < nodes_.size(); ++n) // places of new nodes are known to all, and will be asked for
      if (nodes_.row[static_cast<std::size_t>(n)] == no_row)
        moved.push_back(n);
    nodes_.for_each_field_of_owners(
        [&](const char*, auto& field)
        { renumber_rows(field, moved, new_number, static_cast<std::size_t>(kept)); });
  }
  else
    nodes_.for_each_field_of_owners(compress);
  nodes_.for_each_field_of_all(compress);
  for (auto& e : elements)
    for (index_t& n : e)
      n = new_number[static_cast<std::size_t>(n)];
  return new_number;
}

/// Nodes come in and go out; the advected mesh of the last remesh gets and loses their elements, so that the
/// remesh that follows finds the fluid where it is. All ranks get all rows and do the same. Collective.
template <int dim>
void Fluid<dim>::pass_openings()
{
  collect();
  const double before = energy().total();
  const index_t n_before = nodes_.size();
  inflow_ += openings_.let_in(nodes_, mesh_.elements, next_id_, config_.tait.rho0);
  openings_.drive(nodes_, t_);
  std::vector<char> gone;
  outflow_ += openings_.let_out(nodes_, mesh_.elements, gone);
  if (!gone.empty() || nodes_.size() != n_before)
    delaunay_.forget();
  if (!gone.empty())
  {
    erase_nodes(gone, mesh_.elements, nullptr);
    mesh_.boundary.clear(); // of a mesh that is no more; the edges of splits are then taken as inner ones
  }
  exchange_energy_.assign(nodes_.x.size(), 0.0); // all booked
  openings_energy_ += energy().total() - before;
  update_nodal_volumes<dim>(mesh_, nodes_);
  if (ranks().alone())
    return;
  mesh_.elements = sorted_elements<dim>(std::move(mesh_.elements)); // parts of the new numbers
  team_.share_out(nodes_.size(), mesh_);
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
