// Contact with rigid walls.
#include "fluid_pfem/walls.hpp"

#include "common/error.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace undine::fluid
{

namespace
{

template <int dim>
Vec<dim> leading(const std::array<double, 3>& a)
{
  Vec<dim> v;
  for (int i = 0; i < dim; ++i)
    v[i] = a[static_cast<std::size_t>(i)];
  return v;
}

/// The normal to the left of a → b.
Vec<2> left_normal(const Vec<2>& a, const Vec<2>& b)
{
  const Vec<2> n = -right_normal(b - a);
  return n * (1.0 / norm(n));
}

} // namespace

template <int dim>
bool WallPiece<dim>::covers(const Vec<dim>& x) const
{
  if (plane)
    return true;
  const Vec<dim> t = b - a;
  const double length = norm(t), s = dot(x - a, t) / length;
  return s >= -reach_a && s <= length + reach_b;
}

template <int dim>
Walls<dim>::Walls(const std::vector<WallGeometry>& geometry, double spacing, double t)
    : geometry_(geometry), spacing_(spacing)
{
  for (std::size_t w = 0; w < geometry.size(); ++w)
  {
    const WallGeometry& g = geometry[w];
    if (g.plane)
    {
      WallPiece<dim> piece;
      piece.a = piece.b = leading<dim>(g.points.front());
      piece.n = leading<dim>(g.normal) * (1.0 / norm(leading<dim>(g.normal)));
      piece.wall = static_cast<int>(w);
      piece.plane = true;
      reference_.push_back(piece);
      continue;
    }
    if constexpr (dim == 2)
    {
      const std::size_t n = g.points.size();
      if (n < 2)
        throw InputError("wall '" + g.name + "': a polyline needs at least two points");
      const std::size_t segments = g.closed ? n : n - 1, first = reference_.size();
      for (std::size_t k = 0; k < segments; ++k)
      {
        WallPiece<2> piece;
        piece.a = leading<2>(g.points[k]);
        piece.b = leading<2>(g.points[(k + 1) % n]);
        if (!(norm(piece.b - piece.a) > 0.0))
          throw InputError("wall '" + g.name + "': two successive points coincide");
        piece.n = left_normal(piece.a, piece.b);
        piece.wall = static_cast<int>(w);
        reference_.push_back(piece);
      }
      // Past a concave corner (fluid inside the angle) a piece reaches on, so that nothing slips between two
      // pieces.
      for (std::size_t k = 0; k < segments; ++k)
      {
        if (k + 1 == segments && !g.closed)
          break;
        WallPiece<2>&p = reference_[first + k], &q = reference_[first + (k + 1) % segments];
        if (dot(q.b - q.a, p.n) > 0.0)
          p.reach_b = q.reach_a = 4.0 * spacing;
      }
    }
    else
      throw InputError("wall '" + g.name + "': in 3-D a wall is a plane (point, normal)");
  }
  impulse_.assign(geometry.size(), {});
  pieces_ = before_ = reference_;
  move_to(t);
  before_ = pieces_;
}

template <int dim>
void Walls<dim>::move_to(double t)
{
  before_ = pieces_;
  for (std::size_t k = 0; k < reference_.size(); ++k)
  {
    const WallMotion& motion = geometry_[static_cast<std::size_t>(reference_[k].wall)].motion;
    if (!motion.moves())
      continue;
    const double angle = motion.angle ? (*motion.angle)(0.0, 0.0, 0.0, t) : 0.0, c = std::cos(angle),
                 s = std::sin(angle);
    const auto turn = [&](Vec<dim> v)
    {
      const double x = v[0], y = v[1];
      v[0] = c * x - s * y;
      v[1] = s * x + c * y;
      return v;
    };
    Vec<dim> shift{};
    for (std::size_t i = 0; i < motion.displacement.size(); ++i)
      shift[static_cast<int>(i)] = motion.displacement[i](0.0, 0.0, 0.0, t);
    const Vec<dim> centre = leading<dim>(motion.centre);
    pieces_[k].a = centre + turn(reference_[k].a - centre) + shift;
    pieces_[k].b = centre + turn(reference_[k].b - centre) + shift;
    pieces_[k].n = turn(reference_[k].n);
  }
}

template <int dim>
void Walls<dim>::find_candidates(std::span<const Vec<dim>> x, double margin)
{
  candidates_.clear();
  margin_ = margin;
  moved_ = 0.0;
  const double reach = 2.0 * margin + 0.1 * spacing_; // the node and the wall may both move by `margin`
  for (std::size_t n = 0; n < x.size(); ++n)
    for (std::size_t k = 0; k < pieces_.size(); ++k)
    {
      const auto& piece = pieces_[k];
      const double d = piece.distance(x[n]);
      if (d > reach || d < -2.0 * spacing_)
        continue;
      if (!piece.plane)
      {
        const Vec<dim> t = piece.b - piece.a;
        const double length = norm(t), s = dot(x[n] - piece.a, t) / length;
        if (s < -piece.reach_a - reach || s > length + piece.reach_b + reach)
          continue;
      }
      candidates_.push_back({static_cast<index_t>(n), static_cast<int>(k)});
    }
}

template <int dim>
double Walls<dim>::contact(double dt, std::span<const Vec<dim>> x, std::span<Vec<dim>> v,
                           std::span<const double> m, std::span<Vec<dim>> a, double dt_before)
{
  const double dt_mean = 0.5 * (dt + dt_before); // from one half step to the next
  double work = 0.0;
  // Candidates of one node are adjacent; three rounds settle a node between two or three pieces.
  for (std::size_t begin = 0; begin < candidates_.size();)
  {
    std::size_t end = begin;
    const auto n = static_cast<std::size_t>(candidates_[begin].node);
    while (end < candidates_.size() && candidates_[end].node == candidates_[begin].node)
      ++end;
    for (int round = 0; round < 3; ++round)
    {
      bool corrected = false;
      for (std::size_t c = begin; c < end; ++c)
      {
        const auto k = static_cast<std::size_t>(candidates_[c].piece);
        const Vec<dim> x_end = x[n] + dt * v[n];
        const double d = pieces_[k].distance(x_end);
        if (d >= 0.0 || !pieces_[k].covers(x_end) || before_[k].distance(x[n]) < -0.5 * spacing_)
          continue; // before it, beside it, or a node on the other side of a thin wall
        const Vec<dim> dv = (-d / dt) * pieces_[k].n;
        // Mean of the velocities before and after the step: v_prev = v − ½(Δt + Δt_before) a whatever was
        // corrected before. A node pressed against a wall at rest then gets no work, although the pressure
        // has just kicked it.
        work += 0.5 * m[n] * dot(dv, v[n] - dt_mean * a[n] + v[n] + dv);
        impulse_[static_cast<std::size_t>(pieces_[k].wall)] -= m[n] * dv;
        v[n] += dv;
        a[n] += (1.0 / dt_mean) * dv;
        corrected = true;
      }
      if (!corrected || end - begin == 1)
        break;
    }
    begin = end;
  }
  return work;
}

template <int dim>
std::array<int, 3> Walls<dim>::pieces_at(const Vec<dim>& x, double tolerance) const
{
  std::array<int, 3> found{-1, -1, -1};
  std::size_t count = 0;
  for (std::size_t k = 0; k < pieces_.size() && count < found.size(); ++k)
  {
    if (std::abs(pieces_[k].distance(x)) > tolerance)
      continue;
    if (!pieces_[k].plane)
    {
      const Vec<dim> t = pieces_[k].b - pieces_[k].a;
      const double length = norm(t), s = dot(x - pieces_[k].a, t) / length;
      if (s < -tolerance || s > length + tolerance)
        continue;
    }
    found[count++] = static_cast<int>(k);
  }
  return found;
}

template <int dim>
void Walls<dim>::reset_impulse()
{
  impulse_.assign(geometry_.size(), {});
}

template struct WallPiece<2>;
template struct WallPiece<3>;
template class Walls<2>;
template class Walls<3>;

} // namespace undine::fluid
