// Tests of field frames: read back with HDF5, index against file, damaged and full disks, kills.
#include "common/error.hpp"
#include "common/io/folder.hpp"
#include "common/io/frames.hpp"
#include "tests/common/io/temporary_folder.hpp"

#include <catch2/catch.hpp>
#include <hdf5.h>

#include <csignal>
#include <regex>

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>

using namespace undine;

namespace
{

/// A dataset read back as doubles, with its shape.
struct Stored
{
  std::vector<hsize_t> shape;
  std::vector<double> values;
  std::size_t bytes_per_value = 0;
};

Stored read_dataset(const std::string& path, const std::string& name)
{
  Stored stored;
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  REQUIRE(file >= 0);
  const hid_t set = H5Dopen2(file, name.c_str(), H5P_DEFAULT);
  REQUIRE(set >= 0);
  const hid_t space = H5Dget_space(set);
  stored.shape.resize(static_cast<std::size_t>(H5Sget_simple_extent_ndims(space)));
  H5Sget_simple_extent_dims(space, stored.shape.data(), nullptr);
  stored.values.resize(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
  const hid_t type = H5Dget_type(set);
  stored.bytes_per_value = H5Tget_size(type);
  CHECK(H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, stored.values.data()) >= 0);
  H5Tclose(type);
  H5Sclose(space);
  H5Dclose(set);
  H5Fclose(file);
  return stored;
}

double read_time(const std::string& path, const std::string& frame)
{
  double t = -1.0;
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  REQUIRE(file >= 0);
  const hid_t attribute = H5Aopen_by_name(file, frame.c_str(), "time", H5P_DEFAULT, H5P_DEFAULT);
  CHECK(H5Aread(attribute, H5T_NATIVE_DOUBLE, &t) >= 0);
  H5Aclose(attribute);
  H5Fclose(file);
  return t;
}

const std::vector<double> square_x = {0, 0, 1, 0, 1, 1, 0, 1, 2, 0.5};
const std::vector<index_t> square_quad = {0, 1, 2, 3};
const std::vector<index_t> square_triangle = {1, 4, 2};

FrameMesh square_mesh()
{
  return {.dim = 2,
          .x = square_x,
          .blocks = {{ElementType::quadrilateral4, square_quad}, {ElementType::triangle3, square_triangle}}};
}

/// Every DataItem of the index names a dataset of the file with the same shape. @return their number
int check_index_against_file(const TemporaryFolder& folder, const std::string& name)
{
  const std::string index = content_of(folder / (name + ".xdmf"));
  const std::regex item("<DataItem Dimensions=\"([0-9 ]+)\" [^>]*Format=\"HDF\">([^:<]+):([^<]+)</DataItem>");
  int count = 0;
  for (std::sregex_iterator i(index.begin(), index.end(), item), end; i != end; ++i)
  {
    CHECK((*i)[2] == name + ".h5"); // relative: the folder may be moved
    const Stored stored = read_dataset(folder / (*i)[2].str(), (*i)[3]);
    std::string shape;
    for (const hsize_t n : stored.shape)
      shape.append(shape.empty() ? "" : " ").append(std::to_string(n));
    CHECK((*i)[1] == shape);
    ++count;
  }
  return count;
}

/// Every opened XML element is closed, in order. @return their number
int check_xml(const std::string& text)
{
  std::vector<std::string> open;
  int count = 0;
  const std::regex tag("<(/?)([A-Za-z]+)[^>]*?(/?)>");
  for (std::sregex_iterator i(text.begin(), text.end(), tag), end; i != end; ++i)
  {
    if ((*i)[1].length() > 0)
    {
      REQUIRE_FALSE(open.empty());
      CHECK(open.back() == (*i)[2]);
      open.pop_back();
    }
    else if ((*i)[3].length() == 0)
      open.push_back((*i)[2]);
    ++count;
  }
  CHECK(open.empty());
  return count;
}

/// The text of the Failure(output_failed) that writing a frame throws; "" if it throws none.
std::string failure_of(FrameWriter& writer)
{
  try
  {
    writer.write(1.0, square_mesh(), {});
  }
  catch (const Failure& failure)
  {
    return failure.code() == ExitCode::output_failed ? failure.what() : "wrong exit code";
  }
  return "";
}

/// Runs `action` in a process of its own, as HDF5 keeps a file that it could not close until the process
/// ends.
/// @return what `action` returns (0 to 255), −1 if it was killed
template <class Action>
int in_a_child(Action&& action)
{
  const pid_t child = ::fork();
  if (child == 0)
    ::_exit(action());
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

} // namespace

TEST_CASE("a plane frame reads back as written, in 32 bits and three coordinates", "[common][unit]")
{
  const TemporaryFolder folder;
  FrameWriter writer(folder.path, "fluid");
  const std::vector<double> pressure = {1.0, 2.0, 3.0, 4.0, 1.0 / 3.0};
  const std::vector<double> velocity = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10};
  const std::vector<double> stress = {11, 12, 21, 22, 0, 1, 2, 3}; // two cells
  writer.write(0.1, square_mesh(),
               {{.name = "pressure", .unit = "Pa", .components = 1, .values = pressure},
                {.name = "velocity", .unit = "m/s", .components = 2, .values = velocity},
                {.name = "stress", .unit = "Pa", .components = 4, .values = stress, .on_cells = true}});
  CHECK(writer.frames() == 1);

