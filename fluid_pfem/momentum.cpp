// Element forces, eight elements side by side.
#include "fluid_pfem/momentum.hpp"

#include "fluid_pfem/eight.hpp"
#include "fluid_pfem/newtonian.hpp"
#include "fluid_pfem/remesh/distortion.hpp"
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

/// What the formulas need of an element, or of eight.
template <int dim, class Real>
struct Element
{
  std::array<Vec<dim, Real>, dim> S;  ///< V_e∇N of its corners but the first
  std::array<Vec<dim, Real>, dim> dv; ///< velocities of the same, less that of the first
  Vec<dim, Real> edge;                ///< from the first corner to the second
  std::array<Real, dim + 1> p;
  Real rho; ///< sum over its corners, as the next
  Vec<dim, Real> a;
};

/// What an element adds to its corners but the first, which gets minus their sum: nothing is created.
template <int dim, class Real>
struct Added
{
  std::array<Vec<dim, Real>, dim> F;
  std::array<Real, dim> dm;
  Real dissipation;
  Real S_squared, V; ///< Σ|S|² and volume, for looks at the shape
};

struct Constants
{
  double b1_c0, b2_squared, mu, alpha, dt;
};

/// The formulas of add_element_forces. `least_mass()` is called only where the limit of z may be reached.
template <bool stabilised, bool shear, int dim, class Real, class LeastMass>
Added<dim, Real> element_forces(const Element<dim, Real>& e, const Constants& k, const Vec<dim, Real>& b,
                                LeastMass&& least_mass)
{
  constexpr double weight = 1.0 / (dim + 1);
  Added<dim, Real> add{};
  // S_0 = −Σ S_c: sums over corners of S_c times anything take differences to the first.
  const auto S = [&e](std::size_t c) -> const Vec<dim, Real>& { return e.S[c]; };
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
    V = dot(minus_S0, e.edge);
    add.S_squared = S_squared;
    add.V = V;
  }
  if constexpr (stabilised)
  {
    Real D = dot(S(0), e.dv[0]);
    for (std::size_t c = 1; c < dim; ++c)
      D += dot(S(c), e.dv[c]);
    per_S = inverse_sqrt(S_squared);
    rho = e.rho * weight;
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
      grad_v += outer(e.dv[c], S(c));
    grad_v *= inverse_V;
    const Mat<dim, Real> tau =
        deviatoric_stress<dim, Real>(grad_v, k.mu) * viscous_fraction<dim, Real>(V, S_squared);
    for (std::size_t c = 0; c < dim; ++c)
      add.F[c] -= tau * S(c);
    add.dissipation += contract(tau, grad_v) * V;
  }
  if constexpr (stabilised)
  {
    Vec<dim, Real> z = (e.p[1] - e.p[0]) * S(0);
    for (std::size_t c = 1; c < dim; ++c)
      z += (e.p[c + 1] - e.p[0]) * S(c);
    z -= (V * rho) * (b - Real(weight) * e.a);
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

/// Eight elements out of the records of their corners; without stabilisers without ρ and a.
template <bool stabilised, int dim>
Element<dim, Lanes> gather(const NodeRecord<dim>* record, const Simplex<dim>* element,
                           const Period<dim>& period)
{
  Element<dim, Lanes> e;
  using Record = NodeRecord<dim>;
  const auto rows = [=](std::size_t corner, int part)
  {
    const double* row[Lanes::size];
    for (std::size_t l = 0; l < Lanes::size; ++l)
      row[l] = record[element[l][corner]].c.data() + part;
    return EightRows(row);
  };
  if constexpr (dim == 2)
  {
    // Differences and sums of rows: fewer of them are turned into columns.
    static_assert(Record::x == 0 && Record::v == 2 && Record::p == 4 && Record::rho == 5 && Record::a == 6);
    const EightRows first = rows(0, Record::x);
    std::array<Vec<2, Lanes>, 2> dx;
    for (std::size_t c = 0; c < 2; ++c)
    {
      EightRows other = rows(c + 1, Record::x);
      if (period.any())
      {
        const auto& l = period.length();
        const Lanes length(Lanes::Numbers{l[0], l[1], 0.0, 0.0, l[0], l[1], 0.0, 0.0});
        other.combine(first, [&](const Lanes& q, const Lanes& p) { return Period<2>::image(p, q, length); });
      }
      other -= first;
      Lanes column[4];
      other.columns(column);
      dx[c] = {{column[0], column[1]}};
      e.dv[c] = {{column[2], column[3]}};
    }
    e.S = {{{{Lanes(0.5) * dx[1][1], Lanes(-0.5) * dx[1][0]}},
            {{Lanes(-0.5) * dx[0][1], Lanes(0.5) * dx[0][0]}}}};
    e.edge = dx[0];
    EightRows sum = rows(0, Record::p);
    e.p[0] = sum.first_column();
    for (std::size_t c = 1; c <= 2; ++c)
    {
      const EightRows other = rows(c, Record::p);
      e.p[c] = other.first_column();
      sum += other;
    }
    if constexpr (stabilised)
    {
      Lanes column[4];
      sum.columns(column);
      e.rho = column[1];
      e.a = {{column[2], column[3]}};
    }
  }
  else
  {
    std::array<Vec<dim, Lanes>, dim + 1> x, v, a;
    std::array<Lanes, dim + 1> rho;
#pragma GCC unroll 4
    for (std::size_t c = 0; c <= dim; ++c)
    {
      Lanes column[Record::size];
#pragma GCC unroll 4
      for (int part = 0; part < (stabilised ? Record::size : Record::a); part += 4)
        rows(c, part).columns(column + part);
      for (int i = 0; i < dim; ++i)
      {
        x[c][i] = column[Record::x + i];
        v[c][i] = column[Record::v + i];
        a[c][i] = column[Record::a + i];
      }
      e.p[c] = column[Record::p];
      rho[c] = column[Record::rho];
    }
    period.join(x);
    const auto S = volume_gradients<dim, Lanes>(x);
    e.edge = x[1] - x[0];
    e.rho = rho[0];
    e.a = a[0];
    for (std::size_t c = 1; c <= dim; ++c)
    {
      e.S[c - 1] = S[c];
      e.dv[c - 1] = v[c] - v[0];
      e.rho += rho[c];
      e.a += a[c];
    }
  }
  return e;
}

/// One of the elements from `first` on, `count` ≤ 8, may be below least_quality(); q = 4√3 V/Σl² with
/// Σl² = 4 Σ|S|².
bool may_be_worse(const Added<2, Lanes>& e, index_t first, int count, const ShapeLook& look)
{
  typedef float Floats __attribute__((vector_size(Lanes::size * sizeof(float))));
  const float* const from = look.before.data() + first;
  Floats before;
  if (count == Lanes::size)
    __builtin_memcpy(&before, from, sizeof before);
  else
    for (int l = 0; l < Lanes::size; ++l)
      before[l] = from[std::min(l, count - 1)];
  constexpr double round_off = 1e-9; // far beyond that of q computed in two ways
  const Lanes least =
      Lanes(round_off) + least_quality(look.limit, Lanes(__builtin_convertvector(before, Lanes::Numbers)));
  return any(~(least * e.S_squared < Lanes(std::sqrt(3.0)) * e.V));
}

template <bool stabilised, bool shear, bool looks, int dim>
UNDINE_FLATTEN double element_pass(const FluidMesh<dim>& mesh, const FluidNodes<dim>& nodes,
                                   const Constants& k, const Vec<dim>& body, const index_t* list,
                                   index_t begin, index_t end, const Share& share, ElementSums<dim>& sums,
                                   ShapeLook* look)
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
  bool doubtful = false;
  Element<dim, Lanes> e;
  const auto read = [&](index_t first)
  {
    if (list == nullptr && first + L <= end) // the usual case: told apart here 0.3 ns less
      e = gather<stabilised, dim>(record, mesh.elements.data() + first, nodes.period);
    else
      e = gather<stabilised, dim>(record, &EightElements<dim>(mesh.elements, list, first, end)[0],
                                  nodes.period);
  };
  // Formulas and sums of eight elements wait for each other. In the plane, where the registers suffice, the
  // next eight are read between them.
  constexpr bool ahead = dim == 2;
  if (ahead && begin < end)
    read(begin);
  for (index_t first = begin; first < end; first += L)
  {
    const int count = std::min<index_t>(L, end - first);
    const EightElements<dim> element(mesh.elements, list, first, end);
    if (!ahead)
      read(first);
    const auto least_mass = [&]
    {
      Lanes least;
      const Simplex<dim>* const again = once_more(element);
      for (std::size_t l = 0; l < L; ++l)
      {
        double m = nodes.m[static_cast<std::size_t>(again[l][0])];
        for (std::size_t c = 1; c <= dim; ++c)
          m = std::min(m, nodes.m[static_cast<std::size_t>(again[l][c])]);
        least.set(static_cast<int>(l), m);
      }
      return least;
    };
    const auto add = element_forces<stabilised, shear, dim, Lanes>(e, k, b, least_mass);
    if constexpr (looks)
      doubtful |= may_be_worse(add, first, count, *look);
    if (ahead && first + L < end)
      read(first + L);
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
    const auto each_row = [&]<std::size_t... l>(std::index_sequence<l...>, auto&& add_row)
    {
      const auto add_element = [&]<std::size_t e>()
      {
        add_row(e, 0, -first_row.template row<e>());
        for (std::size_t c = 0; c < dim; ++c)
          add_row(e, c + 1, rows[c].template row<e>());
      };
      (add_element.template operator()<l>(), ...);
    };
    constexpr std::make_index_sequence<L> all{};
    const Simplex<dim>* const again = once_more(element);
    if (count == L && all_mine)
      each_row(all, [&](std::size_t l, std::size_t c, const FourNumbers& row) { sum[again[l][c]] += row; });
    else
      each_row(all,
               [&](std::size_t l, std::size_t c, const FourNumbers& row)
               {
                 if (l < static_cast<std::size_t>(count) && share.owns(again[l][c]))
                   sum[again[l][c]] += row;
               });
    if (count == L)
      dissipation += add.dissipation;
    else
      for (int l = 0; l < count; ++l)
        dissipation_of_rest += add.dissipation[l];
  }
  for (int l = 0; l < L; ++l)
    dissipation_of_rest += dissipation[l];
  if constexpr (looks)
    look->good = look->good && !doubtful;
  return dissipation_of_rest;
}

} // namespace

