// Every `new` of the program, of all its threads, is counted. Include it in one source of a test program of
// its own.
#pragma once

#include <atomic>
#include <cstdlib>
#include <new>

namespace
{
std::atomic<long> allocations{0};

void* counted(std::size_t size, std::size_t alignment)
{
  allocations.fetch_add(1, std::memory_order_relaxed);
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
  allocations.fetch_add(1, std::memory_order_relaxed);
  return std::malloc(size);
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, const std::nothrow_t&) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }
void operator delete(void* p, std::align_val_t) noexcept { std::free(p); }
void operator delete(void* p, std::size_t, std::align_val_t) noexcept { std::free(p); }
