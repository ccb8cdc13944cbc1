// Tests of the case file: reading, defaults, overrides, places of mistakes, documentation.
#include "common/config/case_file.hpp"
#include "common/config/nearest_word.hpp"

#include "common/error.hpp"
#include "tests/common/config/error_of.hpp"

#include <catch2/catch.hpp>

#include <filesystem>
#include <fstream>

using namespace undine;
using undine::test::error_of;

namespace
{

const Key density{"density", "kg/m^3", "reference density rho0"};
const Key gravity{"gravity", "m/s^2", "acceleration of gravity"};

CaseFile parse(const std::string& text, const std::vector<std::string>& overrides = {})
{
  return CaseFile::parse(text, "cases/a/case.toml", overrides);
}

} // namespace

TEST_CASE("values of every type are read as written", "[common][unit]")
{
  const CaseFile file = parse(R"(schema = 1
[fluid]
density = 1000          # an integer is a number
viscosity = 1.0e-3
gravity = [0, -9.81]
name = "water"
moving = true
steps = 20
tags = ["a", "b"]
substeps = "auto"
inner = { depth = 2.0 }
[[interface]]
kind = "slip"
[[interface]]
kind = "no_slip"
)");
  const CaseTable fluid = file.table("fluid", "the fluid");
  CHECK(fluid.present());
  CHECK(fluid.path() == "fluid");
  CHECK(fluid.number(density, positive()) == 1000.0);
  CHECK(fluid.number({"viscosity", "Pa s", "dynamic viscosity"}, non_negative()) == 1.0e-3);
  CHECK(fluid.numbers(gravity, 2, any_number()) == std::vector<double>{0.0, -9.81});
  CHECK(fluid.text({"name", "", "name"}) == "water");
  CHECK(fluid.boolean({"moving", "", "moves"}, false));
  CHECK(fluid.integer({"steps", "", "steps"}, at_least(1)) == 20);
  CHECK(fluid.texts({"tags", "", "tags"}, {}) == std::vector<std::string>{"a", "b"});
  CHECK(fluid.is_text("substeps"));
  CHECK_FALSE(fluid.is_text("steps"));
  CHECK_FALSE(fluid.is_text("absent"));
  CHECK(fluid.table("inner", "inner").number({"depth", "m", "depth"}, positive()) == 2.0);
  CHECK(fluid.has("density"));
  CHECK_FALSE(fluid.has("absent"));
  const auto interfaces = file.tables("interface", "interfaces");
  REQUIRE(interfaces.size() == 2);
  CHECK(interfaces[1].path() == "interface[1]");
  CHECK(interfaces[1].choice({"kind", "", "kind"}, {"slip", "no_slip"}) == "no_slip");
  CHECK(file.has_table("interface"));
  CHECK_FALSE(file.has_table("solid"));
}

TEST_CASE("absent keys and tables give their defaults", "[common][unit]")
{
  const CaseFile file = parse("");
  const CaseTable fluid = file.table("fluid", "the fluid");
  CHECK_FALSE(fluid.present());
  CHECK(fluid.number(density, 7.0, positive()) == 7.0);
  CHECK_FALSE(fluid.optional_number(density, positive()).has_value());
  CHECK(fluid.integer({"steps", "", "steps"}, 3, positive()) == 3);
  CHECK_FALSE(fluid.optional_integer({"steps", "", "steps"}, positive()).has_value());
  CHECK(fluid.boolean({"moving", "", "moves"}, true));
  CHECK(fluid.text({"name", "", "name"}, "x") == "x");
  CHECK_FALSE(fluid.optional_text({"name", "", "name"}).has_value());
  CHECK(fluid.choice({"kind", "", "kind"}, "slip", {"slip", "no_slip"}) == "slip");
  CHECK(fluid.numbers(gravity, 2, {0.0, 1.0}, any_number()) == std::vector<double>{0.0, 1.0});
  CHECK(fluid.texts({"tags", "", "tags"}, {"q"}) == std::vector<std::string>{"q"});
  CHECK(fluid.tables("patch", "patches").empty());
  CHECK_FALSE(fluid.table("inner", "inner").present());
}

