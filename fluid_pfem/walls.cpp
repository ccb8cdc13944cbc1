// Contact with rigid walls.
#include "fluid_pfem/walls.hpp"

#include "common/parallel/in_parts.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace undine::fluid
{

template <int dim>
Walls<dim>::Walls(const std::vector<WallGeometry>& geometry, double spacing, double t)
    : geometry_(geometry), reference_(pieces_of<dim>(geometry, spacing)), spacing_(spacing)
{
  has_convex_ = join(reference_, geometry, spacing);
  reaction_.impulse.assign(geometry.size(), {});
  path_.assign(2, {.pieces = reference_});
  move_to(t);
  path_.assign(2, {.pieces = pieces()});
}

template <int dim>
void Walls<dim>::move_to(std::span<const double> times)
{
  if (!moves())
    return;
  std::swap(path_.front(), path_.back());
  path_.resize(times.size() + 1);
  for (std::size_t k = 0; k < times.size(); ++k)
    move(times[k], path_[k], path_[k + 1]);
}

template <int dim>
void Walls<dim>::move(double t, const Placement& from, Placement& to) const
{
  to = from;
  double fastest = 0.0; // corner, over this move [m]
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
    for (std::size_t c = 0; c < dim; ++c)
    {
      to.pieces[k].corner[c] = centre + turn(reference_[k].corner[c] - centre) + shift;
      fastest = std::max(fastest, norm(to.pieces[k].corner[c] - from.pieces[k].corner[c]));
    }
    to.pieces[k].n = turn(reference_[k].n);
    if (!reference_[k].plane)
      to.pieces[k].find_ends();
  }
  to.moved += fastest;
}

template <int dim>
void Walls<dim>::find_candidates(std::span<const Vec<dim>> x, index_t begin, index_t end, double margin,
                                 int threads)
{
  margin_ = margin;
  blocks_.clear();
  add_blocks(x, begin, end, threads);
  own_blocks_ = {0, static_cast<index_t>(blocks_.size())};
}

template <int dim>
void Walls<dim>::add_blocks(std::span<const Vec<dim>> x, index_t begin, index_t end, int threads)
{
  const std::size_t before = blocks_.size();
  const auto nodes = static_cast<std::size_t>(std::max(begin, end) - begin);
  while (begin < end)
  {
    blocks_.emplace_back().begin = begin;
    blocks_.back().end = begin = std::min(begin + block_size, end);
  }
  in_parts(threads, nodes, block_size,
           [&](int, std::size_t first, std::size_t last)
           {
             for (std::size_t n = first; n < last; n += block_size)
               find_candidates(blocks_[before + n / block_size], path_.back(), x);
           });
}

template <int dim>
void Walls<dim>::surround(std::span<const Vec<dim>> x, index_t begin, index_t end)
{
  std::vector<Block> own(std::make_move_iterator(blocks_.begin() + own_blocks_[0]),
                         std::make_move_iterator(blocks_.begin() + own_blocks_[1]));
  blocks_.clear();
  const index_t own_begin = own.empty() ? begin : own.front().begin,
                own_end = own.empty() ? end : own.back().end;
  add_blocks(x, begin, own_begin);
  own_blocks_ = {static_cast<index_t>(blocks_.size()), static_cast<index_t>(blocks_.size() + own.size())};
  std::move(own.begin(), own.end(), std::back_inserter(blocks_));
  add_blocks(x, own_end, end);
}

template <int dim>
index_t Walls<dim>::block_of(index_t n) const
{
  return static_cast<index_t>(std::partition_point(blocks_.begin(), blocks_.end(),
                                                   [n](const Block& block) { return block.end <= n; }) -
                              blocks_.begin());
}

template <int dim>
void Walls<dim>::find_candidates(Block& block, const Placement& walls, std::span<const Vec<dim>> x) const
{
  block.candidates.clear();
  block.moved = 0.0;
  block.walls_moved = walls.moved;
  const double reach = 2.0 * margin_ + 0.1 * spacing_; // the node and the wall may both move by the margin
  for (auto n = static_cast<std::size_t>(block.begin); n < static_cast<std::size_t>(block.end); ++n)
    for (std::size_t k = 0; k < walls.pieces.size(); ++k)
    {
      const auto& piece = walls.pieces[k];
      const double d = piece.distance(x[n]);
      if (d > reach || d < -2.0 * spacing_)
        continue;
      if (piece.overhang(x[n], true) > reach)
        continue;
      block.candidates.push_back({static_cast<index_t>(n), static_cast<int>(k)});
    }
}

namespace
{

/// Mean velocity over a move of the point of a piece's wall that was at x.
template <int dim>
Vec<dim> velocity_of(const WallPiece<dim>& from, const WallPiece<dim>& to, const Vec<dim>& x, double dt)
{
  Vec<dim> y = to.corner[0] + from.distance(x) * to.n;
  if (from.plane)
    return (1.0 / dt) * (y - from.corner[0] - from.distance(x) * from.n);
  if constexpr (dim == 2)
    y += (dot(x - from.corner[0], from.corner[1] - from.corner[0]) /
          norm_squared(from.corner[1] - from.corner[0])) *
         (to.corner[1] - to.corner[0]);
  else
  {
    const Vec<3> s = from.corner[1] - from.corner[0], t = cross(from.n, s);
    const double length = norm_squared(s);
    const Vec<3> s_now = to.corner[1] - to.corner[0];
    y += (dot(x - from.corner[0], s) / length) * s_now +
         (dot(x - from.corner[0], t) / length) * cross(to.n, s_now);
  }
  return (1.0 / dt) * (y - x);
}

} // namespace

