// The beam as a part of the explicit solid: its end fibres are the nodes that others see.
#include "solid_fe/solid.hpp"

#include "common/error.hpp"
#include "solid_fe/strip.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace undine::solid
{

template <int dim>
void Solid<dim>::make_beam(const SolidConfig& config)
{
  if constexpr (dim == 3)
    throw InputError("solid.formulation = \"beam\": must be in 2-D; use one-point hexahedra in 3-D");
  else
  {
    if (config.plane == PlaneKind::axisymmetric)
      throw InputError("solid.formulation = \"beam\": the plane may be \"strain\" or \"stress\"");
    if (config.material.law != Linear::name && config.material.law != StVenantKirchhoff::name)
      throw InputError(
          "solid.law = \"" + config.material.law +
          "\": a beam is linear in the strains of its middle line; must be \"linear\" or \"svk\"");
    if (config.material.stiffness_damping > 0.0 || !config.rigid.empty())
      throw InputError(
          "solid.formulation = \"beam\": solid.stiffness_damping and solid.rigid do not go with it; "
          "remove them");
    auto strip = make_strip(reference_.mesh);
    strip.beam.material = config.material;
    strip.beam.plane_stress = config.plane == PlaneKind::stress;
    strip.beam.fixed = fibre_supports(reference_.mesh, strip, config);
    fibre_ = strip.ends;
    place_.resize(reference_.mesh.x.size());
    for (std::size_t k = 0; k < fibre_.size(); ++k)
      for (const auto face : both_faces)
        place_[static_cast<std::size_t>(fibre_[k][static_cast<std::size_t>(face)])] = {k, face};
    face_force_.resize(fibre_.size());
    beam_.emplace(strip.beam);
    for (std::size_t c = 0; c < config.velocity.size(); ++c)
    {
      const auto& entry = config.velocity[c];
      const std::string key = "solid.velocity[" + std::to_string(c) + "]";
      if (entry.is_acceleration)
        throw InputError("solid.acceleration: a beam takes prescribed velocities only; give the velocity");
      const auto v = to_vec<2>(entry.value, key + ".value");
      std::vector<bool> taken(fibre_.size(), false);
      for (const index_t n : find_nodes(reference_.mesh, entry.on, key + ".on"))
        if (const auto k = place_[static_cast<std::size_t>(n)].first; !taken[k])
        {
          taken[k] = true;
          for (int i = 0; i < 2; ++i)
            if (entry.components.empty() || std::find(entry.components.begin(), entry.components.end(),
                                                      std::string(1, "xy"[i])) != entry.components.end())
              driven_fibres_.push_back(
                  {k, i, 0.0, entry.function.empty() ? -1 : static_cast<int>(c), v[i], v[i]});
        }
    }
  }
}

template <int dim>
double Solid<dim>::driven_velocity(const DrivenFibre& driven, double t) const
{
  if constexpr (dim == 2)
    if (driven.function >= 0)
      return driving_[static_cast<std::size_t>(driven.function)](static_cast<std::size_t>(driven.component),
                                                                 beam_->X()[driven.fibre], t);
  return driven.v;
}

/// Free motion of the beam under what acts on the ends of its fibres.
template <int dim>
void Solid<dim>::solve_beam(double dt)
{
  if constexpr (dim == 2)
    if (moves_beam())
    {
      for (std::size_t n = 0; n < nodes_.X.size(); ++n)
      {
        auto& f = face_force_[place_[n].first][static_cast<std::size_t>(place_[n].second)];
        for (int i = 0; i < 2; ++i)
          f[i] = F_ext_[n][i] - opposing(n, i);
      }
      beam_->solve_free_motion(dt, face_force_);
      for (std::size_t e = 0; e < beam_->n_elements(); ++e)
        if (const auto s = beam_->section(e); !(s.stretch > 0.0))
          throw NumericalError(fmt::format(
              "solid: element {} of the beam, near ({:.6g}, {:.6g}) m, has the stretch {:.3g} at step {}, t "
              "= {:.9g} s: "
              "it is inverted. The load is beyond what this mesh can carry, or the step is too large",
              e, s.x[0], s.x[1], s.stretch, step_, time()));
      for (auto& driven : driven_fibres_)
        beam_->set_velocity(driven.fibre, driven.component, driven_velocity(driven, time()));
      show_beam(false);
    }
}

template <int dim>
void Solid<dim>::show_beam(bool moves)
{
  if constexpr (dim == 2)
    for (std::size_t n = 0; n < nodes_.X.size(); ++n)
    {
      const auto& [k, face] = place_[n];
      if (moves)
        nodes_.u[n] = beam_->face_position(face, k) - nodes_.X[n];
      nodes_.v[n] = beam_->face_velocity(face, k);
      nodes_.a[n] = beam_->face_acceleration(face, k);
    }
}

template <int dim>
void Solid<dim>::link_beam(std::size_t node, const Vec<dim>& f, double dt)
{
  if constexpr (dim == 2)
    if (beam_)
      beam_->add_face_force(place_[node].second, place_[node].first, f, dt);
}

template class Solid<2>;
template class Solid<3>;

} // namespace undine::solid
