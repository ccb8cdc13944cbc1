// Tests of histories, logs, summaries and replaced files.
#include "common/error.hpp"
#include "common/io/folder.hpp"
#include "common/io/history.hpp"
#include "common/io/log.hpp"
#include "common/io/summary.hpp"
#include "tests/common/io/temporary_folder.hpp"

#include <catch2/catch.hpp>

#include <limits>
#include <regex>

using namespace undine;

namespace
{

/// The text of the Failure(output_failed) that `action` throws; "" if it throws none.
template <class Action>
std::string output_failure(Action&& action)
{
  try
  {
    action();
  }
  catch (const Failure& failure)
  {
    CHECK(failure.code() == ExitCode::output_failed);
    return failure.what();
  }
  return "";
}

} // namespace

TEST_CASE("a history is a CSV with name, definition and units, complete after every row", "[common][unit]")
{
  const TemporaryFolder folder;
  History tip(folder.path + "/out/deep", "tip", "displacement of the gate's tip", {"u_x[m]", "u_y[m]"});
  tip.write(0.0, {0.0, -0.0});
  tip.write(0.1, std::vector<double>{1.0 / 3.0, -1e-300});
  // Read while the file is still open: each row was flushed. 17 digits give back the same double.
  CHECK(content_of(folder / "out/deep/history/tip.csv") ==
        "# name: tip\n# definition: displacement of the gate's tip\nt[s],u_x[m],u_y[m]\n"
        "0,0,-0\n0.10000000000000001,0.33333333333333331,-1e-300\n");
  CHECK_THROWS_AS(tip.write(0.2, {1.0}), InternalError);
}

TEST_CASE("a full disk under a history fails with path and reason", "[common][unit]")
{
  const TemporaryFolder folder;
  make_folder(folder / "history");
  std::filesystem::create_symlink("/dev/full", folder / "history/tip.csv");
  CHECK(output_failure([&] { History(folder.path, "tip", "x", {"u_x[m]"}).write(0.0, {1.0}); }) ==
        (folder / "history/tip.csv") + ": cannot be written: No space left on device");
}

TEST_CASE("a folder that cannot be made fails with path and reason", "[common][unit]")
{
  const TemporaryFolder folder;
  std::ofstream(folder / "file") << "x";
  CHECK(output_failure([&] { make_folder(folder / "file/out"); }) ==
        (folder / "file/out") + ": the output folder cannot be made: Not a directory");
  CHECK(output_failure([&] { make_folder(folder / "file"); }).starts_with((folder / "file") + ": "));
  CHECK(output_failure([&] { make_log(folder / "file", "fluid", false); }) != "");
  CHECK_NOTHROW(make_folder(folder.path));
}

TEST_CASE("a file is replaced as a whole and keeps its content when the disk is full", "[common][unit]")
{
  const TemporaryFolder folder;
  const std::string path = folder / "index.xml";
  replace_file(path, "old");
  replace_file(path, "new content");
  CHECK(content_of(path) == "new content");
  CHECK_FALSE(std::filesystem::exists(path + ".new"));
  std::filesystem::create_symlink("/dev/full", path + ".new"); // the next write meets a full disk
  CHECK(output_failure([&] { replace_file(path, "newer"); }) ==
        path + ": cannot be written: No space left on device");
  CHECK(content_of(path) == "new content");
}

TEST_CASE("a summary nests dotted keys and stays valid JSON", "[common][unit]")
{
  Summary summary;
  summary.set("status", "running");
  summary.set("t_end", 0.1);
  summary.set("fluid.steps", 1200);
  summary.set("conservation.mass_drift", std::numeric_limits<double>::quiet_NaN());
  summary.set("fluid.wall_s", 1.5e-7);
  summary.set("windows", std::int64_t{1} << 40);
  summary.set("fluid.last.text", std::string("a \"quoted\" \\ line\nand \x01 ρ₀"));
  summary.set("pass", true);
  summary.set("fluid.list", std::vector{0.25, std::numeric_limits<double>::infinity()});
  summary.set("status", "completed");
  CHECK(summary.json() == R"({
  "status": "completed",
  "t_end": 0.1,
  "fluid": {
    "steps": 1200,
    "wall_s": 1.5e-07,
    "last": {
      "text": "a \"quoted\" \\ line\nand \u0001 ρ₀"
    },
    "list": [0.25, null]
  },
  "conservation": {
    "mass_drift": null
  },
  "windows": 1099511627776,
  "pass": true
}
)");
  CHECK(Summary().json() == "{}\n");
  const TemporaryFolder folder;
  summary.write(folder / "summary.json");
  CHECK(content_of(folder / "summary.json") == summary.json());
  summary.set("t_end.x", 1);
  CHECK_THROWS_AS(summary.json(), InternalError);
}

TEST_CASE("a log line says when, who and how grave, and is in the file at once", "[common][unit]")
{
  const TemporaryFolder folder;
  const auto log = make_log(folder / "out", "fluid", false);
  log->info("step {}", 7);
  log->warn("close to the limit");
  const std::string stamp = R"(\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{3} fluid )";
  CHECK(std::regex_match(content_of(folder / "out/fluid.log"),
                         std::regex(stamp + "info: step 7\n" + stamp + "warning: close to the limit\n")));
}
