// The circumradius filter.
#include "fluid_pfem/remesh/alpha_shape.hpp"

#include "fluid_pfem/simplex.hpp"

#include <algorithm>

namespace undine::fluid
{

template <int dim>
std::vector<Simplex<dim>> alpha_shape(std::span<const Vec<dim>> x, std::span<const double> h, double alpha,
                                      const std::vector<Simplex<dim>>& delaunay)
{
  std::vector<Simplex<dim>> kept;
  kept.reserve(delaunay.size());
  for (const auto& simplex : delaunay)
  {
    auto sorted = simplex;
    std::sort(sorted.begin(), sorted.end());
    std::array<Vec<dim>, dim + 1> corner;
    double h_min = h[static_cast<std::size_t>(sorted[0])];
    for (std::size_t a = 0; a < sorted.size(); ++a)
    {
      corner[a] = x[static_cast<std::size_t>(sorted[a])];
      h_min = std::min(h_min, h[static_cast<std::size_t>(sorted[a])]);
    }
    if (circumradius<dim>(corner) <= alpha * h_min) // false for the NaN and infinity of a flat simplex
      kept.push_back(simplex);
  }
  return kept;
}

template std::vector<Simplex<2>> alpha_shape<2>(std::span<const Vec<2>>, std::span<const double>, double,
                                                const std::vector<Simplex<2>>&);
template std::vector<Simplex<3>> alpha_shape<3>(std::span<const Vec<3>>, std::span<const double>, double,
                                                const std::vector<Simplex<3>>&);

} // namespace undine::fluid
