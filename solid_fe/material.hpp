// The constitutive laws a case may choose from, and what all of them have in common.
#pragma once

#include "solid_fe/deformation.hpp"
#include "solid_fe/laws.hpp"
#include "solid_fe/material_config.hpp"

#include <cmath>
#include <string>
#include <string_view>
#include <vector>

namespace undine::solid
{

// `Material` (laws.hpp) is one law, chosen at set-up and visited once per element block. A law is a struct of
// constants with pure functions of the displacement gradient H: strain_energy, first_piola, tangent_bound,
// wave_modulus (see any file in materials/). A new law is a file materials/<law>.hpp and a line in
// CMakeLists.txt: docs/new_law.md.

/// Names of the laws, as the case spells them.
std::vector<std::string> law_names();

/// Keys that only this law reads. @throws InputError for an unknown name
std::vector<LawKey> law_keys(std::string_view law);

/// Do the points of this law keep a history?
bool remembers(const Material& material);

/// The law of `config`. @throws InputError for an unknown name
Material make_material(const MaterialConfig& config);

/// Cauchy stress σ = P Fᵀ / J, always 3 × 3: plane strain has a σ₃₃. A small-strain law returns its stress.
/// [Pa]
template <int dim, class Law>
Mat<3> cauchy_stress(const Law& law, const Mat<dim>& H)
{
  const Mat<3> H3 = embed_in_3d(H);
  const Mat<3> P = law.first_piola(H3);
  if constexpr (Law::small_strain)
    return P;
  else
    return P * transpose(deformation_gradient(H3)) * (1.0 / (1.0 + volume_strain(H3)));
}

/// von Mises stress √(3/2 s:s), s the deviator of σ. [Pa]
inline double von_mises(const Mat<3>& sigma)
{
  const Mat<3> s = sigma - (trace(sigma) / 3.0) * Mat<3>::identity();
  return std::sqrt(1.5 * contract(s, s));
}

} // namespace undine::solid
