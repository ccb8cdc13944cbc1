// Memory of arrays that were let go.
#include "common/large_arrays.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <random>
#include <vector>

using undine::LargeArrays;

namespace
{

constexpr std::size_t MB = std::size_t{1} << 20;

struct Array
{
  unsigned char* begin;
  std::size_t size;
  unsigned char mark;
};

} // namespace

// Truth: what is taken from the system is what was in use at once, at most, and arrays never overlap: each
// keeps the mark it was given while others come and go.
TEST_CASE("arrays that were let go serve the next ones, and memory never exceeds what was in use",
          "[common][unit]")
{
  LargeArrays arrays;
  CHECK(arrays.allocate(8 * MB) == nullptr); // not started
  arrays.start();
  CHECK(arrays.allocate(arrays.least() - 1) == nullptr);
  std::mt19937 random(1);
  std::vector<Array> live;
  std::size_t in_use = 0, most = 0, all = 0;
  const auto let_go = [&](std::size_t k)
  {
    const Array gone = live[k];
    REQUIRE(std::all_of(gone.begin, gone.begin + gone.size, [&](unsigned char c) { return c == gone.mark; }));
    REQUIRE(arrays.release(gone.begin));
    live[k] = live.back();
    live.pop_back();
    in_use -= gone.size;
  };
  for (int turn = 0; turn < 400; ++turn)
  {
    if (!live.empty() && (live.size() > 12 || random() % 2 == 0))
      let_go(random() % live.size());
    const std::size_t size = MB + random() % (3 * MB);
    auto* const begin = static_cast<unsigned char*>(arrays.allocate(size));
    REQUIRE(begin != nullptr);
    CHECK(reinterpret_cast<std::uintptr_t>(begin) % 4096 == 0);
    live.push_back({begin, size, static_cast<unsigned char>(turn)});
    std::memset(begin, turn, size);
    in_use += size;
    all += size;
    most = std::max(most, in_use);
    const auto use = arrays.use();
    CHECK(use.used >= in_use);
    CHECK(use.used + use.kept <= most + 13 * 4096); // pages are whole
  }
  CHECK(arrays.use().asked < all / 2);
  while (!live.empty())
    let_go(0);
  CHECK(arrays.use().used == 0);
  CHECK(arrays.use().kept > 0);
  arrays.return_kept();
  CHECK(arrays.use().kept == 0);
}

TEST_CASE("memory that is not from large arrays is left alone", "[common][unit]")
{
  LargeArrays arrays;
  arrays.start();
  int number = 0;
  void* const page = std::aligned_alloc(4096, 4096);
  CHECK_FALSE(arrays.release(&number));
  CHECK_FALSE(arrays.release(page));
  CHECK_FALSE(arrays.release(nullptr));
  std::free(page);
  void* const ours = arrays.allocate(2 * MB);
  arrays.stop();
  CHECK(arrays.allocate(2 * MB) == nullptr);
  CHECK(arrays.release(ours));
  CHECK_FALSE(arrays.release(ours));
}