  const std::string path = folder / "fluid.h5", frame = "/frames/000000";
  CHECK(read_time(path, frame) == 0.1); // 64 bits
  const Stored points = read_dataset(path, frame + "/points");
  CHECK(points.shape == std::vector<hsize_t>{5, 3});
  CHECK(points.bytes_per_value == 4);
  CHECK(points.values == std::vector<double>{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 2, 0.5, 0});
  CHECK(read_dataset(path, frame + "/cells").values == std::vector<double>{5, 0, 1, 2, 3, 4, 1, 4, 2});
  CHECK(read_dataset(path, frame + "/fields/pressure").values ==
        std::vector<double>{1, 2, 3, 4, static_cast<float>(1.0 / 3.0)});
  CHECK(read_dataset(path, frame + "/fields/velocity").values ==
        std::vector<double>{1, 2, 0, 3, 4, 0, 5, 6, 0, 7, 8, 0, 9, 10, 0});
  CHECK(read_dataset(path, frame + "/fields/stress").values ==
        std::vector<double>{11, 12, 0, 21, 22, 0, 0, 0, 0, 0, 1, 0, 2, 3, 0, 0, 0, 0});
  CHECK(check_index_against_file(folder, "fluid") == 5);
  check_xml(content_of(folder / "fluid.xdmf"));
}

TEST_CASE("a frame in space keeps its components", "[common][unit]")
{
  const TemporaryFolder folder;
  FrameWriter writer(folder.path, "solid");
  const auto mesh = box_mesh<3>({{0, 0, 0}}, {{1, 1, 1}}, {1, 1, 1}, ElementType::hexahedron8);
  std::vector<double> x;
  for (const auto& point : mesh.x)
    x.insert(x.end(), point.c.begin(), point.c.end());
  const std::vector<double> stress = {1, 2, 3, 4, 5, 6, 7, 8, 9};
  writer.write(0.0, {.dim = 3, .x = x, .blocks = {{ElementType::hexahedron8, mesh.blocks[0].nodes}}},
               {{.name = "displacement", .unit = "m", .components = 3, .values = x},
                {.name = "stress", .unit = "Pa", .components = 9, .values = stress, .on_cells = true}});
  const std::string path = folder / "solid.h5", frame = "/frames/000000";
  CHECK(read_dataset(path, frame + "/points").values == x);
  CHECK(read_dataset(path, frame + "/fields/displacement").values == x);
  CHECK(read_dataset(path, frame + "/fields/stress").values == stress);
  const Stored cells = read_dataset(path, frame + "/cells");
  CHECK(cells.shape == std::vector<hsize_t>{1, 8});
  CHECK(content_of(folder / "solid.xdmf").find("TopologyType=\"Hexahedron\"") != std::string::npos);
  CHECK(check_index_against_file(folder, "solid") == 4);
}

