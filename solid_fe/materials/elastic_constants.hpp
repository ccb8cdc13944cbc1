// Elastic constants shared by the laws, and what a law tells about its tangent.
#pragma once

namespace undine::solid
{

/// Lamé's constants [Pa].
struct ElasticConstants
{
  double lame_lambda = 0.0;
  double shear_modulus = 0.0;
};

/// Lamé's constants from Young's modulus [Pa] and Poisson's ratio in (−1, ½): λ = E ν / ((1+ν)(1−2ν)), μ = E
/// / (2(1+ν)).
inline ElasticConstants elastic_constants(double youngs_modulus, double poisson_ratio)
{
  return {.lame_lambda =
              youngs_modulus * poisson_ratio / ((1.0 + poisson_ratio) * (1.0 - 2.0 * poisson_ratio)),
          .shear_modulus = 0.5 * youngs_modulus / (1.0 + poisson_ratio)};
}

/// Upper bound of the tangent A = ∂P/∂F as a quadratic form, for every displacement gradient H:
///     H : A : H  ≤  full |H|² + volumetric (M : H)²,   M some matrix with spectral norm ≤ 1.
/// Kept in two parts because the divergence-like part meets a smaller element frequency than the full
/// gradient. [Pa]
struct TangentBound
{
  double full = 0.0;
  double volumetric = 0.0;
};

} // namespace undine::solid
