// Contact of the solid with rigid walls and with its own surfaces: penalty forces or exact impulses at nodes,
// Coulomb friction.
#pragma once

#include "common/mesh/mesh.hpp"
#include "solid_fe/solid_config.hpp"
#include "solid_fe/solid_nodes.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

namespace undine::solid
{

/// Penalty contact (default). A node that is behind a wall or facet by the depth d is pushed out by k d along
/// the normal, with the reaction on the facet's nodes; k = stiffness × ω² × mass, ω the solid's highest
/// frequency at the start, so that depths are of the size of one step's travel and the stable step loses
/// little. Friction: μ k d against the tangential velocity, but never more than would stop a tenth of it in
/// one step (sticking creeps by that much).
///
/// Impulse contact. With v⁻ the velocity of the step just made and v⁺ = v⁻ + Δt M⁻¹(F + Gᵀ R) that of the
/// next one, the contact forces R solve, all at once (projected Gauss-Seidel),
///     G v⁺ ≥ r,   R ≥ 0,   R (G v⁺ − r) = 0,        r = min(−max(g, 0)/Δt, −max(G v⁻, 0)),
/// g the gaps and G their gradients now: a gap that would be passed is closed exactly at the end of the next
/// step, and stays closed. Nodes and facets get opposite forces along the normal through both, so that
/// momentum and angular momentum are kept. The work of R, Σ ½ Δt R G(v⁻ + v⁺), is never positive because of
/// r: nothing is created, a node loses what it had in its own lumped mass. There is no stiffness: the stable
/// step is that of the solid without contact.
template <int dim>
class Contact
{
public:
  /// @throws InputError for unknown surfaces, or a normal of zero length
  Contact(const SolidConfig& config, const Mesh<dim>& mesh, const SolidNodes<dim>& nodes, double omega2);

  bool empty() const { return walls_.empty() && pairs_.empty(); }

  /// Add the contact forces on the nodes [N] at their current position, friction with their current velocity;
  /// `dt` is the step being made [s]. Impulse contact needs the forces of all else on the nodes, `F_free`,
  /// and takes the next step to be like this one; penalty contact does not look at it.
  void add_force(const SolidNodes<dim>& nodes, double dt, std::span<const Vec<dim>> F_free,
                 std::span<Vec<dim>> F);
  bool by_impulse() const { return by_impulse_; }

  /// visit(n) of all nodes that contact reads or pushes, some of them more than once.
  template <class Visit>
  void for_each_node(Visit&& visit) const
  {
    for (const auto& wall : walls_)
      std::for_each(wall.nodes.begin(), wall.nodes.end(), visit);
    for (const auto& pair : pairs_)
      std::for_each(pair.members.begin(), pair.members.end(), visit);
  }

  /// Energy stored in the penalty springs at the last evaluation [J].
  double stored_energy() const { return stored_; }
  /// Upper bound of what contact adds to the squared frequency [1/s²], for contacts that are open too.
  double frequency_squared() const { return added_frequency2_; }
  /// Force of wall `k` on the solid at the last evaluation [N].
  const Vec<dim>& wall_force(std::size_t k) const { return walls_[k].force; }
  std::int64_t searches() const { return searches_; } ///< how often candidates were looked for
  template <class Archive>
  void for_each_state(Archive& archive)
  {
    archive("stored", stored_);
    archive("added_frequency2", added_frequency2_);
    archive("searches", searches_);
    archive("v_next", v_next_);
    for (std::size_t k = 0; k < walls_.size(); ++k)
      archive("wall_force_" + std::to_string(k), walls_[k].force);
    for (std::size_t k = 0; k < pairs_.size(); ++k)
    {
      archive("x_at_search_" + std::to_string(k), pairs_[k].x_at_search);
      archive("candidates_" + std::to_string(k), pairs_[k].candidates);
    }
  }

private:
  struct Wall
  {
    Vec<dim> point, normal;
    double friction;
    std::vector<std::size_t> nodes;
    Vec<dim> force{};
  };
  /// Straight piece of a surface: a segment, or a triangle (quadrilaterals are cut in two).
  using Facet = std::array<std::size_t, dim>;
  struct Pair
  {
    std::vector<std::size_t> slaves;
    std::vector<Facet> facets;
    double friction;
    double skin;                       ///< depth beyond which a node is not taken for a penetrating one [m]
    std::vector<std::size_t> members;  ///< nodes of either side
    std::vector<Vec<dim>> x_at_search; ///< their positions when candidates were found
    std::vector<std::vector<std::size_t>> candidates; ///< facets near each slave
  };

  /// A node at a wall or facet.
  struct Touch
  {
    std::size_t slave;
    const Facet* facet; ///< null: a wall
    Wall* wall;         ///< null: a facet
    std::array<double, dim> weight;
    Vec<dim> normal;
    double gap, friction;
    double rate = 0.0, own = 0.0; ///< r [m/s], what a force at the contact moves there, Δt G M⁻¹ Gᵀ [m/s/N]
    Vec<dim> force{};
  };

  std::optional<Touch> touch_of(const Pair& pair, std::size_t s, const SolidNodes<dim>& nodes,
                                double least_gap, double largest_gap) const;
  void search_if_moved(Pair& pair, const SolidNodes<dim>& nodes);
  void find_touches(const SolidNodes<dim>& nodes);
  template <class Field>
  static Vec<dim> relative(const Touch& touch, Field&& field);
  void prepare_touches(const SolidNodes<dim>& nodes, double dt, std::span<const Vec<dim>> F_free);
  void solve_touches(const SolidNodes<dim>& nodes, double dt);
  void add_impulses(const SolidNodes<dim>& nodes, double dt, std::span<const Vec<dim>> F_free,
                    std::span<Vec<dim>> F);
  double stiffness(double mass) const { return stiffness_ * omega2_ * mass; }
  void push_from_walls(const SolidNodes<dim>& nodes, double dt, std::span<Vec<dim>> F);
  void push_from_facets(Pair& pair, const SolidNodes<dim>& nodes, double dt, std::span<Vec<dim>> F);
  void search(Pair& pair, const SolidNodes<dim>& nodes);

  bool by_impulse_;
  std::vector<Touch> touches_;   ///< of the present instant, impulse contact
  std::vector<Vec<dim>> v_next_; ///< v⁺ [m/s], impulse contact
  double omega2_, stiffness_;
  double stored_ = 0.0, added_frequency2_ = 0.0;
  std::int64_t searches_ = 0;
  std::vector<Wall> walls_;
  std::vector<Pair> pairs_;
};

} // namespace undine::solid
