// States in HDF5: written in memory and put on the disk as a whole, so that a full disk is met outside HDF5.
#include "common/io/state_archive.hpp"

#include "common/error.hpp"
#include "common/io/folder.hpp"
#include "common/io/hdf5_handle.hpp"

#include <fmt/format.h>

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
  std::string name;
  Handle access, file;
  Handle intermediate_groups{name, H5Pcreate(H5P_LINK_CREATE), H5Pclose};

  static hid_t in_memory(hid_t access)
  {
    constexpr std::size_t increment = std::size_t{1} << 20; // [bytes] by which the image grows
    H5Pset_fapl_core(access, increment, false);
    return H5Fcreate("state", H5F_ACC_TRUNC, H5P_DEFAULT, access);
  }

  File() // in memory
      : name("the state in memory"), access(name, H5Pcreate(H5P_FILE_ACCESS), H5Pclose),
        file(name, in_memory(access), H5Fclose)
  {
    H5Pset_create_intermediate_group(intermediate_groups, 1);
  }
  explicit File(const std::string& path)
      : name(path), access(name, H5Pcreate(H5P_FILE_ACCESS), H5Pclose),
        file(name, H5Fopen(path.c_str(), H5F_ACC_RDONLY, access), H5Fclose, "cannot be read",
             ExitCode::bad_input_file)
  {
  }
};

StateArchive::StateArchive()
{
  H5dont_atexit();
  const QuietErrors quiet;
  file_ = std::make_unique<File>();
}

StateArchive::StateArchive(const std::string& path) : reading_(true), path_(path)
{
  H5dont_atexit();
  const QuietErrors quiet;
  file_ = std::make_unique<File>(path);
}

StateArchive::~StateArchive() = default;

void StateArchive::save(const std::string& path)
{
  require(!reading_, "an archive that reads is not saved");
  H5Fflush(file_->file, H5F_SCOPE_LOCAL);
  const ssize_t size = H5Fget_file_image(file_->file, nullptr, 0);
  std::string image(size > 0 ? static_cast<std::size_t>(size) : 0, '\0');
  if (size <= 0 || H5Fget_file_image(file_->file, image.data(), image.size()) != size)
    throw Failure(ExitCode::output_failed, fmt::format("{}: cannot be written: {}", path, hdf5_reason()));
  replace_file(path, image, true);
}

void StateArchive::read_back()
{
  require(!reading_ && prefix_.empty(), "an archive is written as a whole, then read back");
  reading_ = true;
  path_ = file_->name;
}

void StateArchive::inside(const std::string& name, const std::function<void()>& visit)
{
  const std::size_t outer = prefix_.size();
  prefix_ += name + "/";
  visit();
  prefix_.resize(outer);
}

void StateArchive::require_size(std::uint64_t in_file, std::uint64_t here) const
{
  if (reading_ && in_file != here)
    throw Failure(ExitCode::bad_input_file,
                  fmt::format("{}: '{}' has {} entries, expected {}: the checkpoint belongs to another case "
                              "or version",
                              path_, prefix_, in_file, here));
}

std::uint64_t StateArchive::rows_of(const std::string& name) const
{
  const QuietErrors quiet;
  const std::string full = prefix_ + name;
  const hid_t set = H5Dopen2(file_->file, full.c_str(), H5P_DEFAULT);
  if (set < 0)
    throw Failure(
        ExitCode::bad_input_file,
        fmt::format("{}: there is no '{}': the checkpoint belongs to another case or version", path_, full));
  const hid_t space = H5Dget_space(set);
  hsize_t shape[2] = {0, 0};
  H5Sget_simple_extent_dims(space, shape, nullptr);
  H5Sclose(space);
  H5Dclose(set);
  return shape[0];
}

void StateArchive::transfer(const std::string& name, StateNumber number, void* data, std::size_t rows,
                            std::size_t row_bytes)
{
  const QuietErrors quiet;
  const std::string full = prefix_ + name;
  const NumberType type = type_of(number);
  const hsize_t shape[2] = {rows, row_bytes / type.bytes};
  if (!reading_)
  {
    const Handle space(full, H5Screate_simple(2, shape, nullptr), H5Sclose);
    const Handle set(full,
                     H5Dcreate2(file_->file, full.c_str(), type.file, space, file_->intermediate_groups,
                                H5P_DEFAULT, H5P_DEFAULT),
                     H5Dclose);
    if (rows > 0 && H5Dwrite(set, type.memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) < 0)
      throw Failure(ExitCode::output_failed, fmt::format("state '{}': {}", full, hdf5_reason()));
    return;
  }
  const auto wrong = [&](const std::string& what)
  {
    throw Failure(
        ExitCode::bad_input_file,
        fmt::format("{}: '{}' {}: the checkpoint belongs to another case or version", path_, full, what));
  };
  if (rows_of(name) != rows)
    wrong("has another size");
  const Handle set(full, H5Dopen2(file_->file, full.c_str(), H5P_DEFAULT), H5Dclose);
  const Handle space(full, H5Dget_space(set), H5Sclose);
  const Handle in_file(full, H5Dget_type(set), H5Tclose);
  hsize_t found[2] = {0, 0};
  H5Sget_simple_extent_dims(space, found, nullptr);
  if (found[1] != shape[1] || H5Tequal(in_file, type.file) <= 0)
    wrong("is of another kind");
  if (rows > 0 && H5Dread(set, type.memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) < 0)
    wrong("cannot be read (" + hdf5_reason() + ")");
}

} // namespace undine
