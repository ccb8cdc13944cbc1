// Infinity-norm bound of the acoustic operator.
#include "fluid_pfem/critical_time_step.hpp"

#include "common/lanes.hpp"
#include "fluid_pfem/newtonian.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>
#include <type_traits>

namespace undine::fluid
{

namespace
{

/// Row i of |B|, B_ij = ∂V_j/∂x_i = Σ_e V_e∇N_i/(dim+1) over the elements that i and j share.
/// visit(j, |B_ij|, |B_ji|) for all neighbours j, then for i itself.
/// `wraps`: in a periodic space; apart, because it would slow down all others by a third.
template <int dim, bool wraps>
class RowOfB
{
public:
  template <class Visit>
  void for_each(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes, index_t i, Visit&& visit)
  {
    const auto fan = mesh.fan(i);
    if (fan.empty())
      return;
    if constexpr (dim == 2)
    {
      // Two triangles (i, j, k) and (i, l, j) give ½ (x_l − x_k) turned by 90°, whichever end of i–j is
      // asked; one alone gives ½ (x_j − x_k) at i and ½ (x_k − x_i) at j. The fan is chained
      // counter-clockwise.
      const Vec<2>& xi = nodes.x[static_cast<std::size_t>(i)];
      const auto x = [&](index_t n) -> std::conditional_t<wraps, Vec<2>, const Vec<2>&>
      {
        if constexpr (wraps)
          return nodes.period.near(xi, nodes.x[static_cast<std::size_t>(n)]);
        else
          return nodes.x[static_cast<std::size_t>(n)];
      };
      if (is_closed(fan)) // triangles (i, n_k, n_k+1) all around
      {
        index_t before = fan.back().opposite[0];
        for (const auto& entry : fan)
        {
          const double B = sixth * norm(x(before) - x(entry.opposite[1]));
          visit(entry.opposite[0], B, B);
          before = entry.opposite[0];
        }
        return; // its volume does not depend on x_i
      }
      const bool closed = fan.back().opposite[1] == fan.front().opposite[0];
      Vec<2> own{};
      for (std::size_t k = 0; k < fan.size(); ++k)
      {
        const auto [j, next] = fan[k].opposite;
        const bool joined = k > 0 ? fan[k - 1].opposite[1] == j : closed;
        if (joined)
        {
          const index_t before = (k > 0 ? fan[k - 1] : fan.back()).opposite[0];
          const double B = sixth * norm(x(before) - x(next));
          visit(j, B, B);
        }
        else
          visit(j, sixth * norm(x(j) - x(next)), sixth * norm(x(next) - xi));
        const bool last = k + 1 == fan.size() ? !closed : fan[k + 1].opposite[0] != next;
        if (last)
          visit(next, sixth * norm(x(j) - x(next)), sixth * norm(x(j) - xi));
        own += x(j) - x(next);
      }
      const double B = sixth * norm(own);
      visit(i, B, B);
    }
    else
    {
      neighbour_.clear();
      value_.clear();
      Vec<dim> own{};
      for (const auto& entry : fan)
      {
        std::array<Vec<dim>, dim> opposite;
        for (std::size_t k = 0; k < dim; ++k)
          opposite[k] = nodes.period.near(nodes.x[static_cast<std::size_t>(i)],
                                          nodes.x[static_cast<std::size_t>(entry.opposite[k])]);
        const Vec<dim> part = (1.0 / (dim + 1)) * volume_gradient<dim, double>(opposite);
        own += part;
        for (std::size_t k = 0; k < dim; ++k)
        {
          // The other side of the pair: V_e∇N_j of the same element, (j, i, the two others) even.
          std::array<Vec<dim>, dim> seen_from_j;
          seen_from_j[0] = nodes.x[static_cast<std::size_t>(i)];
          seen_from_j[1] = opposite[(k + 2) % 3];
          seen_from_j[2] = opposite[(k + 1) % 3];
          const Vec<dim> back = (1.0 / (dim + 1)) * volume_gradient<dim, double>(seen_from_j);
          const index_t j = entry.opposite[k];
          const auto it = std::find(neighbour_.begin(), neighbour_.end(), j);
          if (it == neighbour_.end())
          {
            neighbour_.push_back(j);
            value_.push_back({part, back});
          }
          else
          {
            auto& value = value_[static_cast<std::size_t>(it - neighbour_.begin())];
            value[0] += part;
            value[1] += back;
          }
        }
      }
      for (std::size_t k = 0; k < neighbour_.size(); ++k)
        visit(neighbour_[k], norm(value_[k][0]), norm(value_[k][1]));
      visit(i, norm(own), norm(own));
    }
  }

private:
  static constexpr double sixth = 1.0 / 6.0;
  std::vector<index_t> neighbour_;
  std::vector<std::array<Vec<dim>, 2>> value_;
};

/// Σ_j |B_ij| of the inner nodes with few neighbours among eight of the plane, side by side: with the
/// neighbours n_k around a node in their order it is Σ_k |x(n_k+1) − x(n_k−1)|/6, and the same for i–j as for
/// j–i.
class RingSums
{
public:
  static constexpr index_t most = 8; ///< neighbours

