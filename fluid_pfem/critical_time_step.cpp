// Infinity-norm bound of the acoustic operator.
#include "fluid_pfem/critical_time_step.hpp"

#include "fluid_pfem/newtonian.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace undine::fluid
{

namespace
{

/// |∂V_j/∂x_i| for one i and all its neighbours j (i itself included): V_e∇N_i/(dim+1) summed over the shared
/// elements.
template <int dim>
class RowOfB
{
public:
  void gather(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes, index_t i)
  {
    neighbour_.clear();
    value_.clear();
    const auto fan = mesh.fan(i);
    Vec<dim> own{};
    if constexpr (dim == 2)
    {
      // Counter-clockwise fan: the edge i–j is shared by the entry that begins with j and the one before it.
      Vec<2> last{};
      for (std::size_t k = 0; k < fan.size(); ++k)
      {
        const Vec<2> part = part_of(nodes, fan[k]);
        own += part;
        const bool joined = k > 0 && fan[k - 1].opposite[1] == fan[k].opposite[0];
        if (k > 0 && !joined)
          add(fan[k - 1].opposite[1], last);
        add(fan[k].opposite[0], joined ? last + part : part);
        last = part;
      }
      if (!fan.empty())
      {
        if (fan.back().opposite[1] == fan.front().opposite[0])
          value_.front() += last; // closed
        else
          add(fan.back().opposite[1], last);
      }
    }
    else
      for (const auto& entry : fan)
      {
        const Vec<dim> part = part_of(nodes, entry);
        own += part;
        for (const index_t j : entry.opposite)
        {
          const auto it = std::find(neighbour_.begin(), neighbour_.end(), j);
          if (it == neighbour_.end())
            add(j, part);
          else
            value_[static_cast<std::size_t>(it - neighbour_.begin())] += part;
        }
      }
    if (!fan.empty())
      add(i, own);
  }
  template <class Visit>
  void for_each(Visit&& visit) const
  {
    for (std::size_t k = 0; k < neighbour_.size(); ++k)
      visit(neighbour_[k], norm(value_[k]));
  }

private:
  static Vec<dim> part_of(const FluidNodes<dim>& nodes, const FanEntry<dim>& entry)
  {
    std::array<Vec<dim>, dim> opposite;
    for (std::size_t k = 0; k < dim; ++k)
      opposite[k] = nodes.x[static_cast<std::size_t>(entry.opposite[k])];
    return (1.0 / (dim + 1)) * volume_gradient<dim, double>(opposite);
  }
  void add(index_t j, const Vec<dim>& part)
  {
    neighbour_.push_back(j);
    value_.push_back(part);
  }
  std::vector<index_t> neighbour_;
  std::vector<Vec<dim>> value_;
};

} // namespace

template <int dim>
double critical_time_step(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes, const Tait& tait,
                          const ElementTermsConfig& viscosity, double floor)
{
  const index_t n_nodes = nodes.size();
  std::vector<double> column_sum(static_cast<std::size_t>(n_nodes), 0.0);
  RowOfB<dim> row;
  for (index_t i = 0; i < n_nodes; ++i)
  {
    row.gather(mesh, nodes, i);
    row.for_each([&](index_t j, double B) { column_sum[static_cast<std::size_t>(j)] += B; });
  }
  double omega_squared = 0.0;
  for (index_t i = 0; i < n_nodes; ++i)
  {
    double sum = 0.0;
    row.gather(mesh, nodes, i);
    row.for_each(
        [&](index_t j, double B)
        {
          const auto k = static_cast<std::size_t>(j);
          sum += B * tait.tangent_modulus(nodes.p[k]) /
                 std::max(nodes.V[k], floor * regular_volume<dim>(nodes.h[k])) * column_sum[k];
        });
    if (sum > 0.0)
      omega_squared = std::max(omega_squared, sum / nodes.inertia[static_cast<std::size_t>(i)]);
  }
  if (!(omega_squared > 0.0))
    return std::numeric_limits<double>::max();
  double dt = 2.0 / std::sqrt(omega_squared);
  if (viscosity.none())
    return dt;

  double xi = viscosity.bulk_linear;
  std::vector<double> shear(viscosity.mu > 0.0 ? static_cast<std::size_t>(n_nodes) : 0,
                            0.0); // row sums [kg/s]
  const double c0 = tait.sound_speed(tait.rho0);
  for (const auto& e : mesh.elements)
  {
    std::array<Vec<dim>, dim + 1> x;
    Mat<dim> V_grad_v;
    double V2_grad_N2 = 0.0, V_grad_N_sum = 0.0;
    for (std::size_t a = 0; a <= dim; ++a)
      x[a] = nodes.x[static_cast<std::size_t>(e[a])];
    const double V = signed_volume<dim, double>(x);
    if (!(V > 0.0))
      continue;
    const auto V_grad_N = volume_gradients<dim, double>(x);
    for (std::size_t a = 0; a <= dim; ++a)
    {
      V_grad_v += outer(nodes.v[static_cast<std::size_t>(e[a])], V_grad_N[a]);
      V2_grad_N2 += norm_squared(V_grad_N[a]);
      V_grad_N_sum += norm(V_grad_N[a]);
    }
    const double height = V / std::sqrt(V2_grad_N2), div_v = trace(V_grad_v) / V;
    const double b2 = viscosity.bulk_quadratic;
    xi = std::max(xi, viscosity.bulk_linear + b2 * b2 * height * std::max(-div_v, 0.0) / c0);
    // vᵀK v = ∫2μ |dev ε|² ≤ ∫2μ |∇v|²: at most twice the Laplacian, of which this is the row sum.
    if (viscosity.mu > 0.0)
      for (std::size_t a = 0; a <= dim; ++a)
        shear[static_cast<std::size_t>(e[a])] +=
            2.0 * viscosity.mu * viscous_fraction<dim>(V, V2_grad_N2) * norm(V_grad_N[a]) * V_grad_N_sum / V;
  }
  double lambda = 0.0;
  for (std::size_t n = 0; n < shear.size(); ++n)
    lambda = std::max(lambda, shear[n] / nodes.inertia[n]);
  dt *= std::sqrt(1.0 + xi * xi) - xi;
  if (lambda > 0.0)
    dt = std::min(dt, 2.0 / lambda);
  return dt;
}

template double critical_time_step<2>(const FluidMesh<2>&, const FluidNodes<2>&, const Tait&,
                                      const ElementTermsConfig&, double);
template double critical_time_step<3>(const FluidMesh<3>&, const FluidNodes<3>&, const Tait&,
                                      const ElementTermsConfig&, double);

} // namespace undine::fluid
