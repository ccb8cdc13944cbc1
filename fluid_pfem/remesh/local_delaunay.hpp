// The Delaunay simplices of a part of the points, from that part and what is near it.
#pragma once

#include "common/tensor.hpp"
#include "fluid_pfem/fluid_mesh.hpp"
#include "fluid_pfem/remesh/moving_delaunay.hpp"

#include <span>
#include <vector>

namespace undine::fluid
{

/// Numbers, ascending, of at least all points within `reach` [m] of a point of `mine` (closed ball).
/// @param among numbers, ascending, of the points that are looked at, those of `mine` among them; null: all
template <int dim>
std::vector<index_t> points_near(std::span<const Vec<dim>> x, std::span<const char> mine, double reach,
                                 const std::vector<index_t>* among = nullptr);

/// The triangulation of some of the points and of a halo around them. A simplex with circumradius R and a
/// corner v lies, with its circumscribed ball, within 2R of v: where the halo is 2R wide, the simplices up to
/// R at the points in question are exactly those of the triangulation of all points, because ties are broken
/// by coordinates alone. The points taken are more than needed, so that the triangulation can be kept and
/// repaired while points move; when one is needed that was not taken, it is made anew. Numbers of points
/// outside are those of all points.
template <int dim>
class LocalDelaunay
{
public:
  /// In the plane, room to move against each other by a part of the reach before the next rebuild; in space
  /// every triangulation is a rebuild.
  static constexpr double spare = dim == 2 ? 1.5 : 1.0;

  /// @param threads as of MovingDelaunay
  explicit LocalDelaunay(int threads = 1) : delaunay_(threads) {}

  /// Triangulate the points where they are now: those marked in `mine` and all within `reach` [m] of them.
  /// `mine` empty: all points.
  /// @param among as of points_near: the others are nowhere; at least all within spare · reach of `mine`
  void update(std::span<const Vec<dim>> x, std::span<const char> mine, double reach,
              const std::vector<index_t>* among = nullptr);
  /// Those whose corner of the lowest number is one of `mine` (empty: all), canonical; no circumradius up to
  /// reach/2 is missing or wrong.
  std::vector<Simplex<dim>> simplices(std::span<const char> mine) const;
  const DelaunayCount& count() const { return delaunay_.count(); }
  /// Points in the triangulation of a part.
  std::size_t size() const { return number_.size(); }
  void forget();

  // As of MovingDelaunay.
  void merge(index_t kept, index_t gone);
  void split(index_t i, index_t j, index_t added);
  void remove(index_t gone);
  void renumber(std::span<const index_t> new_number);

private:
  void leave_to(const std::vector<index_t>& among);
  index_t here(index_t n) const
  {
    if (whole_)
      return n;
    return static_cast<std::size_t>(n) < place_.size() ? place_[static_cast<std::size_t>(n)] : -1;
  }

  MovingDelaunay<dim> delaunay_;
  std::vector<index_t> number_; ///< of each point taken, ascending; empty: all
  std::vector<index_t> place_;  ///< among them, of each point; −1: not taken; empty: all
  bool whole_ = false;          ///< all were asked for
};

} // namespace undine::fluid
