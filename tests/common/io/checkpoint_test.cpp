// States by name, and the manifest that makes a checkpoint valid.
#include "common/error.hpp"
#include "common/io/checkpoint.hpp"
#include "common/io/history.hpp"
#include "common/tensor.hpp"
#include "tests/common/io/temporary_folder.hpp"

#include <catch2/catch.hpp>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>

using namespace undine;

namespace
{

enum class Colour : std::uint8_t
{
  red,
  blue
};

struct Inner
{
  std::vector<Vec<3>> x;
  std::optional<std::int64_t> m;

  void for_each_state(StateArchive& archive)
  {
    archive("x", x);
    archive("m", m);
  }
};

/// One member of every kind that classes with state have.
struct Everything
{
  double t = 0.0;
  bool flag = false;
  Colour colour = Colour::red;
  std::string name;
  std::vector<std::string> names;
  std::vector<float> quality;
  std::vector<std::array<std::int32_t, 3>> elements;
  std::vector<std::vector<std::size_t>> candidates;
  std::vector<Inner> list;
  std::array<std::vector<double>, 2> sides;
  Mat<2> A;
  std::unique_ptr<Inner> owned = std::make_unique<Inner>();

  void for_each_state(StateArchive& archive)
  {
    archive("t", t);
    archive("flag", flag);
    archive("colour", colour);
    archive("name", name);
    archive("names", names);
    archive("quality", quality);
    archive("elements", elements);
    archive("candidates", candidates);
    archive("list", list);
    archive("sides", sides);
    archive("A", A);
    archive("owned", owned);
  }
};

template <class Action>
std::string failure_of(ExitCode code, Action&& action)
{
  try
  {
    action();
  }
  catch (const Failure& failure)
  {
    CHECK(failure.code() == code);
    return failure.what();
  }
  return "nothing was thrown";
}

template <class Object>
void save(Object& object, const std::string& path)
{
  StateArchive archive(path, {});
  archive("object", object);
  archive.save();
}

template <class Object>
void load(Object& object, const std::string& path)
{
  StateArchive archive(path);
  archive("object", object);
}

} // namespace

TEST_CASE("a state comes back with all its bits, also NaN, -0 and empty lists", "[common][unit]")
{
  const TemporaryFolder folder;
  Everything a;
  a.t = std::nextafter(0.1, 1.0);
  a.flag = true;
  a.colour = Colour::blue;
  a.name = "ρ₀ water";
  a.names = {"", "one", "two words"};
  a.quality = {1.0f, -0.0f, std::numeric_limits<float>::quiet_NaN()};
  a.elements = {{1, 2, 3}, {4, 5, 6}};
  a.candidates = {{}, {7, 8}, {9}};
  a.list.resize(2);
  a.list[1].x = {Vec<3>{{1.0, 2.0, 1e-310}}};
  a.list[1].m = 1LL << 40;
  a.sides[1] = {std::numeric_limits<double>::infinity()};
  a.A = Mat<2>::identity();
  a.owned->x = {Vec<3>{{0.25, 0.5, 0.75}}};
  save(a, folder / "a.h5");

  Everything b;
  b.list.resize(5);
  b.names = {"will go"};
  load(b, folder / "a.h5");
  CHECK(b.t == a.t);
  CHECK(b.flag);
  CHECK(b.colour == Colour::blue);
  CHECK(b.name == a.name);
  CHECK(b.names == a.names);
  CHECK(b.elements == a.elements);
  CHECK(b.candidates == a.candidates);
  REQUIRE(b.list.size() == 2);
  CHECK_FALSE(b.list[0].m);
  CHECK(b.list[1].m == a.list[1].m);
  CHECK(b.list[1].x[0][2] == 1e-310);
  CHECK(b.sides == a.sides);
  CHECK(b.A(0, 0) == 1.0);
  CHECK(b.owned->x[0][1] == 0.5);
  CHECK(std::isnan(b.quality[2]));
  CHECK(std::signbit(b.quality[1]));
  save(b, folder / "b.h5");
  CHECK(content_of(folder / "a.h5") == content_of(folder / "b.h5"));
}

