// Several numbers side by side: the number type with which element formulas run in production.
#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <type_traits>

namespace undine
{

/// Eight doubles that are added, multiplied, compared together; formulas templated on their number type take
/// it like a double. Comparisons give a `Lanes::Mask`; use `select` and `any` instead of `if`. GCC and Clang
/// vectors: the compiler splits them into what the machine has.
class Lanes
{
public:
  static constexpr int size = 8;
  typedef double Numbers __attribute__((vector_size(size * sizeof(double))));
  typedef std::int64_t Mask __attribute__((vector_size(size * sizeof(std::int64_t)))); ///< −1 true, 0 false

  constexpr Lanes() : x_{} {}
  constexpr Lanes(double all) : x_{all, all, all, all, all, all, all, all} {}
  constexpr Lanes(Numbers x) : x_(x) {}

  double operator[](int k) const { return x_[k]; }
  void set(int k, double value) { x_[k] = value; }
  const Numbers& numbers() const { return x_; }

  Lanes& operator+=(const Lanes& b)
  {
    x_ += b.x_;
    return *this;
  }
  Lanes& operator-=(const Lanes& b)
  {
    x_ -= b.x_;
    return *this;
  }
  Lanes& operator*=(const Lanes& b)
  {
    x_ *= b.x_;
    return *this;
  }
  friend Lanes operator+(const Lanes& a, const Lanes& b) { return a.x_ + b.x_; }
  friend Lanes operator-(const Lanes& a, const Lanes& b) { return a.x_ - b.x_; }
  friend Lanes operator*(const Lanes& a, const Lanes& b) { return a.x_ * b.x_; }
  friend Lanes operator/(const Lanes& a, const Lanes& b) { return a.x_ / b.x_; }
  friend Lanes operator-(const Lanes& a) { return -a.x_; }
  friend Mask operator>(const Lanes& a, const Lanes& b) { return a.x_ > b.x_; }
  friend Mask operator<(const Lanes& a, const Lanes& b) { return a.x_ < b.x_; }
  friend Mask operator<=(const Lanes& a, const Lanes& b) { return a.x_ <= b.x_; }

  friend Lanes select(const Mask& condition, const Lanes& yes, const Lanes& no)
  {
    return condition ? yes.x_ : no.x_;
  }
  friend Lanes sqrt(const Lanes& a)
  {
    Lanes y;
    for (int k = 0; k < size; ++k) // the compiler makes one instruction of it
      y.x_[k] = __builtin_sqrt(a.x_[k]);
    return y;
  }

private:
  Numbers x_;
};

inline bool any(bool condition) { return condition; }
inline bool any(const Lanes::Mask& condition)
{
  std::int64_t bits = 0;
  for (int k = 0; k < Lanes::size; ++k)
    bits |= condition[k];
  return bits != 0;
}
/// condition ? yes : no, for numbers that may be Lanes.
inline double select(bool condition, double yes, double no) { return condition ? yes : no; }

/// ln(1 + x), x > −1, relative error below 2e-16 · 2 (the polynomial is that of fdlibm's e_log.c). NaN for x
/// < −1.
inline Lanes log1p(const Lanes& x)
{
  using Bits = Lanes::Mask;
  const Lanes::Numbers J = x.numbers() + 1.0;
  // J = 2^k m with m in [√½, √2): shift the bits so that the exponent field of √½ falls on 0.
  const Bits bits = reinterpret_cast<Bits>(J);
  const Bits shifted = bits - 0x3fe6a09e667f3bcdLL;
  const Bits k = shifted >> 52;
  const Lanes::Numbers m = reinterpret_cast<Lanes::Numbers>(bits - (k << 52));
  const Lanes::Numbers exponent = __builtin_convertvector(k, Lanes::Numbers);
  const Lanes::Numbers f = (k == 0) ? x.numbers() : m - 1.0; // x itself keeps the digits of small x
  const Lanes::Numbers s = f / (2.0 + f), z = s * s;
  const Lanes::Numbers R =
      z * (6.666666666666735130e-01 +
           z * (3.999999999940941908e-01 +
                z * (2.857142874366239149e-01 +
                     z * (2.222219843214978396e-01 +
                          z * (1.818357216161805012e-01 +
                               z * (1.531383769920937332e-01 + z * 1.479819860511658591e-01))))));
  const Lanes::Numbers value = exponent * 0.693147180559945309417232 + (f - s * (f - R));
  return (J > 0.0) ? value : Lanes::Numbers{} * 0.0 + __builtin_nan("");
}

/// eˣ − 1 without cancellation at small x; relative error below 1e-15 for |x| < 20.
inline Lanes expm1(const Lanes& x)
{
  using Bits = Lanes::Mask;
  // x = n ln 2 + r, |r| ≤ ½ ln 2;  e^r − 1 by its series, eˣ − 1 = 2ⁿ (e^r − 1) + (2ⁿ − 1).
  const Lanes::Numbers scaled = x.numbers() * 1.442695040888963407;
  const Lanes::Numbers shift = Lanes(6755399441055744.0).numbers(); // 1.5 · 2⁵²: adding it rounds to integers
  const Lanes::Numbers n = (scaled + shift) - shift;
  const Lanes::Numbers r = (x.numbers() - n * 6.93147180369123816490e-01) - n * 1.90821492927058770002e-10;
  Lanes::Numbers p = Lanes(1.0 / 6227020800.0).numbers(); // 1/13!
  for (const double inverse_factorial :
       {1.0 / 479001600.0, 1.0 / 39916800.0, 1.0 / 3628800.0, 1.0 / 362880.0, 1.0 / 40320.0, 1.0 / 5040.0,
        1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5})
    p = p * r + inverse_factorial;
  const Lanes::Numbers small = r + r * r * p;
  const Bits integer = __builtin_convertvector(n, Bits);
  const Lanes::Numbers power = reinterpret_cast<Lanes::Numbers>((integer + 1023) << 52);
  return power * small + (power - 1.0);
}

template <class Real>
constexpr int lanes_of = std::is_same_v<Real, Lanes> ? Lanes::size : 1;

/// Lane `k` of a number that may be a plain double.
inline double lane(double x, int) { return x; }
inline double lane(const Lanes& x, int k) { return x[k]; }
inline void set_lane(double& x, int, double value) { x = value; }
inline void set_lane(Lanes& x, int k, double value) { x.set(k, value); }
inline bool lane(bool x, int) { return x; }
inline bool lane(const Lanes::Mask& x, int k) { return x[k] != 0; }

} // namespace undine
