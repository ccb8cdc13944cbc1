// The state of objects by name, to and from a file: one function per class serves both directions.
#pragma once

#include "common/io/row_file.hpp"
#include "common/parallel/ranks.hpp"

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

namespace undine
{

class StateArchive;

/// A class with state of its own: `void for_each_state(StateArchive& archive)` hands every member that a
/// later step depends on to `archive(name, member)`.
template <class T>
concept HasState = requires(T& object, StateArchive& archive)
{
  object.for_each_state(archive);
};

/// What arrays are made of in the file.
enum class StateNumber
{
  f32,
  f64,
  i8,
  i16,
  i32,
  i64,
  u8,
  u16,
  u32,
  u64,
  bytes ///< a plain struct, as it lies in memory
};

namespace state_detail
{

template <class T>
struct Number
{
  using type = std::byte;
};
template <class T>
requires std::is_arithmetic_v<T>
struct Number<T>
{
  using type = T;
};
template <class T>
requires std::is_enum_v<T>
struct Number<T>
{
  using type = std::underlying_type_t<T>;
};
template <class T, std::size_t n>
struct Number<std::array<T, n>> : Number<T>
{
};
template <class T> // Vec and Mat
requires requires(T t) { t.c.size(); }
struct Number<T> : Number<decltype(T::c)>
{
};

template <class T>
constexpr StateNumber number_of()
{
  using N = typename Number<T>::type;
  if constexpr (std::is_same_v<N, std::byte>)
    return StateNumber::bytes;
  else if constexpr (std::is_floating_point_v<N>)
    return sizeof(N) == 4 ? StateNumber::f32 : StateNumber::f64;
  else if constexpr (std::is_signed_v<N>)
    return sizeof(N) == 1   ? StateNumber::i8
           : sizeof(N) == 2 ? StateNumber::i16
           : sizeof(N) == 4 ? StateNumber::i32
                            : StateNumber::i64;
  else
    return sizeof(N) == 1   ? StateNumber::u8
           : sizeof(N) == 2 ? StateNumber::u16
           : sizeof(N) == 4 ? StateNumber::u32
                            : StateNumber::u64;
}

/// std::vector, std::string, Eigen vectors.
template <class T>
concept Array = requires(T& a, std::size_t n)
{
  a.data();
  a.size();
  a.resize(n);
  requires std::is_trivially_copyable_v<std::remove_reference_t<decltype(*a.data())>>;
};

} // namespace state_detail

/// Writes into memory or into one HDF5 file, or reads from either. Numbers keep all their bits.
/// A name that is missing or has another size than the object expects is Failure(bad_input_file): the
/// checkpoint belongs to another case or version. On several ranks a file holds what rank 0 hands over, and
/// of arrays that the ranks share (`rows`, `part`) what each of them puts in its place: the file has the same
/// bytes on any number of ranks, and no rank holds another's rows for it. What is in memory is the rank's
/// own.
class StateArchive
{
public:
  /// An archive that writes into memory, to be read back.
  StateArchive();
  /// An archive that writes a file, which takes the name `path` (that of rank 0) by `save`. Collective, as
  /// are `rows`, `part` and `save` of it.
  StateArchive(const std::string& path, const Ranks& ranks);
  /// An archive that reads `path`. @throws Failure(bad_input_file)
  explicit StateArchive(const std::string& path);
  ~StateArchive();
  StateArchive(const StateArchive&) = delete;
  StateArchive& operator=(const StateArchive&) = delete;

  bool reading() const { return reading_; }
  bool in_memory() const { return path_.empty(); }
  /// What was written into memory is read from now on.
  void read_back();
  /// Everything was handed over: the file is complete, through to the disk, and replaces one of its name.
  /// @throws Failure(output_failed) on all ranks, also for what failed before; then there is no new file
  void save();

  /// Hand over one member: a number, an array (which takes the size that was written), a class with
  /// for_each_state, or a std::vector, std::array or std::optional of these.
  template <class T>
  void operator()(const std::string& name, T& value)
  {
    using namespace state_detail;
    if constexpr (HasState<T>)
      inside(name, [&] { value.for_each_state(*this); });
    else if constexpr (Array<T>)
    {
      using Item = std::remove_reference_t<decltype(*value.data())>;
      if (reading_)
        value.resize(static_cast<std::size_t>(rows_of(name)));
      transfer(name, number_of<Item>(), value.data(), static_cast<std::size_t>(value.size()), sizeof(Item));
    }
    else if constexpr (std::is_trivially_copyable_v<T>)
      transfer(name, number_of<T>(), &value, 1, sizeof(T));
    else
      each(name, value);
  }

