// Loops that the threads of a rank share.
#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace undine
{

/// act(part, begin, end) for consecutive parts of [0, n), about equally long, at once: as many as there are
/// threads, one where it is not worth it. They have ended on return; no exception may leave `act`.
/// @param unit all parts begin at a multiple of it
/// @returns the number of parts
template <class Act>
int in_parts(int threads, std::size_t n, std::size_t unit, Act&& act)
{
  constexpr std::size_t worth_a_thread = 512;
  const int parts = n / worth_a_thread < static_cast<std::size_t>(threads) ? 1 : threads;
  if (parts == 1)
  {
    act(0, std::size_t{0}, n);
    return 1;
  }
  const std::size_t units = (n + unit - 1) / unit;
  const auto cut = [&](int part)
  { return std::min(n, units * static_cast<std::size_t>(part) / static_cast<std::size_t>(parts) * unit); };
#pragma omp parallel for num_threads(parts) schedule(static, 1)
  for (int part = 0; part < parts; ++part)
    act(part, cut(part), cut(part + 1));
  return parts;
}

template <class Act>
int in_parts(int threads, std::size_t n, Act&& act)
{
  return in_parts(threads, n, 1, std::forward<Act>(act));
}

/// What act(list, begin, end) appends to the lists of the parts of [0, n), in the order of the parts: the
/// same for any number of threads.
/// @param most a list may come to have that many; 0: unknown
template <class T, class Act>
std::vector<T> list_in_parts(int threads, std::size_t n, std::size_t most, Act&& act)
{
  std::vector<std::vector<T>> lists(static_cast<std::size_t>(threads));
  lists[0].reserve(most); // takes no memory before it is written
  const int parts = in_parts(threads, n,
                             [&](int part, std::size_t begin, std::size_t end)
                             {
                               auto& list = lists[static_cast<std::size_t>(part)];
                               if (part > 0)
                                 list.reserve(most / n * (end - begin));
                               act(list, begin, end);
                             });
  for (int part = 1; part < parts; ++part)
  {
    auto& list = lists[static_cast<std::size_t>(part)];
    lists[0].insert(lists[0].end(), list.begin(), list.end());
    list = std::vector<T>();
  }
  return std::move(lists[0]);
}

} // namespace undine
