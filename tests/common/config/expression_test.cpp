// Tests of functions of position and time written in the case.
#include "common/config/expression.hpp"

#include "common/error.hpp"
#include "tests/common/config/error_of.hpp"

#include <catch2/catch.hpp>

#include <cmath>
#include <string>

using namespace undine;
using undine::test::error_of;

TEST_CASE("a formula has the value of mathematics, and so has its copy", "[common][unit]")
{
  const Expression f("2*x - y^2 + sin(pi*z)*min(t/0.1, 1)", "here");
  const Expression copy = f;
  for (const double t : {0.05, 0.2})
  {
    const double truth = 2.0 * 3.0 - 0.25 + std::sin(0.3 * std::acos(-1.0)) * std::min(t / 0.1, 1.0);
    CHECK(std::abs(f(3.0, 0.5, 0.3, t) - truth) <= 1e-15 * truth); // a few operations
    CHECK(copy(3.0, 0.5, 0.3, t) == f(3.0, 0.5, 0.3, t));
  }
}

TEST_CASE("a wrong formula is answered with its place", "[common][unit]")
{
  const auto answer = [](const std::string& formula)
  { return error_of([&] { const Expression f(formula, "fluid.gravity[1]"); }); };
  CHECK(answer("2*w").starts_with("fluid.gravity[1] = \"2*w\": "));
  CHECK(answer("2*w").find("A formula may use x, y, z, t, pi") != std::string::npos);
  CHECK(answer("(x").find("position") != std::string::npos);
  CHECK(answer(std::string(4999, '(') + "x" + std::string(4999, ')')) == "");
  for (const std::size_t n : {10001ul, 1000000ul})
    CHECK(answer(std::string(n, '(')) ==
          "fluid.gravity[1]: a formula of " + std::to_string(n) + " characters; the limit is 10000");
}
