// J2 plasticity at finite strain: F = Fᵉ Fᵖ, hyperelastic Fᵉ, radial return. Simo & Hughes (1998), box 9.1.
#pragma once

#include "common/lanes.hpp"
#include "solid_fe/deformation.hpp"
#include "solid_fe/material_config.hpp"
#include "solid_fe/materials/elastic_constants.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace undine::solid
{

/// Elastic part W = κ/2 (ln J)² + μ/2 (tr b̄ᵉ − 3) with b̄ᵉ = J^(−2/3) F Ḡ Fᵀ, where Ḡ = (F̄ᵖᵀ F̄ᵖ)⁻¹ is kept per
/// point in the reference state: nothing has to be rotated. Flow when √(3/2) |dev τ| exceeds the yield stress
/// of `Hardening`, along dev τ; det b̄ᵉ = 1 is restored after each return.
///
/// A `Hardening` is a struct with
///     static constexpr const char* name; bool heats;
///     double initial_yield_stress;                                     [Pa]
///     double yield_stress(double strain, double rate, double heating); [Pa] equivalent plastic strain, its
///     rate
///                                                                      [1/s], rise of temperature [K]
///     double heating(double work);                                     [K] of a plastic work per volume
///     [J/m³]
template <class Hardening>
struct FinitePlasticity
{
  static constexpr const char* name = Hardening::name;
  static constexpr bool small_strain = false;
  static constexpr bool bound_of_rates = true; ///< tangent_bound comes from a bound in δF F⁻¹

  /// Numbers kept per point, all zero at first: Ḡ − I (xx, yy, zz, xy and in 3-D yz, xz), equivalent plastic
  /// strain, plastic work per volume [J/m³], rise of the static yield stress [Pa], rise of temperature [K].
  static constexpr int history(int dim) { return metric(dim) + 4; }
  static constexpr int metric(int dim) { return dim == 2 ? 4 : 6; }
  static constexpr int strain_at(int dim) { return metric(dim); }
  static constexpr int work_at(int dim) { return metric(dim) + 1; }
  static constexpr int rise_at(int dim) { return metric(dim) + 2; }
  static constexpr int heat_at(int dim) { return metric(dim) + 3; }
  template <int dim, class Real>
  using History = std::array<Real, static_cast<std::size_t>(dim == 2 ? 8 : 10)>;

  ElasticConstants elastic;
  Hardening hardening;

  static FinitePlasticity from(const MaterialConfig& config)
  {
    return {elastic_constants(config.youngs_modulus, config.poisson_ratio), Hardening::from(config)};
  }
  double bulk_modulus() const { return elastic.lame_lambda + 2.0 / 3.0 * elastic.shear_modulus; }

  /// Elastic energy [J/m³] with the plastic state `h`.
  template <int dim, class Real>
  Real strain_energy(const Mat<dim, Real>& H, const History<dim, Real>& h) const
  {
    using std::log1p;
    const Real ln_J = log1p(volume_strain(H));
    return Real(0.5 * bulk_modulus()) * ln_J * ln_J +
           Real(0.5 * elastic.shear_modulus) * elastic_strain(H, ln_J, h).trace();
  }
  /// Plastic work done so far [J/m³].
  template <int dim>
  double dissipated(const History<dim, double>& h) const
  {
    return h[static_cast<std::size_t>(work_at(dim))];
  }

  /// Stress [Pa] after a step of `dt` [s] that ends at H; `h` goes along. Points below yield cost no
  /// plasticity.
  template <int dim, class Real>
  Mat<dim, Real> first_piola(const Mat<dim, Real>& H, History<dim, Real>& h, double dt) const
  {
    using std::log1p;
    const Real J_minus_one = volume_strain(H), ln_J = log1p(J_minus_one);
    const auto trial = elastic_strain(H, ln_J, h); // b̄ᵉ − I
    const Real mean = Real(1.0 / 3.0) * trial.trace();
    auto s = Real(elastic.shear_modulus) * trial.deviator(mean);
    using std::sqrt;
    const Real equivalent = sqrt(Real(1.5) * s.squared());
    const Real excess =
        equivalent - (Real(hardening.initial_yield_stress) + h[static_cast<std::size_t>(rise_at(dim))]);
    const auto yields = excess > Real(0.0);
    if (any(yields))
      flow(H, ln_J, mean, equivalent, yields, dt, s, h);

    const auto tau = s.plane + Real(bulk_modulus()) * ln_J * Mat<dim, Real>::identity();
    const auto cofactor = transpose(adjugate(deformation_gradient(H)));
    return tau * cofactor * (Real(1.0) / (Real(1.0) + J_minus_one));
  }

  /// Cauchy stress of the state `h` as it is, without flow. [Pa]
  template <int dim>
  Mat<3> cauchy_of_state(const Mat<dim>& H, const History<dim, double>& h) const
  {
    const double J_minus_one = volume_strain(H), ln_J = std::log1p(J_minus_one);
    const auto b = elastic_strain(H, ln_J, h);
    const auto s = elastic.shear_modulus * b.deviator(b.trace() / 3.0);
    auto tau = embed_in_3d(s.plane);
    if constexpr (dim == 2)
      tau(2, 2) = s.out;
    return (1.0 / (1.0 + J_minus_one)) * (tau + bulk_modulus() * ln_J * Mat<3>::identity());
  }

  // The response of virgin material, for the checks that all laws share.
  template <int dim>
  double strain_energy(const Mat<dim>& H) const
  {
    return strain_energy(H, History<dim, double>{});
  }
  template <int dim>
  Mat<dim> first_piola(const Mat<dim>& H) const
  {
    History<dim, double> virgin{};
    return first_piola(H, virgin, 0.0);
  }

  /// δP:δF = d:𝕔:d + tr(L τ Lᵀ) with L = δF F⁻¹, d = sym L and 𝕔 the elastic moduli, which bound the plastic
  /// ones:  d:𝕔:d = κ (tr d)² − 2κ ln J |d|² + 2μ̄ |dev d|² − 4/3 (s:d) tr d,  μ̄ = μ/3 tr b̄ᵉ.
  template <int dim>
  TangentBound tangent_bound(const Mat<dim>& H, const History<dim, double>& h) const
  {
    const double ln_J = std::log1p(volume_strain(H)), kappa = bulk_modulus();
    const auto b = elastic_strain(H, ln_J, h);
    const double mean = b.trace() / 3.0;
    const auto s = elastic.shear_modulus * b.deviator(mean);
    const double size = std::sqrt(s.squared());
    const double stretch2 = extreme_stretches_squared(H).first;
    const double shear = elastic.shear_modulus * (1.0 + mean), pressure_part = kappa * ln_J;
    // |tr d| ≤ √3 |d|;  the largest eigenvalue of τ is at most κ ln J + √(2/3) |s|;  the two terms in κ ln J
    // add up to at most |κ ln J| |L|².
    const double full = 2.0 * shear + std::abs(pressure_part) + (4.0 / std::sqrt(3.0) + 0.8165) * size;
    return {.full = full / stretch2, .volumetric = std::max(kappa - 2.0 / 3.0 * shear, 0.0) / stretch2};
  }
  template <int dim>
  TangentBound tangent_bound(const Mat<dim>& H) const
  {
    return tangent_bound(H, History<dim, double>{});
  }

  /// Upper bound of ρ₀c² of virgin material, exact at rest. [Pa]
  template <int dim>
  double wave_modulus(const Mat<dim>& H) const
  {
    const auto bound = tangent_bound(H);
    return bound.full + bound.volumetric;
  }

private:
  /// A symmetric 3 × 3 matrix that in plane strain has only `out` out of the plane.
  template <int dim, class Real>
  struct Symmetric
  {
    Mat<dim, Real> plane;
    Real out{}; ///< the 33 component if dim == 2

    Real trace() const
    {
      if constexpr (dim == 2)
        return undine::trace(plane) + out;
      else
        return undine::trace(plane);
    }
    Symmetric deviator(const Real& mean) const
    {
      return {plane - mean * Mat<dim, Real>::identity(), out - mean};
    }
    Real squared() const
    {
      if constexpr (dim == 2)
        return contract(plane, plane) + out * out;
      else
        return contract(plane, plane);
    }
    Real determinant() const
    {
      if constexpr (dim == 2)
        return undine::determinant(plane) * out;
      else
        return undine::determinant(plane);
    }
    friend Symmetric operator*(const Real& a, const Symmetric& b) { return {a * b.plane, a * b.out}; }
  };

  /// b̄ᵉ − I = (J^(−2/3) − 1) I + J^(−2/3) (b − I + F (Ḡ − I) Fᵀ): no difference of numbers near 1.
  template <int dim, class Real>
  Symmetric<dim, Real> elastic_strain(const Mat<dim, Real>& H, const Real& ln_J,
                                      const History<dim, Real>& h) const
  {
    using std::expm1;
    const auto F = deformation_gradient(H);
    Mat<dim, Real> g;
    g(0, 0) = h[0];
    g(1, 1) = h[1];
    g(0, 1) = g(1, 0) = h[3];
    if constexpr (dim == 3)
    {
      g(2, 2) = h[2];
      g(1, 2) = g(2, 1) = h[4];
      g(0, 2) = g(2, 0) = h[5];
    }
    const Real scale_minus_one = expm1(Real(-2.0 / 3.0) * ln_J), scale = Real(1.0) + scale_minus_one;
    const auto b = left_cauchy_green_minus_one(H) + F * g * transpose(F);
    return {scale * b + scale_minus_one * Mat<dim, Real>::identity(), scale * h[2] + scale_minus_one};
  }

  /// Return of the points that yield to the yield surface, and their new history.
  template <int dim, class Real, class Condition>
  void flow(const Mat<dim, Real>& H, const Real& ln_J, const Real& mean, const Real& equivalent,
            const Condition& yields, double dt, Symmetric<dim, Real>& s, History<dim, Real>& h) const
  {
    constexpr auto strain = static_cast<std::size_t>(strain_at(dim)),
                   work = static_cast<std::size_t>(work_at(dim)),
                   rise = static_cast<std::size_t>(rise_at(dim)),
                   heat = static_cast<std::size_t>(heat_at(dim));
    Real scale(1.0), before_over_after(1.0); // of the equivalent stress
    for (int k = 0; k < lanes_of<Real>; ++k)
    {
      if (!lane(yields, k))
        continue;
      const double before = lane(h[strain], k), heating = lane(h[heat], k);
      const double slope = 3.0 * elastic.shear_modulus * (1.0 + lane(mean, k));
      const double increment = plastic_increment(lane(equivalent, k), slope, before, heating, dt);
      const double after = lane(equivalent, k) - slope * increment;
      set_lane(scale, k, after / lane(equivalent, k));
      set_lane(h[strain], k, before + increment);
      const double stress_before = hardening.yield_stress(before, dt > 0.0 ? increment / dt : 0.0, heating);
      set_lane(before_over_after, k, stress_before / after);
    }
    s = scale * s;

    // b̄ᵉ = s/μ + x I with det b̄ᵉ = 1: Newton's method from the trial value, where x differs by O(|s/μ|²).
    const auto deviator = Real(1.0 / elastic.shear_modulus) * s;
    const auto mean_of = [&](const Symmetric<dim, Real>& of)
    {
      const Real half_square = Real(0.5) * of.squared(), det = of.determinant();
      Real x = Real(1.0) + mean;
      for (int iteration = 0; iteration < 3; ++iteration)
        x = x - (x * x * x - half_square * x + det - Real(1.0)) / (Real(3.0) * x * x - half_square);
      return x;
    };
    const Real x = mean_of(deviator), x_before = mean_of(before_over_after * deviator);

    // Plastic work: what the return takes from the elastic energy μ/2 (tr b̄ᵉ − 3), less what the trial
    // stress, which the solid never feels, seemed to have worked: ½(P + P_old):ΔF = ΔW + this, to second
    // order in the step. The second part is ½ (s_trial − s):d Δt; and ½ (s_before + s_trial):d Δt is the
    // change of the elastic energy from the yield surface before, in the direction of s, to the trial state.
    // (σ Δα is not it: the flow along n spends τ:n b̄ᵉ⁻¹ …, which differs from |s| by O(s/μ) wherever tr n³ ≠
    // 0, as in tension.)
    for (int k = 0; k < lanes_of<Real>; ++k)
    {
      if (!lane(yields, k))
        continue;
      const double trial = lane(mean, k) + 1.0, after = lane(scale, k); // the latter over the trial stress
      const double share = (1.0 - after) / (1.0 + after * lane(before_over_after, k));
      const double spent =
          1.5 * elastic.shear_modulus * (trial - lane(x, k) - share * (trial - lane(x_before, k)));
      set_lane(h[work], k, lane(h[work], k) + spent);
      if (Hardening::heats)
        set_lane(h[heat], k, lane(h[heat], k) + hardening.heating(spent));
      set_lane(h[rise], k,
               hardening.yield_stress(lane(h[strain], k), 0.0, lane(h[heat], k)) -
                   hardening.initial_yield_stress);
    }

    // Ḡ = J^(2/3) F⁻¹ b̄ᵉ F⁻ᵀ
    using std::expm1;
    const auto F_inverse = inverse(deformation_gradient(H));
    const Real volume = Real(1.0) + expm1(Real(2.0 / 3.0) * ln_J);
    const auto G =
        volume * (F_inverse * (deviator.plane + x * Mat<dim, Real>::identity()) * transpose(F_inverse));
    const auto keep = [&](std::size_t at, const Real& value) { h[at] = select(yields, value, h[at]); };
    keep(0, G(0, 0) - Real(1.0));
    keep(1, G(1, 1) - Real(1.0));
    keep(3, G(0, 1));
    if constexpr (dim == 2)
      keep(2, volume * (deviator.out + x) - Real(1.0));
    else
    {
      keep(2, G(2, 2) - Real(1.0));
      keep(4, G(1, 2));
      keep(5, G(0, 2));
    }
  }

  /// Δα of: trial − slope Δα = yield stress(α + Δα, Δα/Δt). Both sides are monotone, so the root is bracketed
  /// by 0 and trial/slope: false position with Illinois' weights.
  double plastic_increment(double trial, double slope, double before, double heating, double dt) const
  {
    const auto residual = [&](double increment)
    {
      return trial - slope * increment -
             hardening.yield_stress(before + increment, dt > 0.0 ? increment / dt : 0.0, heating);
    };
    double low = 0.0, high = trial / slope;
    double at_low = residual(low), at_high = residual(high);
    if (at_low <= 0.0)
      return 0.0;
    for (int iteration = 0; iteration < 60; ++iteration)
    {
      const double next = low + (high - low) * at_low / (at_low - at_high);
      const double value = residual(next);
      if (std::abs(value) <= 1e-12 * trial || high - low <= 1e-15 * high)
        return next;
      if (value > 0.0)
      {
        low = next;
        at_low = value;
        at_high *= 0.5;
      }
      else
      {
        high = next;
        at_high = value;
        at_low *= 0.5;
      }
    }
    return low;
  }
};

} // namespace undine::solid
