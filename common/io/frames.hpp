// Field frames: one HDF5 file per program and an XDMF index that ParaView opens, also while the run goes on.
#pragma once

#include "common/mesh/mesh.hpp"

#include <mpi.h>

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace undine
{

/// A field of a frame: scalars (n) or vectors (n rows of `components`), double in memory, 32-bit floats in
/// the file.
struct FrameField
{
  std::string_view name; ///< e.g. "velocity"; the same in every frame
  std::string_view unit; ///< written as an attribute
  int components = 1;    ///< 1, dim (padded to 3 in the file) or dim·dim
  std::span<const double> values;
  bool on_cells = false; ///< otherwise on nodes
};

/// The mesh of a frame; blocks may differ from frame to frame (PFEM).
struct FrameMesh
{
  int dim = 2;
  std::span<const double> x; ///< n_nodes × dim [m]
  std::vector<std::pair<ElementType, std::span<const index_t>>> blocks;
};

/// Writes `<out>/<name>.h5` and `<out>/<name>.xdmf`. Each frame opens, appends and closes the HDF5 file
/// (32-bit floats, 64-bit time); the index is written to a temporary file and renamed, so that a killed run
/// stays readable.
class FrameWriter
{
public:
  FrameWriter(std::string out_dir, std::string name);
  /// Append one frame. @throws Failure(output_failed) with path and reason (disk full, not writable)
  void write(double t, const FrameMesh&, const std::vector<FrameField>&);
  std::int64_t frames() const;

private:
  std::string h5_path_, xdmf_path_, h5_name_;
  std::vector<std::string> entries_;
};

} // namespace undine
