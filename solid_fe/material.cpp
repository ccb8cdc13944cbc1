// Choice of the constitutive law by its name.
#include "solid_fe/material.hpp"

#include "common/config/case_file.hpp"
#include "common/error.hpp"

#include <utility>

namespace undine::solid
{

namespace
{

template <std::size_t k = 0>
void append_names(std::vector<std::string>& names)
{
  if constexpr (k < std::variant_size_v<Material>)
  {
    names.emplace_back(std::variant_alternative_t<k, Material>::name);
    append_names<k + 1>(names);
  }
}

template <std::size_t k = 0>
Material make_named(std::string_view name, const MaterialConfig& config)
{
  if constexpr (k < std::variant_size_v<Material>)
  {
    using Law = std::variant_alternative_t<k, Material>;
    if (name == Law::name)
    {
      if constexpr (requires { Law::from(config); })
        return Law::from(config);
      else
        return Law{elastic_constants(config.youngs_modulus, config.poisson_ratio)};
    }
    return make_named<k + 1>(name, config);
  }
  else
    throw InputError("solid.law = \"" + std::string(name) + "\": no such law");
}

} // namespace

std::vector<std::string> law_names()
{
  std::vector<std::string> names;
  append_names(names);
  return names;
}

Material make_material(const MaterialConfig& config) { return make_named(config.law, config); }

} // namespace undine::solid