TEST_CASE("the mesh may change from frame to frame, down to loose nodes", "[common][unit]")
{
  const TemporaryFolder folder;
  FrameWriter writer(folder.path, "fluid");
  writer.write(0.0, square_mesh(), {});
  writer.write(0.5, {.dim = 2, .x = square_x, .blocks = {{ElementType::triangle3, square_triangle}}}, {});
  writer.write(1.0, {.dim = 2, .x = square_x, .blocks = {{ElementType::triangle3, {}}}}, {});
  CHECK(writer.frames() == 3);
  CHECK(read_dataset(folder / "fluid.h5", "/frames/000001/cells").shape == std::vector<hsize_t>{1, 3});
  CHECK(read_dataset(folder / "fluid.h5", "/frames/000002/cells").shape == std::vector<hsize_t>{5, 1});
  CHECK(check_index_against_file(folder, "fluid") == 6);
  const std::string index = content_of(folder / "fluid.xdmf");
  check_xml(index);
  for (const char* expected :
       {"TopologyType=\"Mixed\"", "TopologyType=\"Triangle\"", "TopologyType=\"Polyvertex\"",
        "<Time Value=\"0.5\"/>", "CollectionType=\"Temporal\""})
    CHECK(index.find(expected) != std::string::npos);
}

TEST_CASE("the first frame of a new writer starts both files afresh", "[common][unit]")
{
  const TemporaryFolder folder;
  FrameWriter first(folder.path, "fluid");
  for (const double t : {0.0, 0.5, 1.0})
    first.write(t, square_mesh(), {});
  FrameWriter again(folder.path, "fluid");
  CHECK(again.frames() == 0);
  again.write(0.0, square_mesh(), {});
  CHECK(check_index_against_file(folder, "fluid") == 2); // points and cells
}

TEST_CASE("a writer that continues from a checkpoint keeps the frames before it and no others",
          "[common][unit]")
{
  const TemporaryFolder folder;
  const std::string state = folder / "state.h5";
  {
    FrameWriter writer(folder.path, "fluid");
    writer.write(0.0, square_mesh(), {});
    writer.write(0.5, square_mesh(), {});
    StateArchive archive(state, {});
    archive("frames", writer);
    archive.save();
    writer.write(1.0, square_mesh(), {});
    writer.write(1.5, square_mesh(), {});
  }
  const auto continued = [&]
  {
    FrameWriter writer(folder.path, "fluid");
    StateArchive archive(state);
    archive("frames", writer);
    return writer;
  };
  CHECK(continued().frames() == 2);
  CHECK(check_index_against_file(folder, "fluid") == 2 * 2);
  FrameWriter writer = continued();
  writer.write(1.0, square_mesh(), {});
  CHECK(check_index_against_file(folder, "fluid") == 3 * 2);

  std::filesystem::resize_file(folder / "fluid.h5", 100); // what no kill should leave, but a disk may
  CHECK(continued().frames() == 0);
  CHECK(std::filesystem::exists(folder / "fluid.h5.damaged"));
}

TEST_CASE("frames are appended while a reader holds the file open", "[common][unit]")
{
  const TemporaryFolder folder;
  FrameWriter writer(folder.path, "fluid");
  writer.write(0.0, square_mesh(), {});
  const pid_t reader = ::fork(); // another process, with locks as they come by default
  if (reader == 0)
  {
    [[maybe_unused]] const int null = ::dup2(::open("/dev/null", O_WRONLY), STDOUT_FILENO);
    ::execlp("h5ls", "h5ls", "-r", (folder / "fluid.h5").c_str(), static_cast<char*>(nullptr));
    ::_exit(0);
  }
  writer.write(1.0, square_mesh(), {});
  ::waitpid(reader, nullptr, 0);
  CHECK(check_index_against_file(folder, "fluid") == 4);
}

