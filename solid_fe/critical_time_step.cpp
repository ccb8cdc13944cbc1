// Element frequency bounds at the current deformation.
#include "solid_fe/critical_time_step.hpp"

#include "solid_fe/kernels/law_kernels.hpp"

#include <algorithm>
#include <cmath>

namespace undine::solid
{

double stable_step(double omega2, double damping)
{
  const double half = 0.5 * damping;
  return 2.0 / (std::sqrt(omega2 + half * half) + half);
}

template <int dim>
double highest_frequency_squared(const Body<dim>& body, std::span<const Vec<dim>> u)
{
  return std::visit([&](const auto& law) { return highest_frequency_squared_of(body, law, u); },
                    body.material);
}

template double highest_frequency_squared(const Body<2>&, std::span<const Vec<2>>);
template double highest_frequency_squared(const Body<3>&, std::span<const Vec<3>>);

} // namespace undine::solid
