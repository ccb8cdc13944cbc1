// The mistakes users make in case files, each with the exact text that they get to read.
#include "common/config/case_file.hpp"
#include "common/error.hpp"

#include <catch2/catch.hpp>

using namespace undine;

namespace
{

const std::string valid = R"(schema = 1

[fluid]
density = 1000.0
viscosity = 1.0e-3
gravity = [0.0, -9.81]

[solid]
poisson_ratio = 0.3
mesh = "gate.msh"

[[interface]]
kind = "slip"
)";

std::string replace(std::string text, const std::string& from, const std::string& to)
{
  const std::size_t found = text.find(from);
  REQUIRE(found != std::string::npos);
  return text.replace(found, from.size(), to);
}

/// Reads the keys of `valid` as the programs would; @return the text of the error, "" if there is none.
std::string complaint_about(const std::string& text)
{
  try
  {
    const CaseFile file = CaseFile::parse(text, "cases/gate/case.toml");
    const CaseTable fluid = file.table("fluid", "");
    fluid.number({"density", "kg/m^3", "reference density rho0"}, positive());
    fluid.number({"viscosity", "Pa s", "dynamic viscosity mu"}, 0.0, non_negative());
    fluid.numbers({"gravity", "m/s^2", "acceleration of gravity"}, 2, any_number());
    const CaseTable solid = file.table("solid", "");
    solid.number({"poisson_ratio", "", "Poisson ratio nu"}, strictly_between(-1.0, 0.5));
    solid.integer({"layers", "", "elements through the thickness"}, 4, at_least(1));
    solid.text({"mesh", "", "mesh file"});
    solid.boolean({"rotating", "", "starts with a spin"}, false);
    for (const CaseTable& entry : file.tables("interface", ""))
      entry.choice({"kind", "", "tangential condition"}, {"slip", "no_slip"});
    file.reject_unknown_keys({"fluid", "solid", "interface"});
  }
  catch (const InputError& error)
  {
    CHECK(error.code() == ExitCode::bad_case);
    return error.what();
  }
  return "";
}

} // namespace

TEST_CASE("a valid case has nothing to complain about", "[common][unit]")
{
  CHECK(complaint_about(valid) == "");
}

TEST_CASE("a misspelt optional key is named with the nearest known one", "[common][unit]")
{
  CHECK(complaint_about(replace(valid, "viscosity", "viscocity")) ==
        "cases/gate/case.toml:5:1: unknown key 'fluid.viscocity': did you mean 'viscosity'?\n"
        "  viscocity = 1.0e-3\n"
        "  ^~~~~~~~~");
}

TEST_CASE("a misspelt required key is reported where it stands", "[common][unit]")
{
  CHECK(complaint_about(replace(valid, "density", "desnity")) ==
        "cases/gate/case.toml:4:1: unknown key 'fluid.desnity': did you mean 'density'?\n"
        "  desnity = 1000.0\n"
        "  ^~~~~~~");
}

TEST_CASE("a key that resembles none is answered with the known ones", "[common][unit]")
{
  CHECK(complaint_about(replace(valid, "kind = \"slip\"", "kind = \"slip\"\ncolour = 3")) ==
        "cases/gate/case.toml:14:1: unknown key 'interface[0].colour': known here are kind\n"
        "  colour = 3\n"
        "  ^~~~~~");
}

TEST_CASE("a misspelt table is named with the nearest known one", "[common][unit]")
{
  CHECK(
      complaint_about(replace(valid, "[solid]", "[fluid.options]\na = 1\n[solid]")) ==
      "cases/gate/case.toml:8:1: unknown table 'fluid.options': known here are density, gravity, viscosity\n"
      "  [fluid.options]\n"
      "  ^~~~~~~~~~~~~~~");
  CHECK(complaint_about(valid + "\n[outptu]\nevery = 1\n") ==
        "cases/gate/case.toml:15:1: unknown table 'outptu': did you mean 'output'?\n"
        "  [outptu]\n"
        "  ^~~~~~~~");
}

