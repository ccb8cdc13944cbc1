// Loops that threads share.
#include "common/parallel/in_parts.hpp"

#include <catch2/catch.hpp>

#include <cstddef>
#include <numeric>
#include <vector>

using namespace undine;

// Truth: each item once, parts in order, each but the first at a multiple of the unit.
TEST_CASE("parts of a loop are the whole, and lists of parts are the list", "[common][unit]")
{
  for (const std::size_t n : {0, 1, 511, 512, 1025, 5000, 100003})
    for (const int threads : {1, 2, 3, 8})
    {
      CAPTURE(n, threads);
      std::vector<int> count(n, 0);
      const int parts = in_parts(threads, n, 8,
                                 [&](int, std::size_t begin, std::size_t end)
                                 {
                                   for (std::size_t k = begin; k < end; ++k)
                                     count[k] += begin % 8 == 0;
                                 });
      CHECK(count == std::vector<int>(n, 1));
      CHECK(parts == (n / 512 < static_cast<std::size_t>(threads) ? 1 : threads));
      std::vector<std::size_t> all(n);
      std::iota(all.begin(), all.end(), std::size_t{0});
      const auto list = list_in_parts<std::size_t>(threads, n, n,
                                                   [](auto& list, std::size_t begin, std::size_t end)
                                                   {
                                                     for (std::size_t k = begin; k < end; ++k)
                                                       list.push_back(k);
                                                   });
      CHECK(list == all);
    }
}
