// Element forces, eight elements side by side.
#include "fluid_pfem/momentum.hpp"

#include "fluid_pfem/eight.hpp"
#include "fluid_pfem/newtonian.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

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

/// What an element adds to its corners but the first, which gets minus their sum: nothing is created.
template <int dim, class Real>
struct Added
{
  std::array<Vec<dim, Real>, dim> F;
  std::array<Real, dim> dm;
  Real dissipation;
};

struct Constants
{
  double b1_c0, b2_squared, mu, alpha, dt;
};

/// The formulas of add_element_forces. `least_mass()` is called only where the limit of z may be reached.
template <bool stabilised, bool shear, int dim, class Real, class LeastMass>
Added<dim, Real> element_forces(const Corners<dim, Real>& e, const Constants& k, const Vec<dim, Real>& b,
                                LeastMass&& least_mass)
{
  constexpr double weight = 1.0 / (dim + 1);
  Added<dim, Real> add{};
  // S_0 = −Σ S_c: sums over corners of S_c times anything take differences to the first.
  const auto S_all = volume_gradients<dim, Real>(e.x);
  const auto S = [&S_all](std::size_t c) -> const Vec<dim, Real>& { return S_all[c + 1]; };
  Real P = e.p[0];
  for (std::size_t c = 1; c <= dim; ++c)
    P += e.p[c];
  P *= weight;
  Real S_squared, V, per_S, rho;
  if constexpr (stabilised || shear)
  {
    Vec<dim, Real> minus_S0 = S(0);
    S_squared = norm_squared(S(0));
    for (std::size_t c = 1; c < dim; ++c)
    {
      minus_S0 += S(c);
      S_squared += norm_squared(S(c));
    }
    S_squared = max(S_squared + norm_squared(minus_S0), Real(1e-100));
    V = dot(minus_S0, e.x[1] - e.x[0]);
  }
  if constexpr (stabilised)
  {
    Real D = dot(S(0), e.v[1] - e.v[0]);
    for (std::size_t c = 1; c < dim; ++c)
      D += dot(S(c), e.v[c + 1] - e.v[0]);
    per_S = inverse_sqrt(S_squared);
    rho = e.rho[0];
    for (std::size_t c = 1; c <= dim; ++c)
      rho += e.rho[c];
    rho *= weight;
    const Real r = D * per_S, compression = max(Real(0.0) - r, Real(0.0));
    const Real minus_q = rho * (Real(k.b1_c0) + Real(k.b2_squared) * compression) * r;
    P -= minus_q;
    add.dissipation += minus_q * D;
  }
  for (std::size_t c = 0; c < dim; ++c)
    add.F[c] = P * S(c);
  if constexpr (shear)
  {
    // A sliver that is inverted or as flat as round-off has no meaningful velocity gradient.
    const Real flat = Real(1e-9) * (dim == 2 ? S_squared : sqrt(S_squared) * sqrt(sqrt(S_squared)));
    const Real inverse_V = select(V > flat, Real(1.0) / max(V, Real(1e-300)), Real(0.0));
    Mat<dim, Real> grad_v{};
    for (std::size_t c = 0; c < dim; ++c)
      grad_v += outer(e.v[c + 1] - e.v[0], S(c));
    grad_v *= inverse_V;
    const Mat<dim, Real> tau =
        deviatoric_stress<dim, Real>(grad_v, k.mu) * viscous_fraction<dim, Real>(V, S_squared);
    for (std::size_t c = 0; c < dim; ++c)
      add.F[c] -= tau * S(c);
    add.dissipation += contract(tau, grad_v) * V;
  }
  if constexpr (stabilised)
  {
    Vec<dim, Real> z = (e.p[1] - e.p[0]) * S(0), a_bar = e.a[0] + e.a[1];
    for (std::size_t c = 1; c < dim; ++c)
    {
      z += (e.p[c + 1] - e.p[0]) * S(c);
      a_bar += e.a[c + 1];
    }
    a_bar *= Real(weight);
    z -= (V * rho) * (b - a_bar);
    z *= Real(k.alpha) * per_S;
    Real first{}, largest{};
    for (std::size_t c = 0; c < dim; ++c)
    {
      add.dm[c] = Real(0.0) - dot(S(c), z);
      first += add.dm[c];
      largest = max(largest, abs(add.dm[c]));
    }
    largest = max(largest, abs(first));
    // No corner is lighter than a quarter of its share of this element unless elements have turned over.
    const Real wanted = Real(k.dt) * largest;
    const auto heavy = wanted > Real(0.05 * 0.25 * weight) * rho * V;
    if (any(heavy))
    {
      const Real allowed = Real(0.05) * max(least_mass(), Real(0.0));
      // Lane by lane: what an element does must not depend on those beside it.
      const Real limited = select(wanted > allowed, allowed / max(wanted, Real(1e-300)), Real(1.0));
      const Real share = select(heavy, limited, Real(1.0));
      for (std::size_t c = 0; c < dim; ++c)
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

template <bool stabilised, bool shear, int dim>
UNDINE_FLATTEN double element_pass(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes,
                                   const Constants& k, const Vec<dim>& body, const index_t* list,
                                   index_t begin, index_t end, const Share& share, ElementSums<dim>& sums)
{
  using Record = NodeRecord<dim>;
  constexpr int L = Lanes::size;
  Vec<dim, Lanes> b;
  for (int i = 0; i < dim; ++i)
    b[i] = body[i];
  const Record* const record = sums.record.data();
  FourNumbers* const sum = sums.sum.data();
  const bool all_mine = share.owns_corners(list, begin);
  Lanes dissipation(0.0);
  double dissipation_of_rest = 0.0;
  for (index_t first = begin; first < end; first += L)
  {
    const int count = std::min<index_t>(L, end - first);
    const EightElements<dim> element(mesh.elements, list, first, end);
    Corners<dim, Lanes> e;
#pragma GCC unroll 4
    for (std::size_t c = 0; c <= dim; ++c)
    {
      Lanes column[Record::size];
#pragma GCC unroll 4
      for (int part = 0; part < (stabilised ? Record::size : Record::a); part += 4)
      {
        const double* row[L];
        for (std::size_t l = 0; l < L; ++l)
          row[l] = record[element[l][c]].c.data() + part;
        load_columns(row, column + part);
      }
      for (int i = 0; i < dim; ++i)
      {
        e.x[c][i] = column[Record::x + i];
        e.v[c][i] = column[Record::v + i];
        if constexpr (stabilised)
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
        double m = nodes.m[static_cast<std::size_t>(element[l][0])];
        for (std::size_t c = 1; c <= dim; ++c)
          m = std::min(m, nodes.m[static_cast<std::size_t>(element[l][c])]);
        least.set(static_cast<int>(l), m);
      }
      return least;
    };
    const auto add = element_forces<stabilised, shear, dim, Lanes>(e, k, b, least_mass);
    const auto rows_of = [&add](std::size_t c)
    {
      Lanes column[4];
      for (int i = 0; i < dim; ++i)
        column[i] = add.F[c][i];
      if constexpr (stabilised)
        column[3] = add.dm[c];
      return EightRows(column);
    };
    std::array<EightRows, dim> rows = [&rows_of]<std::size_t... c>(std::index_sequence<c...>)
    {
      return std::array<EightRows, dim>{rows_of(c)...};
    }
    (std::make_index_sequence<dim>{});
    EightRows first_row = rows[0];
    for (std::size_t c = 1; c < dim; ++c)
      first_row += rows[c];
    if (count == L && all_mine)
    {
#pragma GCC unroll 8
      for (std::size_t l = 0; l < L; ++l)
      {
        sum[element[l][0]] -= first_row[l];
#pragma GCC unroll 3
        for (std::size_t c = 0; c < dim; ++c)
          sum[element[l][c + 1]] += rows[c][l];
      }
    }
    else
      for (std::size_t l = 0; l < static_cast<std::size_t>(count); ++l)
      {
        if (share.owns(element[l][0]))
          sum[element[l][0]] -= first_row[l];
        for (std::size_t c = 0; c < dim; ++c)
          if (share.owns(element[l][c + 1]))
            sum[element[l][c + 1]] += rows[c][l];
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

} // namespace

template <int dim>
void ElementSums<dim>::reset(index_t n, index_t begin, index_t end)
{
  record.resize(static_cast<std::size_t>(n));
  sum.resize(static_cast<std::size_t>(n));
  std::fill(sum.begin() + begin, sum.begin() + end, FourNumbers{});
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
    const Vec<dim> a = with_a * nodes.a[n];
    std::copy_n(nodes.x[n].c.begin(), dim, c.begin() + Record::x);
    std::copy_n(nodes.v[n].c.begin(), dim, c.begin() + Record::v);
    std::copy_n(a.c.begin(), dim, c.begin() + Record::a);
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
  const bool stabilised = config.bulk() || config.residual > 0.0;
  const auto pass = [&]<bool with_stabilisers, bool with_shear>()
  {
    return element_pass<with_stabilisers, with_shear, dim>(mesh, nodes, constants, b, list, begin, end, share,
                                                           sums);
  };
  if (config.mu > 0.0)
    return stabilised ? pass.template operator()<true, true>() : pass.template operator()<false, true>();
  return stabilised ? pass.template operator()<true, false>() : pass.template operator()<false, false>();
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
