// States in HDF5: rank 0 lays the file out, every rank puts its rows in their places.
#include "common/io/state_archive.hpp"

#include "common/error.hpp"
#include "common/io/hdf5_handle.hpp"

#include <fmt/format.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

namespace undine
{

namespace
{

struct NumberType
{
  hid_t memory, file;
  std::size_t bytes;
};

NumberType type_of(StateNumber number)
{
  switch (number)
  {
  case StateNumber::f32:
    return {H5T_NATIVE_FLOAT, H5T_IEEE_F32LE, 4};
  case StateNumber::f64:
    return {H5T_NATIVE_DOUBLE, H5T_IEEE_F64LE, 8};
  case StateNumber::i8:
    return {H5T_NATIVE_INT8, H5T_STD_I8LE, 1};
  case StateNumber::i16:
    return {H5T_NATIVE_INT16, H5T_STD_I16LE, 2};
  case StateNumber::i32:
    return {H5T_NATIVE_INT32, H5T_STD_I32LE, 4};
  case StateNumber::i64:
    return {H5T_NATIVE_INT64, H5T_STD_I64LE, 8};
  case StateNumber::u16:
    return {H5T_NATIVE_UINT16, H5T_STD_U16LE, 2};
  case StateNumber::u32:
    return {H5T_NATIVE_UINT32, H5T_STD_U32LE, 4};
  case StateNumber::u64:
    return {H5T_NATIVE_UINT64, H5T_STD_U64LE, 8};
  case StateNumber::u8:
  case StateNumber::bytes:
    break;
  }
  return {H5T_NATIVE_UINT8, H5T_STD_U8LE, 1};
}

} // namespace

struct StateArchive::File
{
  std::string name; ///< in what is said of failures
  Handle access, file;
  Handle intermediate_groups{name, H5Pcreate(H5P_LINK_CREATE), H5Pclose};
  Handle plain{name, H5Pcreate(H5P_DATASET_CREATE), H5Pclose};
  Handle in_place = laid_out(name);

  static hid_t create(hid_t access)
  {
    constexpr std::size_t increment = std::size_t{1} << 20; // [bytes] by which the image grows
    H5Pset_fapl_core(access, increment, false);
    return H5Fcreate("state", H5F_ACC_TRUNC, H5P_DEFAULT, access);
  }
  static hid_t create(hid_t access, const std::string& path)
  {
    H5Pset_file_locking(access, false, true);
    return H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access);
  }

  /// Made anew: in memory, or as the file `path...`.
  template <class... Path>
  explicit File(std::string name_, const Path&... path)
      : name(std::move(name_)), access(name, H5Pcreate(H5P_FILE_ACCESS), H5Pclose),
        file(name, create(access, path...), H5Fclose)
  {
    H5Pset_create_intermediate_group(intermediate_groups, 1);
    H5Pset_obj_track_times(plain, false);
  }
  struct Existing
  {
  };
  static constexpr std::uint64_t bookkeeping = 1 << 16; ///< [bytes] of HDF5 for a dataset, at most
  RowFile* disk = nullptr;                              ///< where the file is, if not in memory

  /// A dataset with room for the rows, on the disk too. @param kind plain or in_place
  Handle make(const std::string& full, StateNumber number, std::size_t rows, std::size_t row_bytes,
              const Handle& kind) const
  {
    const NumberType type = type_of(number);
    const hsize_t shape[2] = {rows, row_bytes / type.bytes};
    hsize_t end = 0;
    if (disk != nullptr && H5Fget_filesize(file, &end) >= 0)
      disk->reserve(end + rows * row_bytes + bookkeeping);
    const Handle space(name, H5Screate_simple(2, shape, nullptr), H5Sclose);
    return {name, H5Dcreate2(file, full.c_str(), type.file, space, intermediate_groups, kind, H5P_DEFAULT),
            H5Dclose};
  }
  File(Existing, const std::string& path)
      : name(path), access(name, H5Pcreate(H5P_FILE_ACCESS), H5Pclose),
        file(name, H5Fopen(path.c_str(), H5F_ACC_RDONLY, access), H5Fclose, "cannot be read",
             ExitCode::bad_input_file)
  {
  }
};

/// A dataset that is read.
struct StateArchive::DataSet
{
  std::string full;
  Handle set;
  hsize_t shape[2] = {0, 0};

  DataSet(const StateArchive& archive, const std::string& name)
      : full(archive.prefix_ + name), set(full, open(archive, full), H5Dclose)
  {
    const Handle space(full, H5Dget_space(set), H5Sclose);
    H5Sget_simple_extent_dims(space, shape, nullptr);
  }
  /// It must be of this kind.
  DataSet(const StateArchive& archive, const std::string& name, StateNumber number, std::size_t rows,
          std::size_t row_bytes)
      : DataSet(archive, name)
  {
    const NumberType type = type_of(number);
    const Handle in_file(full, H5Dget_type(set), H5Tclose);
    if (shape[0] != rows)
      archive.fail_to_read(full, "has another size");
    if (shape[1] != row_bytes / type.bytes || H5Tequal(in_file, type.file) <= 0)
      archive.fail_to_read(full, "is of another kind");
  }

  static hid_t open(const StateArchive& archive, const std::string& full)
  {
    const hid_t set = H5Dopen2(archive.file_->file, full.c_str(), H5P_DEFAULT);
    if (set < 0)
      archive.fail_to_read(full, "is missing");
    return set;
  }
};

StateArchive::StateArchive()
{
  H5dont_atexit();
  const QuietErrors quiet;
  file_ = std::make_unique<File>("the state in memory");
}