TEST_CASE("rules hold on their side of the bound and say so", "[common][unit]")
{
  CHECK(positive().holds(1e-300));
  CHECK_FALSE(positive().holds(0.0));
  CHECK(non_negative().holds(0.0));
  CHECK_FALSE(non_negative().holds(-1e-300));
  CHECK(at_least(2).holds(2.0));
  CHECK_FALSE(at_least(2).holds(1.999));
  CHECK(between(0, 1).holds(0.0));
  CHECK(between(0, 1).holds(1.0));
  CHECK_FALSE(strictly_between(-1, 0.5).holds(0.5));
  CHECK(strictly_between(-1, 0.5).holds(0.499));
  CHECK(strictly_between(-1, 0.5).text == "must lie in (-1, 0.5)");
  CHECK(at_least(3).text == "must be at least 3");
}

TEST_CASE("an override replaces a value, adds a key, and reaches into a list of tables", "[common][unit]")
{
  const std::string text = "[fluid]\ndensity = 1000\nname = \"oil\"\n[[interface]]\nkind = \"no_slip\"\n";
  const CaseFile file =
      parse(text, {"fluid.density=998.2", "interface.0.kind=slip", "fluid.name = salt water",
                   "run.name=2d-test", "run.id=7", "fluid.gravity=[0, -1]", "interface[0].separation=true"});
  const CaseTable fluid = file.table("fluid", "");
  CHECK(fluid.number(density, positive()) == 998.2);
  CHECK(fluid.text({"name", "", ""}) == "salt water");
  CHECK(fluid.numbers(gravity, 2, any_number()) == std::vector<double>{0.0, -1.0});
  const CaseTable run = file.table("run", "");
  CHECK(run.text({"name", "", ""}) == "2d-test");
  CHECK(run.text({"id", "", ""}) ==
        "7"); // the shell eats quotes, so a number may stand where a text is wanted
  const auto interfaces = file.tables("interface", "");
  REQUIRE(interfaces.size() == 1);
  CHECK(interfaces[0].choice({"kind", "", ""}, {"slip", "no_slip"}) == "slip");
  CHECK(interfaces[0].boolean({"separation", "", ""}, false));
}

TEST_CASE("a malformed override names itself", "[common][unit]")
{
  const std::string text = "[fluid]\ndensity = 1000\n[[interface]]\nkind = \"slip\"\n";
  const auto error = [&text](const std::string& entry) { return error_of([&] { parse(text, {entry}); }); };
  CHECK(error("fluid.density") == "command line: an override reads table.key=value\n"
                                  "  --set fluid.density\n"
                                  "        ^~~~~~~~~~~~~");
  CHECK(error("fluid.density=") == "command line: the value is missing: an override reads table.key=value\n"
                                   "  --set fluid.density=\n"
                                   "        ^~~~~~~~~~~~~~");
  CHECK(error("fluid.density.x=1") == "command line: 'fluid.density' is a value, not a table\n"
                                      "  --set fluid.density.x=1\n"
                                      "        ^~~~~~~~~~~~~~~");
  CHECK(error("interface.1.kind=slip") ==
        "command line: the case has 1 entries of 'interface', numbered from 0\n"
        "  --set interface.1.kind=slip\n"
        "        ^~~~~~~~~~~~~~~~");
  CHECK(error("interface.kind=slip") ==
        "command line: 'interface' is a list: name the entry, for example interface.0.kind\n"
        "  --set interface.kind=slip\n"
        "        ^~~~~~~~~~~~~~");
  CHECK(error("fluid.gravity=[0, 1") == "command line: the value is not complete: check brackets and quotes\n"
                                        "  --set fluid.gravity=[0, 1\n"
                                        "                      ^~~~~");
  CHECK(error("=3") != "");
  CHECK(error("fluid..density=3") != "");
}

