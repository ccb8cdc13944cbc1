// Field frames in HDF5 with an XDMF index.
#include "common/io/frames.hpp"

#include "common/error.hpp"
#include "common/io/folder.hpp"
#include "common/io/hdf5_handle.hpp"
#include "common/io/row_file.hpp"

#include <fmt/format.h>
#include <hdf5.h>

#include <algorithm>
#include <filesystem>
#include <numeric>
#include <optional>
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

  /// An empty dataset with its place in the file. @return its first byte, for whoever writes its rows
  std::uint64_t lay_out(hid_t parent, const std::string& name, const std::vector<hsize_t>& shape,
                        hid_t file_type, std::string_view unit) const
  {
    const Handle space(path, H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr),
                       H5Sclose);
    const Handle kind = laid_out(path);
    Handle set(path, H5Dcreate2(parent, name.c_str(), file_type, space, H5P_DEFAULT, kind, H5P_DEFAULT),
               H5Dclose);
    if (!unit.empty())
      text_attribute(set, "unit", unit);
    const haddr_t offset = H5Dget_offset(set);
    set.close();
    return offset;
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

/// On rank 0 (`first`) with the shape of all ranks' cells together.
Cells cells_of(const FrameMesh& mesh, std::size_t n_nodes, bool first)
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
  const bool shared = mesh.blocks_are.total > 0;
  require(one_type || !shared, "ranks share a list of cells of one type");
  if (shared)
    cells.count = static_cast<index_t>(mesh.blocks_are.total);
  if (cells.count == 0 && first) // spray only: the nodes themselves are what there is to see
  {
    cells.count = static_cast<index_t>(n_nodes);
    cells.topology =
        fmt::format("TopologyType=\"Polyvertex\" NodesPerElement=\"1\" NumberOfElements=\"{}\"", n_nodes);
    cells.list.resize(n_nodes);
    std::iota(cells.list.begin(), cells.list.end(), 0);
    cells.shape = {n_nodes, 1};
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
    cells.shape = {static_cast<hsize_t>(cells.count), per_element};
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

/// A list of a frame: numbers of four bytes, `row` of them in a row; those of this rank.
struct List
{
  std::string name;           ///< in the frame
  std::string_view unit;      ///< written as an attribute
  bool is_real = true;        ///< floats, else integers
  std::vector<hsize_t> shape; ///< of all ranks' rows together, right on rank 0
  const FrameRows* rows;
  std::vector<float> reals = {};
  std::vector<index_t> integers = {};

  std::span<const std::byte> bytes() const
  {
    return is_real ? std::as_bytes(std::span(reals)) : std::as_bytes(std::span(integers));
  }
  std::size_t row_bytes() const { return 4 * (shape.size() > 1 ? static_cast<std::size_t>(shape[1]) : 1); }
};

/// Bytes that a frame needs at most, bookkeeping included.
std::uintmax_t size_of(const std::vector<List>& lists)
{
  std::uintmax_t bytes = 65536;
  for (const List& list : lists)
    bytes += 4096 + list.row_bytes() * list.shape[0];
  return bytes;
}

/// The frame in the index.
/// @param inside  where it is: the file and the group in it
std::string entry(const std::string& name, double t, const std::string& inside, const std::string& topology,
                  const std::vector<List>& lists, const std::vector<FrameField>& fields)
{
  const auto item = [&](const List& list)
  {
    return data_item(list.shape,
                     list.is_real ? "NumberType=\"Float\" Precision=\"4\""
                                  : "NumberType=\"Int\" Precision=\"4\"",
                     inside + "/" + list.name);
  };
  std::string text =
      fmt::format("      <Grid Name=\"{}\" GridType=\"Uniform\">\n        <Time Value=\"{}\"/>\n"
                  "        <Topology {}>{}</Topology>\n"
                  "        <Geometry GeometryType=\"XYZ\">{}</Geometry>\n",
                  escaped(name), t, topology, item(lists[1]), item(lists[0]));
  for (std::size_t k = 0; k < fields.size(); ++k)
  {
    const List& list = lists[k + 2];
    text += fmt::format("        <Attribute Name=\"{}\" AttributeType=\"{}\" Center=\"{}\">{}</Attribute>\n",
                        escaped(fields[k].name), attribute_type(static_cast<int>(list.row_bytes() / 4)),
                        fields[k].on_cells ? "Cell" : "Node", item(list));
  }
  return text + "      </Grid>\n";
}

/// Put the rows that this rank has into the places of theirs.
/// @param begin first byte of each list in the file
void write_rows(const std::string& path, const std::vector<List>& lists, std::span<const std::uint64_t> begin)
{
  if (std::all_of(lists.begin(), lists.end(), [](const List& list) { return list.bytes().empty(); }))
    return;
  const RowFile file(path, RowFile::to_write);
  for (std::size_t k = 0; k < lists.size(); ++k)
  {
    const FrameRows& rows = *lists[k].rows;
    const std::size_t row = lists[k].row_bytes();
    file.write(lists[k].bytes(), row, begin[k],
               rows.places.empty() ? std::vector<RowRun>{{0, rows.first, lists[k].bytes().size() / row}}
                                   : runs_of(rows.places));
  }
}

} // namespace