TEST_CASE("a state is read back from memory", "[common][unit]")
{
  Everything a, b;
  a.t = 0.1;
  a.names = {"one", ""};
  a.elements = {{1, 2, 3}};
  b.names = {"will go"};
  StateArchive archive;
  archive("object", a);
  archive.read_back();
  CHECK(archive.reading());
  archive("object", b);
  CHECK(b.t == a.t);
  CHECK(b.names == a.names);
  CHECK(b.elements == a.elements);
}

TEST_CASE("a state of another object is refused with the name that does not fit", "[common][unit]")
{
  const TemporaryFolder folder;
  Inner inner;
  save(inner, folder / "state.h5");
  Everything everything;
  CHECK(failure_of(ExitCode::bad_input_file, [&] { load(everything, folder / "state.h5"); })
            .find("'object/t'") != std::string::npos);
  std::vector<double> numbers;
  StateArchive archive(folder / "state.h5");
  CHECK(failure_of(ExitCode::bad_input_file, [&] { archive("object/x", numbers); }).find("another kind") !=
        std::string::npos);
  CHECK(failure_of(ExitCode::bad_input_file, [&] { StateArchive(folder / "none.h5"); })
            .find("cannot be read") != std::string::npos);
}

TEST_CASE("a checkpoint is valid only when its manifest and all its files are whole", "[common][unit]")
{
  const TemporaryFolder folder;
  Checkpoints checkpoints({.every = 0.5, .keep = 3}, folder.path, "hash");
  Inner state;
  const Persistence persistence{.role = "fluid", .checkpoints = &checkpoints};
  const StateVisitor visit = [&](StateArchive& archive) { archive("state", state); };
  CHECK(failure_of(ExitCode::bad_input_file, [&] { find_checkpoint(folder.path, "latest"); })
            .find("holds no complete checkpoint") != std::string::npos);
  for (int step = 1; step <= 20; ++step) // due at 0.5, 1.0, 1.5, 2.0
  {
    state.m = step;
    CHECK(persistence.after_step(0.1 * step + 1e-9, step, visit).empty());
  }
  const Checkpoint latest = find_checkpoint(folder.path, "latest");
  CHECK(latest.folder == folder / "checkpoints/000003");
  CHECK(latest.manifest.t == 0.1 * 20 + 1e-9);
  CHECK(latest.manifest.window == 20);
  CHECK(latest.manifest.case_hash == "hash");
  CHECK_FALSE(std::filesystem::exists(folder / "checkpoints/000000")); // three are kept
  CHECK(std::filesystem::exists(folder / "checkpoints/000001/manifest.toml"));

  Inner read;
  const Persistence again{.role = "fluid", .from = &latest};
  again.restore([&](StateArchive& archive) { archive("state", read); });
  CHECK(read.m == 20);

  std::ofstream(folder / "checkpoints/000003/fluid.h5", std::ios::app) << "x"; // damaged: passed over
  CHECK(find_checkpoint(folder.path, "latest").folder == folder / "checkpoints/000002");
  std::filesystem::remove(folder / "checkpoints/000002/manifest.toml"); // never completed
  CHECK(find_checkpoint(folder.path, "latest").folder == folder / "checkpoints/000001");
  CHECK(failure_of(ExitCode::bad_input_file, [&] { find_checkpoint(folder.path, "000002"); })
            .find("never completed") != std::string::npos);
  CHECK(find_checkpoint(folder.path, folder / "checkpoints/000001").manifest.window == 10);
}

TEST_CASE("a history is cut to the checkpoint and goes on", "[common][unit]")
{
  const TemporaryFolder folder;
  std::string whole;
  {
    History history(folder.path, "tip", "x", {"u_x[m]"});
    history.write(0.0, {1.0});
    save(history, folder / "state.h5");
    history.write(1.0, {2.0});
    whole = content_of(folder / "history/tip.csv");
    history.write(2.0, {3.0});
  }
  History again(folder.path, "tip", "x", {"u_x[m]"});
  CHECK(content_of(folder / "history/tip.csv").size() >
        whole.size()); // nothing is lost before the state is read
  load(again, folder / "state.h5");
  again.write(1.0, {2.0});
  CHECK(content_of(folder / "history/tip.csv") == whole);
}