template <int dim>
void ElementSums<dim>::make_room(index_t n)
{
  record.resize(static_cast<std::size_t>(n));
  sum.resize(static_cast<std::size_t>(n));
}

template <int dim>
void ElementSums<dim>::clear(index_t begin, index_t end)
{
  std::fill(sum.begin() + begin, sum.begin() + end, FourNumbers{});
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
    if constexpr (dim == 2) // pairs of numbers, in two stores
    {
      typedef double Two __attribute__((vector_size(2 * sizeof(double))));
      const auto load = [](const Vec<dim>& from)
      {
        Two two;
        __builtin_memcpy(&two, from.c.data(), sizeof two);
        return two;
      };
      auto* const rows = reinterpret_cast<FourNumbers*>(c.data());
      rows[0] = __builtin_shufflevector(load(nodes.x[n]), load(nodes.v[n]), 0, 1, 2, 3);
      rows[1] = __builtin_shufflevector(Two{nodes.p[n], nodes.rho[n]}, with_a * load(nodes.a[n]), 0, 1, 2, 3);
    }
    else
    {
      const Vec<dim>&x = nodes.x[n], &v = nodes.v[n], a = with_a * nodes.a[n];
      std::copy_n(x.c.begin(), dim, c.begin() + Record::x);
      std::copy_n(v.c.begin(), dim, c.begin() + Record::v);
      std::copy_n(a.c.begin(), dim, c.begin() + Record::a);
      c[Record::p] = nodes.p[n];
      c[Record::rho] = nodes.rho[n];
    }
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
                          ElementSums<dim>& sums, ShapeLook* look)
{
  const Constants constants{.b1_c0 = config.bulk_linear * c0,
                            .b2_squared = config.bulk_quadratic * config.bulk_quadratic,
                            .mu = config.mu,
                            .alpha = config.residual * std::sqrt(2.0 * dim) / c0,
                            .dt = dt};
  const bool stabilised = config.bulk() || config.residual > 0.0;
  const bool looks = dim == 2 && stabilised && list == nullptr && look != nullptr;
  if (look != nullptr && !looks)
    look->good = false;
  const auto pass = [&]<bool with_stabilisers, bool with_shear>()
  {
    const auto run = [&]<bool with_look>()
    {
      return element_pass<with_stabilisers, with_shear, with_look, dim>(mesh, nodes, constants, b, list,
                                                                        begin, end, share, sums, look);
    };
    if constexpr (with_stabilisers && dim == 2)
      if (looks)
        return run.template operator()<true>();
    return run.template operator()<false>();
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
                                      const Share&, ElementSums<2>&, ShapeLook*);
template double add_element_forces<3>(const FluidMesh<3>&, const FluidNodes<3>&, const ElementTermsConfig&,
                                      double, const Vec<3>&, double, const index_t*, index_t, index_t,
                                      const Share&, ElementSums<3>&, ShapeLook*);
template void take_acceleration<2>(FluidNodes<2>&, const Vec<2>&, index_t, index_t, ElementSums<2>&,
                                   std::span<double>);
template void take_acceleration<3>(FluidNodes<3>&, const Vec<3>&, index_t, index_t, ElementSums<3>&,
                                   std::span<double>);

} // namespace undine::fluid
