// Nodal volumes, densities and pressures.
#include "fluid_pfem/mass_conservation.hpp"

#include "fluid_pfem/eight.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>

namespace undine::fluid
{

namespace
{

using std::max;
using std::min;

} // namespace

[[gnu::flatten]] void update_nodal_volumes(const FluidMesh<2>& mesh, index_t begin, index_t end,
                                           FluidNodes<2>& nodes)
{
  constexpr index_t L = Lanes::size;
  const double* const x = nodes.x.front().c.data();
  const auto load = [x](const Rings::Row& row, Vec<2, Lanes>& point)
  {
    const double* from[L];
    for (std::size_t l = 0; l < L; ++l)
      from[l] = x + row[l];
    load_pairs(from, point[0], point[1]);
  };
  for (index_t n = begin; n < end;)
  {
    const index_t group = (n - mesh.first_with_fan) / L, first = mesh.first_with_fan + group * L,
                  next = std::min(first + L, end);
    const Rings::Row *row = mesh.rings.row.data() + mesh.rings.begin[static_cast<std::size_t>(group)],
                     *const row_end =
                         mesh.rings.row.data() + mesh.rings.begin[static_cast<std::size_t>(group) + 1];
    // The triangles between the first neighbour and all others: where a ring has no more, nothing is added.
    Vec<2, Lanes> origin, from{}, before, point;
    Lanes twice_area(0.0);
    load(*row, origin);
    before = origin;
    for (++row; row < row_end; ++row)
    {
      load(*row, point);
      before = nodes.period.near(before, point); // an edge away: never beyond half a cell
      const Vec<2, Lanes> to = before - origin;
      twice_area += from[0] * to[1] - from[1] * to[0];
      from = to;
    }
    const Lanes V = Lanes(1.0 / 6.0) * twice_area;
    if (next - n == L)
      store_lanes(V, &nodes.V[static_cast<std::size_t>(n)], L);
    else
      for (index_t k = n; k < next; ++k)
        nodes.V[static_cast<std::size_t>(k)] = V[k - first];
    n = next;
  }
}

[[gnu::flatten]] void add_element_volumes(const FluidMesh<3>& mesh, const index_t* list, index_t begin,
                                          index_t end, const Share& share, FluidNodes<3>& nodes)
{
  constexpr int L = Lanes::size;
  double* V = nodes.V.data();
  const bool all_mine = share.owns_corners(list, begin);
  for (index_t first = begin; first < end; first += L)
  {
    const int count = std::min<index_t>(L, end - first);
    const EightElements<3> element(mesh.elements, list, first, end);
    std::array<Vec<3, Lanes>, 4> corner;
    for (std::size_t c = 0; c < 4; ++c)
      load_points<3>(nodes.x.data(), element, c, corner[c]);
    nodes.period.join(corner);
    const Lanes share_of_corner = Lanes(0.25) * signed_volume<3, Lanes>(corner);
    double added[L];
    store_lanes(share_of_corner, added, L);
    if (count == L && all_mine)
    {
#pragma GCC unroll 8
      for (std::size_t l = 0; l < L; ++l)
#pragma GCC unroll 4
        for (std::size_t c = 0; c < 4; ++c)
          V[element[l][c]] += added[l];
    }
    else
      for (std::size_t l = 0; l < static_cast<std::size_t>(count); ++l)
        for (const index_t n : element[l])
          if (share.owns(n))
            V[n] += added[l];
  }
}

template <int dim>
void update_nodal_volumes(const FluidMesh<dim>& mesh, FluidNodes<dim>& nodes)
{
  std::fill(nodes.V.begin(), nodes.V.end(), 0.0);
  for (const Simplex<dim>& e : mesh.elements)
  {
    const double share = signed_volume<dim, double>(corners<dim>(nodes.x, e, nodes.period)) / (dim + 1);
    for (const index_t n : e)
      nodes.V[static_cast<std::size_t>(n)] += share;
  }
}

template <int dim>
index_t update_density_and_pressure(const FluidMesh<dim>& mesh, const Tait& tait, double floor,
                                    FluidNodes<dim>& nodes, index_t begin, index_t end)
{
  index_t bad = -1;
  for (index_t first = begin; first < end; first += Lanes::size)
  {
    const int count = std::min<index_t>(Lanes::size, end - first);
    const Lanes V = load_lanes(&nodes.V[static_cast<std::size_t>(first)], count),
                h = load_lanes(&nodes.h[static_cast<std::size_t>(first)], count),
                least = Lanes(floor) * regular_volume<dim>(h);
    if (!any(~(V > least)))
    {
      const Lanes rho = load_lanes(&nodes.m[static_cast<std::size_t>(first)], count) / V;
      store_lanes(rho, &nodes.rho[static_cast<std::size_t>(first)], count);
      store_lanes(tait.pressure(rho), &nodes.p[static_cast<std::size_t>(first)], count);
      continue;
    }
    for (index_t n = first; n < first + count; ++n)
    {
      const auto i = static_cast<std::size_t>(n);
      const double least_volume = floor * regular_volume<dim>(nodes.h[i]);
      if (nodes.V[i] > least_volume)
        nodes.rho[i] = nodes.m[i] / nodes.V[i];
      else if (mesh.isolated(n))
        nodes.rho[i] = tait.rho0;
      else if (nodes.V[i] > -0.5 * least_volume)
        nodes.rho[i] = (nodes.m[i] + tait.rho0 * (least_volume - nodes.V[i])) / least_volume;
      else
      {
        bad = bad < 0 ? n : bad;
        continue;
      }
      nodes.p[i] = tait.pressure(nodes.rho[i]);
    }
  }
  return bad;
}

template <int dim>
void exchange_mass(std::span<const double> mass_rate, double feedback_rate, double dt, double least_mass,
                   const Tait& tait, const Vec<dim>& g, bool tension, FluidNodes<dim>& nodes, index_t begin,
                   index_t end, index_t free_inertia_from, double weight, std::span<double> energy)
{
  for (index_t first = begin; first < end; first += Lanes::size)
  {
    const int count = std::min<index_t>(Lanes::size, end - first);
    const auto i = static_cast<std::size_t>(first);
    const Lanes M = load_lanes(&nodes.M[i], count), m = load_lanes(&nodes.m[i], count),
                h = load_lanes(&nodes.h[i], count),
                exchanged =
                    mass_rate.empty()
                        ? Lanes(0.0)
                        : Lanes(dt) * load_lanes(&mass_rate[static_cast<std::size_t>(first - begin)], count);
    const Lanes most = Lanes(0.2) * m, defect = min(max(M - m, Lanes(0.0) - most), most);
    Lanes fed = Lanes(dt * feedback_rate) / h * defect;
    Lanes least = Lanes(least_mass) * regular_volume<dim>(h);
    std::uint64_t flags = ~std::uint64_t{0}; // of eight nodes
    if (count == Lanes::size)
      std::memcpy(&flags, &nodes.flag[i], sizeof flags);
    for (int l = 0; l < count && (flags & 0x0101010101010101ULL * isolated_node) != 0; ++l)
      if (nodes.flag[i + static_cast<std::size_t>(l)] & isolated_node) // gravity alone moves it: no floor
      {
        fed.set(l, 0.0);
        least.set(l, m[l]);
      }
    if (!energy.empty())
    {
      const auto columns = [&](const std::vector<Vec<dim>>& field)
      {
        Vec<dim, Lanes> f;
        for (int l = 0; l < count; ++l)
          for (int k = 0; k < dim; ++k)
            f[k].set(l, field[i + static_cast<std::size_t>(l)][k]);
        return f;
      };
      const Vec<dim, Lanes> x = columns(nodes.x), v = columns(nodes.v), a = columns(nodes.a);
      const Lanes rho = load_lanes(&nodes.rho[i], count), inertia = load_lanes(&nodes.inertia[i], count);
      Lanes h_n = tait.enthalpy(rho);
      if (!tension)
        for (int l = 0; l < count; ++l)
          if ((nodes.flag[i + static_cast<std::size_t>(l)] & on_free_surface) && rho[l] < tait.rho0)
            h_n.set(l, 0.0);
      Lanes g_x(0.0), v_forces(0.0);
      for (int k = 0; k < dim; ++k)
      {
        g_x += Lanes(g[k]) * x[k];
        v_forces += v[k] * ((M - inertia) * a[k] - (M - m) * Lanes(g[k]));
      }
      double* const to = &energy[static_cast<std::size_t>(first - begin)];
      const Lanes given =
          (Lanes(0.5) * dot(v, v) - g_x) * exchanged + h_n * (exchanged + fed) + Lanes(dt) * v_forces;
      store_lanes(load_lanes(to, count) + Lanes(weight) * given, to, count);
    }
    const Lanes m_new = m + (exchanged + fed);
    store_lanes(m_new, &nodes.m[i], count);
    store_lanes(M + exchanged, &nodes.M[i], count);
    const Lanes inertia = max(m_new, least);
    if (first >= free_inertia_from)
      store_lanes(inertia, &nodes.inertia[i], count);
    else
      for (int l = 0; l < count; ++l)
        if (first + l >= free_inertia_from)
          nodes.inertia[i + static_cast<std::size_t>(l)] = inertia[l];
  }
}

template void update_nodal_volumes<2>(const FluidMesh<2>&, FluidNodes<2>&);
template void update_nodal_volumes<3>(const FluidMesh<3>&, FluidNodes<3>&);
template index_t update_density_and_pressure<2>(const FluidMesh<2>&, const Tait&, double, FluidNodes<2>&,
                                                index_t, index_t);
template void exchange_mass<2>(std::span<const double>, double, double, double, const Tait&, const Vec<2>&,
                               bool, FluidNodes<2>&, index_t, index_t, index_t, double, std::span<double>);
template index_t update_density_and_pressure<3>(const FluidMesh<3>&, const Tait&, double, FluidNodes<3>&,
                                                index_t, index_t);
template void exchange_mass<3>(std::span<const double>, double, double, double, const Tait&, const Vec<3>&,
                               bool, FluidNodes<3>&, index_t, index_t, index_t, double, std::span<double>);

} // namespace undine::fluid