TEST_CASE("a wrong override points at the command line", "[common][unit]")
{
  const CaseFile file = parse("[fluid]\ndensity = 1000\n", {"fluid.density=-1"});
  CHECK(error_of([&] { file.table("fluid", "").number(density, positive()); }) ==
        "command line: fluid.density = -1: must be positive (reference density rho0, kg/m^3)\n"
        "  --set fluid.density=-1\n"
        "                      ^~");
}

TEST_CASE("an override of a key that nobody reads is an error", "[common][unit]")
{
  const CaseFile file = parse("[fluid]\ndensity = 1000\n", {"fluid.viscocity=1"});
  const CaseTable fluid = file.table("fluid", "");
  fluid.number(density, positive());
  fluid.number({"viscosity", "Pa s", "dynamic viscosity"}, 0.0, non_negative());
  CHECK(error_of([&] { file.reject_unknown_keys({"fluid"}); }) ==
        "command line: unknown key 'fluid.viscocity': did you mean 'viscosity'?\n"
        "  --set fluid.viscocity=1\n"
        "        ^~~~~~~~~~~~~~~");
  CHECK_NOTHROW(file.reject_unknown_keys({"solid"})); // the fluid's own keys are the fluid program's business
  const CaseFile other = parse("", {"fluidd.density=1"});
  CHECK(error_of([&] { other.reject_unknown_keys({}); }) ==
        "command line: unknown table 'fluidd': did you mean 'fluid'?\n"
        "  --set fluidd.density=1\n"
        "        ^~~~~~~~~~~~~~");
}

TEST_CASE("text that is not TOML is reported with line and caret", "[common][unit]")
{
  CHECK(error_of([] { parse("[fluid]\ndensity = 1\n\ndensity = 2\n"); }) ==
        "cases/a/case.toml:4:11: 'density' is written twice (first on line 2): keep one\n"
        "  density = 2\n"
        "            ^");
  CHECK(error_of([] { parse("[fluid]\na = 1\n[fluid]\nb = 2\n"); }) ==
        "cases/a/case.toml:3:1: 'fluid' is written twice (first on line 1): keep one\n"
        "  [fluid]\n"
        "  ^~~~~~~");
  CHECK(error_of([] { parse("[fluid]\nx = 1\ndensity = 1 2\n"); }) ==
        "cases/a/case.toml:3:13: not valid TOML: invalid line format (expected newline, but got '2'.)\n"
        "  density = 1 2\n"
        "              ^");
  CHECK(error_of([] { parse("[fluid]\nname = water\n"); }) ==
        "cases/a/case.toml:2:8: not valid TOML: bad format: unknown value appeared\n"
        "  name = water\n"
        "         ^");
}

TEST_CASE("a file in another encoding is refused with its place", "[common][unit]")
{
  CHECK(error_of([] { parse("[run]\nnote = \"ρ\" # ok\nname = \"Rh\xF4ne\"\n"); }) ==
        "cases/a/case.toml:3:11: not valid UTF-8: save the file in this encoding");
  for (const std::string bad : {"\xC0\xAF", "\xE0\x80\xAF", "\xED\xA0\x80", "\xF5\x80\x80\x80", "\xE2\x82"})
    CHECK(error_of([&bad] { parse("# " + bad); }) != "");
  for (const std::string good : {"é", "€", "𝜆", "\xF4\x8F\xBF\xBF"})
    CHECK(error_of([&good] { parse("# " + good); }) == "");
}

