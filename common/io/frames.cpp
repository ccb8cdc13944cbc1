// Field frames in HDF5 with an XDMF index.
#include "common/io/frames.hpp"

#include "common/error.hpp"
#include "common/io/folder.hpp"
#include "common/io/hdf5_handle.hpp"

#include <fmt/format.h>
#include <hdf5.h>

#include <algorithm>
#include <filesystem>
#include <numeric>
#include <utility>

namespace undine
{

namespace
{

/// Writes into one open file; every failure carries its path.
struct Writer
{
  const std::string& path;

  void check(herr_t status) const
  {
    if (status < 0)
      throw Failure(ExitCode::output_failed, fmt::format("{}: cannot be written: {}", path, hdf5_reason()));
  }

  /// Readers (ParaView) may hold the file open: without locks neither side keeps the other out. A frame is in
  /// the index only when it is complete, so that they never meet a half-written one.
  Handle access() const
  {
    Handle list(path, H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    check(H5Pset_file_locking(list, false, true));
    return list;
  }

  template <class Value>
  void dataset(hid_t parent, const char* name, std::vector<hsize_t> shape, std::span<const Value> values,
               hid_t file_type, hid_t memory_type, std::string_view unit) const
  {
    const Handle space(path, H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr),
                       H5Sclose);
    Handle set(path, H5Dcreate2(parent, name, file_type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
               H5Dclose);
    if (!values.empty())
      check(H5Dwrite(set, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()));
    if (!unit.empty())
      text_attribute(set, "unit", unit);
    set.close();
  }

  void text_attribute(hid_t object, const char* name, std::string_view text) const
  {
    const Handle type(path, H5Tcopy(H5T_C_S1), H5Tclose);
    check(H5Tset_size(type, text.size()));
    const Handle space(path, H5Screate(H5S_SCALAR), H5Sclose);
    const Handle attribute(path, H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
    check(H5Awrite(attribute, type, text.data()));
  }

  void number_attribute(hid_t object, const char* name, double value) const
  {
    const Handle space(path, H5Screate(H5S_SCALAR), H5Sclose);
    const Handle attribute(path, H5Acreate2(object, name, H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT),
                           H5Aclose);
    check(H5Awrite(attribute, H5T_NATIVE_DOUBLE, &value));
  }
};

/// Rows of `components` doubles as rows of floats with three components per direction.
std::vector<float> padded(std::span<const double> values, int components, int dim, int& components_in_file)
{
  const auto n = values.size() / static_cast<std::size_t>(components);
  const bool is_vector = components == dim && dim == 2;
  const bool is_tensor = components == 4 && dim == 2;
  if (!is_vector && !is_tensor)
  {
    components_in_file = components;
    return {values.begin(), values.end()};
  }
  components_in_file = is_vector ? 3 : 9;
  std::vector<float> out(n * static_cast<std::size_t>(components_in_file), 0.0f);
  for (std::size_t row = 0; row < n; ++row)
    for (std::size_t c = 0; c < static_cast<std::size_t>(components); ++c)
    {
      const std::size_t place = is_vector ? c : 3 * (c / 2) + c % 2; // row by row of a 3 × 3 matrix
      out[row * static_cast<std::size_t>(components_in_file) + place] =
          static_cast<float>(values[row * static_cast<std::size_t>(components) + c]);
    }
  return out;
}

struct Topology
{
  const char* name; ///< of XDMF
  int code;         ///< in a list of mixed cells
};

Topology topology_of(ElementType type)
{
  switch (type)
  {
  case ElementType::line2:
    return {"Polyline", 2};
  case ElementType::triangle3:
    return {"Triangle", 4};
  case ElementType::quadrilateral4:
    return {"Quadrilateral", 5};
  case ElementType::tetrahedron4:
    return {"Tetrahedron", 6};
  case ElementType::hexahedron8:
    return {"Hexahedron", 9};
  }
  throw InternalError("unknown element type");
}

/// All cells of a frame as one list: (n, nodes) where they are of one type, else XDMF's mixed list.
struct Cells
{
  std::string topology;
  std::vector<index_t> list;
  std::vector<hsize_t> shape;
  index_t count = 0;
};

Cells cells_of(const FrameMesh& mesh)
{
  Cells cells;
  bool one_type = true;
  const ElementType first_type = mesh.blocks.empty() ? ElementType::triangle3 : mesh.blocks[0].first;
  for (const auto& [type, nodes] : mesh.blocks)
  {
    require(nodes.size() % static_cast<std::size_t>(nodes_per_element(type)) == 0,
            "a block holds whole elements");
    cells.count += static_cast<index_t>(nodes.size()) / nodes_per_element(type);
    one_type = one_type && type == first_type;
  }
  if (cells.count == 0) // spray only: the nodes themselves are what there is to see
  {
    const auto n = mesh.x.size() / static_cast<std::size_t>(mesh.dim);
    cells.count = static_cast<index_t>(n);
    cells.topology =
        fmt::format("TopologyType=\"Polyvertex\" NodesPerElement=\"1\" NumberOfElements=\"{}\"", n);
    cells.list.resize(n);
    std::iota(cells.list.begin(), cells.list.end(), 0);
    cells.shape = {n, 1};
    return cells;
  }
  for (const auto& [type, nodes] : mesh.blocks)
  {
    const auto per_element = static_cast<std::size_t>(nodes_per_element(type));
    for (std::size_t first = 0; first < nodes.size(); first += per_element)
    {
      if (!one_type)
      {
        cells.list.push_back(topology_of(type).code);
        if (type == ElementType::line2) // the one type whose number of nodes XDMF wants to be told
          cells.list.push_back(2);
      }
      const auto element = nodes.subspan(first, per_element);
      cells.list.insert(cells.list.end(), element.begin(), element.end());
    }
  }
  const auto per_element = static_cast<std::size_t>(nodes_per_element(first_type));
  const bool is_line = one_type && first_type == ElementType::line2;
  cells.topology = fmt::format("TopologyType=\"{}\"{} NumberOfElements=\"{}\"",
                               one_type ? topology_of(first_type).name : "Mixed",
                               is_line ? " NodesPerElement=\"2\"" : "", cells.count);
  if (one_type)
    cells.shape = {cells.list.size() / per_element, per_element};
  else
    cells.shape = {cells.list.size()};
  return cells;
}

std::string escaped(std::string_view text)
{
  std::string out;
  for (const char c : text)
    out += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '"' ? "&quot;" : std::string(1, c);
  return out;
}

std::string data_item(const std::vector<hsize_t>& shape, const char* number_type, const std::string& where)
{
  std::string dimensions;
  for (const hsize_t n : shape)
    dimensions += fmt::format("{}{}", dimensions.empty() ? "" : " ", n);
  return fmt::format("<DataItem Dimensions=\"{}\" {} Format=\"HDF\">{}</DataItem>", dimensions, number_type,
                     escaped(where));
}

const char* attribute_type(int components_in_file)
{
  return components_in_file == 1   ? "Scalar"
         : components_in_file == 3 ? "Vector"
         : components_in_file == 9 ? "Tensor"
                                   : "Matrix";
}

/// Bytes that a frame needs at most, bookkeeping included.
std::uintmax_t size_of(const FrameMesh& mesh, const Cells& cells, const std::vector<FrameField>& fields)
{
  std::uintmax_t bytes = 65536 + 4 * (2 * mesh.x.size() + cells.list.size());
  for (const FrameField& field : fields)
    bytes += 4096 + 4 * 3 * field.values.size();
  return bytes;
}

} // namespace

FrameWriter::FrameWriter(std::string out_dir, std::string name)
    : name_(std::move(name)), h5_path_(out_dir + "/" + name_ + ".h5"),
      xdmf_path_(out_dir + "/" + name_ + ".xdmf"), h5_name_(name_ + ".h5")
{
  H5dont_atexit(); // files are closed here; HDF5's own tidying at exit stumbles over one that a full disk
                   // kept open
  make_folder(out_dir);
}

void FrameWriter::start_afresh()
{
  entries_.clear();
  write_index(); // first: an old index must not point into the new file
  const QuietErrors quiet;
  const Writer writer{h5_path_};
  const Handle access = writer.access();
  Handle file(h5_path_, H5Fcreate(h5_path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access), H5Fclose);
  Handle frames(h5_path_, H5Gcreate2(file, "frames", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
  frames.close();
  file.close();
}

void FrameWriter::for_each_state(StateArchive& archive)
{
  archive("entries", entries_);
  if (archive.reading() && !entries_.empty())
    keep_first_frames();
}

/// Unlink the frames that the index does not name. A file that is not there, or that a kill has left
/// unreadable, is put aside: the frames then begin anew.
void FrameWriter::keep_first_frames()
{
  const QuietErrors quiet;
  const Writer writer{h5_path_};
  bool whole = std::filesystem::exists(h5_path_);
  if (whole)
    try
    {
      const Handle access = writer.access();
      Handle file(h5_path_, H5Fopen(h5_path_.c_str(), H5F_ACC_RDWR, access), H5Fclose);
      const auto name = [](std::size_t k) { return fmt::format("frames/{:06}", k); };
      whole = H5Lexists(file, name(entries_.size() - 1).c_str(), H5P_DEFAULT) > 0;
      for (std::size_t k = entries_.size(); whole && H5Lexists(file, name(k).c_str(), H5P_DEFAULT) > 0; ++k)
        writer.check(H5Ldelete(file, name(k).c_str(), H5P_DEFAULT));
      file.close();
    }
    catch (const Failure&)
    {
      whole = false;
    }
  if (whole)
    return write_index();
  std::error_code ignored;
  std::filesystem::rename(h5_path_, h5_path_ + ".damaged", ignored);
  start_afresh();
}

void FrameWriter::write(double t, const FrameMesh& mesh, const std::vector<FrameField>& fields)
{
  if (entries_.empty())
    start_afresh();
  const auto n_nodes = mesh.x.size() / static_cast<std::size_t>(mesh.dim);
  require(mesh.x.size() == n_nodes * static_cast<std::size_t>(mesh.dim),
          "a frame's points have dim components");
  const Cells cells = cells_of(mesh);

  // HDF5 1.10 cannot close a file whose last blocks found no room: ask before, while the file is still whole.
  std::error_code ignored;
  const auto space = std::filesystem::space(std::filesystem::path(h5_path_).parent_path(), ignored);
  if (!ignored && space.available < size_of(mesh, cells, fields))
    throw Failure(ExitCode::output_failed,
                  fmt::format("{}: cannot be written: No space left on device ({} bytes free, {} needed)",
                              h5_path_, space.available, size_of(mesh, cells, fields)));

  const std::string frame_name = fmt::format("{:06}", entries_.size());
  const std::string inside = h5_name_ + ":/frames/" + frame_name;
  std::string entry = fmt::format(
      "      <Grid Name=\"{}\" GridType=\"Uniform\">\n        <Time Value=\"{}\"/>\n", escaped(name_), t);

  const QuietErrors quiet;
  const Writer writer{h5_path_};
  const Handle access = writer.access();
  Handle file(h5_path_, H5Fopen(h5_path_.c_str(), H5F_ACC_RDWR, access), H5Fclose);
  Handle frame(h5_path_, H5Gcreate_anon(file, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
  writer.number_attribute(frame, "time", t);

  int components = 0;
  const std::vector<float> points = padded(mesh.x, mesh.dim, mesh.dim, components);
  writer.dataset<float>(frame, "points", {n_nodes, 3}, points, H5T_IEEE_F32LE, H5T_NATIVE_FLOAT, "m");
  writer.dataset<index_t>(frame, "cells", cells.shape, cells.list, H5T_STD_I32LE, H5T_NATIVE_INT32, "");
  entry += fmt::format("        <Topology {}>{}</Topology>\n", cells.topology,
                       data_item(cells.shape, "NumberType=\"Int\" Precision=\"4\"", inside + "/cells"));
  entry += fmt::format("        <Geometry GeometryType=\"XYZ\">{}</Geometry>\n",
                       data_item({n_nodes, 3}, "NumberType=\"Float\" Precision=\"4\"", inside + "/points"));

  Handle group(h5_path_, H5Gcreate2(frame, "fields", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
  for (const FrameField& field : fields)
  {
    const std::size_t rows = field.on_cells ? static_cast<std::size_t>(cells.count) : n_nodes;
    require(field.values.size() == rows * static_cast<std::size_t>(field.components),
            "a frame's field has one row per node or cell");
    const std::string name(field.name);
    const std::vector<float> values = padded(field.values, field.components, mesh.dim, components);
    std::vector<hsize_t> shape{rows};
    if (components > 1)
      shape.push_back(static_cast<hsize_t>(components));
    writer.dataset<float>(group, name.c_str(), shape, values, H5T_IEEE_F32LE, H5T_NATIVE_FLOAT, field.unit);
    entry +=
        fmt::format("        <Attribute Name=\"{}\" AttributeType=\"{}\" Center=\"{}\">{}</Attribute>\n",
                    escaped(name), attribute_type(components), field.on_cells ? "Cell" : "Node",
                    data_item(shape, "NumberType=\"Float\" Precision=\"4\"", inside + "/fields/" + name));
  }
  group.close();
  // The data reach the file before the link that makes them visible: a kill in between leaves the earlier
  // frames whole.
  writer.check(H5Fflush(file, H5F_SCOPE_LOCAL));
  writer.check(H5Olink(frame, file, ("frames/" + frame_name).c_str(), H5P_DEFAULT, H5P_DEFAULT));
  frame.close();
  file.close();

  entries_.push_back(entry + "      </Grid>\n");
  write_index();
}

std::int64_t FrameWriter::frames() const { return static_cast<std::int64_t>(entries_.size()); }

void FrameWriter::write_index() const
{
  std::string index =
      fmt::format("<?xml version=\"1.0\" ?>\n<!DOCTYPE Xdmf SYSTEM \"Xdmf.dtd\" []>\n"
                  "<Xdmf Version=\"2.0\">\n  <Domain>\n"
                  "    <Grid Name=\"{}\" GridType=\"Collection\" CollectionType=\"Temporal\">\n",
                  escaped(name_));
  for (const std::string& entry : entries_)
    index += entry;
  replace_file(xdmf_path_, index + "    </Grid>\n  </Domain>\n</Xdmf>\n");
}

} // namespace undine
