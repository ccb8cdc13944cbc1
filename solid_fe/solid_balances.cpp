// Energies, momenta, reactions and section forces of the explicit solid.
#include "solid_fe/solid.hpp"

namespace undine::solid
{

template <int dim>
Energies Solid<dim>::energies() const
{
  Energies e;
  double gravity_work = -gravity_reference_;
  for (std::size_t n = 0; n < nodes_.X.size(); ++n)
  {
    e.kinetic += 0.5 * nodes_.m[n] * norm_squared(nodes_.v[n]);
    gravity_work += given_mass_[n] * dot(gravity_, nodes_.u[n]);
  }
  if (beam_)
  {
    e.kinetic = beam_->kinetic_energy();
    e.strain = beam_->strain_energy();
  }
  for (const auto& body : bodies_)
  {
    const auto stored = stored_energy(body, std::span<const Vec<dim>>(nodes_.u));
    e.strain += stored.strain;
    e.hourglass += stored.hourglass;
    e.plastic += stored.plastic;
  }
  e.viscous = viscous_work_;
  e.contact = contact_work_;
  e.external = gravity_work + load_work_ + driven_work_;
  e.interface = interface_work_;
  return e;
}

template <int dim>
double Solid<dim>::mass() const
{
  double mass = 0.0;
  for (const double m : nodes_.m)
    mass += m;
  return mass;
}

template <int dim>
Vec<dim> Solid<dim>::linear_momentum() const
{
  Vec<dim> momentum;
  for (std::size_t n = 0; n < nodes_.X.size(); ++n)
    momentum += nodes_.m[n] * nodes_.v[n];
  return momentum;
}

template <int dim>
Vec<3> Solid<dim>::angular_momentum() const
{
  Vec<3> momentum;
  for (std::size_t n = 0; n < nodes_.X.size(); ++n)
  {
    Vec<3> x, v;
    for (int i = 0; i < dim; ++i)
    {
      x[i] = nodes_.X[n][i] + nodes_.u[n][i];
      v[i] = nodes_.v[n][i];
    }
    momentum += nodes_.m[n] * cross(x, v);
  }
  if (beam_) // the rotary inertia is not that of two masses at the ends
    momentum[2] = beam_->angular_momentum();
  return momentum;
}

template <int dim>
Vec<dim> Solid<dim>::reaction(std::span<const index_t> nodes) const
{
  Vec<dim> total;
  if constexpr (dim == 2)
    if (beam_)
    {
      std::vector<bool> counted(fibre_.size(), false);
      for (const index_t node : nodes)
        if (const auto k = place_[static_cast<std::size_t>(node)].first; !counted[k])
        {
          counted[k] = true;
          total += beam_->mass(k) * beam_->acceleration(k) - beam_->force(k);
          for (const index_t end : fibre_[k])
            if (const auto n = static_cast<std::size_t>(end); n < f_link_.size())
              total -= f_link_[n];
        }
      return total;
    }
  for (const index_t k : nodes)
  {
    const auto n = static_cast<std::size_t>(k);
    total += nodes_.m[n] * nodes_.a[n] - F_ext_[n] + F_int_[n];
    for (int i = 0; i < dim; ++i)
      total[i] += opposing(n, i);
    if (n < f_link_.size())
      total -= f_link_[n];
  }
  return total;
}

template <int dim>
std::pair<Vec<dim>, Vec<3>> Solid<dim>::section_force(const Vec<dim>& point, const Vec<dim>& normal) const
{
  // Elements in front of the plane push their own nodes with forces that cancel; what is left is what the cut
  // ones push forward.
  std::size_t nearest = 0;
  for (std::size_t n = 0; n < nodes_.X.size(); ++n)
    if (norm_squared(nodes_.X[n] - point) < norm_squared(nodes_.X[nearest] - point))
      nearest = n;
  const auto about = point + nodes_.u[nearest];
  std::pair<Vec<dim>, Vec<3>> total{};
  const auto add = [&](const Vec<dim>& f, const Vec<dim>& x)
  {
    total.first += f;
    Vec<3> arm, force;
    for (int i = 0; i < dim; ++i)
    {
      arm[i] = x[i] - about[i];
      force[i] = f[i];
    }
    total.second += cross(arm, force);
  };
  if constexpr (dim == 2)
    if (beam_)
    {
      std::vector<Vec<2>> F(beam_->n_nodes());
      std::vector<double> M(beam_->n_nodes());
      beam_->internal_force_at(beam_->u(), beam_->theta(), F, M);
      for (std::size_t k = 0; k < F.size(); ++k)
        if (dot(beam_->X()[k] - point, normal) > 0.0)
        {
          add(-1.0 * F[k], beam_->X()[k] + beam_->u()[k]);
          total.second[2] -= M[k];
        }
      return total;
    }
  for (std::size_t n = 0; n < nodes_.X.size(); ++n)
    if (dot(nodes_.X[n] - point, normal) > 0.0)
      add(-1.0 * F_int_[n], nodes_.X[n] + nodes_.u[n]);
  return total;
}

template <int dim>
index_t Solid<dim>::n_elements() const
{
  index_t n = beam_ ? static_cast<index_t>(beam_->n_elements()) : 0;
  for (const auto& body : bodies_)
    n += std::visit([](const auto& block) { return block.size(); }, body.block);
  return n;
}

template class Solid<2>;
template class Solid<3>;

} // namespace undine::solid