TEST_CASE("a run killed at any moment leaves frames and index readable", "[common][unit]")
{
  // A child writes frames without end and is killed, at another moment after its first frame each time.
  // Everything that the index names must be in the file.
  for (int trial = 0; trial < 12; ++trial)
  {
    const TemporaryFolder folder;
    const pid_t child = ::fork();
    if (child == 0)
    {
      FrameWriter writer(folder.path, "fluid");
      const std::vector<double> x(2 * 20000, 0.5);
      for (int frame = 0;; ++frame)
        writer.write(frame, {.dim = 2, .x = x, .blocks = {{ElementType::triangle3, square_triangle}}},
                     {{.name = "velocity", .unit = "m/s", .components = 2, .values = x}});
    }
    const auto has_frames = [&folder]
    { return content_of(folder / "fluid.xdmf").find("/frames/000000/") != std::string::npos; };
    for (int wait = 0; wait < 20000 && !has_frames(); ++wait)
      ::usleep(1000);
    ::usleep(static_cast<useconds_t>(370 * trial));
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
    const std::string index = content_of(folder / "fluid.xdmf");
    INFO("trial " << trial);
    check_xml(index);
    const int datasets = check_index_against_file(folder, "fluid");
    CHECK(datasets > 0);
    CHECK(datasets % 3 == 0);
  }
}

TEST_CASE("a frame that cannot be written fails with path and reason, and the next one may succeed",
          "[common][unit]")
{
  const TemporaryFolder folder;
  const std::string expected = (folder / "fluid.h5") + ": cannot be written: ";
  CHECK(in_a_child(
            [&]
            {
              FrameWriter writer(folder.path, "fluid");
              writer.write(0.0, square_mesh(), {});
              std::filesystem::rename(folder / "fluid.h5", folder / "kept.h5");
              const std::string gone = failure_of(writer);
              std::filesystem::create_symlink("/dev/full", folder / "fluid.h5");
              const std::string full = failure_of(writer);
              std::filesystem::remove(folder / "fluid.h5");
              std::filesystem::rename(folder / "kept.h5", folder / "fluid.h5");
              const std::string none = failure_of(writer);
              return !gone.starts_with(expected)   ? 1
                     : !full.starts_with(expected) ? 2
                     : !none.empty()               ? 3
                     : writer.frames() != 2        ? 4
                                                   : 0;
            }) == 0);
  CHECK(check_index_against_file(folder, "fluid") == 4);
}

TEST_CASE("a full disk under the frames fails, and leaves the earlier frames readable", "[common][unit]")
{
  // A child is allowed files of 300 kB only: HDF5 meets EFBIG as it would meet ENOSPC. Frames are 120 kB
  // each.
  const TemporaryFolder folder;
  CHECK(in_a_child(
            [&]
            {
              std::signal(SIGXFSZ, SIG_IGN);
              FrameWriter writer(folder.path, "fluid");
              const rlimit limit{300000, 300000};
              ::setrlimit(RLIMIT_FSIZE, &limit);
              const std::vector<double> x(2 * 10000, 0.5);
              try
              {
                for (int frame = 0; frame < 4; ++frame)
                  writer.write(frame,
                               {.dim = 2, .x = x, .blocks = {{ElementType::triangle3, square_triangle}}}, {});
              }
              catch (const Failure& failure)
              {
                const std::string text = failure.what();
                return text.find("fluid.h5: cannot be written: ") == std::string::npos ? 98
                       : writer.frames() != 2                                          ? 99
                                              : static_cast<int>(failure.code());
              }
              return 97;
            }) == static_cast<int>(ExitCode::output_failed));
  CHECK(check_index_against_file(folder, "fluid") == 4);
}
