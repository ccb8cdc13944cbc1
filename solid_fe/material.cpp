// Choice of the constitutive law by its name.
#include "solid_fe/material.hpp"

#include "common/config/case_file.hpp"
#include "common/error.hpp"
#include "solid_fe/materials/plane_stress.hpp"

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

template <class Law>
struct Type
{
};

/// use(Type<Law>) of the law of that name.
template <std::size_t k = 0, class Use>
auto with_law(std::string_view name, Use&& use)
{
  using Law = std::variant_alternative_t<k, Material>;
  if (name == Law::name)
    return use(Type<Law>{});
  if constexpr (k + 1 < std::variant_size_v<Material>)
    return with_law<k + 1>(name, use);
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

bool remembers(const Material& material)
{
  return std::visit([]<class Law>(const Law&) { return history_size<Law>(3) > 0; }, material);
}

std::vector<LawKey> law_keys(std::string_view law)
{
  return with_law(law,
                  []<class Law>(Type<Law>) -> std::vector<LawKey>
                  {
                    if constexpr (requires { Law::own_keys; })
                      return {Law::own_keys.begin(), Law::own_keys.end()};
                    else
                      return {};
                  });
}

Material make_material(const MaterialConfig& config)
{
  return with_law(config.law,
                  [&]<class Law>(Type<Law>) -> Material
                  {
                    if constexpr (requires { Law::from(config); })
                      return Law::from(config);
                    else
                      return Law{elastic_constants(config.youngs_modulus, config.poisson_ratio)};
                  });
}

} // namespace undine::solid
