// Spacing from zones.
#include "fluid_pfem/size_field.hpp"

#include "common/config/case_file.hpp"
#include "common/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace undine::fluid
{

namespace
{

template <int dim>
double distance_to_box(const Vec<dim>& x, const SizeZone& zone)
{
  Vec<dim> out;
  for (int i = 0; i < dim; ++i)
  {
    const auto k = static_cast<std::size_t>(i);
    out[i] = std::max({zone.lower[k] - x[i], x[i] - zone.upper[k], 0.0});
  }
  return norm(out);
}

} // namespace

template <int dim>
SizeField<dim>::SizeField(double h0, double coarsest, std::vector<SizeZone> zones,
                          const std::vector<PlaneSurface<dim>>& faces, const Walls<dim>& walls)
    : h0_(h0), coarsest_(zones.empty() ? h0 : coarsest * h0), smallest_(coarsest_), faces_(faces)
{
  for (std::size_t k = 0; k < zones.size(); ++k)
  {
    Zone zone{.config = std::move(zones[k])};
    smallest_ = std::min(smallest_, zone.config.factor * h0);
    if (!zone.config.near.empty())
    {
      std::vector<std::string> known;
      for (std::size_t w = 0; w < walls.geometry().size(); ++w)
      {
        known.push_back(walls.geometry()[w].name);
        if (known.back() == zone.config.near)
          zone.wall = static_cast<int>(w);
      }
      for (std::size_t f = 0; f < faces.size(); ++f)
      {
        known.push_back(faces[f].name);
        if (known.back() == zone.config.near && zone.wall < 0)
          zone.face = static_cast<int>(f);
      }
      if (zone.wall < 0 && zone.face < 0)
        throw InputError(fmt::format("fluid.spacing[{}].near = '{}': neither a wall nor a face of the fluid. "
                                     "Known: {}",
                                     k, zone.config.near, fmt::join(known, " ")));
    }
    zones_.push_back(std::move(zone));
  }
}

template <int dim>
double SizeField<dim>::operator()(const Vec<dim>& x, const Walls<dim>& walls) const
{
  double h = coarsest_;
  for (const Zone& zone : zones_)
  {
    double distance = std::numeric_limits<double>::max();
    if (zone.face >= 0)
    {
      const auto& face = faces_[static_cast<std::size_t>(zone.face)];
      distance = std::abs(dot(x - face.point, face.normal));
    }
    else if (zone.wall >= 0)
    {
      for (const auto& piece : walls.pieces())
        if (piece.wall == zone.wall)
          distance = std::min(distance, piece.gap(x));
    }
    else
      distance = distance_to_box(x, zone.config);
    h = std::min(h, zone.config.factor * h0_ + zone.config.growth * distance);
  }
  return h;
}

template class SizeField<2>;
template class SizeField<3>;

} // namespace undine::fluid