FrameWriter::FrameWriter(std::string out_dir, std::string name, Ranks ranks)
    : name_(std::move(name)), h5_path_(out_dir + "/" + name_ + ".h5"),
      xdmf_path_(out_dir + "/" + name_ + ".xdmf"), h5_name_(name_ + ".h5"), ranks_(std::move(ranks))
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
  const bool first = ranks_.rank() == 0;
  const auto n_here = mesh.x.size() / static_cast<std::size_t>(mesh.dim);
  require(mesh.x.size() == n_here * static_cast<std::size_t>(mesh.dim),
          "a frame's points have dim components");
  const auto n_nodes = static_cast<hsize_t>(mesh.nodes.total > 0 ? mesh.nodes.total : n_here);
  Cells cells = cells_of(mesh, n_nodes, first);

  std::vector<List> lists;
  int components = 0;
  lists.push_back({.name = "points",
                   .unit = "m",
                   .shape = {n_nodes, 3},
                   .rows = &mesh.nodes,
                   .reals = padded(mesh.x, mesh.dim, mesh.dim, components)});
  lists.push_back({.name = "cells",
                   .unit = "",
                   .is_real = false,
                   .shape = cells.shape,
                   .rows = &mesh.blocks_are,
                   .integers = std::move(cells.list)});
  for (const FrameField& field : fields)
  {
    const FrameRows& rows = field.on_cells ? mesh.cells : mesh.nodes;
    const std::size_t rows_here = field.values.size() / static_cast<std::size_t>(field.components);
    require(field.values.size() == rows_here * static_cast<std::size_t>(field.components) &&
                (rows.places.empty() || rows.places.size() == rows_here) &&
                (rows.total > 0 || !first ||
                 rows_here == (field.on_cells ? static_cast<std::size_t>(cells.count) : n_here)),
            "a frame's field has one row per node or cell");
    std::vector<float> values = padded(field.values, field.components, mesh.dim, components);
    std::vector<hsize_t> shape{field.on_cells ? static_cast<hsize_t>(cells.count) : n_nodes};
    if (components > 1)
      shape.push_back(static_cast<hsize_t>(components));
    lists.push_back({.name = "fields/" + std::string(field.name),
                     .unit = field.unit,
                     .shape = std::move(shape),
                     .rows = &rows,
                     .reals = std::move(values)});
  }

  const QuietErrors quiet;
  const Writer writer{h5_path_};
  std::optional<Handle> access, file, frame;
  std::vector<std::uint64_t> begin; // of each list in the file
  together(
      ranks_,
      [&]
      {
        if (!first)
          return;
        if (entries_.empty())
          start_afresh();
        // HDF5 1.10 cannot close a file whose last blocks found no room: ask before, while it is whole.
        std::error_code ignored;
        const auto space = std::filesystem::space(std::filesystem::path(h5_path_).parent_path(), ignored);
        if (!ignored && space.available < size_of(lists))
          throw Failure(
              ExitCode::output_failed,
              fmt::format("{}: cannot be written: No space left on device ({} bytes free, {} needed)",
                          h5_path_, space.available, size_of(lists)));
        access.emplace(writer.access());
        file.emplace(h5_path_, H5Fopen(h5_path_.c_str(), H5F_ACC_RDWR, *access), H5Fclose);
        frame.emplace(h5_path_, H5Gcreate_anon(*file, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
        writer.number_attribute(*frame, "time", t);
        Handle group(h5_path_, H5Gcreate2(*frame, "fields", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
        for (const List& list : lists)
          begin.push_back(writer.lay_out(*frame, list.name, list.shape,
                                         list.is_real ? H5T_IEEE_F32LE : H5T_STD_I32LE, list.unit));
        group.close();
      });
  begin = ranks_.of_first(begin);
  together(ranks_, [&] { write_rows(h5_path_, lists, begin); });
  together(ranks_,
           [&]
           {
             if (!first)
               return;
             // The data reach the file before the link that makes them visible: a kill in between leaves the
             // earlier frames whole.
             const std::string frame_name = fmt::format("{:06}", entries_.size());
             writer.check(H5Fflush(*file, H5F_SCOPE_LOCAL));
             writer.check(H5Olink(*frame, *file, ("frames/" + frame_name).c_str(), H5P_DEFAULT, H5P_DEFAULT));
             frame->close();
             file->close();
             entries_.push_back(
                 entry(name_, t, h5_name_ + ":/frames/" + frame_name, cells.topology, lists, fields));
             write_index();
           });
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
