// Functions of position and time written in the case, such as "-9.81*min(t/0.1, 1)"; muParser stays behind
// expression.cpp.
#pragma once

#include <memory>
#include <string>

namespace undine
{

/// A formula in x, y, z [m] and t [s] with muParser's operators and functions (sin, exp, min, ?: …) and the
/// constant pi.
class Expression
{
public:
  /// `where` starts the error text, e.g. "fluid.initial_velocity[0]". @throws InputError with the parser's
  /// reason and position
  Expression(const std::string& formula, const std::string& where);
  ~Expression();
  Expression(const Expression& other);
  Expression& operator=(const Expression& other);
  Expression(Expression&&) noexcept;
  Expression& operator=(Expression&&) noexcept;

  double operator()(double x, double y, double z, double t) const;
  const std::string& formula() const;

private:
  struct Parser;
  std::unique_ptr<Parser> parser_;
};

} // namespace undine
