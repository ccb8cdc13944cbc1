// Tests of the tables all programs read, and of the command line.
#include "common/config/command_line.hpp"
#include "common/config/run_config.hpp"
#include "common/error.hpp"
#include "tests/common/config/error_of.hpp"
#include "tests/common/io/temporary_folder.hpp"

#include <catch2/catch.hpp>

using namespace undine;
using undine::test::error_of;

namespace
{

CommandLine parse_line(std::vector<const char*> arguments)
{
  arguments.insert(arguments.begin(), "fluid_pfem");
  return parse_command_line("fluid_pfem", static_cast<int>(arguments.size()), arguments.data());
}

const std::string run_table = "[run]\nt_end = 2\nresolution = 40\ncharacteristic_length = 0.2\n";

} // namespace

TEST_CASE("a run is read with its defaults, and its resolution gives the element size", "[common][unit]")
{
  const CaseFile file = CaseFile::parse(run_table, "cases/gate/case.toml");
  const RunConfig run = read_run_config(file);
  CHECK(run.name == "gate");
  CHECK(run.dim == 2);
  CHECK(run.t_begin == 0.0);
  CHECK(run.t_end == 2.0);
  CHECK(run.preset == "hydraulic");
  CHECK(run.element_size() == 0.2 / 40);
  const OutputConfig output = read_output_config(file, "runs/gate");
  CHECK(output.dir == "runs/gate");
  CHECK(output.frame_interval == 0.0);
  CHECK(output.history_interval == 0.0);
  CHECK(output.frames);
  CHECK(read_probe_configs(file, 2).empty());
  CHECK_NOTHROW(file.reject_unknown_keys({"run", "output", "probe"}));
}

TEST_CASE("run, output and probes are read as written", "[common][unit]")
{
  const CaseFile file = CaseFile::parse(run_table + R"(name = "sloshing"
dimension = 3
preset = "impact"
[output]
every = 0.1
history_every = 1e-3
frames = false
[[probe]]
name = "tip"
on = "solid"
point = [0.3, 0.08, 0]
quantity = ["u", "v"]
[[probe]]
name = "wall"
on = "fluid"
surface = "right"
quantity = "p"
)",
                                        "case.toml");
  const RunConfig run = read_run_config(file);
  CHECK(run.name == "sloshing");
  CHECK(run.dim == 3);
  CHECK(run.preset == "impact");
  const OutputConfig output = read_output_config(file, "out");
  CHECK(output.frame_interval == 0.1);
  CHECK(output.history_interval == 1e-3);
  CHECK_FALSE(output.frames);
  const auto probes = read_probe_configs(file, run.dim);
  REQUIRE(probes.size() == 2);
  CHECK(probes[0].at_point());
  CHECK(probes[0].point == std::vector<double>{0.3, 0.08, 0.0});
  CHECK(probes[0].fields == std::vector<std::string>{"u", "v"});
  CHECK_FALSE(probes[1].at_point());
  CHECK(probes[1].on == "fluid");
  CHECK(probes[1].surface == "right");
  CHECK(probes[1].fields == std::vector<std::string>{"p"});
  CHECK_NOTHROW(file.reject_unknown_keys({"run", "output", "probe"}));
}

