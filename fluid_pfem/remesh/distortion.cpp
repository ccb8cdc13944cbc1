// Shape and deformation of elements, eight side by side.
#include "fluid_pfem/remesh/distortion.hpp"

#include "fluid_pfem/eight.hpp"
#include "fluid_pfem/simplex.hpp"

#include <algorithm>
#include <cmath>

namespace undine::fluid
{

template <int dim>
[[gnu::flatten]] bool is_worse(const FluidMesh<dim>& mesh, index_t begin, index_t end,
                               std::span<const Vec<dim>> x, std::span<const float> before, double limit,
                               const Period<dim>& period)
{
  constexpr int L = Lanes::size;
  for (index_t first = begin; first < end; first += L)
  {
    const EightElements<dim> element(mesh.elements, nullptr, first, end);
    std::array<Vec<dim, Lanes>, dim + 1> corner;
    for (std::size_t c = 0; c <= dim; ++c)
      load_points<dim>(x.data(), element, c, corner[c]);
    period.join(corner);
    double q[L];
    const float* const q_before = before.data() + first;
    if (first + L <= end)
      std::copy_n(q_before, L, q);
    else
      for (index_t l = 0; l < L; ++l)
        q[l] = q_before[std::min(l, end - 1 - first)];
    Lanes least = least_quality(limit, load_lanes(q, L));
    if constexpr (dim == 3)
      least *= least * least;
    if (any(~(least <= quality_power<dim, Lanes>(corner))))
      return true;
  }
  return false;
}

template <int dim>
[[gnu::flatten]] bool is_strained(std::span<const Simplex<dim>> simplices, std::span<const Vec<dim>> x,
                                  std::span<const Vec<dim>> x_before, std::span<const double> h, double limit,
                                  const Period<dim>& period)
{
  const auto n = static_cast<index_t>(simplices.size());
  for (index_t first = 0; first < n; first += Lanes::size)
  {
    const EightElements<dim> element(simplices, nullptr, first, n);
    std::array<Vec<dim, Lanes>, dim + 1> now, then;
    for (std::size_t c = 0; c <= dim; ++c)
    {
      load_points<dim>(x.data(), element, c, now[c]);
      load_points<dim>(x_before.data(), element, c, then[c]);
    }
    period.join(now);
    period.join(then);
    Lanes most;
    for (std::size_t l = 0; l < Lanes::size; ++l)
      most.set(static_cast<int>(l), limit * h[static_cast<std::size_t>(element[l][0])]);
    for (std::size_t a = 0; a <= dim; ++a)
      for (std::size_t b = a + 1; b <= dim; ++b)
        if (any(abs(sqrt(norm_squared(now[a] - now[b])) - sqrt(norm_squared(then[a] - then[b]))) > most))
          return true;
  }
  return false;
}

template bool is_worse<2>(const FluidMesh<2>&, index_t, index_t, std::span<const Vec<2>>,
                          std::span<const float>, double, const Period<2>&);
template bool is_worse<3>(const FluidMesh<3>&, index_t, index_t, std::span<const Vec<3>>,
                          std::span<const float>, double, const Period<3>&);
template bool is_strained<2>(std::span<const Simplex<2>>, std::span<const Vec<2>>, std::span<const Vec<2>>,
                             std::span<const double>, double, const Period<2>&);
template bool is_strained<3>(std::span<const Simplex<3>>, std::span<const Vec<3>>, std::span<const Vec<3>>,
                             std::span<const double>, double, const Period<3>&);

} // namespace undine::fluid
