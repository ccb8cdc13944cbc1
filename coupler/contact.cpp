// Search and projected Gauss-Seidel solution of the contact of one step.
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
UnilateralContact<dim>::UnilateralContact(const link::SurfaceMesh& fluid, const link::SurfaceMesh& solid)
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
  search_due_ = true;
}

template <int dim>
void UnilateralContact<dim>::replace_solid(const link::SurfaceMesh& solid)
{
  solid_mesh_ = solid;
  inverse_mass_[Side::solid] = solid.inverse_mass;
  before_ = after_ = FacetSurface<dim>(as_points(solid.x), solid.face_offset, solid.face_nodes);
  dv_solid_.assign(before_.x().size(), {});
  reach_ = 2.0 * before_.facet_size();
  search_due_ = true;
}

template <int dim>
link::SurfaceMesh UnilateralContact<dim>::solid_now() const
{
  link::SurfaceMesh mesh = solid_mesh_;
  for (std::size_t n = 0; n < before_.x().size(); ++n)
    for (int i = 0; i < dim; ++i)
      mesh.x[n * dim + static_cast<std::size_t>(i)] = before_.x()[n][i];
  return mesh;
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
  ++report_.searches;
  before_.sort_bins();
  candidates_.clear();
  candidate_offset_.assign(1, 0);
  for (const Vec<dim>& x : x_)
  {
    before_.within(x, std::max(reach_, 2.0 * travel), candidates_);
    candidate_offset_.push_back(static_cast<index_t>(candidates_.size()));
  }
}

template <int dim>
void UnilateralContact<dim>::find_rows(double dt, const std::array<std::vector<double>, 2>& v)
{
  constexpr double margin = 0.05; // of a facet: rows that the impulses of others may close
  constexpr double repair = 0.05; // of what a node is inside already, per step: no kick from a remesh
  rows_.clear();
  report_.deepest = 0.0;
  for (std::size_t k = 0; k < x_.size(); ++k)
  {
    const std::span<const index_t> facets(
        candidates_.data() + candidate_offset_[k],
        static_cast<std::size_t>(candidate_offset_[k + 1] - candidate_offset_[k]));
    if (facets.empty())
      continue;
    Vec<dim> x_end = x_[k];
    for (int i = 0; i < dim; ++i)
      x_end[i] += dt * v[Side::fluid][k * dim + static_cast<std::size_t>(i)];
    const auto near = after_.nearest(x_end, facets);
    if (near.beside || near.gap > margin * 0.5 * reach_)
      continue;
    Row row{.node = static_cast<index_t>(k),
            .facet = after_.facets()[static_cast<std::size_t>(near.facet)],
            .weight = near.weight,
            .n = near.normal,
            .gap = near.gap,
            .compliance = 0.0,
            .impulse = last_impulse_[k]};
    Vec<dim> apart = x_[k];
    for (std::size_t c = 0; c < dim; ++c)
      apart -= row.weight[c] * before_.x()[static_cast<std::size_t>(row.facet[c])];
    const double gap_before = dot(row.n, apart);
    if (gap_before < 0.0)
    {
      report_.deepest = std::max(report_.deepest, -gap_before);
      row.gap -= (1.0 - repair) * gap_before;
    }
    row.compliance = dot(row.n, product(inverse_mass_[Side::fluid], row.node, row.n));
    for (std::size_t c = 0; c < dim; ++c)
      row.compliance += row.weight[c] * row.weight[c] *
                        dot(row.n, product(inverse_mass_[Side::solid], row.facet[c], row.n));
    if (row.compliance > 0.0)
      rows_.push_back(row);
  }
}