template <int dim>
auto Walls<dim>::least_crossed(std::span<const Candidate> candidates, const Placement& was,
                               const Placement& now, const Vec<dim>& x, const Vec<dim>& x_end) const
    -> Crossing
{
  Crossing least;
  for (const Candidate& candidate : candidates)
  {
    const auto piece = static_cast<std::size_t>(candidate.piece);
    const double d = now.pieces[piece].distance(x_end);
    if (d >= 0.0)
      continue;
    const double d_begin = was.pieces[piece].distance(x), allowed = std::min(0.0, d_begin);
    if (d < allowed - 1e-13 * spacing_ && d > least.distance &&
        now.pieces[piece].overhang(x_end, true) <= 0.0 &&
        d_begin >= -0.25 * spacing_) // or before it, beside it, or a node on the other side of a thin wall
      least = {piece, d, allowed};
  }
  return least;
}

template <int dim>
void Walls<dim>::contact(index_t block, std::size_t move, double dt, std::span<const Vec<dim>> x,
                         std::span<Vec<dim>> v, std::span<const double> m, std::span<Vec<dim>> a,
                         double dt_before, const std::function<void(Vec<dim>&, index_t)>& constrain,
                         Reaction& reaction) const
{
  const std::vector<Candidate>& candidates = blocks_[static_cast<std::size_t>(block)].candidates;
  const auto admissible = [&](Vec<dim> w, std::size_t n)
  {
    if (constrain)
      constrain(w, static_cast<index_t>(n));
    return w;
  };
  const Placement &was = before(move), &now = after(move);
  const double dt_mean = 0.5 * (dt + dt_before); // from one half step to the next
  // In each round the piece that is crossed least is corrected: on one side of a convex corner this is the
  // wall the node is on, and it is then beside the other one; in a concave corner a few rounds settle it
  // between two or three.
  for (std::size_t begin = 0; begin < candidates.size();)
  {
    std::size_t end = begin;
    const auto n = static_cast<std::size_t>(candidates[begin].node);
    const Vec<dim> v_free = v[n];
    bool corrected = false;
    while (end < candidates.size() && candidates[end].node == candidates[begin].node)
      ++end;
    const auto of_node = std::span(candidates).subspan(begin, end - begin);
    for (int round = 0; round < 12; ++round)
    {
      const Crossing crossing = least_crossed(of_node, was, now, x[n], x[n] + dt * v[n]);
      if (crossing.distance == Crossing::none)
        break;
      const WallPiece<dim>& wall = now.pieces[crossing.piece];
      // A node that is behind already (merged or split around a corner) gets no deeper; settle() takes it
      // out. A velocity that takes it out would be energy from nowhere. A node that may only move in another
      // surface yields along what that leaves of the normal, and the wall feels all of the force.
      const Vec<dim> way = admissible(wall.n, n);
      const double share = dot(wall.n, way);
      if (share < 1e-9)
        break;
      const double closing = (crossing.allowed - crossing.distance) / (dt * share);
      Vec<dim> dv = closing * way, push = closing * wall.n;
      if (geometry_[static_cast<std::size_t>(wall.wall)].no_slip)
      {
        const Vec<dim> v_wall = velocity_of(was.pieces[crossing.piece], wall, x[n], dt);
        push = dv = admissible(
            v_wall + ((crossing.allowed - wall.distance(x[n] + dt * v_wall)) / dt) * wall.n - v[n], n);
      }
      // Mean of the velocities before and after the step: v_prev = v − ½(Δt + Δt_before) a whatever was
      // corrected before. A node pressed against a wall at rest then gets no work, although the pressure
      // has just kicked it.
      reaction.work.add(0.5 * m[n] * dot(dv, v[n] - dt_mean * a[n] + v[n] + dv));
      for (std::size_t i = 0; i < dim; ++i)
        if (push.c[i] != 0.0)
          reaction.impulse[static_cast<std::size_t>(wall.wall)][i].add(-m[n] * push.c[i]);
      v[n] += dv;
      a[n] += (1.0 / dt_mean) * dv;
      corrected = true;
      if (end - begin == 1)
        break;
      if (round == 11) // a corner too acute for rounds: it stays where it is on the wall
        v[n] = admissible(velocity_of(was.pieces[crossing.piece], wall, x[n], dt), n);
    }
    if (corrected)
      reaction.corrections.push_back({static_cast<index_t>(n), v[n] - v_free});
    begin = end;
  }
}

template <int dim>
auto Walls<dim>::Reaction::operator+=(const Reaction& other) -> Reaction&
{
  work += other.work;
  for (std::size_t wall = 0; wall < impulse.size(); ++wall)
    for (std::size_t i = 0; i < dim; ++i)
      impulse[wall][i] += other.impulse[wall][i];
  return *this;
}

template <int dim>
std::vector<Vec<dim>> Walls<dim>::impulse(const Ranks& ranks) const
{
  auto of_all = reaction_.impulse;
  std::vector<ExactSum*> sums;
  for (auto& wall : of_all)
    for (ExactSum& component : wall)
      sums.push_back(&component);
  ranks.sum(sums);
  std::vector<Vec<dim>> values(of_all.size());
  for (std::size_t w = 0; w < values.size(); ++w)
    for (std::size_t i = 0; i < dim; ++i)
      values[w].c[i] = of_all[w][i].value();
  return values;
}

template <int dim>
std::vector<ExactSum*> Walls<dim>::sums()
{
  std::vector<ExactSum*> all{&reaction_.work};
  for (auto& wall : reaction_.impulse)
    for (ExactSum& component : wall)
      all.push_back(&component);
  return all;
}

template class Walls<2>;
template class Walls<3>;

} // namespace undine::fluid
