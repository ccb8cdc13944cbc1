// Where particle mass goes when a remesh moves volume from node to node.
#include "fluid_pfem/fluid.hpp"

#include <algorithm>
#include <cmath>

namespace undine::fluid
{

namespace
{

/// Note that node `from` passes mass to node `to`.
template <int dim>
void pass_mass(std::size_t from, std::size_t to, double mass, std::span<const Vec<dim>> v_half,
               std::span<double> dM, std::span<Received<dim>> received)
{
  dM[from] -= mass;
  dM[to] += mass;
  received[to].mass += mass;
  received[to].momentum += mass * v_half[from];
  received[to].energy += 0.5 * mass * norm_squared(v_half[from]);
}

/// The part θ ≤ 1 of a change of velocity that takes a rise of kinetic energy away: rise + θ linear + θ²
/// square = 0.
double part_of_the_way(double rise, double linear, double square)
{
  const double discriminant = linear * linear - 4.0 * square * rise;
  return linear < 0.0 && discriminant > 0.0 ? std::min(1.0, 2.0 * rise / (std::sqrt(discriminant) - linear))
                                            : 1.0;
}

/// Of a node that received mass and now has M: as far towards the common velocity as the kinetic energy of
/// both parts asks for.
template <int dim>
Vec<dim> change_of_velocity(double M, const Vec<dim>& v, const Received<dim>& received)
{
  const double rise = 0.5 * received.mass * norm_squared(v) - received.energy;
  if (!(rise > 0.0) || !(M > received.mass))
    return {};
  const Vec<dim> dv = (1.0 / M) * (received.momentum - received.mass * v);
  return part_of_the_way(rise, M * dot(v, dv), 0.5 * M * norm_squared(dv)) * dv;
}

} // namespace

/// Elements that the old or the new mesh has alone, or that have been deformed by the remesh.
/// @param number present number of each old node, −1: deleted
template <int dim>
std::vector<Simplex<dim>> Fluid<dim>::changed_elements(std::vector<Simplex<dim>> old,
                                                       std::span<const Vec<dim>> old_x,
                                                       std::span<const index_t> number) const
{
  std::vector<char> moved(nodes_.x.size(), 0);
  for (std::size_t n = 0; n < number.size(); ++n)
    if (number[n] >= 0 && nodes_.x[static_cast<std::size_t>(number[n])] != old_x[n])
      moved[static_cast<std::size_t>(number[n])] = 1;
  bool same_numbers = openings_.empty(); // elements of an inlet are in no order
  for (std::size_t n = 0; n < number.size(); ++n)
    same_numbers = same_numbers && number[n] == static_cast<index_t>(n);
  if (!same_numbers)
  {
    for (auto& e : old)
      for (index_t& n : e)
        n = number[static_cast<std::size_t>(n)];
    old = sorted_elements<dim>(nodes_.size(), std::move(old));
  }
  std::vector<Simplex<dim>> changed;
  const auto& now = mesh_.elements;
  for (std::size_t o = 0, k = 0; o < old.size() || k < now.size();)
    if (k == now.size() || (o < old.size() && old[o] < now[k]))
      changed.push_back(old[o++]);
    else if (o == old.size() || now[k] < old[o])
      changed.push_back(now[k++]);
    else
    {
      if (std::any_of(now[k].begin(), now[k].end(),
                      [&](index_t n) { return moved[static_cast<std::size_t>(n)]; }))
        changed.push_back(now[k]);
      ++o;
      ++k;
    }
  return changed;
}

/// New connectivity hands volume from node to node; particle mass goes with it, so that a remesh of quiet
/// fluid leaves no defect M − m. Nodes that share changed elements form a patch; what its losers lose goes to
/// its gainers. Only volume that the patch as a whole gained or lost is a defect: that was created or dropped
/// by decision. A node that flies or flew keeps its mass. Nodes keep their velocities, which conserves
/// momentum of a linear field, unless the kinetic energy of the patch would grow: then gainers take over as
/// much of the losers' velocity as keeps it.
/// @param changed elements of the old or the new mesh that the other does not have, in the present numbers
/// @param V_before of each node before the remesh [m^dim]
/// @param v_half velocity of the half step, whose energy it is [m/s]
template <int dim>
void Fluid<dim>::hand_over_mass(const std::vector<Simplex<dim>>& changed, std::span<const double> V_before,
                                std::span<Vec<dim>> v_half)
{
  const auto n_nodes = static_cast<std::size_t>(nodes_.size());
  std::vector<index_t> leader(n_nodes, -1); // of the patch; −1: nothing has changed at the node
  const auto leader_of = [&](index_t n)
  {
    for (index_t up; (up = leader[static_cast<std::size_t>(n)]) != n; n = up)
      leader[static_cast<std::size_t>(n)] = leader[static_cast<std::size_t>(up)];
    return n;
  };
  for (const auto& e : changed)
  {
    index_t first = -1;
    for (const index_t n : e)
      if (n >= 0)
      {
        if (leader[static_cast<std::size_t>(n)] < 0)
          leader[static_cast<std::size_t>(n)] = n;
        const index_t root = leader_of(n);
        if (first >= 0) // the smaller number leads, so that the order does not matter
          leader[static_cast<std::size_t>(std::max(first, root))] = std::min(first, root);
        first = first < 0 ? root : std::min(first, root);
      }
  }

  struct Patch
  {
    double gain = 0.0, loss = 0.0, mass = 0.0; ///< volumes; mass that changes hands
    Vec<dim> momentum{};                       ///< of that mass
    double energy = 0.0;                       ///< kinetic, that the patch gains if velocities stay …
    double linear = 0.0, square = 0.0; ///< … plus θ linear + θ² square if gainers take a part θ of the way
  };
  std::vector<Patch> patches(n_nodes); // at its leader
  const auto patch_of = [&](std::size_t n) -> Patch&
  { return patches[static_cast<std::size_t>(leader_of(static_cast<index_t>(n)))]; };
  const auto gain_of = [&](std::size_t n)
  {
    const bool flies = V_before[n] == 0.0 || (nodes_.flag[n] & isolated_node);
    return leader[n] < 0 || flies ? 0.0 : nodes_.V[n] - V_before[n];
  };
  for (std::size_t n = 0; n < n_nodes; ++n)
    if (const double gain = gain_of(n); gain != 0.0)
      (gain > 0.0 ? patch_of(n).gain : patch_of(n).loss) += std::abs(gain);
  for (std::size_t n = 0; n < n_nodes; ++n)
    if (const double gain = gain_of(n); gain < 0.0)
    {
      Patch& p = patch_of(n);
      const double given = nodes_.rho[n] * -gain * std::min(1.0, p.gain / p.loss);
      nodes_.M[n] -= given;
      p.mass += given;
      p.momentum += given * v_half[n];
      p.energy -= 0.5 * given * norm_squared(v_half[n]);
    }
  // Change of velocity of a gainer that takes all the way: its new mass has the mean velocity of both.
  const auto full_change = [&](std::size_t n, const Patch& p, double taken)
  {
    const bool free =
        static_cast<index_t>(n) >= n_wet_ && nodes_.M[n] > taken; // the coupler knows v of wet nodes
    return free ? (taken / nodes_.M[n]) * ((1.0 / p.mass) * p.momentum - v_half[n]) : Vec<dim>{};
  };
  for (std::size_t n = 0; n < n_nodes; ++n)
    if (const double gain = gain_of(n); gain > 0.0)
      if (Patch& p = patch_of(n); p.mass > 0.0)
      {
        const double taken = p.mass * gain / p.gain;
        nodes_.M[n] += taken;
        const Vec<dim> dv = full_change(n, p, taken);
        p.energy += 0.5 * taken * norm_squared(v_half[n]);
        p.linear += nodes_.M[n] * dot(v_half[n], dv);
        p.square += 0.5 * nodes_.M[n] * norm_squared(dv);
      }
  for (std::size_t n = 0; n < n_nodes; ++n)
    if (const double gain = gain_of(n); gain > 0.0)
      if (const Patch& p = patch_of(n); p.mass > 0.0 && p.energy > 0.0 && p.square > 0.0)
      {
        const double theta = part_of_the_way(p.energy, p.linear, p.square);
        const Vec<dim> dv = theta * full_change(n, p, p.mass * gain / p.gain);
        nodes_.v[n] += dv;
        v_half[n] += dv;
      }
  std::vector<Patch>().swap(patches); // 64 bytes a node, and smoothing wants as much
  smooth_mass_defect(v_half);
  for (const index_t n : constrained_)
    constrain(nodes_.v[static_cast<std::size_t>(n)], n);
}

/// Add what has been passed to the particle masses. Nodes keep their velocities, which conserves momentum of
/// a linear field, unless that would raise the kinetic energy: then a receiver takes over as much of the
/// velocity it received as keeps it. The coupler knows the velocity of wet nodes; they keep it.
template <int dim>
void Fluid<dim>::take_mass(std::span<const double> dM, std::span<const Received<dim>> received,
                           std::span<Vec<dim>> v_half)
{
  for (std::size_t n = 0; n < dM.size(); ++n)
  {
    nodes_.M[n] += dM[n];
    if (static_cast<index_t>(n) < n_wet_)
      continue;
    const Vec<dim> dv = change_of_velocity<dim>(nodes_.M[n], v_half[n], received[n]);
    v_half[n] += dv;
    nodes_.v[n] += dv;
  }
}

/// Spread M − m over neighbours, conserving ΣM: the feedback then acts on the smooth part and makes no noise.
/// In a sweep all fluxes go by the state at its begin; a node gives at most 0.6 of its mass.
template <int dim>
void Fluid<dim>::smooth_mass_defect(std::span<Vec<dim>> v_half)
{
  constexpr int sweeps = dim == 2 ? 7 : 14;
  const auto n_nodes = static_cast<std::size_t>(nodes_.size());
  std::vector<double> share(n_nodes, 0.0), defect(n_nodes), dM(n_nodes); // share: per edge of an element
  std::vector<Received<dim>> received(n_nodes);
  for (index_t n = 0; n < nodes_.size(); ++n)
    if (!mesh_.isolated(n))
      share[static_cast<std::size_t>(n)] = 0.6 / static_cast<double>(dim * mesh_.fan(n).size());
  for (int sweep = 0; sweep < sweeps; ++sweep)
  {
    for (std::size_t n = 0; n < n_nodes; ++n)
      defect[n] = nodes_.M[n] - nodes_.m[n];
    std::fill(dM.begin(), dM.end(), 0.0);
    std::fill(received.begin(), received.end(), Received<dim>{});
    for (const auto& e : mesh_.elements)
      for (std::size_t a = 0; a <= dim; ++a)
        for (std::size_t b = a + 1; b <= dim; ++b)
        {
          const auto i = static_cast<std::size_t>(e[a]), j = static_cast<std::size_t>(e[b]);
          const bool forward = defect[i] > defect[j];
          const std::size_t from = forward ? i : j, to = forward ? j : i;
          const double s = std::min(share[i], share[j]);
          pass_mass<dim>(from, to, s * std::min(defect[from] - defect[to], std::max(nodes_.M[from], 0.0)),
                         v_half, dM, received);
        }
    take_mass(dM, received, v_half);
  }
}

template class Fluid<2>;
template class Fluid<3>;

} // namespace undine::fluid
