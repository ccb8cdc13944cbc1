// Pages cut off, joined and moved, not copied.
#include "common/large_arrays.hpp"

#if defined(__linux__)
#include <sys/mman.h>
#include <unistd.h>
#endif

#include <algorithm>
#include <cstdint>
#include <exception>
#include <numeric>

namespace undine
{

namespace
{

union Forever // operator new asks for it before main, operator delete after
{
  LargeArrays arrays;
  constexpr Forever() : arrays() {}
  ~Forever() {}
};

constinit Forever of_process;

} // namespace

LargeArrays& large_arrays() { return of_process.arrays; }

void LargeArrays::start(std::size_t least)
{
  constexpr std::size_t many = 1024; // lists that grow later would lie behind what is small, and keep it
  used_.reserve(many);
  kept_.reserve(many);
  least_ = least;
  on_ = true;
}

#if defined(__linux__)

namespace
{

std::size_t whole_pages(std::size_t bytes)
{
  static const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  return (bytes + page - 1) / page * page;
}

} // namespace

void* LargeArrays::allocate(std::size_t bytes) noexcept
try
{
  if (!on_ || bytes < least_ || bytes > SIZE_MAX / 2)
    return nullptr;
  const std::size_t size = whole_pages(bytes);
  const std::lock_guard lock(mutex_);
  for (auto* const list : {&used_, &kept_}) // nothing below, nor a release, has to ask for more
    if (const std::size_t most = kept_.size() + used_.size() + 2; list->capacity() < most)
      list->reserve(2 * most);
  Block block = take_kept(size);
  if (block.size < size)
  {
    give_back(size - block.size);
    void* whole = MAP_FAILED;
    if (block.size > 0)
    {
      whole = mremap(block.begin, block.size, size, MREMAP_MAYMOVE);
      if (whole == MAP_FAILED) // of two mappings
        munmap(block.begin, block.size);
    }
    if (whole == MAP_FAILED)
    {
      block.size = 0;
      whole = mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    }
    if (whole == MAP_FAILED)
      return nullptr;
    asked_ += size - block.size;
    block = {static_cast<char*>(whole), size};
  }
  used_.push_back(block);
  return block.begin;
}
catch (const std::exception&)
{
  return nullptr;
}

/// The smallest block that is large enough, or else the largest, not more of it than asked for.
LargeArrays::Block LargeArrays::take_kept(std::size_t size)
{
  auto best = kept_.begin();
  for (auto it = kept_.begin(); it != kept_.end(); ++it)
    if (best->size < size ? it->size > best->size : it->size >= size && it->size < best->size)
      best = it;
  if (best == kept_.end())
    return {};
  const Block block{best->begin, std::min(best->size, size)};
  *best = {block.end(), best->size - block.size};
  if (best->size == 0)
    kept_.erase(best);
  return block;
}

/// So many bytes of what is kept, if there are, go back to the system: the smallest blocks first.
void LargeArrays::give_back(std::size_t size)
{
  while (size > 0 && !kept_.empty())
  {
    const auto least_one = std::min_element(kept_.begin(), kept_.end(),
                                            [](const Block& a, const Block& b) { return a.size < b.size; });
    const std::size_t part = std::min(size, least_one->size);
    munmap(least_one->begin, part);
    *least_one = {least_one->begin + part, least_one->size - part};
    size -= part;
    if (least_one->size == 0)
      kept_.erase(least_one);
  }
}

bool LargeArrays::release(void* memory) noexcept
{
  if (memory == nullptr || reinterpret_cast<std::uintptr_t>(memory) % whole_pages(1) != 0)
    return false;
  const std::lock_guard lock(mutex_);
  const auto found = std::find_if(used_.begin(), used_.end(),
                                  [memory](const Block& block) { return block.begin == memory; });
  if (found == used_.end())
    return false;
  const Block block = *found;
  *found = used_.back();
  used_.pop_back();
  auto next = std::lower_bound(kept_.begin(), kept_.end(), block.begin,
                               [](const Block& kept, const char* begin) { return kept.begin < begin; });
  if (next != kept_.begin() && (next - 1)->end() == block.begin)
  {
    --next;
    next->size += block.size;
  }
  else if (next != kept_.end() && block.end() == next->begin)
    *next = {block.begin, block.size + next->size};
  else
    next = kept_.insert(next, block);
  if (next + 1 != kept_.end() && next->end() == (next + 1)->begin)
  {
    next->size += (next + 1)->size;
    kept_.erase(next + 1);
  }
  return true;
}

void LargeArrays::return_kept() noexcept
{
  const std::lock_guard lock(mutex_);
  give_back(SIZE_MAX);
}

#else

void* LargeArrays::allocate(std::size_t) noexcept { return nullptr; }
bool LargeArrays::release(void*) noexcept { return false; }
void LargeArrays::return_kept() noexcept {}

#endif

LargeArrays::Use LargeArrays::use() const
{
  const std::lock_guard lock(mutex_);
  const auto sum = [](const std::vector<Block>& blocks)
  {
    return std::accumulate(blocks.begin(), blocks.end(), std::size_t{0},
                           [](std::size_t sum, const Block& block) { return sum + block.size; });
  };
  return {.used = sum(used_), .kept = sum(kept_), .asked = asked_};
}

} // namespace undine
