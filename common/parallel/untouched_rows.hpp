// Arrays of which a rank uses some rows only.
#pragma once

#include "common/large_arrays.hpp"
#include "common/types.hpp"

#if defined(__linux__)
#include <sys/mman.h>
#include <unistd.h>
#endif

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <new>
#include <span>
#include <utility>
#include <vector>

namespace undine
{

/// Memory that nobody writes when rows are added: they hold anything. On several ranks large memory takes
/// none of the machine's until it is written: the rows of others cost nothing as long as nobody touches them.
/// @tparam for_all there are rows for all ranks; else all will be touched, and their memory may be recycled
template <class T, bool for_all>
struct UntouchedMemory
{
  using value_type = T;
  template <class U>
  struct rebind
  {
    using other = UntouchedMemory<U, for_all>;
  };

  UntouchedMemory() = default;
  template <class U>
  UntouchedMemory(const UntouchedMemory<U, for_all>&) noexcept
  {
  }
  template <class U>
  bool operator==(const UntouchedMemory<U, for_all>&) const noexcept
  {
    return true;
  }

  T* allocate(std::size_t n)
  {
    constexpr std::size_t before = alignof(T) + sizeof(void*);
    void* whole = nullptr;
    if (const std::size_t bytes = n * sizeof(T) + before; n <= (SIZE_MAX - before) / sizeof(T))
    {
      if (!for_all || large_arrays().all_rows_are_touched())
        whole = large_arrays().allocate(bytes);
      if (whole == nullptr)
        whole = std::calloc(bytes, 1);
    }
    if (whole == nullptr)
      throw std::bad_alloc();
    const auto first = reinterpret_cast<std::uintptr_t>(whole) + sizeof(void*);
    auto* const rows = reinterpret_cast<void*>((first + alignof(T) - 1) / alignof(T) * alignof(T));
    static_cast<void**>(rows)[-1] = whole;
    return static_cast<T*>(rows);
  }
  void deallocate(T* rows, std::size_t) noexcept
  {
    if (void* const whole = reinterpret_cast<void**>(rows)[-1]; !large_arrays().release(whole))
      std::free(whole);
  }

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

/// resize() writes nothing: the rows that it adds hold anything.
template <class T>
using UntouchedRows = std::vector<T, UntouchedMemory<T, true>>;
/// The same of rows that are all this rank's.
template <class T>
using UnwrittenRows = std::vector<T, UntouchedMemory<T, false>>;

/// Rows [begin, end) of an array, whose values are not needed any more, take no memory until they are written
/// again; until then those on whole pages are zero. Elsewhere than under Linux nothing is done.
template <class Array>
void give_back(Array& rows, std::size_t begin, std::size_t end)
{
#if defined(__linux__)
  static const auto page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
  const auto first = (reinterpret_cast<std::uintptr_t>(rows.data() + begin) + page - 1) / page * page,
             last = reinterpret_cast<std::uintptr_t>(rows.data() + end) / page * page;
  if (first < last)
    madvise(reinterpret_cast<void*>(first), last - first, MADV_DONTNEED);
#endif
}

/// Ranges [begin, end) that hold all of some rows, whose numbers ascend, and little else.
inline std::vector<std::array<index_t, 2>> ranges_of(std::span<const index_t> numbers)
{
  constexpr index_t little = 1024;
  std::vector<std::array<index_t, 2>> ranges;
  for (const index_t n : numbers)
    if (!ranges.empty() && n < ranges.back()[1] + little)
      ranges.back()[1] = n + 1;
    else
      ranges.push_back({n, n + 1});
  return ranges;
}

/// The same of all rows that lie in none of the ranges.
template <class Array>
void give_back_others(Array& rows, std::span<const std::array<index_t, 2>> ranges)
{
  std::size_t from = 0;
  for (const auto& [begin, end] : ranges)
  {
    if (const std::size_t to = std::min(static_cast<std::size_t>(begin), rows.size()); from < to)
      give_back(rows, from, to);
    from = static_cast<std::size_t>(end);
  }
  if (from < rows.size())
    give_back(rows, from, rows.size());
}

} // namespace undine