/// Projected Gauss-Seidel: each row in turn gets the impulse that closes its own gap exactly, never a
/// negative one. It converges for every symmetric positive semi-definite problem.
template <int dim>
void UnilateralContact<dim>::solve(double dt)
{
  constexpr int most_sweeps = 200;
  std::fill(dv_solid_.begin(), dv_solid_.end(), Vec<dim>{});
  const auto push_solid = [&](const Row& row, double impulse)
  {
    for (std::size_t c = 0; c < dim; ++c)
      dv_solid_[static_cast<std::size_t>(row.facet[c])] -=
          (row.weight[c] * impulse) * product(inverse_mass_[Side::solid], row.facet[c], row.n);
  };
  for (const Row& row : rows_)
    push_solid(row, row.impulse);
  const double small = 1e-12 * reach_;
  report_.sweeps = 0;
  for (double worst = 2.0 * small; worst > small && report_.sweeps < most_sweeps; ++report_.sweeps)
  {
    worst = 0.0;
    for (Row& row : rows_)
    {
      // Each fluid node has one row, so its own change of velocity follows from it.
      const double of_node = dot(row.n, product(inverse_mass_[Side::fluid], row.node, row.n)) * row.impulse;
      double of_solid = 0.0;
      for (std::size_t c = 0; c < dim; ++c)
        of_solid += row.weight[c] * dot(row.n, dv_solid_[static_cast<std::size_t>(row.facet[c])]);
      const double gap = row.gap + dt * (of_node - of_solid);
      const double impulse = std::max(0.0, row.impulse - gap / (dt * row.compliance)),
                   change = impulse - row.impulse;
      if (change == 0.0)
        continue;
      push_solid(row, change);
      row.impulse = impulse;
      worst = std::max(worst, std::abs(change) * dt * row.compliance);
    }
    report_.residual_gap = worst;
  }
}

template <int dim>
void UnilateralContact<dim>::advance(double dt, const std::array<std::vector<double>, 2>& v,
                                     std::array<std::vector<double>, 2>& f)
{
  double fastest[2] = {0.0, 0.0};
  for (const Side s : both_sides)
  {
    f[s].assign(v[s].size(), 0.0);
    for (std::size_t n = 0; n < v[s].size(); n += dim)
    {
      double square = 0.0;
      for (std::size_t i = 0; i < dim; ++i)
        square += v[s][n + i] * v[s][n + i];
      fastest[s] = std::max(fastest[s], square);
    }
  }
  find_candidates(dt * (std::sqrt(fastest[0]) + std::sqrt(fastest[1])));
  report_.rows = report_.touching = report_.sweeps = 0;
  report_.residual_gap = 0.0;
  rows_.clear();
  for (std::size_t n = 0; n < after_.x().size(); ++n)
    for (int i = 0; i < dim; ++i)
      after_.x()[n][i] = before_.x()[n][i] + dt * v[Side::solid][n * dim + static_cast<std::size_t>(i)];
  if (!candidates_.empty())
    find_rows(dt, v);
  std::fill(dv_solid_.begin(), dv_solid_.end(), Vec<dim>{});
  if (!rows_.empty())
  {
    solve(dt);
    ++report_.solves;
    std::fill(last_impulse_.begin(), last_impulse_.end(), 0.0);
  }
  report_.rows = static_cast<int>(rows_.size());
  for (const Row& row : rows_)
  {
    if (!(row.impulse > 0.0))
      continue;
    ++report_.touching;
    last_impulse_[static_cast<std::size_t>(row.node)] = row.impulse;
    const Vec<dim> J = row.impulse * row.n;
    const auto add = [&](Side side, index_t n, const Vec<dim>& impulse)
    {
      for (int i = 0; i < dim; ++i)
        f[side][static_cast<std::size_t>(n) * dim + static_cast<std::size_t>(i)] += impulse[i] / dt;
      impulse_[side] += impulse;
    };
    add(Side::fluid, row.node, J);
    for (std::size_t c = 0; c < dim; ++c)
      add(Side::solid, row.facet[c], -row.weight[c] * J);
    x_[static_cast<std::size_t>(row.node)] += dt * product(inverse_mass_[Side::fluid], row.node, J);
  }
  for (std::size_t n = 0; n < x_.size(); ++n)
    for (int i = 0; i < dim; ++i)
      x_[n][i] += dt * v[Side::fluid][n * dim + static_cast<std::size_t>(i)];
  for (std::size_t n = 0; n < after_.x().size(); ++n)
    before_.x()[n] = after_.x()[n] + dt * dv_solid_[n];

  for (const Side s : both_sides)
    balance_.impulse[s] = norm(impulse_[s]);
  balance_.impulse_mismatch = norm(impulse_[Side::fluid] + impulse_[Side::solid]);
  balance_.velocity_jump = report_.residual_gap / dt;
  balance_.displacement_gap = std::max(report_.residual_gap, report_.deepest);
}

template class UnilateralContact<2>;
template class UnilateralContact<3>;

} // namespace undine::coupler
