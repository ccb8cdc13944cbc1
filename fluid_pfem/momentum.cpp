// Element forces, eight elements side by side.
#include "fluid_pfem/momentum.hpp"

#include "fluid_pfem/eight.hpp"
#include "fluid_pfem/newtonian.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>

namespace undine::fluid
{

namespace
{

using std::abs;
using std::max;
using std::sqrt;

/// The corners of one element, or of eight.
template <int dim, class Real>
struct Corners
{
  std::array<Vec<dim, Real>, dim + 1> x, v, a;
  std::array<Real, dim + 1> p, rho;
};

/// What an element adds to its corners.
template <int dim, class Real>
struct Added
{
  std::array<Vec<dim, Real>, dim + 1> F;
  std::array<Real, dim + 1> dm;
  Real dissipation;
};

struct Constants
{
  double b1_c0, b2_squared, mu, alpha, dt;
};

/// The formulas of add_element_forces. `least_mass()` is called only where the limit of z may be reached.
template <bool bulk, bool shear, bool exchange, int dim, class Real, class LeastMass>
Added<dim, Real> element_forces(const Corners<dim, Real>& e, const Constants& k, const Vec<dim, Real>& b,
                                LeastMass&& least_mass)
{
  constexpr double weight = 1.0 / (dim + 1);
  Added<dim, Real> add{};
  const auto S = volume_gradients<dim, Real>(e.x);
  Real P = e.p[0], rho = e.rho[0];
  for (std::size_t c = 1; c <= dim; ++c)
  {
    P += e.p[c];
    rho += e.rho[c];
  }
  P *= weight;
  rho *= weight;
  Real S_squared = norm_squared(S[0]);
  for (std::size_t c = 1; c <= dim; ++c)
    S_squared += norm_squared(S[c]);
  const Real V = dot(S[0], e.x[0] - e.x[1]);
  const Real per_S = Real(1.0) / sqrt(max(S_squared, Real(1e-100)));
  if constexpr (bulk)
  {
    Real D = dot(S[0], e.v[0]);
    for (std::size_t c = 1; c <= dim; ++c)
      D += dot(S[c], e.v[c]);
    const Real r = D * per_S, compression = max(Real(0.0) - r, Real(0.0));
    const Real q = Real(0.0) - rho * (Real(k.b1_c0) + Real(k.b2_squared) * compression) * r;
    P += q;
    add.dissipation -= q * D;
  }
  for (std::size_t c = 0; c <= dim; ++c)
    add.F[c] = P * S[c];
  if constexpr (shear)
  {
    // A sliver that is inverted or as flat as round-off has no meaningful velocity gradient.
    const Real flat = Real(1e-9) * (dim == 2 ? S_squared : sqrt(S_squared) * sqrt(sqrt(S_squared)));
    const Real inverse_V = select(V > flat, Real(1.0) / max(V, Real(1e-300)), Real(0.0));
    Mat<dim, Real> grad_v{};
    for (std::size_t c = 0; c <= dim; ++c)
      grad_v += outer(e.v[c], S[c]);
    grad_v *= inverse_V;
    const Mat<dim, Real> tau = deviatoric_stress<dim, Real>(grad_v, k.mu) *
                               viscous_fraction<dim, Real>(V, max(S_squared, Real(1e-100)));
    for (std::size_t c = 0; c <= dim; ++c)
      add.F[c] -= tau * S[c];
    add.dissipation += contract(tau, grad_v) * V;
  }
  if constexpr (exchange)
  {
    Vec<dim, Real> z{}, a_bar{};
    for (std::size_t c = 0; c <= dim; ++c)
    {
      z += e.p[c] * S[c];
      a_bar += e.a[c];
    }
    a_bar *= Real(weight);
    z -= (V * rho) * (b - a_bar);
    z *= Real(k.alpha) * per_S;
    Real largest{};
    for (std::size_t c = 0; c <= dim; ++c)
    {
      add.dm[c] = Real(0.0) - dot(S[c], z);
      largest = max(largest, abs(add.dm[c]));
    }
    // No corner is lighter than a quarter of its share of this element unless elements have turned over.
    const Real wanted = Real(k.dt) * largest;
    const auto heavy = wanted > Real(0.05 * 0.25 * weight) * rho * V;
    if (any(heavy))
    {
      const Real allowed = Real(0.05) * max(least_mass(), Real(0.0));
      // Lane by lane: what an element does must not depend on those beside it.
      const Real limited = select(wanted > allowed, allowed / max(wanted, Real(1e-300)), Real(1.0));
      const Real share = select(heavy, limited, Real(1.0));
      for (std::size_t c = 0; c <= dim; ++c)
        add.dm[c] *= share;
    }
  }
  return add;
}

// Flattened: eight elements fit into the registers only if every formula is inlined. With sanitizers that
// would take the compiler minutes.
#ifdef __SANITIZE_ADDRESS__
#define UNDINE_FLATTEN
#else
#define UNDINE_FLATTEN [[gnu::flatten]]
#endif

template <bool bulk, bool shear, bool exchange, int dim>
UNDINE_FLATTEN double element_pass(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes,
                                   const Constants& k, const Vec<dim>& body, const index_t* list,
                                   index_t begin, index_t end, const Share& share, ElementSums<dim>& sums)
{
  using Record = NodeRecord<dim>;
  constexpr int L = Lanes::size;
  Vec<dim, Lanes> b;
  for (int i = 0; i < dim; ++i)
    b[i] = body[i];
  const bool all_mine = share.node_begin == 0 && share.node_end == nodes.size();
  Lanes dissipation(0.0);
  double dissipation_of_rest = 0.0;
  for (index_t first = begin; first < end; first += L)
  {
    const int count = std::min<index_t>(L, end - first);
    const auto element = eight_of<dim>(mesh.elements, list, first, end);
    Corners<dim, Lanes> e;
#pragma GCC unroll 4
    for (std::size_t c = 0; c <= dim; ++c)
    {
      Lanes column[Record::size];
      for (int part = 0; part < Record::size; part += L)
      {
        if (part > 0 && !exchange)
          break; // only accelerations are there
        const double* row[L];
        for (std::size_t l = 0; l < L; ++l)
          row[l] = sums.record[static_cast<std::size_t>((*element[l])[c])].c.data() + part;
        load_columns(row, column + part);
      }
      for (int i = 0; i < dim; ++i)
      {
        e.x[c][i] = column[Record::x + i];
        e.v[c][i] = column[Record::v + i];
        if constexpr (exchange)
          e.a[c][i] = column[Record::a + i];
      }
      e.p[c] = column[Record::p];
      e.rho[c] = column[Record::rho];
    }
    nodes.period.join(e.x);
    const auto least_mass = [&]
    {
      Lanes least;
      for (std::size_t l = 0; l < L; ++l)
      {
        double m = nodes.m[static_cast<std::size_t>((*element[l])[0])];
        for (std::size_t c = 1; c <= dim; ++c)
          m = std::min(m, nodes.m[static_cast<std::size_t>((*element[l])[c])]);
        least.set(static_cast<int>(l), m);
      }
      return least;
    };
    const auto add = element_forces<bulk, shear, exchange, dim, Lanes>(e, k, b, least_mass);
#pragma GCC unroll 4
    for (std::size_t c = 0; c <= dim; ++c)
    {
      Lanes column[4];
      for (int i = 0; i < dim; ++i)
        column[i] = add.F[c][i];
      if constexpr (exchange)
        column[3] = add.dm[c];
      FourNumbers row[L];
      store_rows(column, row);
      if (count == L && all_mine)
        for (std::size_t l = 0; l < L; ++l)
          sums.sum[static_cast<std::size_t>((*element[l])[c])] += row[l];
      else
        for (std::size_t l = 0; l < static_cast<std::size_t>(count); ++l)
          if (const index_t n = (*element[l])[c]; share.owns(n))
            sums.sum[static_cast<std::size_t>(n)] += row[l];
    }
    if (count == L)
      dissipation += add.dissipation;
    else
      for (int l = 0; l < count; ++l)
        dissipation_of_rest += add.dissipation[l];
  }
  for (int l = 0; l < L; ++l)
    dissipation_of_rest += dissipation[l];
  return dissipation_of_rest;
}

/// Call `act.template operator()<bulk, shear, exchange>()` with the three run-time switches as constants.
template <class Act>
void with_switches(bool bulk, bool shear, bool exchange, Act&& act)
{
  const auto third = [&]<bool A, bool B>()
  { exchange ? act.template operator()<A, B, true>() : act.template operator()<A, B, false>(); };
  const auto second = [&]<bool A>()
  { shear ? third.template operator()<A, true>() : third.template operator()<A, false>(); };
  bulk ? second.template operator()<true>() : second.template operator()<false>();
}

} // namespace

template <int dim>
void ElementSums<dim>::reset(index_t n)
{
  record.assign(static_cast<std::size_t>(n), {});
  sum.assign(static_cast<std::size_t>(n), FourNumbers{});
  body.clear();
}

template <int dim>
void record_nodes(const FluidNodes<dim>& nodes, const ElementTermsConfig& config, index_t begin, index_t end,
                  ElementSums<dim>& sums)
{
  using Record = NodeRecord<dim>;
  const double with_a = config.residual_with_acceleration ? 1.0 : 0.0;
  for (auto n = static_cast<std::size_t>(begin); n < static_cast<std::size_t>(end); ++n)
  {
    auto& c = sums.record[n].c;
    for (std::size_t i = 0; i < dim; ++i)
    {
      c[Record::x + i] = nodes.x[n].c[i];
      c[Record::v + i] = nodes.v[n].c[i];
      c[Record::a + i] = with_a * nodes.a[n].c[i];
    }
    c[Record::p] = nodes.p[n];
    c[Record::rho] = nodes.rho[n];
  }
  if (!sums.body.empty())
    for (auto n = static_cast<std::size_t>(begin); n < static_cast<std::size_t>(end); ++n)
      for (std::size_t i = 0; i < dim; ++i)
        sums.record[n].c[Record::a + i] -= sums.body[n].c[i];
}

template <int dim>
double add_element_forces(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes,
                          const ElementTermsConfig& config, double c0, const Vec<dim>& b, double dt,
                          const index_t* list, index_t begin, index_t end, const Share& share,
                          ElementSums<dim>& sums)
{
  const Constants constants{.b1_c0 = config.bulk_linear * c0,
                            .b2_squared = config.bulk_quadratic * config.bulk_quadratic,
                            .mu = config.mu,
                            .alpha = config.residual * std::sqrt(2.0 * dim) / c0,
                            .dt = dt};
  double power = 0.0;
  with_switches(config.bulk(), config.mu > 0.0, config.residual > 0.0,
                [&]<bool B, bool S, bool X>() {
                  power =
                      element_pass<B, S, X, dim>(mesh, nodes, constants, b, list, begin, end, share, sums);
                });
  return power;
}

template <int dim>
void take_acceleration(FluidNodes<dim>& nodes, const Vec<dim>& b, index_t begin, index_t end,
                       ElementSums<dim>& sums, std::span<double> mass_rate)
{
  for (auto n = static_cast<std::size_t>(begin); n < static_cast<std::size_t>(end); ++n)
  {
    const double per_mass = 1.0 / nodes.inertia[n];
    for (int i = 0; i < dim; ++i)
      nodes.a[n][i] = per_mass * (sums.sum[n][i] + nodes.m[n] * b[i]); // what weighs is m, whatever resists
  }
  for (std::size_t k = 0; k < mass_rate.size(); ++k)
    mass_rate[k] = sums.sum[static_cast<std::size_t>(begin) + k][3];
  std::fill(sums.sum.begin() + begin, sums.sum.begin() + end, FourNumbers{});
}

template struct ElementSums<2>;
template struct ElementSums<3>;
template void record_nodes<2>(const FluidNodes<2>&, const ElementTermsConfig&, index_t, index_t,
                              ElementSums<2>&);
template void record_nodes<3>(const FluidNodes<3>&, const ElementTermsConfig&, index_t, index_t,
                              ElementSums<3>&);
template double add_element_forces<2>(const FluidMesh<2>&, const FluidNodes<2>&, const ElementTermsConfig&,
                                      double, const Vec<2>&, double, const index_t*, index_t, index_t,
                                      const Share&, ElementSums<2>&);
template double add_element_forces<3>(const FluidMesh<3>&, const FluidNodes<3>&, const ElementTermsConfig&,
                                      double, const Vec<3>&, double, const index_t*, index_t, index_t,
                                      const Share&, ElementSums<3>&);
template void take_acceleration<2>(FluidNodes<2>&, const Vec<2>&, index_t, index_t, ElementSums<2>&,
                                   std::span<double>);
template void take_acceleration<3>(FluidNodes<3>&, const Vec<3>&, index_t, index_t, ElementSums<3>&,
                                   std::span<double>);

} // namespace undine::fluid