TEST_CASE("a negative density must be positive", "[common][unit]")
{
  CHECK(complaint_about(replace(valid, "1000.0", "-1")) ==
        "cases/gate/case.toml:4:11: fluid.density = -1: must be positive (reference density rho0, kg/m^3)\n"
        "  density = -1\n"
        "            ^~");
}

TEST_CASE("a Poisson ratio of 0.7 breaks its rule", "[common][unit]")
{
  CHECK(complaint_about(replace(valid, "0.3", "0.7")) ==
        "cases/gate/case.toml:9:17: solid.poisson_ratio = 0.7: must lie in (-1, 0.5) (Poisson ratio nu)\n"
        "  poisson_ratio = 0.7\n"
        "                  ^~~");
}

TEST_CASE("a value of the wrong type names the wanted one", "[common][unit]")
{
  CHECK(complaint_about(replace(valid, "1000.0", "\"heavy\"")) ==
        "cases/gate/case.toml:4:11: fluid.density = \"heavy\": must be a number (reference density rho0, "
        "kg/m^3)\n"
        "  density = \"heavy\"\n"
        "            ^~~~~~~");
  CHECK(complaint_about(replace(valid, "\"gate.msh\"", "3")) ==
        "cases/gate/case.toml:10:8: solid.mesh = 3: must be a text in quotes (mesh file)\n"
        "  mesh = 3\n"
        "         ^");
  CHECK(
      complaint_about(replace(valid, "\"gate.msh\"", "\"a\"\nlayers = 2.5")) ==
      "cases/gate/case.toml:11:10: solid.layers = 2.5: must be an integer (elements through the thickness)\n"
      "  layers = 2.5\n"
      "           ^~~");
  CHECK(complaint_about(replace(valid, "\"gate.msh\"", "\"a\"\nrotating = 1")) ==
        "cases/gate/case.toml:11:12: solid.rotating = 1: must be true or false (starts with a spin)\n"
        "  rotating = 1\n"
        "             ^");
  CHECK(complaint_about(replace(valid, "[0.0, -9.81]", "-9.81")) ==
        "cases/gate/case.toml:6:11: fluid.gravity = -9.81: must be a list of numbers (acceleration of "
        "gravity, m/s^2)\n"
        "  gravity = -9.81\n"
        "            ^~~~~");
}

TEST_CASE("NaN and infinity are no numbers", "[common][unit]")
{
  CHECK(complaint_about(replace(valid, "1000.0", "nan")) ==
        "cases/gate/case.toml:4:11: fluid.density = nan: must be finite (reference density rho0, kg/m^3)\n"
        "  density = nan\n"
        "            ^~~");
  CHECK(
      complaint_about(replace(valid, "-9.81", "-inf")) ==
      "cases/gate/case.toml:6:17: fluid.gravity[1] = -inf: must be finite (acceleration of gravity, m/s^2)\n"
      "  gravity = [0.0, -inf]\n"
      "                  ^~~~");
}

TEST_CASE("a list of the wrong length says both lengths", "[common][unit]")
{
  CHECK(complaint_about(replace(valid, "[0.0, -9.81]", "[0.0, 0.0, -9.81]")) ==
        "cases/gate/case.toml:6:11: fluid.gravity = [0.0, 0.0, -9.81]: must have 2 entries, not 3 "
        "(acceleration of gravity, m/s^2)\n"
        "  gravity = [0.0, 0.0, -9.81]\n"
        "            ^~~~~~~~~~~~~~~~~");
  CHECK(complaint_about(replace(valid, "[0.0, -9.81]", "[0.0,\n  0.0,\n  -9.81]")) ==
        "cases/gate/case.toml:6:11: fluid.gravity = [0.0, ...: must have 2 entries, not 3 "
        "(acceleration of gravity, m/s^2)\n"
        "  gravity = [0.0,\n"
        "            ^~~~~");
}

TEST_CASE("a word that is none of the choices is answered with the nearest", "[common][unit]")
{
  CHECK(complaint_about(replace(valid, "\"slip\"", "\"noslip\"")) ==
        "cases/gate/case.toml:13:8: interface[0].kind = \"noslip\": must be one of \"slip\", \"no_slip\"; "
        "did you mean \"no_slip\"? (tangential condition)\n"
        "  kind = \"noslip\"\n"
        "         ^~~~~~~~");
}