TEST_CASE("what goes too deep is refused, however deep", "[common][unit]")
{
  const auto repeat = [](const std::string& word, std::size_t n)
  {
    std::string text;
    for (std::size_t k = 0; k < n; ++k)
      text += word;
    return text;
  };
  for (const std::size_t n : {33ul, 1000ul, 1000000ul})
  {
    CHECK(error_of([&] { parse("[run]\nx = " + repeat("[", n)); }) ==
          "cases/a/case.toml:2:37: more than 32 levels: is a bracket not closed?");
    CHECK(
        error_of([&] { parse("x = " + repeat("[\n", n)); }).starts_with("cases/a/case.toml:33:1: more than"));
    CHECK(error_of([&] { parse("x = " + repeat("{a=", n)); }).find("more than 32 levels") !=
          std::string::npos);
    CHECK(error_of([&] { parse(repeat("a.", n) + "b = 1"); }) ==
          "cases/a/case.toml:1:64: more than 32 levels: a case has keys of few words");
    CHECK(error_of([&] { parse("[" + repeat("a.", n) + "b]"); }).find("more than 32") != std::string::npos);
    CHECK(error_of([&] { parse("", {repeat("a.", n) + "b=1"}); }).find("more than 32 words") !=
          std::string::npos);
    CHECK(error_of([&] { parse("", {"a=" + repeat("[", n)}); }).find("more than 32 levels") !=
          std::string::npos);
  }
  for (const std::string quotes :
       {"\"\"\"", "\"\"\"\"", "\"\"\"\"\"", "''''"}) // closing a text on several lines
    CHECK(error_of([&] { parse("x = [" + quotes.substr(0, 3) + "a" + quotes + ", " + repeat("[", 100000)); })
              .find("more than 32 levels") != std::string::npos);
  // as deep as may be, and what only looks deep
  CHECK(error_of([&] { parse("x = " + repeat("[", 32) + repeat("]", 32)); }) == "");
  CHECK(error_of([&] { parse(repeat("a.", 31) + "b = 1"); }) == "");
  for (const std::string quote : {"\"", "'", "\"\"\"", "'''"})
    CHECK(error_of([&] { parse("x = " + quote + repeat("[.", 40) + quote); }) == "");
  CHECK(error_of([&] { parse("x = \"\\\"" + repeat("[", 40) + "\" # " + repeat("[", 40)); }) == "");
  CHECK(error_of([&] { parse("x = [" + repeat("0.5, ", 100) + "[1]]"); }) == "");
  CHECK(error_of([&] { parse(repeat("# interval [0, 1)\n", 100)); }) == "");
}

TEST_CASE("only schema 1 is accepted", "[common][unit]")
{
  CHECK_NOTHROW(parse("schema = 1"));
  CHECK(error_of([] { parse("schema = 2"); }) ==
        "cases/a/case.toml:1:10: schema = 2: must be 1 (this program reads schema 1 of the case file)\n"
        "  schema = 2\n"
        "           ^");
}

TEST_CASE("carets stay below their place behind tabs and non-ASCII letters", "[common][unit]")
{
  const CaseFile file = parse("[fluid]\n\tname = \"Rhône\"\n\tdensity = -1 # ρ₀\n");
  CHECK(error_of([&] { file.table("fluid", "").number(density, positive()); }) ==
        "cases/a/case.toml:3:12: fluid.density = -1: must be positive (reference density rho0, kg/m^3)\n"
        "  \tdensity = -1 # ρ₀\n"
        "  \t          ^~");
  const CaseFile inner = parse("fluid = { note = \"ρ₀\", density = -1 }\n");
  CHECK(error_of([&] { inner.table("fluid", "").number(density, positive()); }) ==
        "cases/a/case.toml:1:34: fluid.density = -1: must be positive (reference density rho0, kg/m^3)\n"
        "  fluid = { note = \"ρ₀\", density = -1 }\n"
        "                                   ^~");
}

TEST_CASE("a file that is not there ends with exit code 4", "[common][unit]")
{
  try
  {
    CaseFile::read("/nonexistent/case.toml");
    FAIL("no error");
  }
  catch (const InputError& error)
  {
    CHECK(error.code() == ExitCode::bad_input_file);
    CHECK(std::string(error.what()) == "/nonexistent/case.toml: there is no such case file");
  }
}

