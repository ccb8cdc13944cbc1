#!/usr/bin/python3
"""The mistakes of a user, with the real programs on one mpirun line: exit code, file, line, caret, rule, nearest name, once.

Example: tests/system/bad_input_test.py --build build/release BadInput.test_a_negative_density
"""
import re
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import programs  # noqa: E402

LIMIT = 8  # [s]; the programs end in a fraction of a second, mpirun on a busy machine takes more


class BadInput(programs.SystemTest):
    def expect(self, case, says, options=(), code=2, points_at=None, files=True):
        """All programs end with `code` and one message that has the parts `says`; the caret stands below `points_at`."""
        ended = programs.run(programs.coupled_line(case, self.out, "--set", "coupling.hello_timeout=4", *options), LIMIT)
        report = f"\n{ended.text}\nexit code {ended.code} after {ended.seconds:.1f} s"
        print(f"    {self._testMethodName}: {ended.seconds:.1f} s, exit code {ended.code}", file=sys.stderr)
        self.assertEqual(ended.code, code, report)
        self.assertEqual(ended.left, [], report)
        self.assertEqual(len(ended.errors()), 1, "programs that printed an error" + report)
        for text in says:
            self.assertIn(text, ended.errors()[0], report)
        if points_at:
            lines = ended.text.split("\n")
            first = lines.index(ended.errors()[0])
            source, marks = lines[first + 1:first + 3]
            found = re.search(r"\^~*", marks)
            self.assertIsNotNone(found, report)
            self.assertEqual(source[found.start():found.end()], points_at, report)
        if files:
            self.assertEqual(programs.read_failed(self.out).get("code"), str(code), report)

    def line_of(self, case, text):
        """'path:line:' of the first line of the case that contains `text`."""
        lines = Path(case).read_text().split("\n")
        return f"{case}:{next(k for k, line in enumerate(lines, start=1) if text in line)}:"

    def expect_change(self, old, new, says, points_at, place=None, **how):
        case = self.variant((old, new))
        self.expect(case, [self.line_of(case, place or new), *says], points_at=points_at, **how)

    def test_a_misspelt_key_of_the_fluid(self):
        self.expect_change("viscosity = 0.0", "viscocity = 0.0", ["unknown key 'fluid.viscocity': did you mean 'viscosity'?"], "viscocity")

    def test_a_misspelt_key_that_all_programs_read(self):
        self.expect_change("resolution = 40", "rezolution = 40", ["unknown key 'run.rezolution': did you mean 'resolution'?"], "rezolution")

    def test_a_misspelt_table(self):
        self.expect_change("[output]", "[outptu]", ["unknown table 'outptu': did you mean 'output'?"], "[outptu]")

    def test_a_negative_density(self):
        self.expect_change("density = 1000.0", "density = -1000.0", ["fluid.density = -1000.0: must be positive", "kg/m^3"], "-1000.0")

    def test_a_poisson_ratio_of_0_7(self):
        self.expect_change("poisson_ratio = 0.4", "poisson_ratio = 0.7", ["solid.poisson_ratio = 0.7: must lie in (-1, 0.5)"], "0.7")

    def test_a_value_of_the_wrong_type(self):
        self.expect_change("bulk_modulus = 2.2e9", 'bulk_modulus = "stiff"', ['fluid.bulk_modulus = "stiff": must be a number'], '"stiff"')

    def test_a_law_that_does_not_exist(self):
        self.expect_change('law = "neo_hookean_ln"', 'law = "neohookean_ln"', ["neohookean_ln", "neo_hookean_ln"], '"neohookean_ln"')

    def test_a_solid_surface_that_does_not_exist(self):
        self.expect_change('solid = "top"', 'solid = "topp"', ["interface \"wet\": solid = \"topp\"", "bottom, left, right, top", 'did you mean "top"?'],
                           '"topp"')

    def test_a_fluid_surface_that_does_not_exist(self):
        self.expect_change('fluid = "bottom"', 'fluid = "botom"', ["interface 'wet': fluid = 'botom'", "left right bottom top", "Did you mean 'bottom'?"],
                           '"botom"')

    def test_a_support_on_a_surface_that_does_not_exist(self):
        self.expect_change('on = "bottom"', 'on = "floor"', ["solid.fix[0].on = \"floor\"", "bottom, left, right, top"], '"floor"')

    def test_a_missing_end_time(self):
        self.expect_change("t_end = 0.5", "", ["missing key 'run.t_end'", "the run goes from t = 0 to this time"], "[run]", place="[run]")

    def test_a_missing_mesh_file(self):
        case = self.variant(("width = 0.05                   # m\nheight = 0.25                  # m\nelement = \"Q4\"", 'mesh = "column.msh"'),
                            ("origin = [0.0, 0.0]            # m\n", ""))
        self.expect(case, [self.line_of(case, "column.msh"), f"{self.folder}/column.msh: the mesh file cannot be read"], code=4,
                    points_at='"column.msh"')

    def test_a_broken_line(self):
        self.expect_change("height = 0.75 ", "height = = 0.75 ", ["not valid TOML"], None)

    def test_a_resolution_too_coarse_for_the_fluid(self):
        case = self.variant()
        self.expect(case, [self.line_of(case, "size_factor = 1.6"), "the spacing of fluid nodes is larger than the smallest extent of the box"],
                    options=["--set", "run.resolution=2"], points_at="1.6")

    def test_an_override_of_an_unknown_key(self):
        self.expect(programs.COLUMN, ["command line: unknown key 'solid.densty': did you mean 'density'?"], options=["--set", "solid.densty=1"],
                    points_at="solid.densty")

    def test_an_override_that_breaks_a_rule(self):
        self.expect(programs.COLUMN, ["command line: solid.youngs_modulus = -1: must be positive"], options=["--set", "solid.youngs_modulus=-1"],
                    points_at="-1")

    def test_an_override_without_a_value(self):
        self.expect(programs.COLUMN, ["command line: an override reads table.key=value"], options=["--set", "solid.density"])

    def test_an_unknown_option(self):
        self.expect(programs.COLUMN, ["command line:", "--colour"], options=["--colour"], files=False)

    def test_a_case_that_is_not_there(self):
        self.expect(self.folder / "nowhere" / "case.toml", [f"{self.folder}/nowhere/case.toml"], code=4)

    def test_separation_needs_the_whole_boundary(self):
        self.expect_change("separation = false", "separation = true", ["interface[0].fluid", 'write fluid = "boundary"'], '"bottom"', place='fluid = "bottom"')