TEST_CASE("a missing key points at its table, or says that the table is missing", "[common][unit]")
{
  CHECK(complaint_about(replace(valid, "mesh = \"gate.msh\"\n", "")) ==
        "cases/gate/case.toml:8:1: missing key 'solid.mesh' (mesh file)\n"
        "  [solid]\n"
        "  ^~~~~~~");
  CHECK(complaint_about("[run]\n") ==
        "cases/gate/case.toml: missing key 'fluid.density' (reference density rho0, "
        "kg/m^3): the case has no table [fluid]");
}

TEST_CASE("a table in the place of a list of tables, and the reverse, show the right brackets",
          "[common][unit]")
{
  CHECK(complaint_about(replace(valid, "[[interface]]", "[interface]")) ==
        "cases/gate/case.toml:12:1: 'interface' is a list of tables: write [[interface]]\n"
        "  [interface]\n"
        "  ^~~~~~~~~~~");
  CHECK(complaint_about(replace(valid, "[fluid]", "[[fluid]]")) ==
        "cases/gate/case.toml:3:1: 'fluid' is one table: write [fluid]\n"
        "  [[fluid]]\n"
        "  ^~~~~~~~~");
}

TEST_CASE("a program's own check points at the value it dislikes", "[common][unit]")
{
  const CaseFile file = CaseFile::parse(valid, "cases/gate/case.toml");
  try
  {
    file.table("solid", "").fail("mesh", "there is no such file: write a path relative to the case's folder");
  }
  catch (const InputError& error)
  {
    CHECK(std::string(error.what()) ==
          "cases/gate/case.toml:10:8: solid.mesh = \"gate.msh\": there is no such file: "
          "write a path relative to the case's folder\n"
          "  mesh = \"gate.msh\"\n"
          "         ^~~~~~~~~~");
  }
}

TEST_CASE("a mistake found later gets the place of the key, entry or file it begins with", "[common][unit]")
{
  const std::string text = replace(valid, "[[interface]]",
                                   "[[solid.fix]]\non = \"left\"\n\n[[solid.fix]]\non = \"botom\"\n\n"
                                   "[[interface]]\nname = \"wet\"\nsolid = \"topp\"");
  const CaseFile file = CaseFile::parse(text, "cases/gate/case.toml", {"solid.law=rubber"});
  const auto beginning_of = [&file](const std::string& complaint)
  {
    const std::string placed = file.with_place(complaint);
    CHECK(placed.find(complaint) != std::string::npos);
    return placed.substr(0, placed.find(complaint)) +
           placed.substr(placed.find('\n', placed.find(complaint)));
  };
  CHECK(beginning_of("solid.fix[1].on = \"botom\": no such surface") ==
        "cases/gate/case.toml:16:6: \n  on = \"botom\"\n       ^~~~~~~");
  CHECK(beginning_of("solid.fix.on = 'botom': no such surface") ==
        "cases/gate/case.toml:16:6: \n  on = \"botom\"\n       ^~~~~~~");
  CHECK(beginning_of("interface \"wet\": solid = \"topp\": no such surface") ==
        "cases/gate/case.toml:20:9: \n  solid = \"topp\"\n          ^~~~~~");
  CHECK(beginning_of("interface 'wet': it has no faces") ==
        "cases/gate/case.toml:18:1: \n  [[interface]]\n  ^~~~~~~~~~~~~");
  CHECK(beginning_of("solid.law = \"rubber\": no such law") ==
        "command line: \n  --set solid.law=rubber\n                  ^~~~~~");
  CHECK(beginning_of("cases/gate/gate.msh: the mesh file cannot be read") ==
        "cases/gate/case.toml:10:8: \n  mesh = \"gate.msh\"\n         ^~~~~~~~~~");

  for (const std::string elsewhere : {"cases/gate/case.toml:3:1: solid.mesh: x", "interface 'dry': x",
                                      "solid.nothing = 3: x", "command line: x", "the case", ""})
    CHECK(file.with_place(elsewhere) == elsewhere);
}
