// Rows of new nodes, and nodes that leave.
#include "fluid_pfem/openings.hpp"

#include "common/error.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

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
Openings<dim>::Openings(std::vector<InletConfig> inlets, std::vector<OutletConfig> outlets, double spacing)
    : outlets_(std::move(outlets))
{
  if constexpr (dim == 2)
    for (InletConfig& config : inlets)
    {
      Inlet inlet;
      inlet.a = {{config.a[0], config.a[1]}};
      inlet.t = {{config.b[0] - config.a[0], config.b[1] - config.a[1]}};
      inlet.length = norm(inlet.t);
      inlet.t *= 1.0 / inlet.length;
      inlet.n = -right_normal(inlet.t);
      inlet.intervals = std::max(1, static_cast<int>(std::lround(inlet.length / spacing)));
      inlet.row = inlet.length / inlet.intervals;
      inlet.bit = SurfaceMask{1} << (31 - inlets_.size());
      inlet.config = std::move(config);
      driven_ |= inlet.bit;
      inlets_.push_back(std::move(inlet));
    }
  else if (!inlets.empty())
    throw InputError("fluid.inlet: inlets exist in the plane only");
}

template <int dim>
void Openings<dim>::first_rows(std::vector<Vec<dim>>& x, std::vector<SurfaceMask>& surface,
                               std::vector<int>& body) const
{
  for (const Inlet& inlet : inlets_)
    for (int row = 0; row <= driven_rows; ++row)
      for (int k = 0; k <= inlet.intervals; ++k)
      {
        x.push_back(inlet.a + (k * inlet.length / inlet.intervals) * inlet.t - (row * inlet.row) * inlet.n);
        surface.push_back(row == 0 ? 0 : inlet.bit);
        body.push_back(-1);
      }
}

template <int dim>
bool Openings<dim>::behind_inlet(const Vec<dim>& x) const
{
  return std::any_of(inlets_.begin(), inlets_.end(),
                     [&](const Inlet& inlet)
                     {
                       const double s = offset(inlet, x), along = dot(x - inlet.a, inlet.t);
                       return s < 0.0 && s > -(driven_rows + 0.5) * inlet.row && along > 0.0 &&
                              along < inlet.length;
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
bool Openings<dim>::row_due(const FluidNodes<dim>& nodes) const
{
  for (const Inlet& inlet : inlets_)
  {
    double last = 0.0;
    for (std::size_t i = 0; i < nodes.x.size(); ++i)
      if (nodes.surface[i] & inlet.bit)
        last = std::min(last, offset(inlet, nodes.x[i]));
    if (last > -(driven_rows - 1) * inlet.row)
      return true;
  }
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
        if (offset(inlet, nodes.x[i]) >= 0.0)
          nodes.surface[i] &= ~inlet.bit;
        else
          driven.emplace_back(offset(inlet, nodes.x[i]), n);
      }
      std::sort(driven.begin(), driven.end());
      const double last = driven.empty() ? 0.0 : driven.front().first;
      if (driven.empty() || last <= -(driven_rows - 1) * inlet.row)
        break;
      std::vector<std::pair<double, index_t>> front; // by place along the opening
      for (const auto& [s, n] : driven)
        if (s < last + 0.5 * inlet.row)
          front.emplace_back(dot(nodes.x[static_cast<std::size_t>(n)] - inlet.a, inlet.t), n);
      std::sort(front.begin(), front.end());
      const index_t first = nodes.size();
      for (const auto& [along, n] : front)
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
      for (std::size_t k = 0; k + 1 < front.size(); ++k)
      {
        const index_t p = front[k].second, q = front[k + 1].second, r = first + static_cast<index_t>(k);
        if constexpr (dim == 2) // the opening's normal is to the left of its tangent
          for (const Simplex<2>& e : {Simplex<2>{r, r + 1, q}, Simplex<2>{r, q, p}})
          {
            elements.push_back(e);
            mass += share<dim>(nodes, e, 1.0);
          }
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
