// Functions of place and time that a case writes as text, evaluated by muParser.
#pragma once

#include "common/tensor.hpp"

#include <memory>
#include <string>
#include <vector>

namespace undine::solid
{

/// A vector of formulas in x, y, z [m] and t [s], such as "0.1*sin(2*pi*t)". Movable; evaluation is not
/// thread safe.
class FieldFunction
{
public:
  FieldFunction() = default;
  /// @throws InputError with muParser's words if a formula cannot be understood; `key` names it
  FieldFunction(const std::vector<std::string>& formulas, const std::string& key);

  bool empty() const { return parsers_ == nullptr; }
  std::size_t size() const;
  /// Value of formula k at X and t.
  template <int dim>
  double operator()(std::size_t k, const Vec<dim>& X, double t) const
  {
    return evaluate(k, X[0], X[1], dim == 3 ? X[dim - 1] : 0.0, t);
  }
  template <int dim>
  Vec<dim> vector(const Vec<dim>& X, double t) const
  {
    Vec<dim> value;
    for (int i = 0; i < dim; ++i)
      value[i] = (*this)(static_cast<std::size_t>(i), X, t);
    return value;
  }

private:
  struct Parsers; // muParser stays behind field_function.cpp
  double evaluate(std::size_t k, double x, double y, double z, double t) const;
  std::shared_ptr<Parsers> parsers_;
};

} // namespace undine::solid
