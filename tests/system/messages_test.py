#!/usr/bin/python3
"""Cases that a user has broken, and what `scripts/run --check` says: place, key, value, rule, what to do. docs/messages.md shows them all.

Example: tests/system/messages_test.py --build build/release [--write docs/messages.md]

Errors end with the documented code and one message; advice (warnings) leaves the code 0 and names the key to change.
"""
import argparse
import concurrent.futures
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from lib.launch import ENVIRONMENT, ROOT  # noqa: E402

BUILD = ROOT / "build" / "release"

TRIANGLE = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
1 1 "wet"
2 2 "body"
$EndPhysicalNames
$Nodes
3
1 0 0 0
2 0.05 0 0
3 {x} {y} 0
$EndNodes
$Elements
2
1 1 2 1 1 1 2
2 2 2 2 1 1 2 3
$EndElements
"""
BOX = 'origin = [0.0, 0.0]            # m\nwidth = 0.05                   # m\nheight = 0.25                  # m\nelement = "Q4"'
LONE = '\n[[fluid.wall]]\npoints = {points}\n'
# (what is wrong, case, [(from, to)], options, exit code, parts of the message)
COLUMN, BAR, TANK, GATES = "elastic_column", "bar_wave", "dam_break", "two_gates"
BROKEN = [
    # the file
    ("a misspelt key", COLUMN, [("viscosity = 0.0", "viscocity = 0.0")], [], 2, ["case.toml:", "unknown key 'fluid.viscocity': did you mean 'viscosity'?", "^"]),
    ("a misspelt key that all programs read", COLUMN, [("resolution = 40", "rezolution = 40")], [], 2, ["unknown key 'run.rezolution': did you mean 'resolution'?"]),
    ("a misspelt table", COLUMN, [("[output]", "[outptu]")], [], 2, ["unknown table 'outptu': did you mean 'output'?"]),
    ("a misspelt key of a wall", TANK, [('name = "tank"', 'nmae = "tank"')], [], 2, ["unknown key 'fluid.wall[0].nmae': did you mean 'name'?"]),
    ("a text where a number belongs", COLUMN, [("bulk_modulus = 2.2e9", 'bulk_modulus = "stiff"')], [], 2, ['fluid.bulk_modulus = "stiff": must be a number', "Pa"]),
    ("a number where a text belongs", COLUMN, [('law = "neo_hookean_ln"', "law = 3")], [], 2, ["solid.law = 3: must be a text"]),
    ("a word that is no choice", COLUMN, [('law = "neo_hookean_ln"', 'law = "neohookean_ln"')], [], 2, ["neohookean_ln", 'did you mean "neo_hookean_ln"?']),
    ("a required key left out", COLUMN, [("density = 1000.0               # kg/m^3\n", "")], [], 2, ["missing key 'fluid.density'", "kg/m^3"]),
    ("no end time", COLUMN, [("t_end = 0.5 ", "#")], [], 2, ["missing key 'run.t_end'", "the run goes from t = 0 to this time"]),
    ("a line that is no TOML", COLUMN, [("height = 0.75 ", "height = = 0.75 ")], [], 2, ["not valid TOML", "case.toml:"]),
    ("a key written twice", COLUMN, [("density = 1000.0 ", "density = 999.0\ndensity = 1000.0 ")], [], 2, ["'density' is written twice (first on line 12): keep one"]),
    ("an empty file", COLUMN, [(None, "")], [], 2, ["case.toml", "neither [fluid] nor [solid]"]),
    ("a schema of the future", COLUMN, [("schema = 1", "schema = 7")], [], 2, ["schema = 7", "1"]),
    ("two closures of the fluid", COLUMN, [("bulk_modulus = 2.2e9", "bulk_modulus = 2.2e9\nsound_speed = 1483.0")], [], 2,
     ["fluid.sound_speed = 1483.0: give either bulk_modulus or sound_speed, not both"]),
    ("an interface without a solid", COLUMN, [("[solid]", "[solid_]"), ("[[solid.fix]]", "[[solid_.fix]]")], [], 2, ["unknown table 'solid_': did you mean 'solid'?"]),
    ("a solid and a fluid without an interface", COLUMN, [("[[interface]]", "[[interfaces]]")], [], 2, ["at least one [[interface]] with name, fluid and solid"]),
    ("two solids of one name", GATES, [('name = "right_gate"', 'name = "left_gate"')], [], 2, ['solid[1].name = "left_gate": another entry has this name', "^"]),
    ("solids whose names are too long together", GATES, [('name = "left_gate"', "".join(f'name = "{c * 31}"\n[[solid]]\n' for c in "abcd") + 'name = "left_gate"')], [], 2,
     ['solid[3].name = "', "must fit into 122 bytes, with this one they take 128: write shorter names", "^"]),
    ("a surface of no solid", GATES, [('body = "right_gate"', 'body = "rihgt_gate"')], [], 2, ['interface[1].body = "rihgt_gate"', 'did you mean "right_gate"?']),
    ("an interface that does not say of which solid", GATES, [('body = "right_gate"\n', "")], [], 2, ["missing key 'interface[1].body'", "needed where there are several"]),
    ("a misspelt key of one of two solids", GATES, [("[[solid.fix]]\n", "[[solid.fixx]]\n")], [], 2, ["unknown table 'solid.fixx'", "did you mean 'fix'?"]),
    # the command line
    ("a case that is not there", "nowhere", [], [], 4, ["no case 'nowhere'", "Cases here:", "elastic_column"]),
    ("an override of an unknown key", COLUMN, [], ["--set", "solid.densty=1"], 2, ["command line: unknown key 'solid.densty': did you mean 'density'?"]),
    ("an override without a value", COLUMN, [], ["--set", "solid.density"], 2, ["command line: an override reads table.key=value"]),
    ("an end before the beginning", COLUMN, [], ["--until=-1"], 2, ["--until", "must be positive"]),
    ("ranks of a program that is not there", BAR, [], ["--ranks", "fluid=4"], 2, ["--ranks fluid=4", "solid"]),
    ("an option that is not there", COLUMN, [], ["--colour"], 2, ["--colour"]),
    # values
    ("a negative density", COLUMN, [("density = 1000.0", "density = -1000.0")], [], 2, ["fluid.density = -1000.0: must be positive", "kg/m^3"]),
    ("a Poisson ratio of 0.7", COLUMN, [("poisson_ratio = 0.4", "poisson_ratio = 0.7")], [], 2, ["solid.poisson_ratio = 0.7: must lie in (-1, 0.5)"]),
    ("an incompressible solid", COLUMN, [("poisson_ratio = 0.4", "poisson_ratio = 0.5")], [], 2, ["solid.poisson_ratio = 0.5: must lie in (-1, 0.5)"]),
    ("a solid without stiffness", COLUMN, [("youngs_modulus = 2.3e5", "youngs_modulus = 0.0")], [], 2, ["solid.youngs_modulus = 0.0: must be positive"]),
    ("four dimensions", COLUMN, [("dimension = 2", "dimension = 4")], [], 2, ["run.dimension = 4: must lie in [2, 3]"]),
    ("an end time of zero", COLUMN, [("t_end = 0.5", "t_end = 0.0")], [], 2, ["run.t_end = 0.0: must be positive"]),
    ("gravity with three components in the plane", COLUMN, [("gravity = [0.0, -10.0]         # m/s^2\ninitial", "gravity = [0.0, -10.0, 0.0]\ninitial")], [], 2,
     ["fluid.gravity", "must have 2 entries, not 3"]),
    ("a formula that cannot be read", TANK, [("viscosity = 0.0", 'viscosity = 0.0\nbody_force = ["0", "sin(t"]')], [], 2, ["fluid.body_force[1]", "sin(t"]),
    ("one formula for two components", TANK, [("viscosity = 0.0", 'viscosity = 0.0\nbody_force = ["sin(t)"]')], [], 2, ["fluid.body_force", "needs 2 formulas"]),
    ("sub-steps that are no number", COLUMN, [('substeps = "auto"', 'substeps = "many"')], [], 2, ["coupling.substeps", "many", "auto"]),
    ("half steps with sub-steps", COLUMN, [('substeps = "auto"', 'substeps = 10\nform = "half_step"')], [], 2, ['coupling.substeps = 10', 'form = "half_step" is stable at equal steps only']),
    ("a form of the window where water may leave", GATES, [("[output]", '[coupling]\nform = "macro_continuity"\n\n[output]')], [], 2, ["coupling.form", "separation = true has a form of its own"]),
    ("continuity at the windows' ends with a lumped operator", COLUMN, [('substeps = "auto"', 'substeps = "auto"\nform = "macro_continuity"\noperator = "lumped"')], [], 2, ["coupling.operator", "finds multipliers by trial"]),
    ("no sub-steps", COLUMN, [('substeps = "auto"', "substeps = 0")], [], 2, ["coupling.substeps = 0: must be at least 1"]),
    ("an end before the first step", BAR, [("t_end = 1.54179852e-3 ", "t_end = 1e-9 ")], [], 20, ["run.t_end = 1e-09", "shorter than one time step"]),
    # geometry
    ("a body of water in millimetres", COLUMN, [("height = 0.75 ", "height = 750000.0 ")], [], 2, ["fluid", "nodes", "in metres"]),
    ("a surface of the solid that does not exist", COLUMN, [('solid = "top"', 'solid = "topp"')], [], 2, ['solid = "topp"', "bottom, left, right, top", 'did you mean "top"?']),
    ("a surface of the fluid that does not exist", COLUMN, [('fluid = "bottom"', 'fluid = "botom"')], [], 2, ["fluid = 'botom'", "left right bottom top", "Did you mean 'bottom'?"]),
    ("a support on a surface that does not exist", COLUMN, [('[[solid.fix]]\non = "bottom"', '[[solid.fix]]\non = "floor"')], [], 2, ['solid.fix[0].on = "floor"', "bottom, left, right, top"]),
    ("a wall on a side that does not exist", COLUMN, [('[[fluid.wall]]\non = "left"', '[[fluid.wall]]\non = "west"')], [], 2, ["west", "left"]),
    ("a wall without a place", TANK, [("points = [0.0, 9.0, 0.0, 0.0, 0.584, 0.0, 0.584, 9.0]", "#")], [], 2, ["fluid.wall[0]", "a wall needs `on`, `points`"]),
    ("half a corner of a wall", TANK, [("points = [0.0, 9.0, 0.0,", "points = [0.0, 9.0,")], [], 2, ["fluid.wall[0].points", "x, y pairs"]),
    ("fluid and solid in the same place", COLUMN, [("origin = [0.0, 0.25] ", "origin = [0.0, 0.1] ")], [], 20, ["overlap", "fluid.origin", "solid.origin"]),
    ("fluid and solid that do not meet", COLUMN, [("origin = [0.0, 0.25] ", "origin = [0.0, 0.5] ")], [], 20, ['interface "wet"', "0.25 m", "apart"]),
    ("a solid in millimetres", COLUMN, [("width = 0.05                   # m\nheight = 0.25 ", "width = 50.0\nheight = 250.0 ")], [], 2, ["solid.width = 50", "3.2e+08 elements", "in metres"]),
    ("a solid without thickness", COLUMN, [("width = 0.05                   # m\nheight = 0.25 ", "width = 0.0\nheight = 0.25 ")], [], 2, ["solid.width = 0.0: must be positive"]),
    ("elements larger than the fluid", COLUMN, [], ["--set", "run.resolution=2"], 2, ["the spacing of fluid nodes is larger than the smallest extent of the box", "refine run.resolution"]),
    ("a mesh file that is not there", COLUMN, [(BOX, 'mesh = "column.msh"')], [], 4, ["column.msh: the mesh file cannot be read"]),
    ("a file that is no mesh", COLUMN, [(BOX, 'mesh = "case.toml"')], [], 4, ["case.toml", "is not a Gmsh mesh: it does not begin with $MeshFormat"]),
    ("a mesh with a flat element", COLUMN, [(BOX, 'mesh = "flat.msh"'), ('[[solid.fix]]\non = "left"\ncomponents = ["x"]\n\n[[solid.fix]]\non = "right"\ncomponents = ["x"]\n', ""),
                                            ('on = "bottom"\ncomponents', 'on = "wet"\ncomponents'), ('solid = "top"', 'solid = "wet"')], [], 4, ["flat.msh", "element 2", "is flat: it has no area"]),
    ("a probe outside the solid", COLUMN, [("point = [0.025, 0.25] ", "point = [0.025, 7.0] ")], [], 20, ["probe[0].point = [0.025, 7.0]", "outside the solid", "0.25) m"]),
    ("a probe of something that is not measured", COLUMN, [('quantity = ["u", "v"]', 'quantity = ["stress"]')], [], 2, ["stress", "u"]),
    ("a probe without a place", COLUMN, [("point = [0.025, 0.25] ", "#")], [], 2, ["probe[0]", "'point'", "'surface'"]),
    ("two probes with one name", TANK, [("[[probe]]", '[[probe]]\nname = "front"\non = "fluid"\nquantity = "front"\n\n[[probe]]')], [], 2, ["probe[1].name", "another probe has this name"]),
    ("a reference file that is not there", COLUMN, [('file = "reference/column1d_nonlinear.csv"', 'file = "reference/mine.csv"')], [], 2, ["reference[0]", "mine.csv", "no such file"]),
    ("a measure that does not exist", COLUMN, [('measure = "relative_L2"', 'measure = "relativ_L2"')], [], 2, ["reference[0]", "relativ_L2", "relative_L2"]),
    ("a column that the history does not have", COLUMN, [('column = "u_y[m]"', 'column = "uy"')], [], 2, ["reference[0]", "uy", "u_y[m]"]),
    ("a solid program that is not there", COLUMN, [("[solid]\n", '[solid]\nprogram = ["my_solid"]\n')], [], 2, ["my_solid", "PATH"]),
]
ADVICE = [
    ("water in g/cm3", COLUMN, [("density = 1000.0", "density = 1.0")], [], ["fluid.density = 1", "g/cm3", "kg/m^3"]),
    ("a modulus in MPa", COLUMN, [("youngs_modulus = 2.3e5", "youngs_modulus = 0.23")], [], ["solid.youngs_modulus = 0.23", "MPa"]),
    ("gravity in mm/s2", COLUMN, [("gravity = [0.0, -10.0]         # m/s^2\ninitial", "gravity = [0.0, -9810.0]\ninitial")], [], ["fluid.gravity", "mm/s2"]),
    ("viscosity in cP", COLUMN, [("viscosity = 0.0", "viscosity = 1.0")], [], ["fluid.viscosity = 1", "water"]),
    ("a sound speed too low for the fall", TANK, [("sound_speed = 16.925", "sound_speed = 3.0")], [], ["fluid.sound_speed = 3", "at least"]),
    ("a solid thinner than its elements", COLUMN, [], ["--set", "solid.size_factor=8"], ["elements over", "solid"]),
    ("a run longer than a day", TANK, [], ["--until", "1e5"], ["longer than a day", "run.t_end", "run.resolution"]),
    ("a solid in g/cm3", COLUMN, [("density = 1500.0", "density = 1.5")], [], ["solid.density = 1.5", "g/cm3", "kg/m^3"]),
    ("gravity of the solid in mm/s2", COLUMN, [("gravity = [0.0, -10.0]         # m/s^2\norigin", "gravity = [0.0, -9810.0]\norigin")], [], ["solid.gravity = 9810", "mm/s2", "differs"]),
    ("a bulk modulus in GPa", COLUMN, [("bulk_modulus = 2.2e9", "bulk_modulus = 2.2")], [], ["fluid.bulk_modulus = 2.2", "GPa"]),
    ("a bulk modulus too low for the fall", COLUMN, [("bulk_modulus = 2.2e9", "bulk_modulus = 2.2e4")], [], ["fluid.bulk_modulus = 22000", "too slow", "fluid.sound_speed ="]),
    ("a sound speed too low for a solid that comes", "wedge_impact", [("bulk_modulus = 2.2e9", "bulk_modulus = 1e7")], [], ["fluid.bulk_modulus = 1e+07", "flow of 30 m/s", "300 m/s"]),
    ("an extreme ratio of the steps", COLUMN, [("bulk_modulus = 2.2e9", "bulk_modulus = 2.2e12")], [], ["sub-steps", "coupling.substeps_max"]),
]


def prepare(folder, case, changes):
    """A copy of `case` in `folder` with texts replaced; returns its path."""
    source = ROOT / "cases" / case
    if not source.is_dir():
        return case
    text = (source / "case.toml").read_text()
    for old, new in changes:
        if old is None:
            text = new
            continue
        assert old in text, f"cases/{case} no longer has {old!r}"
        text = text.replace(old, new)
    (folder / "case.toml").write_text(text)
    (folder / "flat.msh").write_text(TRIANGLE.format(x=0.1, y=0.0))
    for other in source.iterdir():
        if other.name != "case.toml":
            (folder / other.name).symlink_to(other)
    return folder / "case.toml"


def check(entry):
    """(exit code, text) of scripts/run --check on the broken case; the text names the case as case.toml."""
    _, case, changes, options, *_ = entry
    with tempfile.TemporaryDirectory() as name:
        path = prepare(Path(name), case, changes)
        try:
            done = subprocess.run([sys.executable, "-B", ROOT / "scripts" / "run_case.py", path, "--build", BUILD, "--check", "--out", Path(name) / "out", *options],
                                  capture_output=True, text=True, env=ENVIRONMENT, timeout=60)
        except subprocess.TimeoutExpired:
            return None, "no answer in 60 s"
        return done.returncode, (done.stderr + done.stdout).replace(f"{name}/", "").replace(str(BUILD), "build/release")


def check_all(entries):
    with concurrent.futures.ThreadPoolExecutor(6) as pool:  # the programs wait more than they work
        return list(pool.map(check, entries))


class Messages(unittest.TestCase):
    def test_every_broken_case_gets_its_message(self):
        results = check_all(BROKEN)
        for entry, (code, text) in zip(BROKEN, results):
            with self.subTest(entry[0]):
                self.assertEqual(code, entry[4], text)
                self.assertEqual(text.count("error: "), 1, text)
                for part in entry[5]:
                    self.assertIn(part, text)
                self.assertNotIn("Traceback", text)

    def test_every_doubtful_case_gets_advice_and_the_key_to_change(self):
        for entry, (code, text) in zip(ADVICE, check_all(ADVICE)):
            with self.subTest(entry[0]):
                self.assertEqual(code, 0, text)
                advice = "\n".join(line for line in text.split("\n") if line.startswith("advice: "))
                for part in entry[4]:
                    self.assertIn(part, advice, text)

    def test_good_cases_get_none(self):
        good = [("", case, [], []) for case in (COLUMN, BAR, TANK, "hydrostatic_tank", "standing_wave", "viscous_wave", "wedge_impact", "elastica", "elastic_gate")]
        for entry, (code, text) in zip(good, check_all(good)):
            with self.subTest(entry[1]):
                self.assertEqual(code, 0, text)
                self.assertNotIn("advice:", text)
                self.assertRegex(text, r"estimate: (fluid|solid) about \d+ steps of \d+ nodes, up to .* of computing")
                self.assertRegex(text, r"estimate: [\d.]+ MB of memory, \d+ frames of [\d.]+ [kM]?B in all")
                if entry[1] == COLUMN:  # 2081 windows of 95 sub-steps in docs/benchmarks/column_convergence.md
                    self.assertRegex(text, r"estimate: about 20[78]\d windows of 95 sub-steps of the fluid")


def write_page(path):
    lines = ["# What the programs say about a broken case", "",
             "Every message names place, key, value, rule and what to do. This page is written by `tests/system/messages_test.py --write docs/messages.md` from the "
             "cases that the test breaks; `scripts/run CASE --check` gives them without running anything.", "", f"## {len(BROKEN)} errors", ""]
    for entry, (code, text) in zip(BROKEN, check_all(BROKEN)):
        lines += [f"**{entry[0]}** (exit code {code})", "", "```", text.strip(), "```", ""]
    lines += [f"## Advice in {len(ADVICE)} doubtful cases", "", "The case is valid and would run; the exit code is 0.", ""]
    for entry, (_, text) in zip(ADVICE, check_all(ADVICE)):
        lines += [f"**{entry[0]}**", "", "```", "\n".join(line for line in text.split("\n") if line.startswith("advice: ")), "```", ""]
    path.write_text("\n".join(lines))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, default=BUILD)
    parser.add_argument("--write", type=Path, metavar="FILE", help="write the page of all messages")
    arguments, rest = parser.parse_known_args()
    BUILD = arguments.build.resolve()
    if arguments.write:
        write_page(arguments.write)
    else:
        unittest.main(argv=[sys.argv[0], "-v", *rest])