TEST_CASE("the hash follows the text and the overrides and is the same when both are", "[common][unit]")
{
  const auto hash = parse("[run]\nt_end = 1\n").hash();
  CHECK(hash == parse("[run]\nt_end = 1\n").hash());
  CHECK(hash != parse("[run]\nt_end = 2\n").hash());
  CHECK(hash != parse("[run]\nt_end = 1\n", {"run.t_end=1"}).hash());
  CHECK(parse("", {"run.a=1", "run.b=2"}).hash() != parse("", {"run.b=2", "run.a=1"}).hash());
  CHECK(hash != 0);
}

TEST_CASE("files are found beside the case", "[common][unit]")
{
  const CaseFile file = CaseFile::parse("", "cases/a/case.toml");
  CHECK(file.resolve("mesh.msh") == "cases/a/mesh.msh");
  CHECK(file.resolve("../b/mesh.msh") == "cases/b/mesh.msh");
  CHECK(file.resolve("/tmp/mesh.msh") == "/tmp/mesh.msh");
  CHECK(CaseFile::parse("", "case.toml").resolve("mesh.msh") == "mesh.msh");
}

TEST_CASE("every key that was read is documented once", "[common][unit]")
{
  const CaseFile file = parse("[[interface]]\nkind = \"slip\"\n[[interface]]\nkind = \"slip\"\n");
  const CaseTable fluid = file.table("fluid", "The fluid body.");
  fluid.number(density, 1000.0, positive());
  fluid.optional_number({"depth", "m", "water depth"}, positive());
  for (const CaseTable& entry : file.tables("interface", "Wet surfaces."))
    entry.choice({"kind", "", "contact at the wall"}, {"slip", "no_slip"});
  CHECK(file.documentation() == R"(## `[fluid]`

The fluid body.

| key | type | unit | default | rule | meaning |
| --- | --- | --- | --- | --- | --- |
| `density` | number | kg/m^3 | `1000` | positive | reference density rho0 |
| `depth` | number | m | none | positive | water depth |

## `[[interface]]`

Wet surfaces.

| key | type | unit | default | rule | meaning |
| --- | --- | --- | --- | --- | --- |
| `kind` | text |  | required | one of "slip", "no_slip" | contact at the wall |

)");
}

TEST_CASE("the nearest word is found within its distance and not beyond", "[common][unit]")
{
  const std::vector<std::string> words = {"viscosity", "density", "width"};
  CHECK(nearest_word("viscocity", words) == "viscosity");
  CHECK(nearest_word("desnity", words) == "density");
  CHECK(nearest_word("widht", words) == "width");
  CHECK(nearest_word("temperature", words) == "");
  CHECK(nearest_word("x", {"y"}) == ""); // one letter for another is no misspelling of a one-letter word
  CHECK(nearest_word("", words) == "");
}

// HELLO has 127 bytes for "fluid" and the names of the solids with commas between: 3 names of 30 and one of
// 28 are the longest that fit.
TEST_CASE("names that are too long together for a HELLO are refused where they become so", "[common][unit]")
{
  const auto case_with = [](std::size_t last)
  {
    std::string text = "schema = 1\n";
    for (int k = 0; k < 4; ++k)
      text += "[[solid]]\nname = \"" + std::string(k < 3 ? 30 : last, static_cast<char>('a' + k)) + "\"\n";
    return text;
  };
  const CaseFile fits = parse(case_with(28));
  CHECK(fits.names_of("solid").size() == 4);
  const std::string error = error_of([&] { parse(case_with(29)).names_of("solid"); });
  CHECK(error.find("case.toml:9:") != std::string::npos);
  CHECK(error.find("must fit into 122 bytes, with this one they take 123: write shorter names") !=
        std::string::npos);
}