class Check(programs.SystemTest):
    """scripts/run --check, with the build that is there."""

    def check(self, case, *options):
        line = [sys.executable, "-B", str(programs.ROOT / "scripts" / "run_case.py"), str(case), "--build", str(programs.BUILD), "--check",
                "--out", str(self.out), *options]
        return subprocess.run(line, capture_output=True, text=True, env=programs.ENVIRONMENT, check=False, timeout=60)

    def test_a_good_case_is_described_and_nothing_is_written(self):
        result = self.check(programs.COLUMN)
        self.assertEqual(result.returncode, 0, result.stderr)
        for part in ("coupler: 1 interface", "fluid: ", "solid in 2-D", "would run: mpirun"):
            self.assertIn(part, result.stdout)
        self.assertFalse(self.out.exists())

    def test_a_foreign_solid_is_met_and_its_surface_looked_at(self):
        result = self.check("swap_plate")
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertRegex(result.stdout, r"solid: python3 plate.py, a program of its own: .* keep (\d+) of \1 rules")
        self.assertIn("would run: mpirun", result.stdout)

    def test_a_foreign_solid_without_the_interface_is_found(self):
        result = self.check("swap_plate", "--set", 'interface.0.name="other"')
        self.assertEqual(result.returncode, 20, result.stdout + result.stderr)

    def test_what_three_programs_find_is_said_once(self):
        result = self.check(self.variant(("resolution = 40", "rezolution = 40")))
        self.assertEqual(result.returncode, 2)
        self.assertEqual(result.stderr.count("error: "), 1, result.stderr)
        self.assertNotIn("would run", result.stdout)

    def test_a_mistake_that_one_program_finds_is_found(self):
        result = self.check(self.variant(('solid = "top"', 'solid = "topp"')))
        self.assertEqual(result.returncode, 2)
        self.assertEqual(result.stderr.count("error: "), 1, result.stderr)
        self.assertIn('did you mean "top"?', result.stderr)


class CommandLine(programs.SystemTest):
    def test_help_and_version_need_no_case(self):
        for role in ("coupler", "fluid", "solid"):
            for option, part in (("--help", "--set"), ("--version", " 0.1.0")):
                result = subprocess.run([programs.program(role), option], capture_output=True, text=True, env=programs.ENVIRONMENT, check=False)
                self.assertEqual(result.returncode, 0, result.stderr)
                self.assertIn(part, result.stdout)

    def test_a_program_without_a_case_says_how_it_is_called(self):
        result = subprocess.run([programs.program("fluid")], capture_output=True, text=True, env=programs.ENVIRONMENT, check=False)
        self.assertEqual(result.returncode, 2)
        self.assertIn("the case is missing: fluid_pfem case.toml", result.stderr)


class BuildFolder(programs.SystemTest):
    """scripts/run_case.py --build: a folder from where one stands, absolute, or the name of a preset."""

    def check(self, build):
        line = [sys.executable, "-B", str(programs.ROOT / "scripts" / "run_case.py"), "bar_wave", "--check", "--out", str(self.out), "--build", str(build)]
        return subprocess.run(line, cwd=programs.BUILD.parent, capture_output=True, text=True, timeout=LIMIT)

    def test_a_folder_from_here_and_from_the_root(self):
        for build in (programs.BUILD.name, f"./{programs.BUILD.name}", f"../build/{programs.BUILD.name}", programs.BUILD):
            done = self.check(build)
            self.assertEqual((done.returncode, done.stderr), (0, ""), build)
            self.assertIn(f"would run: {programs.BUILD}/bin/solid_fe", done.stdout)

    def test_a_folder_without_programs(self):
        done = self.check("nowhere")
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertEqual(done.stderr, f"error: there is no {programs.ROOT}/build/nowhere/bin/solid_fe: scripts/run builds it, or name another build folder than --build nowhere\n")


if __name__ == "__main__":
    programs.main(__doc__)
