// Field frames: one HDF5 file per program and an XDMF index that ParaView opens, also while the run goes on.
#pragma once

#include "common/io/state_archive.hpp"
#include "common/mesh/mesh.hpp"
#include "common/parallel/ranks.hpp"

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace undine
{

/// Which rows of a list this rank gives. By default rank 0 gives all of them, and other ranks none.
struct FrameRows
{
  std::size_t total = 0;           ///< rows of all ranks; 0: those that rank 0 gives
  std::size_t first = 0;           ///< the place of the first row here
  std::span<const index_t> places; ///< of the rows here, ascending; empty: one after the other from `first`
};

/// A field of a frame: scalars (n) or vectors (n rows of `components`), double in memory, 32-bit floats in
/// the file.
struct FrameField
{
  std::string_view name;          ///< e.g. "velocity"; the same in every frame
  std::string_view unit;          ///< written as an attribute
  int components = 1;             ///< 1, dim (padded to 3 in the file) or dim·dim
  std::span<const double> values; ///< of the rows that this rank gives
  bool on_cells = false;          ///< otherwise on nodes
};

/// The mesh of a frame; blocks may differ from frame to frame (PFEM).
struct FrameMesh
{
  int dim = 2;
  std::span<const double> x; ///< n_nodes × dim [m]
  std::vector<std::pair<ElementType, std::span<const index_t>>> blocks;
  FrameRows nodes = {};      ///< which rows `x` and fields on nodes are
  FrameRows cells = {};      ///< which rows fields on cells are
  FrameRows blocks_are = {}; ///< which cells `blocks` are; some of a list of one type only
};

/// Writes `<out>/<name>.h5` and `<out>/<name>.xdmf`. Each frame opens, appends and closes the HDF5 file
/// (32-bit floats, 64-bit time) without locks; a frame is linked into the file when it is complete, and the
/// index is replaced as a whole, so that a killed run stays readable. Rank 0 lays the frame out and keeps the
/// index; every rank puts its own rows in their places, without passing them through another. No call waits
/// inside MPI's or HDF5's collective output, which knows no deadline. The file is the same on any number of
/// ranks, all of which must see its folder. File: /frames/000000/{points, cells,
/// fields/<name>}, with attributes `time` [s] and `unit`; points, vectors and tensors have three components
/// per direction.
class FrameWriter
{
public:
  /// Creates `out_dir`; the first frame starts both files afresh. @throws Failure(output_failed)
  FrameWriter(std::string out_dir, std::string name, Ranks ranks = {});
  /// Append one frame at time `t` [s]. Collective. @throws Failure(output_failed) on all ranks with path and
  /// reason (disk full, not writable)
  void write(double t, const FrameMesh&, const std::vector<FrameField>&);
  /// Frames written so far, on rank 0.
  std::int64_t frames() const;
  /// The index. After a restart the frames behind the checkpoint are deleted.
  void for_each_state(StateArchive& archive);

private:
  void start_afresh();
  void keep_first_frames();
  void write_index() const;

  std::string name_, h5_path_, xdmf_path_, h5_name_;
  Ranks ranks_;
  std::vector<std::string> entries_; ///< the index: one XML grid per frame
};

} // namespace undine
