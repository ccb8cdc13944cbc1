// A faceted surface that moves, and the nearest point on it: contact needs the gap, its normal and the nodes
// that carry the point.
#pragma once

#include "common/tensor.hpp"
#include "common/types.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace undine
{

/// Segments in the plane, triangles in space (quadrilaterals are cut in two), outward orientation of the body
/// they bound.
template <int dim>
class FacetSurface
{
public:
  using Facet = std::array<index_t, dim>;

  /// Where a point meets the surface.
  struct Near
  {
    index_t facet = -1;               ///< −1: nothing within reach
    std::array<double, dim> weight{}; ///< of the facet's nodes at the nearest point; they sum to 1
    Vec<dim> normal{};                ///< unit, out of the body
    double gap = 0.0;                 ///< signed distance, negative inside the body [m]
    bool beside =
        false; ///< the nearest point lies on the rim of an open surface and the point a quarter facet beyond
  };

  FacetSurface() = default;
  /// @param x positions of the nodes [m]
  /// @param face_offset,face_nodes faces as in link::SurfaceMesh: CSR, segments in 2-D, triangles or
  /// quadrilaterals in 3-D
  FacetSurface(std::vector<Vec<dim>> x, std::span<const std::int32_t> face_offset,
               std::span<const std::int32_t> face_nodes);

  bool empty() const { return facets_.empty(); }
  const std::vector<Vec<dim>>& x() const { return x_; }
  std::vector<Vec<dim>>& x() { return x_; }
  const std::vector<Facet>& facets() const { return facets_; }
  /// Patches of facets that meet at less than `angle` [rad]: the smooth sides of the body.
  std::vector<int> patches(double angle) const;
  /// Pairs of facets of different patches that meet where the body is convex, in the order in which they
  /// follow each other; in space none.
  std::vector<std::array<index_t, 2>> convex_corners(std::span<const int> patch) const;
  Vec<dim> normal_of(index_t facet) const; ///< unit, out of the body
  double facet_size() const;               ///< mean length, or square root of twice the mean area [m]

  /// Facets within `reach` of `p` [m], appended to `found`.
  void within(const Vec<dim>& p, double reach, std::vector<index_t>& found) const;
  /// Nearest point among `candidates`. Of facets that are equally near, the one that the point is most
  /// squarely before decides about inside and outside.
  Near nearest(const Vec<dim>& p, std::span<const index_t> candidates) const;
  /// Nearest point within `reach` [m].
  Near nearest(const Vec<dim>& p, double reach) const;

  /// Sort the facets into bins again, after the nodes have moved; within() needs it.
  void sort_bins();

  template <class Archive>
  void for_each_state(Archive& archive)
  {
    archive("x", x_);
    archive("facets", facets_);
    archive("rim", rim_);
    archive("bin_size", bin_size_);
    std::vector<Bin> bin;
    std::vector<index_t> in_bin;
    for (const auto& [place, facet] : bins_)
    {
      bin.push_back(place);
      in_bin.push_back(facet);
    }
    archive("bin", bin);
    archive("in_bin", in_bin);
    bins_.clear();
    for (std::size_t k = 0; k < bin.size(); ++k)
      bins_.emplace_back(bin[k], in_bin[k]);
  }

private:
  struct Projection
  {
    std::array<double, dim> weight;
    Vec<dim> normal;
    double distance; ///< to the nearest point of the facet
    double height;   ///< signed, over the facet's plane
    bool on_rim;     ///< the nearest point is on the surface's rim
    bool interior;   ///< it is inside the facet
  };
  Projection project(const Vec<dim>& p, index_t facet) const;
  /// And how far away it is [m]; infinite without candidates.
  std::pair<Near, double> nearest_of(const Vec<dim>& p, std::span<const index_t> candidates) const;
  using Bin = std::array<long, dim>;
  Bin bin_of(const Vec<dim>& p) const;
  /// act(bin) for all bins of the box of which first and last are opposite corners.
  template <class Act>
  static void each_bin(const Bin& first, const Bin& last, Act&& act);

  std::vector<Vec<dim>> x_;
  std::vector<Facet> facets_;
  std::vector<std::array<bool, dim>>
      rim_; ///< per facet: node a (2-D), edge opposite of node a (3-D) is on the rim
  double bin_size_ = 0.0;
  std::vector<std::pair<Bin, index_t>> bins_; ///< sorted
};

} // namespace undine
