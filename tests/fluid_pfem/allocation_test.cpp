// Steps between two remeshes allocate nothing. In its own program: it counts every `new`.
#include "fluid_pfem/fluid.hpp"
#include "tests/fluid_pfem/fixtures.hpp"

#include <catch2/catch.hpp>

#include <cstdlib>
#include <new>

namespace
{
long allocations = 0;

void* counted(std::size_t size, std::size_t alignment)
{
  ++allocations;
  const std::size_t rounded = (size + alignment - 1) / alignment * alignment;
  if (void* p = alignment > 16 ? std::aligned_alloc(alignment, rounded) : std::malloc(size))
    return p;
  throw std::bad_alloc();
}
} // namespace

void* operator new(std::size_t size) { return counted(size, 16); }
void* operator new(std::size_t size, std::align_val_t alignment)
{
  return counted(size, static_cast<std::size_t>(alignment));
}
void* operator new(std::size_t size,
                   const std::nothrow_t&) noexcept // Catch uses it; new and delete must match
{
  ++allocations;
  return std::malloc(size);
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, const std::nothrow_t&) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }
void operator delete(void* p, std::align_val_t) noexcept { std::free(p); }
void operator delete(void* p, std::size_t, std::align_val_t) noexcept { std::free(p); }

using namespace undine::fluid;

// A falling column in its tank: the first step and the first bound may still size arrays, no later one.
TEST_CASE("a step, its bound and the look at the mesh allocate nothing", "[fluid][unit]")
{
  Fluid<2> fluid(undine::test::dam_break_config(0.146 / 10.0));
  const double dt = fluid.critical_time_step();
  const auto step = [&]
  {
    fluid.predict(dt);
    fluid.solve_free_motion(dt);
  };
  for (int k = 0; k < 3; ++k)
    step();
  const long before = allocations;
  bool distorted = false;
  double bound = 0.0;
  for (int k = 0; k < 15; ++k)
  {
    step();
    bound += fluid.critical_time_step();
    distorted = fluid.is_distorted() || distorted;
  }
  CHECK(bound > 0.0);
  CHECK(!distorted);
  CHECK(allocations - before == 0);
}
