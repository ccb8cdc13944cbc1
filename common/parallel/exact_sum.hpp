// Sums that do not depend on the order of their terms, nor on who holds which.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>

namespace undine
{

/// A sum of doubles without rounding (the long accumulator of Kulisch): digits of 32 bits from the smallest
/// to the largest double. Only value() rounds. At most 2³⁰ terms between two calls of normalise(); infinities
/// and NaN make value() NaN.
class ExactSum
{
public:
  static constexpr std::size_t digits = 69;

  void add(double term)
  {
    const auto bits = std::bit_cast<std::uint64_t>(term);
    const auto exponent = static_cast<unsigned>(bits >> 52) & 0x7ffU;
    if (exponent == 0x7ffU)
    {
      digit_[digits - 1] = 1; // where no finite term reaches
      return;
    }
    // term = ± mantissa 2^(place − 1074)
    const std::uint64_t mantissa = (bits & 0xfffffffffffffULL) | (exponent != 0 ? 0x10000000000000ULL : 0ULL);
    const unsigned place = exponent != 0 ? exponent - 1 : 0, shift = place % 32;
    std::int64_t* d = digit_.data() + place / 32;
    const std::uint64_t low = (mantissa & 0xffffffffULL) << shift, high = (mantissa >> 32) << shift;
    const auto d0 = static_cast<std::int64_t>(low & 0xffffffffULL),
               d1 = static_cast<std::int64_t>((low >> 32) + (high & 0xffffffffULL)),
               d2 = static_cast<std::int64_t>(high >> 32);
    const std::int64_t sign = bits >> 63 ? -1 : 1;
    d[0] += sign * d0;
    d[1] += sign * d1;
    d[2] += sign * d2;
  }

  /// Add all terms of another sum.
  ExactSum& operator+=(const ExactSum& other)
  {
    for (std::size_t k = 0; k < digits; ++k)
      digit_[k] += other.digit_[k];
    return *this;
  }

  /// The digits, to be added up over several sums; unique only inside value().
  std::span<std::int64_t> raw() { return digit_; }
  std::span<const std::int64_t> raw() const { return digit_; }

  /// The sum, rounded towards zero at worst by one unit in the last place.
  double value() const
  {
    if (digit_[digits - 1] != 0)
      return std::numeric_limits<double>::quiet_NaN();
    ExactSum s = *this;
    s.normalise();
    const auto& d = s.digit_;
    std::size_t top = digits;
    while (top > 0 && d[top - 1] == 0)
      --top;
    double sum = 0.0;
    for (std::size_t k = top > 4 ? top - 4 : 0; k < top; ++k) // 97 bits at least
      sum += std::ldexp(static_cast<double>(d[k]), static_cast<int>(32 * k) - 1074);
    return sum;
  }

  /// Make room for 2³⁰ more terms: all digits get the sign of the sum and less than 33 bits.
  void normalise()
  {
    if (digit_[digits - 1] != 0)
      return;
    carry();
    if (digit_[digits - 1] >= 0)
      return;
    negate();
    carry();
    negate();
  }

private:
  void carry()
  {
    for (std::size_t k = 0; k + 1 < digits; ++k)
    {
      const std::int64_t over =
          digit_[k] >> 32; // rounds down: digits become 0 … 2³² − 1, the last has the sign
      digit_[k] -= over << 32;
      digit_[k + 1] += over;
    }
  }
  void negate()
  {
    for (auto& d : digit_)
      d = -d;
  }

  std::array<std::int64_t, digits> digit_{};
};

} // namespace undine
