// Steps of the solid allocate nothing. In its own program: it counts every `new`.
#include "solid_fe/solid.hpp"
#include "tests/solid_fe/fixtures.hpp"
#include "tests/support/counted_new.hpp"

#include <catch2/catch.hpp>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

// Every element in every form, elastic and flowing; the first step may still size arrays, no later one.
TEMPLATE_TEST_CASE_SIG("a step allocates nothing", "[solid][unit]", ((int dim), dim), 2, 3)
{
  for (const std::string law : {"neo_hookean_ln", "j2"})
    for (const ElementType type : element_types<dim>())
      for (const Formulation form : {Formulation::full, Formulation::one_point, Formulation::locking_free})
      {
        const bool simplex = type == ElementType::triangle3 || type == ElementType::tetrahedron4;
        if (simplex && form == Formulation::one_point)
          continue;
        auto config = soft_config(dim, law);
        config.formulation = form;
        if (law == "j2")
          config.material.yield_stress = 1e-3; // [Pa]: every point flows
        Solid<dim> solid(config, distorted_box<dim>(type));
        solid.set_motion(zero_field<dim>(),
                         [](const Vec<dim>& X)
                         {
                           Vec<dim> v;
                           v[0] = 0.1 * X[1] * X[1];
                           return v;
                         });
        const double dt = 0.5 * solid.critical_time_step();
        const auto step = [&]
        {
          solid.predict(dt);
          solid.solve_free_motion(dt);
        };
        for (int k = 0; k < 3; ++k)
          step();
        const long before = allocations;
        for (int k = 0; k < 15; ++k)
          step();
        const long made = allocations - before;
        CAPTURE(law, element_name(type), static_cast<int>(form));
        // Nodal dilatation takes one array of nodal pressures a step, before its loops over elements.
        CHECK(made == (simplex && form == Formulation::locking_free ? 15 : 0));
      }
}
