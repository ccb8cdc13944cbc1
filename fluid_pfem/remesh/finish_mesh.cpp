// All that follows from a new set of elements.
#include "common/parallel/in_parts.hpp"
#include "fluid_pfem/fluid.hpp"
#include "fluid_pfem/mass_conservation.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace undine::fluid
{

/// Elements sorted and shared out; each rank finds the fans of its nodes. Collective.
/// @param elements of this rank: those of all ranks make up the mesh
template <int dim>
void Fluid<dim>::connect_mesh(std::vector<Simplex<dim>> elements)
{
  share_elements(sorted_elements<dim>(std::move(elements), team_.threads()));
  find_surroundings();
  const Range nodes = around_.back();
  find_fans<dim>(
      mesh_, nodes.begin < team_.node_begin() ? nodes.begin / Lanes::size * Lanes::size : nodes.begin,
      nodes.end, before_elements_here(), elements_here_.begin, elements_here_.end, team_.threads());
  if constexpr (dim == 2)
    std::erase_if(mesh_.boundary, [this](const Facet<dim>& facet) { return !team_.owns(facet[0]); });
  if (!ranks().alone())
    mesh_.boundary = ranks().gather(mesh_.boundary);
  find_ghosts();
  reach_is_found_ = false;
}

/// All that follows from positions, densities and connectivity, for the nodes of each rank. Collective.
template <int dim>
void Fluid<dim>::finish_mesh()
{
  const index_t n_nodes = nodes_.size(), begin = team_.node_begin(), end = team_.node_end();
  const std::vector<std::uint8_t> was(nodes_.flag.begin() + begin, nodes_.flag.begin() + end);
  flag_nodes();
  // A node that opened at the free surface had no pull; when the fluid closes around it, it begins with none.
  if (!config_.surface_tension_allowed)
    for (std::size_t k = 0; k < was.size(); ++k)
      if (const std::size_t i = static_cast<std::size_t>(begin) + k;
          (was[k] & on_free_surface) && !(nodes_.flag[i] & on_free_surface))
        nodes_.rho[i] = std::max(nodes_.rho[i], config_.tait.rho0);
  constrained_.clear();
  for (index_t n = 0; n < n_nodes && wall_mask_ != 0; ++n)
    if (nodes_.surface[static_cast<std::size_t>(n)] & wall_mask_)
      constrained_.push_back(n);
  constrain_velocities();

  const auto each_element = [this](auto&& add)
  {
    team_.each(
        [&](const Share& share)
        {
          sweep(
              mesh_, share, false, 0, 0,
              [&](const index_t* list, index_t first, index_t last) { add(list, first, last, share); },
              [](index_t, index_t) {});
        });
  };
  if constexpr (dim == 2)
    team_.each([this](const Share& share)
               { update_nodal_volumes(mesh_, share.node_begin, share.node_end, nodes_); });
  else
  {
    std::fill(nodes_.V.begin() + begin, nodes_.V.begin() + end, 0.0);
    each_element([&](const index_t* list, index_t first, index_t last, const Share& share)
                 { add_element_volumes(mesh_, list, first, last, share, nodes_); });
  }

  // ρ and p are the state; masses follow the new volumes. An isolated node keeps its mass and flies.
  const auto take_mass = [this](index_t n)
  {
    const auto i = static_cast<std::size_t>(n);
    if (mesh_.isolated(n))
      nodes_.rho[i] = config_.tait.rho0;
    if (mesh_.isolated(n))
      nodes_.m[i] = nodes_.M[i] > 0.0 ? nodes_.M[i] : least_inertia(i);
    else // the inverse of update_density_and_pressure, completed nodes included
      nodes_.m[i] =
          nodes_.rho[i] * nodes_.V[i] + (nodes_.rho[i] - config_.tait.rho0) *
                                            std::max(0.0, least_inertia(i) / config_.tait.rho0 - nodes_.V[i]);
    nodes_.p[i] = config_.tait.pressure(nodes_.rho[i]);
    // What flies is moved by gravity alone: no element can accelerate it.
    nodes_.inertia[i] = mesh_.isolated(n) ? nodes_.m[i] : std::max(nodes_.m[i], least_inertia(i));
  };
  mass_rate_.resize(static_cast<std::size_t>(n_nodes));
  exchange_energy_.resize(static_cast<std::size_t>(n_nodes)); // all booked: zeros
  sums_.make_room(n_nodes);
  team_.each(
      [&](const Share& share)
      {
        for (index_t n = share.node_begin; n < share.node_end; ++n)
          take_mass(n);
        limit_tension(share.node_begin, share.node_end);
        std::fill(mass_rate_.begin() + share.node_begin, mass_rate_.begin() + share.node_end, 0.0);
        std::fill(exchange_energy_.begin() + share.node_begin, exchange_energy_.begin() + share.node_end,
                  0.0);
        sums_.clear(share.node_begin, share.node_end);
      });
  sums_.body.clear();
  sums_.heat.assign(static_cast<std::size_t>(mesh_.n_elements() / element_block) + 1, 0.0);
  // Viscous terms need the velocity of the half step: at the full one, nodes pressed against a wall carry
  // half a kick into it.
  const std::vector<Vec<dim>> v(nodes_.v.begin() + begin, nodes_.v.begin() + end);
  // Of half a kick into a wall nothing will be left, but the residual of momentum sees the difference between
  // it and that of the new mesh.
  const auto each_pressed = [&](auto&& visit) // visit(node, part of its acceleration into walls)
  {
    for (index_t n = contact_.empty() ? end : std::max(n_wet_, begin); n < end; ++n)
      if (const auto i = static_cast<std::size_t>(n); nodes_.flag[i] & on_wall)
        visit(i, contact_.into_walls(nodes_.x[i], on_wall_within * nodes_.h[i], nodes_.a[i]));
  };
  std::vector<Vec<dim>> pressed;
  each_pressed([&](std::size_t, const Vec<dim>& a) { pressed.push_back(a); });
  team_.each(
      [&](const Share& share)
      {
        for (index_t n = share.node_begin; n < share.node_end; ++n)
          nodes_.v[static_cast<std::size_t>(n)] -= 0.5 * dt_before_ * nodes_.a[static_cast<std::size_t>(n)];
        record_nodes<dim>(nodes_, config_.terms, share.node_begin, share.node_end, sums_);
      });
  halo_.update(sums_.record, nodes_.m);
  each_element([&](const index_t* list, index_t first, index_t last, const Share& share)
               { add_element_forces(present_step(dt_before_), list, first, last, share); });
  std::fill(sums_.heat.begin(), sums_.heat.end(), 0.0); // no time has passed
  team_.each([&](const Share& share)
             { accelerate(present_step(dt_before_), share.node_begin, share.node_end); });
  add_body_force(begin, end);
  constrain_accelerations(begin, end);
  find_impedance();
  let_waves_out(dt_before_, false);
  team_.each(
      [&](const Share& share)
      {
        std::copy(v.begin() + (share.node_begin - begin), v.begin() + (share.node_end - begin),
                  nodes_.v.begin() + share.node_begin);
      });
  each_pressed([&, k = std::size_t{0}](std::size_t i, const Vec<dim>& a) mutable
               { nodes_.v[i] += (0.5 * dt_before_) * (a - pressed[k++]); });
  openings_.drive(nodes_, t_);

  f_link_.assign(static_cast<std::size_t>(n_wet_) * dim, 0.0);
  steps_since_remesh_ = 0;
  travelled_ = 0.0;
  good_for_ = 0;
  good_at_ = -1;
  turned_over_ = turned_over_agreed_ = 0;
  agreed_at_ = steps_;
  keep_places();
  measure_quality();
  if (!contact_.empty())
    contact_.find_candidates(nodes_.x, begin, end, config_.element_size, team_.threads());
  ++surface_epoch_;
}

/// Where nodes of this rank and ghosts are in the new mesh.
template <int dim>
void Fluid<dim>::keep_places()
{
  const index_t begin = team_.node_begin(), end = team_.node_end();
  x_remesh_.resize(nodes_.x.size());
  in_parts(team_.threads(), static_cast<std::size_t>(end - begin),
           [&](int, std::size_t first, std::size_t last)
           {
             const auto from = nodes_.x.begin() + begin;
             std::copy(from + static_cast<std::ptrdiff_t>(first), from + static_cast<std::ptrdiff_t>(last),
                       x_remesh_.begin() + begin + static_cast<std::ptrdiff_t>(first));
           });
  for (const auto& ghosts : halo_.received())
    for (const index_t n : ghosts)
      x_remesh_[static_cast<std::size_t>(n)] = nodes_.x[static_cast<std::size_t>(n)];
}

template <int dim>
void Fluid<dim>::measure_quality()
{
  quality_.resize(mesh_.elements.size());
  team_.each(
      [this](const Share& share)
      {
        for (auto e = static_cast<std::size_t>(share.element_begin);
             e < static_cast<std::size_t>(share.element_end); ++e)
          quality_[e] =
              static_cast<float>(quality<dim>(corners<dim>(x_remesh_, mesh_.elements[e], nodes_.period)));
      });
}

/// Boundary, free surface, wall, isolated: from the boundary facets and the walls. Each rank flags its nodes.
/// Collective.
template <int dim>
void Fluid<dim>::flag_nodes()
{
  const std::vector<OnPieces> on_walls = nodes_on_walls();
  const auto from = [&](index_t n)
  {
    return std::lower_bound(on_walls.begin(), on_walls.end(), n,
                            [](const OnPieces& here, index_t k) { return here.node < k; });
  };
  const auto pieces_of = [&](index_t n)
  {
    const auto it = from(n);
    return it != on_walls.end() && it->node == n ? it->pieces : std::array<int, 3>{-1, -1, -1};
  };
  team_.each(
      [&](const Share& share)
      {
        auto next = from(share.node_begin);
        for (index_t n = share.node_begin; n < share.node_end; ++n)
        {
          const auto i = static_cast<std::size_t>(n);
          const bool on_piece = next != on_walls.end() && next->node == n;
          next += on_piece;
          const bool wall = on_piece || (nodes_.surface[i] & wall_mask_);
          const bool alone = mesh_.isolated(n);
          nodes_.flag[i] =
              static_cast<std::uint8_t>((wall ? on_wall : 0) | (alone ? isolated_node | on_boundary : 0));
          nodes_.alone[i] = alone ? static_cast<std::uint8_t>(std::min(nodes_.alone[i] + 1, 255)) : 0;
        }
      });
  for (const auto& facet : mesh_.boundary)
  {
    if (std::none_of(facet.begin(), facet.end(), [this](index_t n) { return team_.owns(n); }))
      continue;
    SurfaceMask surface = wall_mask_ | wet_mask_ | impedance_mask_ | openings_.driven_mask();
    std::array<int, 3> shared = pieces_of(facet[0]);
    for (const index_t n : facet)
    {
      surface &= nodes_.surface[static_cast<std::size_t>(n)];
      const auto p = pieces_of(n);
      for (int& piece : shared)
        if (std::find(p.begin(), p.end(), piece) == p.end())
          piece = -1;
    }
    const bool bound =
        surface != 0 || std::any_of(shared.begin(), shared.end(), [](int piece) { return piece >= 0; });
    for (const index_t n : facet)
      nodes_.flag[static_cast<std::size_t>(n)] |=
          static_cast<std::uint8_t>(bound ? on_boundary : on_boundary | on_free_surface);
  }
  halo_.update(nodes_.flag);
}

/// Areas at impedance nodes, of which all ranks know all. Collective.
template <int dim>
void Fluid<dim>::find_impedance()
{
  impedance_.clear();
  if (impedance_mask_ == 0)
    return;
  std::vector<Vec<dim>> area(nodes_.x.size());
  for (const auto& facet : mesh_.boundary)
  {
    SurfaceMask common = impedance_mask_;
    std::array<Vec<dim>, dim> x;
    for (std::size_t k = 0; k < dim; ++k)
    {
      common &= nodes_.surface[static_cast<std::size_t>(facet[k])];
      x[k] = nodes_.x[static_cast<std::size_t>(facet[k])];
    }
    nodes_.period.join(x);
    // volume_gradient of the facet is inward: V∇N = −area/dim
    for (const index_t n : facet)
      if (common != 0)
        area[static_cast<std::size_t>(n)] -= volume_gradient<dim, double>(x);
  }
  const auto [begin, end] = rows_to_sum(ranks().alone());
  for (std::size_t n = begin; n < end; ++n)
    if (norm_squared(area[n]) > 0.0)
      impedance_.push_back({n, area[n]});
  impedance_ = ranks().gather(impedance_);
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
