// Where fluid and solid meet: facets near nodes, faces of the fluid on the solid and their mortar rows, and
// how long nothing can touch.
#include "coupler/contact.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace undine::coupler
{

/// Facets that a node can meet before both together have moved by the reach.
template <int dim>
void UnilateralContact<dim>::find_candidates(double travel)
{
  travelled_ += travel;
  if (!search_due_ && travelled_ < 0.9 * reach_)
    return;
  travelled_ = travel;
  search_due_ = false;
  before_.sort_bins();
  candidates_.clear();
  candidate_offset_.assign(1, 0);
  for (const Vec<dim>& x : x_)
  {
    before_.within(x, std::max(reach_, 2.0 * travel), candidates_);
    candidate_offset_.push_back(static_cast<index_t>(candidates_.size()));
  }
}

/// Where the fluid's nodes at x_end_ meet the solid's surface after_.
template <int dim>
void UnilateralContact<dim>::find_near()
{
  for (std::size_t k = 0; k < x_.size(); ++k)
    near_[k] = after_.nearest(
        x_end_[k],
        std::span<const index_t>(candidates_.data() + candidate_offset_[k],
                                 static_cast<std::size_t>(candidate_offset_[k + 1] - candidate_offset_[k])));
}

/// Faces of the fluid that lie on one smooth side of the solid.
template <int dim>
void UnilateralContact<dim>::find_active()
{
  constexpr double touching = 0.02; // of a facet
  for (std::size_t f = 0; f < faces_.size(); ++f)
  {
    int side = -1;
    bool on = true;
    for (const int k : faces_[f])
    {
      const Near& near = near_[static_cast<std::size_t>(k)];
      on = on && near.facet >= 0 && !near.beside && near.gap < touching * 0.5 * reach_;
      if (!on)
        break;
      const int other = side_[static_cast<std::size_t>(near.facet)];
      on = side < 0 || side == other;
      side = other;
    }
    active_[f] = on;
  }
}

/// Nodes of the active faces that have one of `touched`; empty: of all active faces.
template <int dim>
std::vector<char> UnilateralContact<dim>::nodes_of_active(const std::vector<char>& touched) const
{
  std::vector<char> nodes(x_.size(), 0);
  for (std::size_t f = 0; f < faces_.size(); ++f)
    if (active_[f] && (touched.empty() || touches(f, touched)))
      for (const int k : faces_[f])
        nodes[static_cast<std::size_t>(k)] = 1;
  return nodes;
}

template <int dim>
bool UnilateralContact<dim>::touches(std::size_t face, const std::vector<char>& nodes) const
{
  return std::any_of(faces_[face].begin(), faces_[face].end(),
                     [&nodes](int k) { return nodes[static_cast<std::size_t>(k)] != 0; });
}

/// Nodes on active faces that have slid since their rows were made, and those of faces that have come or
/// gone.
template <int dim>
std::vector<char> UnilateralContact<dim>::find_changed(double dt, const std::array<std::vector<double>, 2>& v)
{
  constexpr double sliding = 0.02; // of a facet
  const bool first = active_built_.size() != active_.size();
  std::vector<char> changed = nodes_of_active({});
  for (std::size_t k = 0; k < x_.size(); ++k)
    if (changed[k])
    {
      const Near& near = near_[k];
      const auto& facet = after_.facets()[static_cast<std::size_t>(near.facet)];
      Vec<dim> w = row_of(v[Side::fluid], static_cast<index_t>(k));
      for (std::size_t c = 0; c < dim; ++c)
        w -= near.weight[c] * row_of(v[Side::solid], facet[c]);
      slid_[k] += dt * norm(w);
      changed[k] = first || slid_[k] > sliding * 0.5 * reach_;
    }
  for (std::size_t f = 0; f < faces_.size() && !first; ++f)
    if (active_[f] != active_built_[f])
      for (const int k : faces_[f])
        changed[static_cast<std::size_t>(k)] = 1;
  active_built_ = active_;
  return changed;
}

/// Mortar rows of the nodes that have changed. A node changes the normals of its neighbours, and they the
/// rows of theirs. A row needs all faces of its node, and these all faces of theirs for the normals.
template <int dim>
void UnilateralContact<dim>::integrate_rows(const std::vector<char>& changed)
{
  if (std::find(changed.begin(), changed.end(), 1) == changed.end())
    return;
  std::vector<char> rows = nodes_of_active(changed);
  for (std::size_t k = 0; k < x_.size(); ++k)
    rows[k] = rows[k] || changed[k];
  const std::vector<char> with_neighbours = nodes_of_active(rows);
  for (std::size_t k = 0; k < x_.size(); ++k)
    if (rows[k])
    {
      mortar_[k].clear();
      slid_[k] = 0.0;
    }
  InterfaceFaces<dim> ours{x_end_, {}}, theirs{after_.x(), {}};
  for (std::size_t f = 0; f < faces_.size(); ++f)
    if (active_[f] && touches(f, with_neighbours))
      ours.faces.push_back(faces_[f]);
  if (ours.faces.empty())
    return;
  for (std::size_t f = 0; f + 1 < solid_mesh_.face_offset.size(); ++f)
    theirs.faces.emplace_back(solid_mesh_.face_nodes.begin() + solid_mesh_.face_offset[f],
                              solid_mesh_.face_nodes.begin() + solid_mesh_.face_offset[f + 1]);
  ++report_.searches;
  report_.integrated += static_cast<std::int64_t>(ours.faces.size());
  const auto mortar = integrate_mortar<dim>(ours, theirs, 0.5 * reach_);
  for (std::size_t a = 0; a < mortar.D.size(); ++a)
    if (const auto k = static_cast<std::size_t>(mortar.multiplier_node[a]); rows[k])
      for (const auto& [node, c] : mortar.C[a])
        mortar_[k].push_back({node, c / mortar.D[a]});
}

/// How far both sides are from each other as they are.
template <int dim>
void UnilateralContact<dim>::look_around()
{
  if (!candidates_.empty())
  {
    after_.x() = before_.x();
    x_end_ = x_;
    find_near();
  }
  measure_clearance();
}

/// Nodes without candidates were further away than the reach at the last search.
template <int dim>
void UnilateralContact<dim>::measure_clearance()
{
  clearance_ = x_.empty() ? std::numeric_limits<double>::max() : reach_ - travelled_;
  if (!candidates_.empty())
    for (const Near& near : near_)
      if (near.facet >= 0)
        clearance_ = std::min(clearance_, near.gap);
}

template <int dim>
std::int64_t UnilateralContact<dim>::flight() const
{
  constexpr double most = 4.0, margin = 0.05; // of a facet: as wide as that of rows
  const double free = clearance_ - margin * 0.5 * reach_;
  return free > 0.0 ? static_cast<std::int64_t>(std::clamp(free / (4.0 * travel_of_step_), 1.0, most)) : 1;
}

template <int dim>
void UnilateralContact<dim>::fly(double time, std::int64_t steps, const std::array<std::vector<double>, 2>& v)
{
  const double travel = fastest_travel(time, v);
  travel_of_step_ = travel / static_cast<double>(steps);
  find_candidates(travel);
  rows_.clear();
  report_.rows = report_.touching = report_.sweeps = 0;
  report_.residual_gap = report_.deepest = 0.0;
  for (std::size_t n = 0; n < x_.size(); ++n)
    x_[n] += time * row_of(v[Side::fluid], static_cast<index_t>(n));
  for (std::size_t n = 0; n < before_.x().size(); ++n)
    before_.x()[n] += time * row_of(v[Side::solid], static_cast<index_t>(n));
  show_solid();
  look_around();
  balance_.velocity_jump = balance_.displacement_gap = 0.0;
}

/// Of the fastest nodes of both sides together [m].
template <int dim>
double UnilateralContact<dim>::fastest_travel(double time, const std::array<std::vector<double>, 2>& v) const
{
  double fastest[2] = {0.0, 0.0};
  for (const Side s : both_sides)
    for (std::size_t n = 0; n < v[s].size(); n += dim)
    {
      double square = 0.0;
      for (std::size_t i = 0; i < dim; ++i)
        square += v[s][n + i] * v[s][n + i];
      fastest[s] = std::max(fastest[s], square);
    }
  return time * (std::sqrt(fastest[0]) + std::sqrt(fastest[1]));
}

template class UnilateralContact<2>;
template class UnilateralContact<3>;

} // namespace undine::coupler
