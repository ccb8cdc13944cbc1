// Memory of large arrays that were let go, for those that come next.
#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <vector>

namespace undine
{

/// Pages that an array of 256 kB or more has had serve the next ones, instead of going back to the system,
/// which would clear new ones page by page: in a remesh, where large arrays come and go, that can take as
/// long as all that is computed. Memory taken from the system never exceeds what was in use at once: what is
/// missing is asked for only after as much of what is kept has been given back. Under Linux; elsewhere, and
/// before start(), nothing is kept.
class LargeArrays
{
public:
  /// Smallest array that counts [B].
  std::size_t least() const { return least_; }

  void start(std::size_t least = std::size_t{1} << 18);
  /// Nothing is allocated any more.
  void stop() { on_ = false; }
  /// No rank is there whose rows could remain untouched (common/parallel/untouched_rows.hpp).
  void all_rows_will_be_touched() { all_rows_ = true; }
  bool all_rows_are_touched() const { return on_ && all_rows_; }

  /// Memory for so many bytes, with anything in it, at the begin of a page; null: too small, off, or none.
  void* allocate(std::size_t bytes) noexcept;
  /// @returns false if it is not from allocate()
  bool release(void* memory) noexcept;
  /// What is kept goes back to the system: before much is allocated that is small.
  void return_kept() noexcept;

  struct Use
  {
    std::size_t used = 0, kept = 0; ///< [B]
    std::size_t asked = 0;          ///< of the system, in all [B]
  };
  Use use() const;

private:
  struct Block
  {
    char* begin = nullptr;
    std::size_t size = 0;
    char* end() const { return begin + size; }
  };

  Block take_kept(std::size_t size);
  void give_back(std::size_t size);

  bool on_ = false, all_rows_ = false;
  std::size_t least_ = SIZE_MAX;
  mutable std::mutex mutex_;
  std::vector<Block> used_, kept_; ///< the latter in the order of their places, none of them adjacent
  std::size_t asked_ = 0;
};

/// Of this process.
LargeArrays& large_arrays();

} // namespace undine
