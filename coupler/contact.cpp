// Rows of contact in one step and their solution by projected Gauss-Seidel; where the sides meet:
// contact_search.cpp, corners: contact_corners.cpp.
#include "coupler/contact.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <cmath>

namespace undine::coupler
{

template <int dim>
std::vector<Vec<dim>> UnilateralContact<dim>::as_points(std::span<const double> values)
{
  std::vector<Vec<dim>> points(values.size() / dim);
  for (std::size_t n = 0; n < points.size(); ++n)
    points[n] = row_of(values, static_cast<index_t>(n));
  return points;
}

template <int dim>
Vec<dim> UnilateralContact<dim>::row_of(std::span<const double> values, index_t n)
{
  Vec<dim> row;
  std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(n) * dim, dim, row.c.begin());
  return row;
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

/// The mesh of the solid is where its surface is.
template <int dim>
void UnilateralContact<dim>::show_solid()
{
  for (std::size_t n = 0; n < before_.x().size(); ++n)
    std::copy(before_.x()[n].c.begin(), before_.x()[n].c.end(),
              solid_mesh_.x.begin() + static_cast<std::ptrdiff_t>(n) * dim);
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

/// Of the active faces at their nodes, weighted by their measure: the fluid's outward normal points into the
/// solid.
template <int dim>
void UnilateralContact<dim>::find_normals()
{
  normal_.assign(x_.size(), {});
  for (std::size_t f = 0; f < faces_.size(); ++f)
    if (active_[f])
    {
      Vec<dim> n;
      const auto at = [&](std::size_t a) { return x_end_[static_cast<std::size_t>(faces_[f][a])]; };
      if constexpr (dim == 2)
        n = right_normal(at(1) - at(0));
      else
        n = cross(at(1) - at(0), at(2) - at(0));
      for (const int k : faces_[f])
        normal_[static_cast<std::size_t>(k)] -= n;
    }
}

template <int dim>
void UnilateralContact<dim>::find_rows(double dt, const std::array<std::vector<double>, 2>& v)
{
  weights_.clear();
  report_.deepest = 0.0;
  for (std::size_t k = 0; k < x_.size(); ++k)
    x_end_[k] = x_[k] + dt * row_of(v[Side::fluid], static_cast<index_t>(k));
  find_near();
  find_active();
  integrate_rows(find_changed(dt, v));
  find_normals();
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
    else if (!mortar_[k].empty() && norm_squared(normal_[k]) > 0.0)
    {
      weights_.insert(weights_.end(), mortar_[k].begin(), mortar_[k].end());
      add_row(static_cast<index_t>(k), (1.0 / norm(normal_[k])) * normal_[k], first);
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

/// Impulses of the rows as forces on both sides, and as what the fluid's nodes move by.
template <int dim>
void UnilateralContact<dim>::give_forces(double dt, std::array<std::vector<double>, 2>& f)
{
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
    after_.x()[n] = before_.x()[n] + dt * row_of(v[Side::solid], static_cast<index_t>(n));
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
  give_forces(dt, f);
  for (std::size_t n = 0; n < x_.size(); ++n)
    x_[n] += dt * row_of(v[Side::fluid], static_cast<index_t>(n));
  for (std::size_t n = 0; n < after_.x().size(); ++n)
    before_.x()[n] = after_.x()[n] + dt * dv_solid_[n];
  show_solid();

  for (const Side s : both_sides)
    balance_.impulse[s] = norm(impulse_[s]);
  balance_.impulse_mismatch = norm(impulse_[Side::fluid] + impulse_[Side::solid]);
  balance_.velocity_jump = report_.residual_gap / dt;
  balance_.displacement_gap = std::max(report_.residual_gap, report_.deepest);
}

template class UnilateralContact<2>;
template class UnilateralContact<3>;

} // namespace undine::coupler
