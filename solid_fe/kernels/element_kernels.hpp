// The hot loops of the solid: gather, deformation, stress, scatter; included by the unit of each law only.
#pragma once

#include "solid_fe/kernels/law_kernels.hpp"
#include "solid_fe/materials/plane_stress.hpp"

#include <algorithm>
#include <cmath>

namespace undine::solid
{

namespace kernels
{

template <class Law, class Element>
constexpr int history_of = history_size<Law>(strain_dim<Element>);

template <class Law, class Element, class Real>
using PointHistory = std::array<Real, static_cast<std::size_t>(history_of<Law, Element>)>;

/// F̄ − I = (J̄/J)^(1/d) (I + H) − I from J − 1 and J̄ − 1.
template <int d, class Real>
Mat<d, Real> with_volume(const Mat<d, Real>& H, const Real& J_minus_one, const Real& mean_minus_one)
{
  using std::expm1;
  using std::log1p;
  const Real factor = expm1(Real(1.0 / d) * (log1p(mean_minus_one) - log1p(J_minus_one)));
  return H + factor * (Mat<d, Real>::identity() + H);
}

template <int d, class Real>
Mat<d, Real> inverse_transposed(const Mat<d, Real>& F)
{
  return transpose(inverse(F));
}

/// J − 1, or tr H for a small-strain law.
template <class Law, int d, class Real>
Real dilatation(const Mat<d, Real>& H)
{
  if constexpr (Law::small_strain)
    return trace(H);
  else
    return volume_strain(H);
}

/// H with the volume change `mean` instead of its own.
template <class Law, int d, class Real>
Mat<d, Real> dilated(const Mat<d, Real>& H, const Real& own, const Real& mean)
{
  if constexpr (Law::small_strain)
    return H + Real(1.0 / d) * (mean - own) * Mat<d, Real>::identity();
  else
    return with_volume(H, own, mean);
}

/// Kirchhoff stress P F̄ᵀ (or the stress itself of a small-strain law).
template <class Law, int d, class Real>
Mat<d, Real> kirchhoff(const Mat<d, Real>& P, const Mat<d, Real>& H_bar)
{
  if constexpr (Law::small_strain)
    return P;
  else
    return P * transpose(deformation_gradient(H_bar));
}

/// First Piola stress that does the work of F̄:  [dev τ̄ + p J I] F⁻ᵀ with p = mean(tr τ̄ / d) / J̄.
template <class Law, int d, class Real>
Mat<d, Real> stress_with_pressure(const Mat<d, Real>& deviator, const Real& p, const Mat<d, Real>& H)
{
  if constexpr (Law::small_strain)
    return deviator + p * Mat<d, Real>::identity();
  else
    return (deviator + p * (Real(1.0) + volume_strain(H)) * Mat<d, Real>::identity()) *
           inverse_transposed(deformation_gradient(H));
}

/// Nodal forces of one element or pack; returns the smallest J − 1 of its points.
template <class Element, class Law, class Real>
Real element_force(const Law& law, const ElementGeometry<Element, Real>& g,
                   const std::array<Vec<Element::dim, Real>, Element::nodes>& u, double dt,
                   std::array<PointHistory<Law, Element, Real>, Element::points>& history,
                   std::array<Vec<Element::dim, Real>, Element::nodes>& f)
{
  constexpr int d = strain_dim<Element>;
  constexpr auto points = static_cast<std::size_t>(Element::points);
  Real lowest(1e300);
  if constexpr (Element::dilatation == Dilatation::of_element)
  {
    std::array<Mat<d, Real>, points> H, tau;
    std::array<Real, points> own;
    Real mean{}, volume{};
    for (std::size_t q = 0; q < points; ++q)
    {
      H[q] = displacement_gradient<Element>(g, static_cast<int>(q), u);
      own[q] = dilatation<Law>(H[q]);
      const Real J_minus_one = volume_strain(H[q]);
      lowest = select(J_minus_one < lowest, J_minus_one, lowest) + (J_minus_one - J_minus_one); // NaN stays
      mean += g.weight[q] * own[q];
      volume += g.weight[q];
    }
    mean = mean * (Real(1.0) / volume);
    Real pressure{};
    for (std::size_t q = 0; q < points; ++q)
    {
      const auto H_bar = dilated<Law>(H[q], own[q], mean);
      tau[q] = kirchhoff<Law>(stress_of(law, H_bar, history[q], dt), H_bar);
      const Real p = Real(1.0 / d) * trace(tau[q]);
      tau[q] -= p * Mat<d, Real>::identity();
      pressure += g.weight[q] * p;
    }
    pressure = pressure * (Real(1.0) / volume);
    if constexpr (!Law::small_strain)
      pressure = pressure * (Real(1.0) / (Real(1.0) + mean));
    for (std::size_t q = 0; q < points; ++q)
      add_stress_divergence<Element>(g, static_cast<int>(q),
                                     g.weight[q] * stress_with_pressure<Law>(tau[q], pressure, H[q]), f);
  }
  else
    for (std::size_t q = 0; q < points; ++q)
    {
      const auto H = displacement_gradient<Element>(g, static_cast<int>(q), u);
      const Real J_minus_one = volume_strain(H);
      lowest = select(J_minus_one < lowest, J_minus_one, lowest) + (J_minus_one - J_minus_one); // NaN stays
      auto P = g.weight[q] * stress_of(law, H, history[q], dt);
      if constexpr (Element::hourglass_modes > 0)
      {
        auto force = hourglass_amplitudes<Element>(g, H, u);
        for (auto& component : force)
          component *= g.hourglass_stiffness[0];
        add_hourglass_force<Element>(g, force, P, f);
      }
      add_stress_divergence<Element>(g, static_cast<int>(q), P, f);
    }
  return lowest;
}

/// The `Real`s of pack p, or of element e alone.
template <class Element>
std::array<Vec<Element::dim, Lanes>, Element::nodes> gather_pack(const ReferenceBlock<Element>& block,
                                                                 index_t first, int count,
                                                                 std::span<const Vec<Element::dim>> field)
{
  std::array<Vec<Element::dim, Lanes>, Element::nodes> local;
  const auto* nodes = &block.nodes[static_cast<std::size_t>(first)];
  for (std::size_t a = 0; a < Element::nodes; ++a)
  {
    std::array<const double*, Lanes::size> at;
    for (int k = 0; k < Lanes::size; ++k)
      at[static_cast<std::size_t>(k)] =
          field[static_cast<std::size_t>(nodes[k < count ? k : count - 1][a])].c.data();
    for (int i = 0; i < Element::dim; ++i)
      local[a][i] = Lanes(
          Lanes::Numbers{at[0][i], at[1][i], at[2][i], at[3][i], at[4][i], at[5][i], at[6][i], at[7][i]});
  }
  return local;
}

/// Element by element, so that each node's sum is taken in the order of the elements.
template <class Element>
void scatter_pack(const ReferenceBlock<Element>& block, index_t first, int count,
                  const std::array<Vec<Element::dim, Lanes>, Element::nodes>& f,
                  std::span<Vec<Element::dim>> F)
{
  constexpr std::size_t n = Element::nodes * Element::dim;
  alignas(64) double table[n][Lanes::size];
  for (std::size_t a = 0; a < Element::nodes; ++a)
    for (int i = 0; i < Element::dim; ++i)
      *reinterpret_cast<Lanes::Numbers*>(table[a * Element::dim + static_cast<std::size_t>(i)]) =
          f[a][i].numbers();
  for (int k = 0; k < count; ++k)
  {
    const auto& nodes = block.nodes[static_cast<std::size_t>(first + k)];
    for (std::size_t a = 0; a < Element::nodes; ++a)
    {
      auto& sum = F[static_cast<std::size_t>(nodes[a])];
      for (int i = 0; i < Element::dim; ++i)
        sum[i] += table[a * Element::dim + static_cast<std::size_t>(i)][k];
    }
  }
}

/// History of a pack in memory: point after point, number after number.
template <class Law, class Element>
std::array<PointHistory<Law, Element, Lanes>, Element::points>
load_history(const BodyState<Element::dim>& state, index_t p)
{
  std::array<PointHistory<Law, Element, Lanes>, Element::points> history;
  if constexpr (history_of < Law, Element >> 0)
  {
    const Lanes* from =
        state.history.data() + static_cast<std::ptrdiff_t>(p) * Element::points * history_of<Law, Element>;
    for (auto& point : history)
      for (auto& number : point)
        number = *from++;
  }
  return history;
}

template <class Law, class Element>
void store_history(const std::array<PointHistory<Law, Element, Lanes>, Element::points>& history, index_t p,
                   BodyState<Element::dim>& state)
{
  if constexpr (history_of < Law, Element >> 0)
  {
    Lanes* to =
        state.history.data() + static_cast<std::ptrdiff_t>(p) * Element::points * history_of<Law, Element>;
    for (const auto& point : history)
      for (const auto& number : point)
        *to++ = number;
  }
}

/// Lane k of a pack's history, and back.
template <class Law, class Element>
std::array<PointHistory<Law, Element, double>, Element::points>
one_lane(const std::array<PointHistory<Law, Element, Lanes>, Element::points>& pack, int k)
{
  std::array<PointHistory<Law, Element, double>, Element::points> one;
  for (std::size_t q = 0; q < one.size(); ++q)
    for (std::size_t i = 0; i < one[q].size(); ++i)
      one[q][i] = pack[q][i][k];
  return one;
}

template <class Law, class Element>
auto history_of_element(const ReferenceBlock<Element>& block, const BodyState<Element::dim>& state, index_t e)
{
  const auto [p, k] = block.place(e);
  return one_lane<Law, Element>(load_history<Law, Element>(state, p), k);
}

/// Packs of elements side by side.
template <class Element, class Law>
index_t add_forces_in_lanes(const ReferenceBlock<Element>& block, const Law& law, index_t begin, index_t end,
                            std::span<const Vec<Element::dim>> u, double dt, BodyState<Element::dim>& state,
                            std::span<Vec<Element::dim>> F_int)
{
  index_t inverted = -1;
  for (index_t p = begin; p < end; ++p)
  {
    const auto [first, count] = block.elements_of(p);
    const auto u_e = gather_pack(block, first, count, u);
    auto history = load_history<Law, Element>(state, p);
    std::array<Vec<Element::dim, Lanes>, Element::nodes> f{};
    const Lanes lowest =
        element_force<Element>(law, block.pack[static_cast<std::size_t>(p)], u_e, dt, history, f);
    store_history<Law, Element>(history, p, state);
    if (!any(lowest <= Lanes(-1.0)) && !any(~(lowest <= Lanes(1e300)))) [[likely]]
    {
    }
    else
      for (int k = 0; k < count; ++k)
        if (!(lowest[k] > -1.0))
          inverted = first + k;
    scatter_pack(block, first, count, f, F_int);
  }
  return inverted;
}

/// One element after the other, for laws that cannot run in lanes.
template <class Element, class Law>
index_t add_forces_one_by_one(const ReferenceBlock<Element>& block, const Law& law, index_t begin,
                              index_t end, std::span<const Vec<Element::dim>> u, double dt,
                              BodyState<Element::dim>& state, std::span<Vec<Element::dim>> F_int)
{
  index_t inverted = -1;
  for (index_t p = begin; p < end; ++p)
  {
    const auto [first, count] = block.elements_of(p);
    auto pack = load_history<Law, Element>(state, p);
    for (int k = 0; k < count; ++k)
    {
      const index_t e = first + k;
      const auto& nodes = block.nodes[static_cast<std::size_t>(e)];
      auto history = one_lane<Law, Element>(pack, k);
      std::array<Vec<Element::dim>, Element::nodes> f{};
      const double lowest =
          element_force<Element>(law, block.geometry(e), gather<Element>(nodes, u), dt, history, f);
      if (!(lowest > -1.0))
        inverted = e;
      for (std::size_t q = 0; q < history.size(); ++q)
        for (std::size_t i = 0; i < history[q].size(); ++i)
          pack[q][i].set(k, history[q][i]);
      for (std::size_t a = 0; a < nodes.size(); ++a)
        F_int[static_cast<std::size_t>(nodes[a])] += f[a];
    }
    store_history<Law, Element>(pack, p, state);
  }
  return inverted;
}

/// Mean over the nodes of the element of a field of nodal means.
template <class Element>
double mean_of_nodes(const std::array<index_t, Element::nodes>& nodes, const std::vector<double>& field)
{
  double sum = 0.0;
  for (const index_t n : nodes)
    sum += field[static_cast<std::size_t>(n)];
  return sum / Element::nodes;
}

/// Nodal means of the volume changes of the elements, into state.nodal_field. Returns an inverted element or
/// −1.
template <class Law, class Element>
index_t average_dilatation(const ReferenceBlock<Element>& block, std::span<const Vec<Element::dim>> u,
                           BodyState<Element::dim>& state)
{
  index_t inverted = -1;
  std::fill(state.nodal_field.begin(), state.nodal_field.end(), 0.0);
  for (index_t e = 0; e < block.size(); ++e)
  {
    const auto& nodes = block.nodes[static_cast<std::size_t>(e)];
    const auto g = block.geometry(e);
    const auto H = displacement_gradient<Element>(g, 0, gather<Element>(nodes, u));
    if (!(volume_strain(H) > -1.0))
      inverted = e;
    for (const index_t n : nodes)
      state.nodal_field[static_cast<std::size_t>(n)] += g.weight[0] * dilatation<Law>(H);
  }
  for (std::size_t n = 0; n < state.nodal_field.size(); ++n)
    if (state.nodal_volume[n] > 0.0)
      state.nodal_field[n] /= state.nodal_volume[n];
  return inverted;
}

/// Nodal dilatation: volume changes to the nodes, stress, pressures to the nodes, forces.
template <class Element, class Law>
index_t add_forces_with_nodal_dilatation(const ReferenceBlock<Element>& block, const Law& law,
                                         std::span<const Vec<Element::dim>> u, double dt,
                                         BodyState<Element::dim>& state, std::span<Vec<Element::dim>> F_int)
{
  constexpr int d = Element::dim;
  const index_t inverted = average_dilatation<Law>(block, u, state);
  std::vector<double> pressure(state.nodal_field.size(), 0.0);
  for (index_t e = 0; e < block.size(); ++e)
  {
    const auto& nodes = block.nodes[static_cast<std::size_t>(e)];
    const auto g = block.geometry(e);
    const auto H = displacement_gradient<Element>(g, 0, gather<Element>(nodes, u));
    const double mean = mean_of_nodes<Element>(nodes, state.nodal_field);
    const auto H_bar = dilated<Law>(H, dilatation<Law>(H), mean);
    const auto [p, k] = block.place(e);
    auto pack = load_history<Law, Element>(state, p);
    auto history = one_lane<Law, Element>(pack, k);
    auto tau = kirchhoff<Law>(stress_of(law, H_bar, history[0], dt), H_bar);
    for (std::size_t i = 0; i < history[0].size(); ++i)
      pack[0][i].set(k, history[0][i]);
    store_history<Law, Element>(pack, p, state);
    const double t = trace(tau) / d;
    state.element_tau[static_cast<std::size_t>(e)] = tau - t * Mat<d>::identity();
    const double share = g.weight[0] * t / (Law::small_strain ? 1.0 : 1.0 + mean) / Element::nodes;
    for (const index_t n : nodes)
      pressure[static_cast<std::size_t>(n)] += share / state.nodal_volume[static_cast<std::size_t>(n)];
  }
  for (index_t e = 0; e < block.size(); ++e)
  {
    const auto& nodes = block.nodes[static_cast<std::size_t>(e)];
    const auto g = block.geometry(e);
    const auto H = displacement_gradient<Element>(g, 0, gather<Element>(nodes, u));
    const double p = Element::nodes * mean_of_nodes<Element>(nodes, pressure);
    std::array<Vec<d>, Element::nodes> f{};
    add_stress_divergence<Element>(
        g, 0, g.weight[0] * stress_with_pressure<Law>(state.element_tau[static_cast<std::size_t>(e)], p, H),
        f);
    for (std::size_t a = 0; a < nodes.size(); ++a)
      F_int[static_cast<std::size_t>(nodes[a])] += f[a];
  }
  return inverted;
}

template <class Element, class Law>
index_t add_forces(const ReferenceBlock<Element>& block, const Law& law, Part part,
                   std::span<const Vec<Element::dim>> u, double dt, BodyState<Element::dim>& state,
                   std::span<Vec<Element::dim>> F_int)
{
  if constexpr (Element::dilatation == Dilatation::of_nodes)
  {
    const bool mine = (part == Part::interface) == (block.n_interface > 0);
    return mine ? add_forces_with_nodal_dilatation(block, law, u, dt, state, F_int) : -1;
  }
  else
  {
    const index_t begin = part == Part::interface ? 0 : block.n_interface_packs();
    const index_t end = part == Part::interface ? block.n_interface_packs() : block.n_active_packs();
    if constexpr (runs_in_lanes<Law>())
      return add_forces_in_lanes(block, law, begin, end, u, dt, state, F_int);
    else
      return add_forces_one_by_one(block, law, begin, end, u, dt, state, F_int);
  }
}

/// Calls visit(e, q, geometry, u of the element, H, H̄, history of q) for the points of every element that
/// this rank counts.
template <class Element, class Law, class Visit>
void for_each_point(const ReferenceBlock<Element>& block, const Law&, const BodyState<Element::dim>& state,
                    std::span<const Vec<Element::dim>> u, Visit&& visit)
{
  BodyState<Element::dim> nodal;
  if constexpr (Element::dilatation == Dilatation::of_nodes)
  {
    nodal.nodal_volume = state.nodal_volume;
    nodal.nodal_field.resize(state.nodal_volume.size());
    average_dilatation<Law>(block, u, nodal);
  }
  for (index_t e = 0; e < block.size(); ++e)
  {
    if (!block.counts(e))
      continue;
    const auto& nodes = block.nodes[static_cast<std::size_t>(e)];
    const auto u_e = gather<Element>(nodes, u);
    const auto g = block.geometry(e);
    const auto history = history_of_element<Law>(block, state, e);
    std::array<Mat<strain_dim<Element>>, Element::points> H;
    double mean = 0.0, volume = 0.0;
    for (std::size_t q = 0; q < H.size(); ++q)
    {
      H[q] = displacement_gradient<Element>(g, static_cast<int>(q), u_e);
      mean += g.weight[q] * dilatation<Law>(H[q]);
      volume += g.weight[q];
    }
    mean /= volume;
    if constexpr (Element::dilatation == Dilatation::of_nodes)
      mean = mean_of_nodes<Element>(nodes, nodal.nodal_field);
    for (std::size_t q = 0; q < H.size(); ++q)
    {
      if constexpr (Element::dilatation == Dilatation::of_point)
        visit(e, q, g, u_e, H[q], H[q], history[q]);
      else
        visit(e, q, g, u_e, H[q], dilated<Law>(H[q], dilatation<Law>(H[q]), mean), history[q]);
    }
  }
}

template <class Element, class Law>
constexpr bool has_energy_in_lanes =
    runs_in_lanes<Law>() && history_of<Law, Element> == 0 &&
    Element::dilatation
        != Dilatation::of_nodes&& requires(const Law& law, const Mat<strain_dim<Element>, Lanes>& H)
{
  law.strain_energy(H);
};

/// Energies that packs of elements side by side store: laws without a history.
template <class Element, class Law>
void add_stored_energy_in_lanes(const ReferenceBlock<Element>& block, const Law& law,
                                std::span<const Vec<Element::dim>> u, StoredEnergy& energy)
{
  for (index_t p = 0; p < block.n_packs(); ++p)
  {
    const auto [first, count] = block.elements_of(p);
    const auto u_e = gather_pack(block, first, count, u);
    const auto& g = block.pack[static_cast<std::size_t>(p)];
    std::array<Mat<strain_dim<Element>, Lanes>, Element::points> H;
    Lanes mean{}, volume{}, strain{};
    for (std::size_t q = 0; q < H.size(); ++q)
    {
      H[q] = displacement_gradient<Element>(g, static_cast<int>(q), u_e);
      if constexpr (Element::dilatation == Dilatation::of_element)
      {
        mean += g.weight[q] * dilatation<Law>(H[q]);
        volume += g.weight[q];
      }
    }
    if constexpr (Element::dilatation == Dilatation::of_element)
    {
      mean = mean * (Lanes(1.0) / volume);
      for (auto& H_q : H)
        H_q = dilated<Law>(H_q, dilatation<Law>(H_q), mean);
    }
    for (std::size_t q = 0; q < H.size(); ++q)
      strain += g.weight[q] * law.strain_energy(H[q]);
    Lanes hourglass{};
    if constexpr (Element::hourglass_modes > 0)
      for (const auto& a : hourglass_amplitudes<Element>(g, H[0], u_e))
        hourglass += Lanes(0.5) * g.hourglass_stiffness[0] * dot(a, a);
    for (int k = 0; k < count; ++k)
      if (block.counts(first + k))
      {
        energy.strain.add(strain[k]);
        if constexpr (Element::hourglass_modes > 0)
          energy.hourglass.add(hourglass[k]);
      }
  }
}

/// Call work(block, law) with the block's type, and the law in plane stress where that is what the body is
/// in.
template <int dim, class Law, class Work>
decltype(auto) with_block(const Body<dim>& body, const Law& law, Work&& work)
{
  return std::visit(
      [&]<class Element>(const ReferenceBlock<Element>& block)
      {
        if constexpr (dim == 2 && Element::dilatation == Dilatation::of_point && !Element::axisymmetric)
          if (body.plane_stress)
            return work(block, PlaneStress<Law>{law});
        return work(block, law);
      },
      body.block);
}

} // namespace kernels

template <int dim, class Law>
index_t add_forces_of(const Body<dim>& body, const Law& law, Part part, std::span<const Vec<dim>> u,
                      double dt, BodyState<dim>& state, std::span<Vec<dim>> F_int)
{
  return kernels::with_block(body, law,
                             [&](const auto& block, const auto& used)
                             { return kernels::add_forces(block, used, part, u, dt, state, F_int); });
}

template <int dim, class Law>
void add_stored_energy_of(const Body<dim>& body, const Law& law, std::span<const Vec<dim>> u,
                          StoredEnergy& energy)
{
  kernels::with_block(
      body, law,
      [&]<class Element, class Used>(const ReferenceBlock<Element>& block, const Used& used)
      {
        if constexpr (kernels::has_energy_in_lanes<Element, Used>)
          return kernels::add_stored_energy_in_lanes(block, used, u, energy);
        double strain = 0.0, plastic = 0.0, hourglass = 0.0; // of one element
        kernels::for_each_point(
            block, used, body.state, u,
            [&]([[maybe_unused]] index_t e, std::size_t q, const auto& g, [[maybe_unused]] const auto& u_e,
                [[maybe_unused]] const auto& H, const auto& H_bar, const auto& history)
            {
              strain = (q > 0 ? strain : 0.0) + g.weight[q] * energy_of(used, H_bar, history);
              if constexpr (requires { used.template dissipated<strain_dim<Element>>(history); })
              {
                plastic = (q > 0 ? plastic : 0.0) +
                          g.weight[q] * used.template dissipated<strain_dim<Element>>(history);
                if (q + 1 == Element::points)
                  energy.plastic.add(plastic);
              }
              if constexpr (Element::hourglass_modes > 0)
              {
                hourglass = 0.0; // one point
                for (const auto& a : hourglass_amplitudes<Element>(g, H, u_e))
                  hourglass += 0.5 * g.hourglass_stiffness[0] * norm_squared(a);
                energy.hourglass.add(hourglass);
              }
              if (q + 1 == Element::points)
                energy.strain.add(strain);
            });
      });
}

template <int dim, class Law>
double highest_frequency_squared_of(const Body<dim>& body, const Law& law, std::span<const Vec<dim>> u)
{
  return kernels::with_block(
      body, law,
      [&]<class Element, class Used>(const ReferenceBlock<Element>& block, const Used& used)
      {
        double highest = 0.0;
        TangentBound worst;
        const auto at_rest = law.tangent_bound(Mat<strain_dim<Element>>{});
        kernels::for_each_point(
            block, used, body.state, u,
            [&](index_t e, std::size_t q, const auto&, const auto&, const auto& H, const auto& H_bar,
                const auto& history)
            {
              if (q == 0) // hourglass control was weighed against the law at rest
                worst = {.full = Element::hourglass_modes > 0 ? at_rest.full : 0.0, .volumetric = 0.0};
              auto bound = bound_of(used, H_bar, history);
              if constexpr (Element::dilatation != Dilatation::of_point)
              {
                // δF̄ = (J̄/J)^(1/d) (δF + (δJ̄/J̄ − tr(δF F⁻¹)) F/d): the volume changes of the others enter
                // with the ratio of the volumes, and an isotropic part stretched by F.
                // A law whose bound is one of the deviator of δF F⁻¹ does not see the second part: only the
                // volume ratio counts.
                if constexpr (requires { Law::bound_of_rates; })
                {
                  const double ratio = (1.0 + volume_strain(H)) / (1.0 + volume_strain(H_bar));
                  bound.volumetric *= std::max(1.0, ratio * ratio);
                }
                else if constexpr (!Law::small_strain)
                {
                  const auto [low, high] = extreme_stretches_squared(H);
                  bound.full *= high / low;
                  bound.volumetric *= high / low;
                }
              }
              worst.full = std::max(worst.full, bound.full);
              worst.volumetric = std::max(worst.volumetric, bound.volumetric);
              if (q + 1 == Element::points)
                highest = std::max(highest, worst.full * block.gamma[static_cast<std::size_t>(e)] +
                                                worst.volumetric * block.delta[static_cast<std::size_t>(e)]);
            });
        return highest;
      });
}

template <int dim, class Law>
void append_stress_of(const Body<dim>& body, const Law& law, std::span<const Vec<dim>> u,
                      std::vector<Mat<3>>& sigma, std::vector<double>& plastic_strain)
{
  kernels::with_block(body, law,
                      [&]<class Element, class Used>(const ReferenceBlock<Element>& block, const Used& used)
                      {
                        const auto first = sigma.size();
                        sigma.resize(first + static_cast<std::size_t>(block.size()));
                        plastic_strain.resize(sigma.size(), 0.0);
                        kernels::for_each_point(
                            block, used, body.state, u,
                            [&](index_t e, [[maybe_unused]] std::size_t q, const auto&, const auto&,
                                const auto&, const auto& H_bar, const auto& history)
                            {
                              const auto at = first + static_cast<std::size_t>(e);
                              constexpr bool in_plane_stress = !std::is_same_v<Used, Law>;
                              constexpr int d = in_plane_stress ? 3 : strain_dim<Element>;
                              Mat<d> H;
                              if constexpr (in_plane_stress)
                                H = Used::in_3d(H_bar, history.back());
                              else
                                H = H_bar;
                              if constexpr (history_size<Law>(3) > 0)
                              {
                                std::array<double, static_cast<std::size_t>(history_size<Law>(d))> h;
                                std::copy_n(history.begin(), h.size(), h.begin());
                                sigma[at] += (1.0 / Element::points) * law.cauchy_of_state(H, h);
                                plastic_strain[at] +=
                                    h[static_cast<std::size_t>(Law::strain_at(d))] / Element::points;
                              }
                              else
                                sigma[at] += (1.0 / Element::points) * cauchy_stress(law, H);
                            });
                      });
}

template <int dim, class Law>
std::size_t history_lanes_of(const Body<dim>& body, const Law& law)
{
  return kernels::with_block(body, law,
                             []<class Element, class Used>(const ReferenceBlock<Element>& block, const Used&)
                             {
                               return block.pack.size() * Element::points *
                                      static_cast<std::size_t>(kernels::history_of<Used, Element>);
                             });
}

/// One line per law and dimension in the law's unit.
#define UNDINE_INSTANTIATE_LAW_IN(dim, Law)                                                                  \
  template index_t add_forces_of(const Body<dim>&, const Law&, Part, std::span<const Vec<dim>>, double,      \
                                 BodyState<dim>&, std::span<Vec<dim>>);                                      \
  template void add_stored_energy_of(const Body<dim>&, const Law&, std::span<const Vec<dim>>,                \
                                     StoredEnergy&);                                                         \
  template double highest_frequency_squared_of(const Body<dim>&, const Law&, std::span<const Vec<dim>>);     \
  template void append_stress_of(const Body<dim>&, const Law&, std::span<const Vec<dim>>,                    \
                                 std::vector<Mat<3>>&, std::vector<double>&);                                \
  template std::size_t history_lanes_of(const Body<dim>&, const Law&);

} // namespace undine::solid