StateArchive::StateArchive(const std::string& path) : reading_(true), path_(path)
{
  H5dont_atexit();
  const QuietErrors quiet;
  file_ = std::make_unique<File>(File::Existing{}, path);
}

StateArchive::StateArchive(const std::string& path, const Ranks& ranks) : ranks_(ranks)
{
  H5dont_atexit();
  const auto name = ranks_.of_first(std::vector<char>(path.begin(), path.end()));
  path_.assign(name.begin(), name.end());
  temporary_ = path_ + ".new";
  const QuietErrors quiet;
  if (is_first())
    attempt(
        [&]
        {
          RowFile(temporary_, RowFile::to_create, path_).reserve(File::bookkeeping); // HDF5 has a disk
          file_ = std::make_unique<File>(path_, temporary_);
        });
  ranks_.any(false); // it is there
  attempt(
      [&]
      {
        rows_ = std::make_unique<RowFile>(temporary_, RowFile::to_write, path_);
        if (file_)
          file_->disk = rows_.get();
      });
}

StateArchive::~StateArchive()
{
  if (temporary_.empty() || !is_first())
    return;
  const QuietErrors quiet;
  file_.reset();
  std::remove(temporary_.c_str()); // of a file that was not saved
}

/// What fails while a file is written is said by save(), so that no rank leaves the others waiting.
template <class Work>
void StateArchive::attempt(Work&& work)
{
  if (in_memory())
    return work();
  if (!failure_.empty())
    return;
  try
  {
    work();
  }
  catch (const Failure& f)
  {
    failure_ = f.what();
  }
}

void StateArchive::save()
{
  require(!temporary_.empty(), "only an archive that writes a file is saved");
  const QuietErrors quiet;
  together(ranks_,
           [&]
           {
             attempt([&] { rows_->to_disk(); });
             if (!failure_.empty())
               throw Failure(ExitCode::output_failed, failure_);
           });
  together(ranks_,
           [&]
           {
             if (!is_first())
               return;
             file_->file.close();
             rows_->to_disk();
             if (std::rename(temporary_.c_str(), path_.c_str()) != 0)
               throw Failure(ExitCode::output_failed,
                             fmt::format("{}: cannot be written: {}", path_, std::strerror(errno)));
             temporary_.clear();
           });
}

void StateArchive::read_back()
{
  require(!reading_ && in_memory() && prefix_.empty(), "a state in memory is written as a whole, then read");
  reading_ = true;
}

void StateArchive::inside(const std::string& name, const std::function<void()>& visit)
{
  const std::size_t outer = prefix_.size();
  prefix_ += name + "/";
  visit();
  prefix_.resize(outer);
}

void StateArchive::fail_to_read(const std::string& full, const std::string& what) const
{
  throw Failure(
      ExitCode::bad_input_file,
      fmt::format("{}: '{}' {}: the checkpoint belongs to another case or version", file_->name, full, what));
}

void StateArchive::require_size(std::uint64_t in_file, std::uint64_t here) const
{
  if (reading_ && in_file != here)
    fail_to_read(prefix_, fmt::format("has {} entries, expected {}", in_file, here));
}

std::uint64_t StateArchive::rows_of(const std::string& name) const
{
  const QuietErrors quiet;
  return DataSet(*this, name).shape[0];
}

void StateArchive::transfer(const std::string& name, StateNumber number, void* data, std::size_t rows,
                            std::size_t row_bytes)
{
  const QuietErrors quiet;
  const NumberType type = type_of(number);
  if (reading_)
  {
    const DataSet set(*this, name, number, rows, row_bytes);
    if (rows > 0 && H5Dread(set.set, type.memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) < 0)
      fail_to_read(set.full, "cannot be read (" + hdf5_reason() + ")");
    return;
  }
  if (!is_first())
    return;
  attempt(
      [&]
      {
        const std::string full = prefix_ + name;
        const Handle set = file_->make(full, number, rows, row_bytes, file_->plain);
        if (rows > 0 && H5Dwrite(set, type.memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) < 0)
          throw Failure(ExitCode::output_failed,
                        fmt::format("{}: cannot be written: {}", file_->name, hdf5_reason()));
      });
}

/// Rank 0 lays the array out, every rank puts its rows in their places.
void StateArchive::put(const std::string& name, StateNumber number, std::span<const std::byte> data,
                       std::size_t rows, std::size_t row_bytes, std::span<const RowRun> runs)
{
  const QuietErrors quiet;
  std::vector<std::uint64_t> begin; // first byte in the file; nothing: there are no rows, or no room for them
  if (is_first())
    attempt(
        [&]
        {
          const Handle set = file_->make(prefix_ + name, number, rows, row_bytes, file_->in_place);
          if (const haddr_t offset = H5Dget_offset(set); offset != HADDR_UNDEF)
            begin.push_back(offset);
        });
  begin = ranks_.of_first(begin);
  if (!begin.empty())
    attempt([&] { rows_->write(data, row_bytes, begin.front(), runs); });
}

/// This rank's rows of an array.
void StateArchive::get(const std::string& name, StateNumber number, std::span<std::byte> data,
                       std::size_t rows, std::size_t row_bytes, std::span<const RowRun> runs)
{
  const QuietErrors quiet;
  const DataSet set(*this, name, number, rows, row_bytes);
  if (runs.empty() || rows == 0)
    return;
  const haddr_t begin = H5Dget_offset(set.set);
  if (begin == HADDR_UNDEF)
    fail_to_read(set.full, "is not in one piece");
  if (!rows_)
    rows_ = std::make_unique<RowFile>(path_, RowFile::to_read);
  rows_->read(data, row_bytes, begin, runs);
}

} // namespace undine
