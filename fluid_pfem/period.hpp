// Space that repeats itself: periodic boundaries without ghosts.
//
// A periodic direction has no boundary: elements join nodes at one end of the cell with those at the other.
// A node has one position; whatever is computed of several takes, of each, the image next to the first. The
// cell is at least `least_cells` spacings long, so that this image is the right one for all that can be
// fluid.
#pragma once

#include "common/lanes.hpp"
#include "common/tensor.hpp"

#include <cmath>
#include <cstddef>
#include <vector>

namespace undine::fluid
{

template <int dim>
class Period
{
public:
  static constexpr double least_cells =
      12.0; ///< twice the diameter of the largest circle of an inner element

  Period() = default;
  /// @param length of the cell along each axis; 0: space does not repeat itself there [m]
  Period(const Vec<dim>& origin, const Vec<dim>& length) : origin_(origin), length_(length)
  {
    for (int i = 0; i < dim; ++i)
      any_ = any_ || length[i] > 0.0;
  }

  bool any() const { return any_; }
  const Vec<dim>& origin() const { return origin_; }
  const Vec<dim>& length() const { return length_; }

  /// The image of q next to p.
  template <class Real>
  Vec<dim, Real> near(const Vec<dim, Real>& p, Vec<dim, Real> q) const
  {
    for (int i = 0; i < dim && any_; ++i)
      if (length_[i] > 0.0)
        q[i] = image(p[i], q[i], Real(length_[i]));
    return q;
  }
  /// Of a coordinate q along an axis along which the cell has this length, the image next to p.
  template <class Real>
  static Real image(const Real& p, const Real& q, const Real& length)
  {
    const Real d = q - p, half = Real(0.5) * length;
    return q + (select(d < Real(0.0) - half, length, Real(0.0)) - select(d > half, length, Real(0.0)));
  }
  /// The images of all points next to the first.
  template <class Points>
  void join(Points& x) const
  {
    for (std::size_t a = 1; a < x.size() && any_; ++a)
      x[a] = near(x[0], x[a]);
  }
  /// The image in the cell.
  Vec<dim> wrapped(Vec<dim> x) const
  {
    for (int i = 0; i < dim && any_; ++i)
      if (length_[i] > 0.0)
        x[i] -= length_[i] * std::floor((x[i] - origin_[i]) / length_[i]);
    return x;
  }
  /// From a point to itself and its images in the neighbouring cells; the first is zero.
  std::vector<Vec<dim>> shifts() const
  {
    std::vector<Vec<dim>> all{Vec<dim>{}};
    for (int i = 0; i < dim; ++i)
      for (std::size_t k = 0, n = all.size(); k < n && length_[i] > 0.0; ++k)
        for (const double step : {-length_[i], length_[i]})
        {
          all.push_back(all[k]);
          all.back()[i] += step;
        }
    return all;
  }

private:
  Vec<dim> origin_{}, length_{};
  bool any_ = false;
};

} // namespace undine::fluid