  /// Hand over an array that has room for the rows of all ranks, or is empty on all: its rows `own` go to
  /// the file from here. What is read has them all.
  template <class T, class Memory>
  void rows(const std::string& name, std::vector<T, Memory>& all, std::span<const RowRun> own)
  {
    if (reading_ || in_memory())
      (*this)(name, all);
    else
      put(name, state_detail::number_of<T>(), std::as_bytes(std::span(all)), all.size(), sizeof(T),
          all.empty() ? std::span<const RowRun>{} : own);
  }
  /// Hand over an array that holds some of the `total` rows of all ranks: those in `runs` go to the file from
  /// here, or come from it.
  template <class T>
  void part(const std::string& name, std::vector<T>& some, std::size_t total, std::span<const RowRun> runs)
  {
    const StateNumber number = state_detail::number_of<T>();
    if (in_memory())
      (*this)(name, some);
    else if (reading_)
      get(name, number, std::as_writable_bytes(std::span(some)), total, sizeof(T), runs);
    else
      put(name, number, std::as_bytes(std::span(some)), total, sizeof(T), runs);
  }

private:
  template <class T>
  void each(const std::string& name, std::vector<T>& list)
  {
    inside(name,
           [&]
           {
             std::uint64_t size = list.size();
             (*this)("size", size);
             if constexpr (std::is_default_constructible_v<T>)
               list.resize(static_cast<std::size_t>(size));
             else
               require_size(size, list.size());
             for (std::size_t k = 0; k < list.size(); ++k)
               (*this)(std::to_string(k), list[k]);
           });
  }
  /// Lists of numbers for each of many: one array, and the sizes.
  template <class T>
  requires std::is_trivially_copyable_v<T>
  void each(const std::string& name, std::vector<std::vector<T>>& lists)
  {
    std::vector<std::uint64_t> size;
    std::vector<T> all;
    for (const auto& list : lists)
    {
      size.push_back(list.size());
      all.insert(all.end(), list.begin(), list.end());
    }
    inside(name,
           [&]
           {
             (*this)("sizes", size);
             (*this)("all", all);
           });
    if (!reading_)
      return;
    lists.clear();
    auto from = all.begin();
    for (const std::uint64_t n : size)
    {
      lists.emplace_back(from, from + static_cast<std::ptrdiff_t>(n));
      from += static_cast<std::ptrdiff_t>(n);
    }
  }
  template <class T, std::size_t n>
  void each(const std::string& name, std::array<T, n>& list)
  {
    inside(name,
           [&]
           {
             for (std::size_t k = 0; k < n; ++k)
               (*this)(std::to_string(k), list[k]);
           });
  }
  template <class T>
  void each(const std::string& name, std::optional<T>& value)
  {
    inside(name,
           [&]
           {
             bool present = value.has_value();
             (*this)("present", present);
             if (reading_ && present != value.has_value())
             {
               if constexpr (std::is_default_constructible_v<T>)
                 present ? static_cast<void>(value.emplace()) : value.reset();
               else
                 require_size(present, value.has_value());
             }
             if (value)
               (*this)("value", *value);
           });
  }
  template <class T>
  void each(const std::string& name, std::unique_ptr<T>& object)
  {
    (*this)(name, *object);
  }

  void inside(const std::string& name, const std::function<void()>& visit);
  void require_size(std::uint64_t in_file, std::uint64_t here) const;
  std::uint64_t rows_of(const std::string& name) const;
  void transfer(const std::string& name, StateNumber number, void* data, std::size_t rows,
                std::size_t row_bytes);
  void put(const std::string& name, StateNumber number, std::span<const std::byte> data, std::size_t rows,
           std::size_t row_bytes, std::span<const RowRun> runs);
  void get(const std::string& name, StateNumber number, std::span<std::byte> data, std::size_t rows,
           std::size_t row_bytes, std::span<const RowRun> runs);
  [[noreturn]] void fail_to_read(const std::string& full, const std::string& what) const;
  template <class Work>
  void attempt(Work&& work);
  bool is_first() const { return ranks_.rank() == 0; }

  struct File;
  struct DataSet;
  std::unique_ptr<File> file_; ///< on rank 0, and where it is read
  Ranks ranks_;
  bool reading_ = false;
  std::string path_;              ///< empty: in memory
  std::string temporary_;         ///< where it is written
  std::unique_ptr<RowFile> rows_; ///< the same file, for rows of this rank
  std::string failure_;           ///< of what was to be written
  std::string prefix_;            ///< names of the objects around, each with a slash
};

} // namespace undine
