// Arrays of which a rank uses some rows only.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <new>
#include <utility>
#include <vector>

namespace undine
{

/// Memory that nobody has written is zero, and large memory takes none of the machine's until it is written:
/// the rows of other ranks cost nothing as long as nobody touches them.
template <class T>
struct UntouchedMemory
{
  using value_type = T;

  UntouchedMemory() = default;
  template <class U>
  UntouchedMemory(const UntouchedMemory<U>&) noexcept
  {
  }
  template <class U>
  bool operator==(const UntouchedMemory<U>&) const noexcept
  {
    return true;
  }

  T* allocate(std::size_t n)
  {
    constexpr std::size_t before = alignof(T) + sizeof(void*);
    void* const whole =
        n > (SIZE_MAX - before) / sizeof(T) ? nullptr : std::calloc(n * sizeof(T) + before, 1);
    if (whole == nullptr)
      throw std::bad_alloc();
    const auto first = reinterpret_cast<std::uintptr_t>(whole) + sizeof(void*);
    auto* const rows = reinterpret_cast<void*>((first + alignof(T) - 1) / alignof(T) * alignof(T));
    static_cast<void**>(rows)[-1] = whole;
    return static_cast<T*>(rows);
  }
  void deallocate(T* rows, std::size_t) noexcept { std::free(reinterpret_cast<void**>(rows)[-1]); }

  template <class U>
  void construct(U*) noexcept // stays as it is
  {
  }
  template <class U, class... Arguments>
  void construct(U* row, Arguments&&... arguments)
  {
    ::new (static_cast<void*>(row)) U(std::forward<Arguments>(arguments)...);
  }
};

/// resize() writes nothing: rows of a new array are zero, others may be what was there before.
template <class T>
using UntouchedRows = std::vector<T, UntouchedMemory<T>>;

} // namespace undine
