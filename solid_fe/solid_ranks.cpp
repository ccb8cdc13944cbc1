// The solid on several ranks: who computes what, and the whole state from its parts.
#include "common/error.hpp"
#include "common/parallel/partition.hpp"
#include "solid_fe/solid.hpp"

#include <algorithm>
#include <numeric>

namespace undine::solid
{

namespace
{

/// visit(nodes, active) of the elements of all bodies.
template <int dim, class Visit>
void for_each_element(const std::vector<Body<dim>>& bodies, Visit&& visit)
{
  for (const auto& body : bodies)
    std::visit(
        [&]<class Element>(const ReferenceBlock<Element>& block)
        {
          for (index_t e = 0; e < block.size(); ++e)
            visit(std::span<const index_t>(block.nodes[static_cast<std::size_t>(e)]),
                  e < block.n_active ? Element::points : 0);
        },
        body.block);
}

/// Keep the nodes that the rank owns, and their rows.
template <class Owns, class Row>
void keep_rows(std::vector<index_t>& nodes, const Owns& owns, std::vector<Row>& rows)
{
  std::size_t kept = 0;
  for (std::size_t k = 0; k < nodes.size(); ++k)
    if (owns(nodes[k]))
    {
      nodes[kept] = nodes[k];
      rows[kept++] = rows[k];
    }
  nodes.resize(kept);
  rows.resize(kept);
}

} // namespace

/// Which nodes must be rank 0's.
template <int dim>
std::vector<char> Solid<dim>::nodes_of_first_rank() const
{
  std::vector<char> marked(nodes_.X.size(), beam_ ? 1 : 0);
  for (const auto& body : rigid_)
    for (const auto n : body.members())
      marked[n] = 1;
  if (contact_)
    contact_->for_each_node([&](std::size_t n) { marked[n] = 1; });
  return marked;
}

/// Nodes that share an element are neighbours; the work of a node is that of its elements.
template <int dim>
Graph Solid<dim>::graph_of_nodes() const
{
  const auto n = nodes_.X.size();
  std::vector<std::span<const index_t>> elements;
  std::vector<std::size_t> begin(n + 1, 0); // of each node's elements
  Graph graph;
  graph.work.assign(n, 1);
  for_each_element(bodies_,
                   [&](std::span<const index_t> nodes, int points)
                   {
                     elements.push_back(nodes);
                     for (const index_t node : nodes)
                     {
                       ++begin[static_cast<std::size_t>(node) + 1];
                       graph.work[static_cast<std::size_t>(node)] += points;
                     }
                   });
  for (std::size_t k = 0; k < n; ++k)
    begin[k + 1] += begin[k];
  std::vector<std::size_t> of_node(begin.back()), next(begin.begin(), begin.end() - 1);
  for (std::size_t e = 0; e < elements.size(); ++e)
    for (const index_t node : elements[e])
      of_node[next[static_cast<std::size_t>(node)]++] = e;
  std::vector<std::size_t> seen(n, n); // last node whose neighbour it was found to be
  for (std::size_t k = 0; k < n; ++k)
  {
    seen[k] = k;
    for (std::size_t j = begin[k]; j < begin[k + 1]; ++j)
      for (const index_t node : elements[of_node[j]])
        if (seen[static_cast<std::size_t>(node)] != k)
        {
          seen[static_cast<std::size_t>(node)] = k;
          graph.neighbour.push_back(node);
        }
    graph.offset.push_back(static_cast<int>(graph.neighbour.size()));
  }
  return graph;
}

template <int dim>
void Solid<dim>::distribute(const Ranks& ranks)
{
  if (ranks.alone())
    return;
  const auto parts = [&] { return partition(graph_of_nodes(), nodes_of_first_rank(), ranks.size()); };
  distribute(ranks, ranks.of_first(ranks.rank() == 0 ? parts() : std::vector<int>{}));
}

template <int dim>
void Solid<dim>::distribute(const Ranks& ranks, std::vector<int> owner)
{
  if (ranks.alone())
    return;
  require(owner.size() == nodes_.X.size(), "a rank for each node");
  const std::vector<char> first = nodes_of_first_rank();
  for (std::size_t n = 0; n < owner.size(); ++n)
    require(owner[n] >= 0 && owner[n] < ranks.size() && (first[n] == 0 || owner[n] == 0),
            "what must be rank 0's is, and the rest some rank's");

  // The forces on a rank's nodes need the elements that touch them; with nodal dilatation pressures come from
  // the neighbours' elements, and their volume changes from those of the next neighbours.
  const auto of_nodes = []<class Element>(const ReferenceBlock<Element>&)
  { return Element::dilatation == Dilatation::of_nodes; };
  const bool nodal = std::any_of(bodies_.begin(), bodies_.end(),
                                 [&](const auto& body) { return std::visit(of_nodes, body.block); });
  std::vector<char> held(nodes_.X.size());
  std::transform(owner.begin(), owner.end(), held.begin(), [&](int r) { return r == ranks.rank(); });
  std::vector<std::vector<index_t>> kept(bodies_.size());
  for (int layer = 0; layer < (nodal ? 3 : 1); ++layer)
  {
    const auto inner = held;
    for (std::size_t k = 0; k < bodies_.size(); ++k)
    {
      kept[k].clear();
      std::visit(
          [&](const auto& block)
          {
            for (index_t e = 0; e < block.size(); ++e)
            {
              const auto& nodes = block.nodes[static_cast<std::size_t>(e)];
              if (std::none_of(nodes.begin(), nodes.end(),
                               [&](index_t n) { return inner[static_cast<std::size_t>(n)] != 0; }))
                continue;
              kept[k].push_back(e);
              for (const index_t n : nodes)
                held[static_cast<std::size_t>(n)] = 1;
            }
          },
          bodies_[k].block);
    }
  }
  share_ = NodeShare(ranks, std::move(owner), held);
  for (std::size_t k = 0; k < bodies_.size(); ++k)
    hold_part_of(k, std::move(kept[k]));

  const auto owns = [this](index_t n) { return share_.owns(static_cast<std::size_t>(n)); };
  for (auto& load : loads_)
    keep_rows(load.nodes, owns, load.force);
  for (auto& load : formula_loads_)
  {
    keep_rows(load.nodes, owns, load.area);
    Surface mine;
    for (index_t f = 0; f < load.surface.size(); ++f)
    {
      const auto first = load.surface.nodes.begin() + load.surface.offset[static_cast<std::size_t>(f)];
      const auto last = load.surface.nodes.begin() + load.surface.offset[static_cast<std::size_t>(f) + 1];
      if (std::none_of(first, last, owns))
        continue;
      mine.nodes.insert(mine.nodes.end(), first, last);
      mine.offset.push_back(static_cast<index_t>(mine.nodes.size()));
    }
    load.surface = std::move(mine);
  }
}

/// Only the elements `held` of body k, ascending, are left of it here.
template <int dim>
void Solid<dim>::hold_part_of(std::size_t k, std::vector<index_t> held)
{
  auto& body = bodies_[k];
  auto state = std::move(body.state);
  auto& whole = whole_.emplace_back();
  whole.held = std::move(held);
  std::visit(
      [&]<class Element>(ReferenceBlock<Element>& block)
      {
        if (block.n_packs() > 0)
          whole.row = state.history.size() / static_cast<std::size_t>(block.n_packs());
        for (const auto& nodes : block.nodes) // its first node's rank counts an element
          whole.owner.push_back(share_.owner()[static_cast<std::size_t>(nodes[0])]);
        auto part = block.part(whole.held);
        for (const index_t e : whole.held)
          part.is_copy.push_back(whole.owner[static_cast<std::size_t>(e)] != ranks().rank());
        block.pack = {};
        block.gamma = block.delta = block.hourglass_inverse_mass = {};
        whole.block = std::move(block);
        body.block = std::move(part);
      },
      body.block);
  take_state(k, state);
}

template <int dim>
std::vector<index_t> Solid<dim>::counted_elements(std::size_t k) const
{
  if (!whole_.empty())
  {
    std::vector<index_t> counted = whole_[k].held;
    for (index_t& e : counted)
      if (whole_[k].owner[static_cast<std::size_t>(e)] != ranks().rank())
        e = -1;
    return counted;
  }
  std::vector<index_t> all(
      std::visit([](const auto& block) { return static_cast<std::size_t>(block.size()); }, whole_block(k)));
  std::iota(all.begin(), all.end(), 0);
  return all;
}

template <int dim>
void Solid<dim>::collect()
{
  if (ranks().alone())
    return;
  for (auto* field : {&nodes_.u, &nodes_.v, &nodes_.a, &F_int_, &F_ext_, &F_viscous_, &F_viscous_old_,
                      &F_formula_, &F_formula_old_})
    share_.collect(*field);
  for (auto* work : {&external_work_, &viscous_work_})
    share_.collect(*work);
  const auto collect_first = [this](auto& rows) // of the wet nodes
  { share_.collect(rows, std::span(share_.owner()).first(rows.size())); };
  collect_first(a_free_wet_);
  collect_first(f_link_);
  collect_first(step_of_wet_);
  collect_first(interface_work_);
  std::vector<std::array<double, 3>> rows;
  std::vector<int> owner;
  for (const auto& driven : driven_)
  {
    rows.push_back({driven.reaction, driven.v_step, driven.v_end});
    owner.push_back(share_.owner()[driven.node]);
  }
  share_.collect(rows, owner);
  for (std::size_t k = 0; k < driven_.size(); ++k)
  {
    driven_[k].reaction = rows[k][0];
    driven_[k].v_step = rows[k][1];
    driven_[k].v_end = rows[k][2];
  }
}

template class Solid<2>;
template class Solid<3>;

} // namespace undine::solid
