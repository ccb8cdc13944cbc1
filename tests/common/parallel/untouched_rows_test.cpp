// Rows that nobody writes.
#include "common/parallel/untouched_rows.hpp"

#include <catch2/catch.hpp>

#include <array>
#include <cstdint>
#include <fstream>
#include <unistd.h>
#include <vector>

using namespace undine;

namespace
{

/// Memory of this process that is really there [bytes].
double resident()
{
  double size = 0.0, pages = 0.0;
  std::ifstream("/proc/self/statm") >> size >> pages;
  return pages * static_cast<double>(sysconf(_SC_PAGESIZE));
}

struct alignas(64) Row
{
  std::array<double, 8> c;
};

} // namespace

// Truth: the kernel's count. 256 MB are asked for, 1 MB is written; a page or two more at the ends, and what
// the library takes meanwhile.
TEST_CASE("rows that nobody writes take no memory and are zero", "[common][unit]")
{
  [[maybe_unused]] const double before = resident();
  UntouchedRows<Row> rows;
  rows.resize(std::size_t{1} << 22);
  for (std::size_t n = 1000000; n < 1000000 + (1 << 14); ++n)
    rows[n].c[3] = 1.0;
#ifndef __SANITIZE_ADDRESS__ // which marks every byte
  CHECK(resident() - before < 2e6);
#endif
  CHECK(rows[3000000].c[7] == 0.0);
  CHECK(rows[1000001].c[3] == 1.0);
}

// Truth as above: of 64 MB that were written 1.3 stay, in two ranges that numbers near each other make.
TEST_CASE("rows that are given back take no memory, others keep their values", "[common][unit]")
{
  std::vector<Row> rows(std::size_t{1} << 20, Row{{1.0, 2.0}});
  std::vector<index_t> numbers;
  for (index_t n = 300000; n < 310000; n += 7)
    numbers.push_back(n);
  for (index_t n = 700000; n < 710000; n += 1000)
    numbers.push_back(n);
  const auto ranges = ranges_of(numbers);
  CHECK(ranges == std::vector<std::array<index_t, 2>>{{300000, numbers[1428] + 1}, {700000, 709001}});
  [[maybe_unused]] const double before = resident();
  give_back_others(rows, ranges);
#ifdef __linux__
  CHECK(resident() - before < -64e6);
  CHECK(rows[500000].c[1] == 0.0);
#endif
  for (const index_t n : numbers)
    CHECK(rows[static_cast<std::size_t>(n)].c[1] == 2.0);
}

TEST_CASE("rows lie as their type wants it, few or many, and stay when there are more", "[common][unit]")
{
  UntouchedRows<Row> rows;
  for (int n = 0; n < 100; ++n)
  {
    rows.push_back({{double(n)}});
    CHECK(reinterpret_cast<std::uintptr_t>(rows.data()) % alignof(Row) == 0);
  }
  rows.resize(10000);
  CHECK(rows[99].c[0] == 99.0);
  CHECK(rows[9999].c[0] == 0.0);
  const UntouchedRows<Row> copy = rows;
  CHECK(copy[98].c[0] == 98.0);
}
