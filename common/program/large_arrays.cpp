// operator new and delete of the programs that recycle large arrays; sanitizers have their own.
#include "common/program/large_arrays.hpp"

#include "common/large_arrays.hpp"

#include <cstdlib>
#include <new>
#if defined(__GLIBC__)
#include <malloc.h>
#endif

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

void* operator new(std::size_t bytes)
{
  if (bytes >= undine::large_arrays().least())
    if (void* const memory = undine::large_arrays().allocate(bytes))
      return memory;
  for (;;)
  {
    if (void* const memory = std::malloc(bytes == 0 ? 1 : bytes))
      return memory;
    if (const std::new_handler handler = std::get_new_handler())
      handler();
    else
      throw std::bad_alloc();
  }
}

void operator delete(void* memory) noexcept
{
  if (!undine::large_arrays().release(memory))
    std::free(memory);
}

void operator delete(void* memory, std::size_t bytes) noexcept
{
  if (bytes < undine::large_arrays().least() || !undine::large_arrays().release(memory))
    std::free(memory);
}

#endif

namespace undine
{

void recycle_large_arrays()
{
#if defined(__GLIBC__)
  mallopt(M_MMAP_THRESHOLD, 1 << 20); // what C code lets go
#endif
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  large_arrays().start();
#endif
}

} // namespace undine
