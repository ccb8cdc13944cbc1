// The one place that knows muParser.
#include "solid_fe/field_function.hpp"

#include "common/error.hpp"

#include <muParser.h>

#include <numbers>

namespace undine::solid
{

struct FieldFunction::Parsers
{
  double x = 0.0, y = 0.0, z = 0.0, t = 0.0;
  std::vector<mu::Parser> parser;
};

FieldFunction::FieldFunction(const std::vector<std::string>& formulas, const std::string& key)
{
  if (formulas.empty())
    return;
  parsers_ = std::make_shared<Parsers>();
  for (const auto& formula : formulas)
  {
    auto& parser = parsers_->parser.emplace_back();
    try
    {
      parser.DefineVar("x", &parsers_->x);
      parser.DefineVar("y", &parsers_->y);
      parser.DefineVar("z", &parsers_->z);
      parser.DefineVar("t", &parsers_->t);
      parser.DefineConst("pi", std::numbers::pi);
      parser.SetExpr(formula);
      parser.Eval();
    }
    catch (const mu::Parser::exception_type& error)
    {
      throw InputError(key + " = \"" + formula + "\": " + error.GetMsg() +
                       "; a formula may use x, y, z, t, pi");
    }
  }
}

std::size_t FieldFunction::size() const { return parsers_ == nullptr ? 0 : parsers_->parser.size(); }

double FieldFunction::evaluate(std::size_t k, double x, double y, double z, double t) const
{
  parsers_->x = x;
  parsers_->y = y;
  parsers_->z = z;
  parsers_->t = t;
  return parsers_->parser[k].Eval();
}

} // namespace undine::solid
