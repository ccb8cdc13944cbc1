// Rows of new nodes, and nodes that leave.
#include "fluid_pfem/openings.hpp"

#include "common/error.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace undine::fluid
{

namespace
{

constexpr int driven_rows = 3; ///< behind the opening

/// Give each corner its share of an element's mass, or take it.
template <int dim>
double share(FluidNodes<dim>& nodes, const Simplex<dim>& e, double sign)
{
  const double V = signed_volume<dim, double>(corners<dim>(nodes.x, e, nodes.period)) / (dim + 1);
  double mass = 0.0;
  for (const index_t n : e)
  {
    const auto i = static_cast<std::size_t>(n);
    const double m = sign * nodes.rho[i] * V;
    nodes.m[i] += m;
    nodes.M[i] += m;
    nodes.V[i] += sign * V;
    mass += m;
  }
  return mass;
}

} // namespace

template <int dim>
std::array<double, dim - 1> Openings<dim>::Inlet::place(const Vec<dim>& x) const
{
  std::array<double, dim - 1> p;
  for (std::size_t k = 0; k < p.size(); ++k)
    p[k] = dot(x - a, side[k]) / norm_squared(side[k]);
  return p;
}

template <int dim>
std::size_t Openings<dim>::Inlet::number(const std::array<int, dim - 1>& place) const
{
  int n = 0;
  for (std::size_t k = 0; k < place.size(); ++k)
    n = n * (intervals[k] + 1) + place[k];
  return static_cast<std::size_t>(n);
}

template <int dim>
std::size_t Openings<dim>::Inlet::nodes_per_row() const
{
  return number(intervals) + 1;
}

namespace
{

/// All places p with 0 ≤ p_k ≤ last_k, in the order of their numbers.
template <std::size_t n>
std::vector<std::array<int, n>> places(const std::array<int, n>& last)
{
  std::vector<std::array<int, n>> all{{}};
  for (std::size_t k = 0; k < n; ++k)
  {
    std::vector<std::array<int, n>> longer;
    for (const auto& p : all)
      for (int i = 0; i <= last[k]; ++i)
      {
        longer.push_back(p);
        longer.back()[k] = i;
      }
    all = std::move(longer);
  }
  return all;
}

} // namespace

template <int dim>
Openings<dim>::Openings(std::vector<InletConfig> inlets, std::vector<OutletConfig> outlets, double spacing)
    : outlets_(std::move(outlets))
{
  for (InletConfig& config : inlets)
  {
    Inlet inlet;
    inlet.a = leading<dim>(config.a);
    const std::array<Vec<dim>, 2> ends{leading<dim>(config.b), leading<dim>(config.c)};
    for (std::size_t k = 0; k < dim - 1; ++k)
    {
      const Vec<dim> whole = ends[k] - inlet.a;
      inlet.intervals[k] = std::max(1, static_cast<int>(std::lround(norm(whole) / spacing)));
      inlet.side[k] = (1.0 / inlet.intervals[k]) * whole;
    }
    if constexpr (dim == 2)
      inlet.n = -right_normal(inlet.side[0]);
    else
      inlet.n = cross(inlet.side[0], inlet.side[1]);
    inlet.n *= 1.0 / norm(inlet.n);
    inlet.row = norm(inlet.side[0]);
    inlet.bit = SurfaceMask{1} << (31 - inlets_.size());
    inlet.config = std::move(config);
    driven_ |= inlet.bit;
    inlets_.push_back(std::move(inlet));
  }
}

template <int dim>
void Openings<dim>::first_rows(std::vector<Vec<dim>>& x, std::vector<SurfaceMask>& surface,
                               std::vector<int>& body) const
{
  for (const Inlet& inlet : inlets_)
    for (int row = 0; row <= driven_rows; ++row)
      for (const auto& place : places(inlet.intervals))
      {
        x.push_back(inlet.a - (row * inlet.row) * inlet.n);
        for (std::size_t k = 0; k < dim - 1; ++k)
          x.back() += double(place[k]) * inlet.side[k];
        surface.push_back(
            inlet.bit); // the first row too, until it has passed: fluid that waits there would be hit
        body.push_back(-1);
      }
}

template <int dim>
bool Openings<dim>::behind_inlet(const Vec<dim>& x) const
{
  return std::any_of(inlets_.begin(), inlets_.end(),
                     [&](const Inlet& inlet)
                     {
                       const double s = inlet.offset(x);
                       bool within = s < 0.0 && s > -(driven_rows + 0.5) * inlet.row;
                       const auto place = inlet.place(x);
                       for (std::size_t k = 0; k < dim - 1; ++k)
                         within = within && place[k] > 0.0 && place[k] < inlet.intervals[k];
                       return within;
                     });
}

template <int dim>
void Openings<dim>::drive(FluidNodes<dim>& nodes, double t) const
{
  for (const Inlet& inlet : inlets_)
  {
    const Vec<dim> v = inlet.config.speed.front()(0.0, 0.0, 0.0, t) * inlet.n;
    for (std::size_t i = 0; i < nodes.x.size(); ++i)
      if (nodes.surface[i] & inlet.bit)
      {
        nodes.v[i] = v;
        nodes.a[i] = {};
      }
  }
}

template <int dim>
std::vector<double> Openings<dim>::behind(const FluidNodes<dim>& nodes, std::size_t begin,
                                          std::size_t end) const
{
  std::vector<double> behind;
  for (const Inlet& inlet : inlets_)
  {
    double last = 0.0;
    for (std::size_t i = begin; i < end; ++i)
      if (nodes.surface[i] & inlet.bit)
        last = std::min(last, inlet.offset(nodes.x[i]));
    behind.push_back(-last);
  }
  return behind;
}

template <int dim>
bool Openings<dim>::row_due(std::span<const double> behind) const
{
  for (std::size_t k = 0; k < inlets_.size(); ++k)
    if (behind[k] < (driven_rows - 1) * inlets_[k].row)
      return true;
  return false;
}

template <int dim>
double Openings<dim>::let_in(FluidNodes<dim>& nodes, std::vector<Simplex<dim>>& elements,
                             global_index_t& next_id, double rho0) const
{
  double mass = 0.0;
  for (const Inlet& inlet : inlets_)
    for (;;)
    {
      std::vector<std::pair<double, index_t>> driven;
      for (index_t n = 0; n < nodes.size(); ++n)
      {
        const auto i = static_cast<std::size_t>(n);
        if (!(nodes.surface[i] & inlet.bit))
          continue;
        if (inlet.offset(nodes.x[i]) >= 0.0)
          nodes.surface[i] &= ~inlet.bit;
        else
          driven.emplace_back(inlet.offset(nodes.x[i]), n);
      }
      std::sort(driven.begin(), driven.end());
      const double last = driven.empty() ? 0.0 : driven.front().first;
      if (driven.empty() || last <= -(driven_rows - 1) * inlet.row)
        break;
      std::vector<index_t> front(inlet.nodes_per_row(), -1); // the last row, by place
      for (const auto& [s, n] : driven)
        if (s < last + 0.5 * inlet.row)
        {
          std::array<int, dim - 1> place;
          const auto p = inlet.place(nodes.x[static_cast<std::size_t>(n)]);
          for (std::size_t k = 0; k < dim - 1; ++k)
            place[k] = std::clamp(static_cast<int>(std::lround(p[k])), 0, inlet.intervals[k]);
          front[inlet.number(place)] = n;
        }
      require(std::count(front.begin(), front.end(), -1) == 0, "driven nodes keep their places");
      const index_t first = nodes.size();
      for (const index_t n : front)
      {
        const auto i = static_cast<std::size_t>(n);
        const Vec<dim> x = nodes.x[i] - inlet.row * inlet.n;
        nodes.for_each_field([i](const char*, auto& field) { field.push_back(field[i]); });
        nodes.x.back() = x;
        nodes.m.back() = nodes.M.back() = nodes.V.back() = 0.0;
        nodes.rho.back() = rho0;
        nodes.id.back() = next_id++;
        nodes.row.back() = no_row;
      }
      // Between four (eight) nodes of the two rows a simplex per way along the axes, one after the other.
      std::array<int, dim - 1> last_cell = inlet.intervals;
      for (int& k : last_cell)
        --k;
      for (const auto& cell : places(last_cell))
      {
        std::array<std::size_t, dim> axes;
        std::iota(axes.begin(), axes.end(), std::size_t{0});
        do
        {
          auto place = cell;
          bool old = false;
          Simplex<dim> e;
          for (std::size_t c = 0; c <= dim; ++c)
          {
            const std::size_t k = inlet.number(place);
            e[c] = old ? front[k] : first + static_cast<index_t>(k);
            if (c < dim && axes[c] == dim - 1)
              old = true;
            else if (c < dim)
              ++place[axes[c]];
          }
          if (signed_volume<dim, double>(corners<dim>(nodes.x, e, nodes.period)) < 0.0)
            std::swap(e[0], e[1]);
          elements.push_back(e);
          mass += share<dim>(nodes, e, 1.0);
        } while (std::next_permutation(axes.begin(), axes.end()));
      }
    }
  return mass;
}

template <int dim>
double Openings<dim>::let_out(FluidNodes<dim>& nodes, std::vector<Simplex<dim>>& elements,
                              std::vector<char>& gone) const
{
  gone.clear();
  bool any = false;
  std::vector<char> out(nodes.x.size(), 0);
  for (const OutletConfig& outlet : outlets_)
    for (std::size_t i = 0; i < nodes.x.size(); ++i)
    {
      bool inside = true;
      for (std::size_t k = 0; k < dim; ++k)
        inside = inside && nodes.x[i].c[k] >= outlet.lower[k] && nodes.x[i].c[k] <= outlet.upper[k];
      out[i] = static_cast<char>(out[i] || inside);
      any = any || inside;
    }
  if (!any)
    return 0.0;
  double mass = 0.0;
  const auto leaves = [&](index_t n) { return out[static_cast<std::size_t>(n)] != 0; };
  std::erase_if(elements,
                [&](const Simplex<dim>& e)
                {
                  if (std::none_of(e.begin(), e.end(), leaves))
                    return false;
                  mass -= share<dim>(nodes, e, -1.0);
                  return true;
                });
  // What hung on the dropped elements only leaves as well.
  std::vector<char> held(nodes.x.size(), 0);
  for (const auto& e : elements)
    for (const index_t n : e)
      held[static_cast<std::size_t>(n)] = 1;
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = static_cast<char>(out[i] || (!held[i] && !(nodes.flag[i] & isolated_node)));
  for (std::size_t i = 0; i < out.size(); ++i)
    if (out[i])
      mass += nodes.M[i];
  gone = std::move(out);
  return mass;
}

template class Openings<2>;
template class Openings<3>;

} // namespace undine::fluid