TEST_CASE("a wrong run, output or probe is answered with place and rule", "[common][unit]")
{
  const auto run_error = [](const std::string& text)
  { return error_of([&] { read_run_config(CaseFile::parse(text, "case.toml")); }); };
  CHECK(run_error(run_table + "dimension = 4\n") ==
        "case.toml:5:13: run.dimension = 4: must lie in [2, 3] (2 (plane strain) or 3)\n"
        "  dimension = 4\n"
        "              ^");
  CHECK(run_error("[run]\nt_end = 0\n") ==
        "case.toml:2:9: run.t_end = 0: must be positive (the run goes from t = 0 to this time, s)\n"
        "  t_end = 0\n"
        "          ^");
  const auto probe_error = [](const std::string& text)
  { return error_of([&] { read_probe_configs(CaseFile::parse("[[probe]]\n" + text, "case.toml"), 2); }); };
  CHECK(probe_error("name = \"a\"\non = \"fluid\"\nquantity = \"p\"\n") ==
        "case.toml:1:1: probe[0]: a probe needs a 'point', a 'surface' or (fluid) a 'wall'\n"
        "  [[probe]]\n"
        "  ^~~~~~~~~");
  CHECK(probe_error("name = \"a\"\non = \"fluid\"\nquantity = \"p\"\npoint = [0, 1, 2]\n")
            .starts_with("case.toml:5:9: probe[0].point = [0, 1, 2]: must have 2 entries, not 3 "));
  CHECK(probe_error("name = \"a\"\non = \"fluid\"\npoint = [0, 1]\n")
            .starts_with("case.toml:1:1: probe[0].quantity: a probe needs a 'quantity'"));
  CHECK(probe_error("name = \"a/b\"\non = \"fluid\"\npoint = [0, 1]\nquantity = \"p\"\n")
            .starts_with("case.toml:2:8: probe[0].name = \"a/b\": must be a file name without '/'"));
  const std::string probe = "name = \"a\"\non = \"fluid\"\npoint = [0, 1]\nquantity = \"p\"\n";
  CHECK(probe_error(probe + "[[probe]]\n" + probe)
            .starts_with("case.toml:7:8: probe[1].name = \"a\": another probe has this name"));
  CHECK(probe_error(probe + "surface = \"left\"\n").find("not several") != std::string::npos);
}

TEST_CASE("every option of the command line arrives", "[common][unit]")
{
  const CommandLine line =
      parse_line({"--set", "fluid.gravity=[0, -9.81]", "cases/gate/case.toml", "--set=a.b=c d", "--out",
                  "here", "--until", "0.25", "--check", "--verbose"});
  CHECK(line.case_path == "cases/gate/case.toml");
  CHECK(line.out_dir == "here");
  CHECK(line.overrides == std::vector<std::string>{"fluid.gravity=[0, -9.81]", "a.b=c d", "run.t_end=0.25"});
  CHECK(line.check_only);
  CHECK(line.verbose);
  CHECK_FALSE(line.document_keys);
  CHECK(line.answer == "");
}

TEST_CASE("the output folder is named after the case's folder", "[common][unit]")
{
  CHECK(parse_line({"cases/gate/case.toml"}).out_dir == "runs/gate");
  CHECK(parse_line({"/tmp/../srv/gate/case.toml"}).out_dir == "runs/gate");
  const TemporaryFolder folder; // a folder means the case.toml inside
  CHECK(parse_line({folder.path.c_str()}).case_path == folder / "case.toml");
  CHECK(parse_line({folder.path.c_str()}).out_dir ==
        "runs/" + std::filesystem::path(folder.path).filename().string());
}

TEST_CASE("help and version are answers, not runs", "[common][unit]")
{
  CHECK(parse_line({"--version"}).answer == std::string("fluid_pfem ") + UNDINE_VERSION + "\n");
  CHECK(parse_line({"--help"}).answer.find("--until") != std::string::npos);
  CHECK(parse_line({"--document-keys"}).document_keys);
}

TEST_CASE("a wrong command line is an error with exit code 2 that names the argument", "[common][unit]")
{
  CHECK(error_of([] { parse_line({}); }) ==
        "command line: the case is missing: fluid_pfem case.toml (see fluid_pfem --help)");
  CHECK(error_of([] { parse_line({"case.toml", "--utnil", "1"}); }).find("--utnil") != std::string::npos);
  CHECK(error_of([] { parse_line({"case.toml", "--until", "soon"}); }).find("soon") != std::string::npos);
  CHECK(error_of(
            [] {
              parse_line({"case.toml", "--until", "-1"});
            }) == "command line: --until -1: must be positive (end time, s)");
  CHECK(error_of([] { parse_line({"case.toml", "--set"}); }).find("--set") != std::string::npos);
  CHECK(error_of([] { parse_line({"case.toml", "other.toml"}); }).find("other.toml") != std::string::npos);
}
