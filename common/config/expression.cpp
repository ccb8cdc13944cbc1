// muParser behind one translation unit.
#include "common/config/expression.hpp"

#include "common/error.hpp"

#include <muParser.h>

#include <cmath>

namespace undine
{

struct Expression::Parser
{
  Parser(const std::string& formula, const std::string& where) : formula(formula), where(where)
  {
    if (formula.size() > longest)
      throw InputError(where + ": a formula of " + std::to_string(formula.size()) +
                       " characters; the limit is " + std::to_string(longest));
    parser.DefineConst("pi", std::acos(-1.0));
    parser.DefineVar("x", &x);
    parser.DefineVar("y", &y);
    parser.DefineVar("z", &z);
    parser.DefineVar("t", &t);
    try
    {
      parser.SetExpr(formula);
      parser.Eval(); // compiles, so that mistakes show here
    }
    catch (const mu::Parser::exception_type& error)
    {
      throw InputError(where + " = \"" + formula + "\": " + error.GetMsg() + " (position " +
                       std::to_string(error.GetPos() + 1) +
                       "). A formula may use x, y, z, t, pi and the usual functions");
    }
  }
  static constexpr std::size_t longest = 10000; ///< muParser takes 100000, but not with so many brackets
  std::string formula, where;
  mu::Parser parser;
  double x = 0.0, y = 0.0, z = 0.0, t = 0.0;
};

Expression::Expression(const std::string& formula, const std::string& where)
    : parser_(std::make_unique<Parser>(formula, where))
{
}
Expression::~Expression() = default;
// A parser knows the addresses of its variables, so a copy is a new one.
Expression::Expression(const Expression& other) : Expression(other.parser_->formula, other.parser_->where) {}
Expression& Expression::operator=(const Expression& other)
{
  parser_ = std::make_unique<Parser>(other.parser_->formula, other.parser_->where);
  return *this;
}
Expression::Expression(Expression&&) noexcept = default;
Expression& Expression::operator=(Expression&&) noexcept = default;

double Expression::operator()(double x, double y, double z, double t) const
{
  parser_->x = x;
  parser_->y = y;
  parser_->z = z;
  parser_->t = t;
  return parser_->parser.Eval();
}

const std::string& Expression::formula() const { return parser_->formula; }

} // namespace undine
