// The part that a face of the multiplier side shares with a face of the other, and quadrature points in it.
#pragma once

#include "coupler/mortar.hpp"

#include <array>
#include <vector>

namespace undine::coupler
{

/// A quadrature point common to a multiplier face and an other face.
struct CommonPoint
{
  double weight = 0.0;                  ///< includes the measure of the multiplier face
  std::array<double, 4> N_multiplier{}; ///< shape functions of the multiplier face
  std::array<double, 4> N_other{};
  double gap = 0.0; ///< [m]
};

/// Corners of a face, or of a part of it, in the plane of a multiplier face. A convex one clipped by a
/// quadrilateral has 8 at most; one that is not, 19: each of the four edges adds half as many at most.
class Polygon
{
public:
  static constexpr std::size_t most = 19;
  void push_back(const Vec<2>& corner) { corner_[size_++] = corner; }
  void reverse();
  std::size_t size() const { return size_; }
  const Vec<2>& operator[](std::size_t k) const { return corner_[k]; }

private:
  std::array<Vec<2>, most> corner_;
  std::size_t size_ = 0;
};

/// A face of the multiplier side, that other faces are cut by.
template <int dim>
class MultiplierFace;

/// In the plane: points of an other face are brought to it along its interpolated nodal normals.
template <>
class MultiplierFace<2>
{
public:
  MultiplierFace(const InterfaceFaces<2>& side, const std::vector<Vec<2>>& nodal_normals,
                 const std::vector<int>& face);
  /// Gauss points (3, exact to degree 5) of the segment shared with face o of the other side, appended.
  void append_common_points(const InterfaceFaces<2>& other, const std::vector<int>& o,
                            std::vector<CommonPoint>& points) const;

private:
  Vec<2> a_, b_, n_a_, n_b_; ///< ends and normals there
};

/// In space: polygons are clipped in its plane.
template <>
class MultiplierFace<3>
{
public:
  MultiplierFace(const InterfaceFaces<3>& side, const std::vector<Vec<3>>& nodal_normals,
                 const std::vector<int>& face);
  /// Six points (exact to degree 4: products of two bilinear functions) in each triangle of a fan over the
  /// polygon shared with face o of the other side, appended.
  void append_common_points(const InterfaceFaces<3>& other, const std::vector<int>& o,
                            std::vector<CommonPoint>& points) const;

private:
  Polygon in_plane(const InterfaceFaces<3>& side, const std::vector<int>& face) const;

  const InterfaceFaces<3>& side_;
  const std::vector<int>& face_;
  Vec<3> origin_, e_1_, e_2_;
  Polygon polygon_;
  double area_; ///< of the polygon [m²]
};

} // namespace undine::coupler
