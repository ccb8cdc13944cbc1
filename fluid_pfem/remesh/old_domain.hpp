// Was this point inside the fluid before the remesh?
#pragma once

#include "fluid_pfem/fluid_mesh.hpp"

#include "common/tensor.hpp"

#include <span>
#include <vector>

namespace undine::fluid
{

/// The advected mesh of the last remesh as a point set: a bin grid over its positively oriented elements.
template <int dim>
class OldDomain
{
public:
  OldDomain() = default;
  /// @param bin size of a bin, about the spacing of nodes [m]
  OldDomain(std::span<const Vec<dim>> x, std::span<const Simplex<dim>> elements, double bin);

  bool empty() const { return elements_.empty(); }
  bool contains(const Vec<dim>& p) const;
  double volume() const { return volume_; } ///< signed sum [m^dim]

private:
  std::size_t bin_of(const std::array<long, dim>& cell) const;

  std::vector<std::array<Vec<dim>, dim + 1>> elements_;
  std::vector<index_t> begin_, in_bin_;
  Vec<dim> origin_{};
  double bin_ = 1.0, volume_ = 0.0;
  std::array<long, dim> cells_{};
};

} // namespace undine::fluid
