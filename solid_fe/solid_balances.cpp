// Energies, momenta, reactions and section forces of the explicit solid.
#include "solid_fe/solid.hpp"

#include <algorithm>
#include <array>

namespace undine::solid
{

template <int dim>
template <int size, class Term>
Vec<size> Solid<dim>::sum_over_nodes(Term&& term) const
{
  std::array<ExactSum, size> sums;
  share_.for_own(
      [&](std::size_t n)
      {
        const Vec<size> row = term(n);
        for (int i = 0; i < size; ++i)
          sums[static_cast<std::size_t>(i)].add(row[i]);
      });
  std::array<ExactSum*, size> all;
  std::transform(sums.begin(), sums.end(), all.begin(), [](ExactSum& sum) { return &sum; });
  ranks().sum(all);
  Vec<size> total;
  for (int i = 0; i < size; ++i)
    total[i] = sums[static_cast<std::size_t>(i)].value();
  return total;
}

template <int dim>
double Solid<dim>::gravity_work() const
{
  if (norm_squared(gravity_) == 0.0)
    return 0.0;
  return sum_over_nodes<1>([this](std::size_t n)
                           { return Vec<1>{{given_mass_[n] * dot(gravity_, nodes_.u[n])}}; })[0];
}

/// The part of this rank.
template <int dim>
void Solid<dim>::add_works(const std::vector<double>& works, ExactSum& sum) const
{
  share_.for_own(0, works.size(),
                 [&](std::size_t n)
                 {
                   if (works[n] != 0.0)
                     sum.add(works[n]);
                 });
}

template <int dim>
double Solid<dim>::interface_work() const
{
  ExactSum sum;
  add_works(interface_work_, sum);
  ranks().sum({&sum});
  return sum.value();
}

template <int dim>
Energies Solid<dim>::energies() const
{
  ExactSum kinetic, external, interface, viscous, contact;
  StoredEnergy stored;
  if (moves_beam())
  {
    kinetic.add(beam_->kinetic_energy());
    stored.strain.add(beam_->strain_energy());
  }
  if (!beam_)
    share_.for_own([&](std::size_t n) { kinetic.add(0.5 * nodes_.m[n] * norm_squared(nodes_.v[n])); });
  add_works(external_work_, external);
  add_works(interface_work_, interface);
  add_works(viscous_work_, viscous);
  add_works(contact_work_, contact);
  for (const auto& body : bodies_)
    add_stored_energy(body, std::span<const Vec<dim>>(nodes_.u), stored);
  ranks().sum({&kinetic, &external, &interface, &viscous, &contact, &stored.strain, &stored.hourglass,
               &stored.plastic});

  Energies e;
  e.kinetic = kinetic.value();
  e.strain = stored.strain.value();
  e.hourglass = stored.hourglass.value();
  e.plastic = stored.plastic.value();
  e.viscous = viscous.value();
  e.contact = contact.value();
  e.external = gravity_work() - gravity_reference_ + external.value();
  e.interface = interface.value();
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
  return sum_over_nodes<dim>([this](std::size_t n) { return nodes_.m[n] * nodes_.v[n]; });
}

template <int dim>
Vec<3> Solid<dim>::angular_momentum() const
{
  auto momentum = sum_over_nodes<3>(
      [this](std::size_t n)
      {
        Vec<3> x, v;
        for (int i = 0; i < dim; ++i)
        {
          x[i] = nodes_.X[n][i] + nodes_.u[n][i];
          v[i] = nodes_.v[n][i];
        }
        return nodes_.m[n] * cross(x, v);
      });
  if (beam_) // the rotary inertia is not that of two masses at the ends
    momentum[2] = of_first(beam_->angular_momentum());
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
      return of_first(total);
    }
  const auto reactions = at(nodes,
                            [this](std::size_t n)
                            {
                              Vec<dim> f = nodes_.m[n] * nodes_.a[n] - F_ext_[n] + F_int_[n];
                              for (int i = 0; i < dim; ++i)
                                f[i] += opposing(n, i);
                              if (n < f_link_.size())
                                f -= f_link_[n];
                              return f;
                            });
  for (const auto& f : reactions)
    total += f;
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
  const std::array<index_t, 1> there{static_cast<index_t>(nearest)};
  const auto about = point + at(there, [this](std::size_t n) { return nodes_.u[n]; }).front();
  std::pair<Vec<dim>, Vec<3>> total{};
  const auto moment = [&](const Vec<dim>& f, const Vec<dim>& x)
  {
    Vec<3> arm, force;
    for (int i = 0; i < dim; ++i)
    {
      arm[i] = x[i] - about[i];
      force[i] = f[i];
    }
    return cross(arm, force);
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
          total.first -= F[k];
          total.second += moment(-1.0 * F[k], beam_->X()[k] + beam_->u()[k]);
          total.second[2] -= M[k];
        }
      return {of_first(total.first), of_first(total.second)};
    }
  const auto in_front = [&](std::size_t n) { return dot(nodes_.X[n] - point, normal) > 0.0; };
  total.first =
      sum_over_nodes<dim>([&](std::size_t n) { return in_front(n) ? -1.0 * F_int_[n] : Vec<dim>{}; });
  total.second = sum_over_nodes<3>(
      [&](std::size_t n)
      { return in_front(n) ? moment(-1.0 * F_int_[n], nodes_.X[n] + nodes_.u[n]) : Vec<3>{}; });
  return total;
}

template <int dim>
index_t Solid<dim>::n_elements() const
{
  index_t n = beam_ ? static_cast<index_t>(beam_->n_elements()) : 0;
  for (std::size_t k = 0; k < bodies_.size(); ++k)
    n += std::visit([](const auto& block) { return block.size(); }, whole_block(k));
  return n;
}

template class Solid<2>;
template class Solid<3>;

} // namespace undine::solid
