// Search and projected Gauss-Seidel solution of the contact of one step.
#include "coupler/contact.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace undine::coupler
{

template <int dim>
std::vector<Vec<dim>> UnilateralContact<dim>::as_points(std::span<const double> values)
{
  std::vector<Vec<dim>> points(values.size() / dim);
  for (std::size_t n = 0; n < points.size(); ++n)
    for (int i = 0; i < dim; ++i)
      points[n][i] = values[n * dim + static_cast<std::size_t>(i)];
  return points;
}

template <int dim>
Vec<dim> UnilateralContact<dim>::product(const std::vector<double>& inverse_mass, index_t n,
                                         const Vec<dim>& w)
{
  Vec<dim> result{};
  const double* block = inverse_mass.data() + static_cast<std::ptrdiff_t>(n) * dim * dim;
  for (int i = 0; i < dim; ++i)
    for (int j = 0; j < dim; ++j)
      result[i] += block[i * dim + j] * w[j];
  return result;
}

template <int dim>
UnilateralContact<dim>::UnilateralContact(const link::SurfaceMesh& fluid, const link::SurfaceMesh& solid,
                                          std::vector<std::string> no_slip)
    : no_slip_(std::move(no_slip))
{
  require(fluid.dim == dim && solid.dim == dim, "both participants have the same dimension");
  replace_solid(solid);
  replace_fluid(fluid);
}

template <int dim>
void UnilateralContact<dim>::for_each_state(StateArchive& archive)
{
  archive("solid_x", solid_mesh_.x);
  archive("solid_epoch", solid_mesh_.epoch);
  archive("x", x_);
  archive("inverse_mass", inverse_mass_);
  archive("before", before_);
  archive("after", after_);
  archive("candidates", candidates_);
  archive("candidate_offset", candidate_offset_);
  archive("reach", reach_);
  archive("travelled", travelled_);
  archive("search_due", search_due_);
  archive("last_impulse", last_impulse_);
  archive("faces", faces_);
  archive("side", side_);
  archive("sticks", sticks_);
  archive("x_end", x_end_);
  archive("active", active_);
  archive("active_built", active_built_);
  archive("mortar", mortar_);
  archive("normal", normal_);
  archive("travel_of_step", travel_of_step_);
  archive("clearance", clearance_);
  archive("slid", slid_);
  archive("partner", partner_);
  archive("partner_inverse_mass", partner_inverse_mass_);
  std::vector<std::array<index_t, 4>> held;
  for (const Held& k : held_)
    held.push_back({k.facet[0], k.facet[1], k.neighbour[0], k.neighbour[1]});
  archive("held", held);
  held_.clear();
  for (const auto& k : held)
    held_.push_back({{k[0], k[1]}, {k[2], k[3]}});
  archive("dv_fluid", dv_fluid_);
  archive("dv_solid", dv_solid_);
  archive("impulse", impulse_);
  archive("report", report_);
  archive("balance", balance_);
}

template <int dim>
void UnilateralContact<dim>::replace_fluid(const link::SurfaceMesh& fluid)
{
  x_ = as_points(fluid.x);
  inverse_mass_[Side::fluid] = fluid.inverse_mass;
  last_impulse_.assign(x_.size(), 0.0);
  near_.resize(x_.size());
  x_end_ = x_;
  mortar_.assign(x_.size(), {});
  faces_.clear();
  for (std::size_t f = 0; f + 1 < fluid.face_offset.size(); ++f)
    faces_.emplace_back(fluid.face_nodes.begin() + fluid.face_offset[f],
                        fluid.face_nodes.begin() + fluid.face_offset[f + 1]);
  active_.assign(faces_.size(), 0);
  active_built_.clear();
  slid_.assign(x_.size(), 0.0);
  search_due_ = true;
  clearance_ = 0.0;
  if (travel_of_step_ > 0.0)
  {
    find_candidates(0.0);
    look_around();
  }
  dv_fluid_.assign(x_.size(), {});
  find_held();
}

/// Nodes on a corner whose neighbours on the boundary lie on the sides before and after it.
template <int dim>
void UnilateralContact<dim>::find_held()
{
  held_.assign(x_.size(), {});
  if constexpr (dim == 2)
  {
    constexpr double same_place = 1e-6, touching = 0.02; // of a facet
    const double size = before_.facet_size();
    std::vector<index_t> before(x_.size(), -1), after(x_.size(), -1); // neighbours on the boundary
    for (const auto& f : faces_)
    {
      after[static_cast<std::size_t>(f[0])] = f[1];
      before[static_cast<std::size_t>(f[1])] = f[0];
    }
    for (const auto& corner : before_.convex_corners(side_))
    {
      const auto& facet = before_.facets()[static_cast<std::size_t>(corner[0])];
      const Vec<dim> at = before_.x()[static_cast<std::size_t>(facet[1])];
      const auto lies_on = [&](index_t node, index_t of_side)
      {
        if (node < 0)
          return false;
        const Near near = before_.nearest(x_[static_cast<std::size_t>(node)], size);
        return near.facet >= 0 && std::abs(near.gap) < touching * size &&
               side_[static_cast<std::size_t>(near.facet)] == side_[static_cast<std::size_t>(of_side)];
      };
      for (std::size_t k = 0; k < x_.size(); ++k) // the fluid runs along the solid the other way round
        if (norm(x_[k] - at) < same_place * size && lies_on(after[k], corner[0]) &&
            lies_on(before[k], corner[1]))
          held_[k] = {corner, {before[k], after[k]}};
    }
  }
}

/// Held nodes that the water presses less than what would turn them around the corner slide or leave from the
/// next step on.
template <int dim>
void UnilateralContact<dim>::let_go(double dt, const std::array<std::vector<double>, 2>& v)
{
  const auto velocity = [&v](Side side, index_t n)
  {
    Vec<dim> w;
    for (int i = 0; i < dim; ++i)
      w[i] = v[side][static_cast<std::size_t>(n * dim + i)];
    return w;
  };
  for (std::size_t k = 0; k < x_.size(); ++k)
    if (Held& held = held_[k]; held.facet[0] >= 0)
    {
      Vec<dim> outward{};
      for (const index_t f : held.facet)
        outward += after_.normal_of(f);
      const double pressed = dot(outward, dv_fluid_[k]) / (norm(outward) * dt); // [m/s²]
      const Vec<dim> V = velocity(Side::solid, after_.facets()[static_cast<std::size_t>(held.facet[0])][1]);
      double turning = 0.0; // v²/r [m/s²]
      for (const index_t n : held.neighbour)
        turning = std::max(turning, norm_squared(velocity(Side::fluid, n) - V) /
                                        norm(x_[static_cast<std::size_t>(n)] - x_[k]));
      if (!(pressed > turning))
        held = {};
    }
}

template <int dim>
void UnilateralContact<dim>::replace_solid(const link::SurfaceMesh& solid)
{
  solid_mesh_ = solid;
  inverse_mass_[Side::solid] = solid.inverse_mass;
  partner_.assign(static_cast<std::size_t>(solid.n_nodes()), -1);
  partner_inverse_mass_.assign(solid.coupled_nodes.empty() ? 0 : solid.inverse_mass.size(), 0.0);
  for (std::size_t p = 0; 2 * p < solid.coupled_nodes.size(); ++p)
  {
    const index_t a = solid.coupled_nodes[2 * p], b = solid.coupled_nodes[2 * p + 1];
    partner_[static_cast<std::size_t>(a)] = b;
    partner_[static_cast<std::size_t>(b)] = a;
    for (std::size_t i = 0; i < dim; ++i)
      for (std::size_t j = 0; j < dim; ++j)
      {
        const double w = solid.coupled_inverse_mass[(p * dim + i) * dim + j]; // of a per force on b
        partner_inverse_mass_[(static_cast<std::size_t>(b) * dim + i) * dim + j] = w;
        partner_inverse_mass_[(static_cast<std::size_t>(a) * dim + j) * dim + i] = w;
      }
  }
  before_ = after_ = FacetSurface<dim>(as_points(solid.x), solid.face_offset, solid.face_nodes);
  side_ = before_.patches(0.7); // 40 degrees
  sticks_.clear();
  for (std::size_t f = 0; f + 1 < solid.face_offset.size(); ++f)
  {
    const auto& name = solid.interfaces[static_cast<std::size_t>(solid.face_interface[f])];
    const bool sticks = std::find(no_slip_.begin(), no_slip_.end(), name) != no_slip_.end();
    const auto facets = static_cast<std::size_t>(solid.face_offset[f + 1] - solid.face_offset[f] - dim + 1);
    sticks_.insert(sticks_.end(), facets, sticks);
  }
  dv_solid_.assign(before_.x().size(), {});
  active_built_.clear();
  reach_ = 2.0 * before_.facet_size();
  search_due_ = true;
  clearance_ = 0.0;
}

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

/// Faces of the fluid that lie on one smooth side of the solid, and their mortar projection.
template <int dim>
void UnilateralContact<dim>::find_faces(double dt, const std::array<std::vector<double>, 2>& v)
{
  constexpr double touching = 0.02, sliding = 0.02; // of a facet
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
  const auto nodes_of = [&](auto&& chosen) // of the active faces f with chosen(f)
  {
    std::vector<char> nodes(x_.size(), 0);
    for (std::size_t f = 0; f < faces_.size(); ++f)
      if (active_[f] && chosen(f))
        for (const int k : faces_[f])
          nodes[static_cast<std::size_t>(k)] = 1;
    return nodes;
  };
  const auto touches = [&](const std::vector<char>& nodes)
  {
    return [&](std::size_t f)
    {
      return std::any_of(faces_[f].begin(), faces_[f].end(),
                         [&](int k) { return nodes[static_cast<std::size_t>(k)] != 0; });
    };
  };

  // Nodes that have slid, and those of faces that have come or gone.
  const bool first = active_built_.size() != active_.size();
  std::vector<char> changed = nodes_of([&](std::size_t) { return true; });
  for (std::size_t k = 0; k < x_.size(); ++k)
    if (changed[k])
    {
      const Near& near = near_[k];
      const auto& facet = after_.facets()[static_cast<std::size_t>(near.facet)];
      Vec<dim> w;
      for (int i = 0; i < dim; ++i)
      {
        const auto component = static_cast<std::size_t>(i);
        w[i] = v[Side::fluid][k * dim + component];
        for (std::size_t c = 0; c < dim; ++c)
          w[i] -= near.weight[c] * v[Side::solid][static_cast<std::size_t>(facet[c]) * dim + component];
      }
      slid_[k] += dt * norm(w);
      changed[k] = first || slid_[k] > sliding * 0.5 * reach_;
    }
  for (std::size_t f = 0; f < faces_.size() && !first; ++f)
    if (active_[f] != active_built_[f])
      for (const int k : faces_[f])
        changed[static_cast<std::size_t>(k)] = 1;
  active_built_ = active_;
  if (std::find(changed.begin(), changed.end(), 1) == changed.end())
    return;

  // A node changes the normals of its neighbours, and they the rows of theirs. A row needs all faces of its
  // node, and these all faces of theirs for the normals.
  std::vector<char> rows = nodes_of(touches(changed));
  for (std::size_t k = 0; k < x_.size(); ++k)
    rows[k] = rows[k] || changed[k];
  const std::vector<char> with_neighbours = nodes_of(touches(rows));
  const auto needed = touches(with_neighbours);
  for (std::size_t k = 0; k < x_.size(); ++k)
    if (rows[k])
    {
      mortar_[k].clear();
      slid_[k] = 0.0;
    }
  InterfaceFaces<dim> ours{x_end_, {}}, theirs{after_.x(), {}};
  for (std::size_t f = 0; f < faces_.size(); ++f)
    if (active_[f] && needed(f))
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

/// Row of a node whose weights have just been appended.
template <int dim>
void UnilateralContact<dim>::add_row(index_t node, const Vec<dim>& n, std::size_t first_weight, bool held)
{
  constexpr double margin = 0.05; // of a facet: rows that the impulses of others may close
  // Push of a node that is inside already, per step: of its depth, and at most of a facet [22a].
  constexpr double repair = 0.02, slow = 2e-5;
  const auto k = static_cast<std::size_t>(node);
  Row row{.node = node,
          .n = n,
          .begin = first_weight,
          .end = weights_.size(),
          .impulse = held ? 0.0 : last_impulse_[k],
          .held = held};
  Vec<dim> apart = x_end_[k], apart_before = x_[k];
  row.compliance = dot(n, product(inverse_mass_[Side::fluid], node, n));
  for (std::size_t w = row.begin; w < row.end; ++w)
  {
    const auto [c, P] = weights_[w];
    apart -= P * after_.x()[static_cast<std::size_t>(c)];
    apart_before -= P * before_.x()[static_cast<std::size_t>(c)];
    row.compliance += P * P * dot(n, product(inverse_mass_[Side::solid], c, n));
  }
  row.gap = dot(n, apart);
  if (held)
  {
    rows_.push_back(row);
    return;
  }
  if (row.gap > margin * 0.5 * reach_ || !(row.compliance > 0.0))
  {
    weights_.resize(first_weight);
    return;
  }
  const double gap_before = dot(n, apart_before);
  if (gap_before < 0.0)
  {
    report_.deepest = std::max(report_.deepest, -gap_before);
    row.gap -= gap_before;
    if (may_push())
      row.gap -= std::min(repair * -gap_before, slow * 0.5 * reach_);
  }
  rows_.push_back(row);
  if (sticks_[static_cast<std::size_t>(near_[k].facet)])
    add_rows_along(row);
}

/// Rows of the node of the last row, `row`, along the surface: what it moves along it in this step.
template <int dim>
void UnilateralContact<dim>::add_rows_along(const Row& row)
{
  const auto k = static_cast<std::size_t>(row.node);
  const auto normal = static_cast<index_t>(rows_.size()) - 1;
  Vec<dim> moved = x_end_[k] - x_[k];
  for (std::size_t w = row.begin; w < row.end; ++w)
  {
    const auto c = static_cast<std::size_t>(weights_[w].node);
    moved -= weights_[w].P * (after_.x()[c] - before_.x()[c]);
  }
  std::array<Vec<dim>, dim - 1> along;
  if constexpr (dim == 2)
    along[0] = right_normal(row.n);
  else
  {
    int least = 0;
    for (int i = 1; i < dim; ++i)
      if (std::abs(row.n[i]) < std::abs(row.n[least]))
        least = i;
    Vec<dim> e{};
    e[least] = 1.0;
    along[0] = cross(row.n, e);
    along[0] = (1.0 / norm(along[0])) * along[0];
    along[1] = cross(row.n, along[0]);
  }
  for (const Vec<dim>& t : along)
  {
    Row other = row;
    other.n = t;
    other.gap = dot(t, moved);
    other.compliance = dot(t, product(inverse_mass_[Side::fluid], row.node, t));
    for (std::size_t w = row.begin; w < row.end; ++w)
      other.compliance +=
          weights_[w].P * weights_[w].P * dot(t, product(inverse_mass_[Side::solid], weights_[w].node, t));
    other.impulse = 0.0;
    other.normal = normal;
    if (other.compliance > 0.0)
      rows_.push_back(other);
  }
}

template <int dim>
void UnilateralContact<dim>::find_rows(double dt, const std::array<std::vector<double>, 2>& v)
{
  weights_.clear();
  report_.deepest = 0.0;
  for (std::size_t k = 0; k < x_.size(); ++k)
    for (int i = 0; i < dim; ++i)
      x_end_[k][i] = x_[k][i] + dt * v[Side::fluid][k * dim + static_cast<std::size_t>(i)];
  find_near();
  find_faces(dt, v);

  std::vector<Vec<dim>>& normal = normal_;
  normal.assign(x_.size(), {});
  for (std::size_t f = 0; f < faces_.size(); ++f)
    if (active_[f])
    {
      Vec<dim> n;
      const auto at = [&](std::size_t a) { return x_end_[static_cast<std::size_t>(faces_[f][a])]; };
      if constexpr (dim == 2)
        n = right_normal(at(1) - at(0));
      else
        n = cross(at(1) - at(0), at(2) - at(0));
      for (const int k :
           faces_[f]) // weighted by the measure; the fluid's outward normal points into the solid
        normal[static_cast<std::size_t>(k)] -= n;
    }
  for (std::size_t k = 0; k < x_.size(); ++k)
  {
    const Near& near = near_[k];
    const std::size_t first = weights_.size();
    if (held_[k].facet[0] >= 0)
      for (int i = 0; i < dim; ++i)
      {
        const std::size_t begin = weights_.size();
        weights_.push_back({after_.facets()[static_cast<std::size_t>(held_[k].facet[0])][1], 1.0});
        Vec<dim> e{};
        e[i] = 1.0;
        add_row(static_cast<index_t>(k), e, begin, true);
      }
    else if (!mortar_[k].empty() && norm_squared(normal[k]) > 0.0)
    {
      weights_.insert(weights_.end(), mortar_[k].begin(), mortar_[k].end());
      add_row(static_cast<index_t>(k), (1.0 / norm(normal[k])) * normal[k], first);
    }
    else if (near.facet >= 0 && !near.beside)
    {
      const auto& facet = after_.facets()[static_cast<std::size_t>(near.facet)];
      for (std::size_t c = 0; c < dim; ++c)
        weights_.push_back({facet[c], near.weight[c]});
      add_row(static_cast<index_t>(k), near.normal, first);
    }
  }
}

/// Projected Gauss-Seidel: each row in turn gets the impulse that closes its own gap exactly, never a
/// negative one. It converges for every symmetric positive semi-definite problem.
template <int dim>
void UnilateralContact<dim>::solve(double dt)
{
  constexpr int most_sweeps = 200;
  std::fill(dv_fluid_.begin(), dv_fluid_.end(), Vec<dim>{});
  std::fill(dv_solid_.begin(), dv_solid_.end(), Vec<dim>{});
  const auto push = [&](const Row& row, double impulse)
  {
    dv_fluid_[static_cast<std::size_t>(row.node)] +=
        product(inverse_mass_[Side::fluid], row.node, impulse * row.n);
    for (std::size_t w = row.begin; w < row.end; ++w)
    {
      const auto n = static_cast<std::size_t>(weights_[w].node);
      const double p = weights_[w].P * impulse;
      dv_solid_[n] -= p * product(inverse_mass_[Side::solid], weights_[w].node, row.n);
      if (partner_[n] >= 0)
        dv_solid_[static_cast<std::size_t>(partner_[n])] -=
            p * product(partner_inverse_mass_, weights_[w].node, row.n);
    }
  };
  for (const Row& row : rows_)
    push(row, row.impulse);
  const double small = 1e-12 * reach_;
  report_.sweeps = 0;
  for (double worst = 2.0 * small; worst > small && report_.sweeps < most_sweeps; ++report_.sweeps)
  {
    worst = 0.0;
    for (Row& row : rows_)
    {
      const double of_node = dot(row.n, dv_fluid_[static_cast<std::size_t>(row.node)]);
      double of_solid = 0.0;
      for (std::size_t w = row.begin; w < row.end; ++w)
        of_solid += weights_[w].P * dot(row.n, dv_solid_[static_cast<std::size_t>(weights_[w].node)]);
      const double gap = row.gap + dt * (of_node - of_solid);
      const double wanted = row.impulse - gap / (dt * row.compliance);
      double impulse = row.held ? wanted : std::max(0.0, wanted);
      if (row.normal >= 0)
        impulse = rows_[static_cast<std::size_t>(row.normal)].impulse > 0.0 ? wanted : 0.0;
      const double change = impulse - row.impulse;
      if (change == 0.0)
        continue;
      push(row, change);
      row.impulse = impulse;
      worst = std::max(worst, std::abs(change) * dt * row.compliance);
    }
    report_.residual_gap = worst;
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
    for (int i = 0; i < dim; ++i)
      x_[n][i] += time * v[Side::fluid][n * dim + static_cast<std::size_t>(i)];
  for (std::size_t n = 0; n < before_.x().size(); ++n)
    for (int i = 0; i < dim; ++i)
    {
      before_.x()[n][i] += time * v[Side::solid][n * dim + static_cast<std::size_t>(i)];
      solid_mesh_.x[n * dim + static_cast<std::size_t>(i)] = before_.x()[n][i];
    }
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

template <int dim>
void UnilateralContact<dim>::advance(double dt, const std::array<std::vector<double>, 2>& v,
                                     std::array<std::vector<double>, 2>& f)
{
  for (const Side s : both_sides)
    f[s].assign(v[s].size(), 0.0);
  travel_of_step_ = fastest_travel(dt, v);
  find_candidates(travel_of_step_);
  report_.rows = report_.touching = report_.sweeps = 0;
  report_.residual_gap = 0.0;
  rows_.clear();
  for (std::size_t n = 0; n < after_.x().size(); ++n)
    for (int i = 0; i < dim; ++i)
      after_.x()[n][i] = before_.x()[n][i] + dt * v[Side::solid][n * dim + static_cast<std::size_t>(i)];
  if (!candidates_.empty())
    find_rows(dt, v);
  measure_clearance();
  std::fill(dv_solid_.begin(), dv_solid_.end(), Vec<dim>{});
  if (!rows_.empty())
  {
    solve(dt);
    let_go(dt, v);
    ++report_.solves;
    std::fill(last_impulse_.begin(), last_impulse_.end(), 0.0);
  }
  report_.rows = static_cast<int>(rows_.size());
  for (const Row& row : rows_)
  {
    if (row.impulse == 0.0)
      continue;
    ++report_.touching;
    if (!row.held && row.normal < 0)
      last_impulse_[static_cast<std::size_t>(row.node)] = row.impulse;
    const Vec<dim> J = row.impulse * row.n;
    const auto add = [&](Side side, index_t n, const Vec<dim>& impulse)
    {
      for (int i = 0; i < dim; ++i)
        f[side][static_cast<std::size_t>(n) * dim + static_cast<std::size_t>(i)] += impulse[i] / dt;
      impulse_[side] += impulse;
    };
    add(Side::fluid, row.node, J);
    for (std::size_t w = row.begin; w < row.end; ++w)
      add(Side::solid, weights_[w].node, -weights_[w].P * J);
    x_[static_cast<std::size_t>(row.node)] += dt * product(inverse_mass_[Side::fluid], row.node, J);
  }
  for (std::size_t n = 0; n < x_.size(); ++n)
    for (int i = 0; i < dim; ++i)
      x_[n][i] += dt * v[Side::fluid][n * dim + static_cast<std::size_t>(i)];
  for (std::size_t n = 0; n < after_.x().size(); ++n)
  {
    before_.x()[n] = after_.x()[n] + dt * dv_solid_[n];
    for (int i = 0; i < dim; ++i)
      solid_mesh_.x[n * dim + static_cast<std::size_t>(i)] = before_.x()[n][i];
  }

  for (const Side s : both_sides)
    balance_.impulse[s] = norm(impulse_[s]);
  balance_.impulse_mismatch = norm(impulse_[Side::fluid] + impulse_[Side::solid]);
  balance_.velocity_jump = report_.residual_gap / dt;
  balance_.displacement_gap = std::max(report_.residual_gap, report_.deepest);
}

template class UnilateralContact<2>;
template class UnilateralContact<3>;

} // namespace undine::coupler
