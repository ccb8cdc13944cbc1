// Handles of HDF5 that close themselves, and its errors in words; for the files of common/io only.
#pragma once

#include "common/error.hpp"

#include <fmt/format.h>
#include <hdf5.h>

#include <string>
#include <utility>

namespace undine
{

/// Switches HDF5's own printing of errors off for a while; their text goes into our exceptions.
class QuietErrors
{
public:
  QuietErrors()
  {
    H5Eget_auto2(H5E_DEFAULT, &function_, &data_);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  }
  ~QuietErrors() { H5Eset_auto2(H5E_DEFAULT, function_, data_); }
  QuietErrors(const QuietErrors&) = delete;
  QuietErrors& operator=(const QuietErrors&) = delete;

private:
  H5E_auto2_t function_ = nullptr;
  void* data_ = nullptr;
};

/// The deepest entry of HDF5's error stack, which holds the reason of the operating system.
inline std::string hdf5_reason()
{
  std::string reason;
  H5Ewalk2(
      H5E_DEFAULT, H5E_WALK_UPWARD,
      [](unsigned depth, const H5E_error2_t* error, void* text) -> herr_t
      {
        if (depth == 0 && error->desc != nullptr)
          *static_cast<std::string*>(text) = error->desc;
        return 0;
      },
      &reason);
  return reason.empty() ? "HDF5 gives no reason" : reason;
}

/// An HDF5 handle that closes itself. Closing may fail (a full disk is noticed late): call `close` where that
/// counts.
class Handle
{
public:
  using Closer = herr_t (*)(hid_t);
  Handle(const std::string& path, hid_t id, Closer closer, const char* failing = "cannot be written",
         ExitCode code = ExitCode::output_failed)
      : path_(path), id_(id), closer_(closer)
  {
    if (id_ < 0)
      throw Failure(code, fmt::format("{}: {}: {}", path_, failing, hdf5_reason()));
  }
  ~Handle()
  {
    if (id_ >= 0)
      closer_(id_);
  }
  Handle(Handle&& other) : path_(other.path_), id_(std::exchange(other.id_, -1)), closer_(other.closer_) {}
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  operator hid_t() const { return id_; }

  void close()
  {
    if (closer_(std::exchange(id_, -1)) < 0)
      throw Failure(ExitCode::output_failed, fmt::format("{}: cannot be written: {}", path_, hdf5_reason()));
  }

private:
  const std::string& path_;
  hid_t id_;
  Closer closer_;
};

/// How a dataset is made that has its place in the file at once, for whoever writes its rows past HDF5. The
/// bytes of a file are those of the numbers in it: no times.
inline Handle laid_out(const std::string& path)
{
  Handle kind(path, H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  if (H5Pset_alloc_time(kind, H5D_ALLOC_TIME_EARLY) < 0 || H5Pset_fill_time(kind, H5D_FILL_TIME_NEVER) < 0 ||
      H5Pset_obj_track_times(kind, false) < 0)
    throw Failure(ExitCode::output_failed, fmt::format("{}: cannot be written: {}", path, hdf5_reason()));
  return kind;
}

} // namespace undine
