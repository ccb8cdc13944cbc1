// Sums without an order.
#include "common/parallel/exact_sum.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

using undine::ExactSum;

TEST_CASE("an exact sum has no order, loses nothing and may be added up in parts", "[common][unit]")
{
  std::mt19937 random(3);
  std::uniform_real_distribution<double> mantissa(-1.0, 1.0);
  std::uniform_int_distribution<int> exponent(-300, 300);
  for (int round = 0; round < 50; ++round)
  {
    std::vector<double> terms;
    for (int k = 0; k < 400; ++k)
    {
      terms.push_back(std::ldexp(mantissa(random), exponent(random)));
      if (k % 2 == 0)
        terms.push_back(-terms.back()); // what cancels must leave the rest alone
    }
    const double small = mantissa(random) * 1e-290;
    terms.push_back(small);
    ExactSum forward;
    for (const double t : terms)
      forward.add(t);
    std::shuffle(terms.begin(), terms.end(), random);
    ExactSum first, second;
    for (std::size_t k = 0; k < terms.size(); ++k)
      (k % 3 == 0 ? first : second).add(terms[k]);
    first += second;
    CHECK(first.value() == forward.value());
  }
}

TEST_CASE("an exact sum is right to the last place", "[common][unit]")
{
  ExactSum cancelled;
  for (const double t : {1e300, 3.0, -1e300, 1e-300, -3.0})
    cancelled.add(t);
  CHECK(cancelled.value() == 1e-300);

  // Against sums of integers, which doubles hold exactly.
  std::mt19937_64 random(5);
  std::uniform_int_distribution<std::int64_t> integer(-1000000000000, 1000000000000);
  for (int round = 0; round < 100; ++round)
  {
    ExactSum sum;
    std::int64_t truth = 0;
    for (int k = 0; k < 100; ++k)
    {
      const std::int64_t term = integer(random);
      truth += term;
      sum.add(std::ldexp(static_cast<double>(term), -40));
    }
    CHECK(sum.value() == std::ldexp(static_cast<double>(truth), -40));
  }

  ExactSum ends;
  ends.add(std::numeric_limits<double>::denorm_min());
  CHECK(ends.value() == std::numeric_limits<double>::denorm_min());
  ends.add(std::numeric_limits<double>::max());
  CHECK(ends.value() == std::numeric_limits<double>::max());
  ends.add(std::numeric_limits<double>::infinity());
  CHECK(std::isnan(ends.value()));
  CHECK(ExactSum{}.value() == 0.0);
}