  [[gnu::flatten]] RingSums(const FluidMesh<2>& mesh, const FluidNodes<2>& nodes, std::size_t group)
  {
    constexpr std::size_t L = Lanes::size;
    const Rings::Row* const row = mesh.rings.row.data() + mesh.rings.begin[group];
    const auto n_rows = static_cast<std::size_t>(mesh.rings.begin[group + 1] - mesh.rings.begin[group]);
    const std::size_t n_lanes = std::min(L, mesh.fan_begin.size() - 1 - L * group);
    // A ring that is open somewhere has its node in it.
    const index_t twice_first = 2 * (mesh.first_with_fan + static_cast<index_t>(L * group));
    std::array<index_t, L> open{}, size{};
    for (std::size_t k = 0; k < n_rows; ++k)
      for (std::size_t l = 0; l < L; ++l)
        open[l] |= row[k][l] == twice_first + 2 * static_cast<index_t>(l);
    const index_t* const begin = mesh.fan_begin.data() + L * group;
    for (std::size_t l = 0; l < n_lanes; ++l)
      if (!open[l] && begin[l + 1] - begin[l] <= most)
        size[l] = begin[l + 1] - begin[l];
    const double *const x = nodes.x.front().c.data(), *last[L];
    Lanes neighbours;
    std::size_t largest = 0;
    for (std::size_t l = 0; l < L; ++l)
    {
      const auto s = static_cast<std::size_t>(size[l]);
      here_[l] = s > 0;
      neighbours.set(static_cast<int>(l), static_cast<double>(s));
      largest = std::max(largest, s);
      last[l] = x + row[std::max<std::size_t>(s, 1) - 1][l];
    }
    const auto load = [&](std::size_t k, Vec<2, Lanes>& point)
    {
      const double* from[L];
      for (std::size_t l = 0; l < L; ++l)
        from[l] = x + row[k < n_rows ? k : 0][l];
      load_pairs(from, point[0], point[1]);
    };
    Vec<2, Lanes> before, here, next;
    load_pairs(last, before[0], before[1]);
    load(0, here);
    for (std::size_t k = 0; k < largest; ++k)
    {
      load(k + 1, next);
      sum_ += select(Lanes(static_cast<double>(k)) < neighbours, Lanes(1.0 / 6.0), Lanes(0.0)) *
              sqrt(norm_squared(before - next));
      before = here;
      here = next;
    }
  }
  bool here(std::size_t lane) const { return here_[lane]; }
  bool all_here() const { return std::count(here_.begin(), here_.end(), true) == Lanes::size; }
  const Lanes& sum() const { return sum_; }

private:
  Lanes sum_;
  std::array<bool, Lanes::size> here_;
};

/// Square of the highest frequency, bounded by [6] without damping [1/s²].
template <int dim, bool wraps>
double largest_omega_squared(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes, const Tait& tait,
                             double floor, const Team& team, Halo& halo, StepWorkspace& workspace)
{
  const index_t n_nodes = nodes.size();
  // Row sums of |B|, and column sums times the stiffness of their node.
  std::vector<double>&stiffness = workspace.stiffness, &row_sum = workspace.row_sum;
  stiffness.resize(static_cast<std::size_t>(n_nodes));
  row_sum.resize(static_cast<std::size_t>(n_nodes));
  team.each(
      [&](const Share& share)
      {
        RowOfB<dim, wraps> row;
        const auto set = [&](index_t i, double of_row, double of_column)
        {
          const auto k = static_cast<std::size_t>(i);
          row_sum[k] = of_row;
          stiffness[k] = of_column * tait.tangent_modulus(nodes.p[k]) /
                         std::max(nodes.V[k], floor * regular_volume<dim>(nodes.h[k]));
        };
        const auto set_one = [&](index_t i)
        {
          double of_row = 0.0, of_column = 0.0;
          row.for_each(mesh, nodes, i,
                       [&](index_t, double B_ij, double B_ji)
                       {
                         of_row += B_ij;
                         of_column += B_ji;
                       });
          set(i, of_row, of_column);
        };
        if constexpr (dim == 2 && !wraps)
          for (index_t n = share.node_begin; n < share.node_end;)
          {
            const index_t group = (n - mesh.first_with_fan) / Lanes::size,
                          first = mesh.first_with_fan + group * Lanes::size,
                          end = std::min(first + Lanes::size, share.node_end);
            const RingSums rings(mesh, nodes, static_cast<std::size_t>(group));
            if (rings.all_here() && end - n == Lanes::size)
            {
              const auto k = static_cast<std::size_t>(n);
              const Lanes least = Lanes(floor) * regular_volume<2>(load_lanes(&nodes.h[k], Lanes::size));
              store_lanes(rings.sum(), &row_sum[k], Lanes::size);
              store_lanes(rings.sum() * tait.tangent_modulus(load_lanes(&nodes.p[k], Lanes::size)) /
                              max(load_lanes(&nodes.V[k], Lanes::size), least),
                          &stiffness[k], Lanes::size);
              n = end;
            }
            for (; n < end; ++n)
              if (rings.here(static_cast<std::size_t>(n - first)))
                set(n, rings.sum()[n - first], rings.sum()[n - first]);
              else
                set_one(n);
          }
        else
          for (index_t i = share.node_begin; i < share.node_end; ++i)
            set_one(i);
      });
  halo.update(stiffness);
  const auto eight = [](const std::vector<double>& field, index_t first, index_t end) {
    return load_lanes(&field[static_cast<std::size_t>(first)], std::min<index_t>(Lanes::size, end - first));
  };
  double stiffest = 0.0; // of all nodes in the rows here
  const auto look = [&](double of_one) { stiffest = std::max(stiffest, of_one); };
  Lanes stiffest_of_eight(0.0);
  for (index_t n = team.node_begin(); n < team.node_end(); n += Lanes::size)
    stiffest_of_eight = max(stiffest_of_eight, eight(stiffness, n, team.node_end()));
  for (int l = 0; l < Lanes::size; ++l)
    look(stiffest_of_eight[l]);
  for (const auto& ghosts : halo.received())
    for (const index_t n : ghosts)
      look(stiffness[static_cast<std::size_t>(n)]);
  workspace.largest.assign(team.shares().size(), 0.0);
  team.each(
      [&](const Share& share)
      {
        RowOfB<dim, wraps> row;
        double largest = 0.0;
        const auto see = [&](index_t i)
        {
          double sum = 0.0;
          row.for_each(mesh, nodes, i,
                       [&](index_t j, double B_ij, double)
                       { sum += B_ij * stiffness[static_cast<std::size_t>(j)]; });
          if (sum > 0.0)
            largest = std::max(largest, sum / nodes.inertia[static_cast<std::size_t>(i)]);
        };
        // A row sums to no more than it would with the stiffest of its nodes: is it worth a look? The first
        // looks go where the largest is likely to be, so that few more are needed.
        constexpr double beyond_rounding = 1.0 + 1e-12;
        const auto may_be_larger = [&](std::size_t n, double most)
        { return !(row_sum[n] * most * beyond_rounding < largest * nodes.inertia[n]); };
        const auto look_closer = [&](index_t i)
        {
          const auto n = static_cast<std::size_t>(i);
          if (!may_be_larger(n, stiffest))
            return;
          double most = stiffness[n];
          for (const auto& entry : mesh.fan(i))
            for (const index_t j : entry.opposite)
              most = std::max(most, stiffness[static_cast<std::size_t>(j)]);
          if (may_be_larger(n, most))
            see(i);
        };
        double likely = -1.0;
        index_t begin = share.node_begin;
        for (index_t first = share.node_begin; first < share.node_end; first += Lanes::size)
          if (any(eight(row_sum, first, share.node_end) * eight(stiffness, first, share.node_end) >
                  Lanes(likely) * eight(nodes.inertia, first, share.node_end)))
            for (index_t i = first; i < std::min(first + Lanes::size, share.node_end); ++i)
              if (const auto n = static_cast<std::size_t>(i);
                  row_sum[n] * stiffness[n] > likely * nodes.inertia[n])
              {
                likely = row_sum[n] * stiffness[n] / nodes.inertia[n];
                begin = i;
              }
        if (begin < share.node_end)
        {
          see(begin);
          for (const auto& entry : mesh.fan(begin))
            if (share.owns(entry.opposite[0]))
              see(entry.opposite[0]);
        }
        for (index_t first = share.node_begin; first < share.node_end; first += Lanes::size)
        {
          if (!any(~(eight(row_sum, first, share.node_end) * Lanes(stiffest * beyond_rounding) <
                     Lanes(largest) * eight(nodes.inertia, first, share.node_end))))
            continue;
          for (index_t i = first; i < std::min(first + Lanes::size, share.node_end); ++i)
            look_closer(i);
        }
        workspace.largest[team.number(share)] = largest;
      });
  return *std::max_element(workspace.largest.begin(), workspace.largest.end());
}

} // namespace

template <int dim>
double critical_time_step(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes, const Tait& tait,
                          const ElementTermsConfig& viscosity, double floor, const Team& team, Halo& halo,
                          StepWorkspace& workspace)
{
  double omega_squared =
      nodes.period.any() ? largest_omega_squared<dim, true>(mesh, nodes, tait, floor, team, halo, workspace)
                         : largest_omega_squared<dim, false>(mesh, nodes, tait, floor, team, halo, workspace);

  double xi = viscosity.bulk_linear;
  std::vector<double>& shear = workspace.shear; // row sums [kg/s]
  shear.assign(viscosity.mu > 0.0 ? nodes.x.size() : 0, 0.0);
  const bool depends_on_elements = viscosity.mu > 0.0 || viscosity.bulk_quadratic > 0.0;
  const double c0 = tait.sound_speed(tait.rho0);
  const auto see = [&](const Simplex<dim>& e, const Share& share, bool own, double& xi_here)
  {
    const auto x = corners<dim>(nodes.x, e, nodes.period);
    Mat<dim> V_grad_v;
    double V2_grad_N2 = 0.0, V_grad_N_sum = 0.0;
    const double V = signed_volume<dim, double>(x);
    if (!(V > 0.0))
      return;
    const auto V_grad_N = volume_gradients<dim, double>(x);
    for (std::size_t a = 0; a <= dim; ++a)
    {
      V_grad_v += outer(nodes.v[static_cast<std::size_t>(e[a])], V_grad_N[a]);
      V2_grad_N2 += norm_squared(V_grad_N[a]);
      V_grad_N_sum += norm(V_grad_N[a]);
    }
    const double height = V / std::sqrt(V2_grad_N2), div_v = trace(V_grad_v) / V;
    const double b2 = viscosity.bulk_quadratic;
    if (own)
      xi_here = std::max(xi_here, viscosity.bulk_linear + b2 * b2 * height * std::max(-div_v, 0.0) / c0);
    // vᵀK v = ∫2μ |dev ε|² ≤ ∫2μ |∇v|²: at most twice the Laplacian, of which this is the row sum.
    if (viscosity.mu > 0.0)
      for (std::size_t a = 0; a <= dim; ++a)
        if (share.owns(e[a]))
          shear[static_cast<std::size_t>(e[a])] += 2.0 * viscosity.mu * viscous_fraction<dim>(V, V2_grad_N2) *
                                                   norm(V_grad_N[a]) * V_grad_N_sum / V;
  };
  if (depends_on_elements)
  {
    team.each(
        [&](const Share& share)
        {
          double xi_here = xi;
          for (const index_t e : share.before)
            see(mesh.elements[static_cast<std::size_t>(e)], share, false, xi_here);
          for (index_t e = share.element_begin; e < share.element_end; ++e)
            see(mesh.elements[static_cast<std::size_t>(e)], share, true, xi_here);
          workspace.largest[team.number(share)] = xi_here;
        });
    xi = *std::max_element(workspace.largest.begin(), workspace.largest.end());
  }
  double lambda = 0.0;
  for (std::size_t n = 0; n < shear.size(); ++n)
    lambda = std::max(lambda, shear[n] / nodes.inertia[n]);

  std::array<double, 3> bounds{omega_squared, xi, lambda};
  team.ranks().max(bounds);
  std::tie(omega_squared, xi, lambda) = std::tie(bounds[0], bounds[1], bounds[2]);
  if (!(omega_squared > 0.0))
    return std::numeric_limits<double>::max();
  double dt = 2.0 / std::sqrt(omega_squared);
  if (viscosity.none())
    return dt;
  dt *= std::sqrt(1.0 + xi * xi) - xi;
  if (lambda > 0.0)
    dt = std::min(dt, 2.0 / lambda);
  return dt;
}

template double critical_time_step<2>(const FluidMesh<2>&, const FluidNodes<2>&, const Tait&,
                                      const ElementTermsConfig&, double, const Team&, Halo&, StepWorkspace&);
template double critical_time_step<3>(const FluidMesh<3>&, const FluidNodes<3>&, const Tait&,
                                      const ElementTermsConfig&, double, const Team&, Halo&, StepWorkspace&);

} // namespace undine::fluid
