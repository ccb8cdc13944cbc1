#!/usr/bin/python3
"""The three-program run of the elastic column on a coarse mesh: right against the reference, and everything is written.

Example: tests/system/column_test.py --build build/release
"""
import csv
import json
import subprocess
import sys
import unittest
import xml.etree.ElementTree as xml
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import programs  # noqa: E402
from lib import case as case_file  # noqa: E402
from lib import compare  # noqa: E402

RESOLUTION = 10
T_END = 0.5
PERIOD = 0.1298  # of the fundamental mode, from the reference [s]


def read_table(path):
    """(comment lines, {column: array}) of a history."""
    with open(path, newline="") as stream:
        lines = stream.read().split("\n")
    comments = [line for line in lines if line.startswith("#")]
    rows = list(csv.reader(line for line in lines if line and not line.startswith("#")))
    data = np.array([[float(x) for x in row] for row in rows[1:]])
    return comments, {name: data[:, k] for k, name in enumerate(rows[0])}


def run_case(test, *options):
    line = [sys.executable, "-B", str(programs.ROOT / "scripts" / "run_case.py"), str(programs.COLUMN), "--build", str(programs.BUILD),
            "--out", str(test.out), "--set", f"run.resolution={RESOLUTION}", *options]
    return programs.run(line, 120)


class Column(programs.SystemTest):
    """One run, many questions."""

    @classmethod
    def setUpClass(cls):
        import tempfile
        cls._run_folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls._run_folder.cleanup)
        cls.result = Path(cls._run_folder.name)
        line = [sys.executable, "-B", str(programs.ROOT / "scripts" / "run_case.py"), str(programs.COLUMN), "--build", str(programs.BUILD),
                "--out", str(cls.result), "--set", f"run.resolution={RESOLUTION}"]
        cls.ended = programs.run(line, 120)

    def setUp(self):
        super().setUp()
        self.assertEqual(self.ended.code, 0, self.ended.text)
        self.summary = json.loads((self.result / "summary.json").read_text())

    def test_the_interface_follows_the_reference(self):
        settings = case_file.load(programs.COLUMN, [f"run.resolution={RESOLUTION}"])
        errors = {c["measure"]: c["error"] for c in compare.compare_all(programs.COLUMN, settings, self.result)}
        # Second order in space: linear elements err by (k h)^2/24 in the frequency of a mode; the fundamental has k H = 0.667 in the
        # solid (k = 2 pi/(T c_s) = 2.67 1/m, c_s = 18.1 m/s), so (k h)^2/24 = 1.9e-4 at h = H/10, and the phase error after
        # 0.5 s = 3.9 periods is 2 pi 3.9 1.9e-4 = 4.5e-3 of the amplitude at the end, 2.6e-3 in the mean square over the run. The time
        # step is of the size h/c_s and errs as much with the other sign or less. Twice the spatial error: 6e-3.
        self.assertLess(errors["relative_L2"], 6e-3)
        # Period: (k h)^2/24 = 1.9e-4 from space, as much from time, and the minima of a history that is sampled at windows
        # (140 per period) and carries the second mode: 1e-3.
        self.assertLess(errors["period_of_minima"], 1e-3)
        print(f"    relative L2 {errors['relative_L2']:.3e}, period {errors['period_of_minima']:.3e}", file=sys.stderr)

    def test_the_energy_only_falls_and_by_less_than_a_thousandth_per_period(self):
        least, most = compare.energy_changes_per_period(self.result, PERIOD)
        print(f"    energy change per period {least:.2e} to {most:.2e}", file=sys.stderr)
        self.assertGreater(least, -1e-3)
        # At least one number rises by round-off and by the O(dt^2) difference of two neighbouring phases:
        # (omega dt)^2/8 = (48.4 * 9e-4)^2/8 = 2.4e-4 of the energy, times the mismatch of the phase, 1 %.
        self.assertLess(most, 2e-5)

    def test_velocities_match_and_nothing_is_lost_at_the_interface(self):
        conservation = self.summary["conservation"]
        self.assertLess(conservation["velocity_jump"], 1e-13)  # velocities of 0.3 m/s times 2^-52, times a factor of condition
        self.assertLess(conservation["interface_energy"], 1e-12)  # GC-F only dissipates
        self.assertGreater(conservation["interface_energy"], -4e-3)  # 1e-3 per period, 3.9 periods
        self.assertEqual(conservation["mass_drift"], 0.0)  # no remesh, no mass flux between nodes
        self.assertLess(conservation["displacement_gap"], 1e-3 * 0.0185)  # against the largest displacement [m]
        # Trapezoidal rule of two step sizes over the same load: O((omega dt)^2) = 1.9e-3 of the impulse at most.
        self.assertLess(abs(conservation["momentum_drift"]), 2e-3)

    def test_there_is_no_motion_across_the_column(self):
        _, probe = read_table(self.result / "history" / "interface.csv")
        # The staggered mesh of this width is not mirror-symmetric: its pressure errs by the asymmetry of nodal volumes. 1e-3 of the
        # vertical velocity is allowed; it must not grow: five times at most between the first
        # and the last fifth of the run, which is what five independent errors of one size may add up to.
        t, across, along = probe["t[s]"], np.abs(probe["v_x[m/s]"]), np.abs(probe["v_y[m/s]"])
        print(f"    v_x/v_y {np.max(across) / np.max(along):.1e}", file=sys.stderr)
        self.assertLess(np.max(across), 1e-3 * np.max(along))
        first, last = np.max(across[t < 0.1]), np.max(across[t > 0.4])
        self.assertLess(last, max(5.0 * first, 1e-6 * np.max(along)))

    def test_the_summary_is_complete(self):
        s = self.summary
        self.assertEqual((s["status"], s["exit_code"]), ("completed", 0))
        self.assertAlmostEqual(s["t_end"], T_END, delta=1e-12)
        self.assertGreater(s["wall_s"], 0.0)
        # ratio of the stable steps, (h_s/c_s)/(h_f/c_f) = 1483/18.13/1.6 = 51 for equal bounds; the nodal bound of triangles is about half
        self.assertTrue(40 <= s["substeps"] <= 250, s["substeps"])
        self.assertGreater(s["windows"], 300)
        for key in ("mass_drift", "momentum_drift", "energy_drift", "interface_energy"):
            self.assertIsInstance(s["conservation"][key], (int, float), key)
            self.assertIsInstance(s["conservation"][key + "_definition"], str, key)
        for program in ("fluid", "solid"):
            for key in ("steps", "wall_s", "ns_per_node_step", "nodes", "mass_drift"):
                self.assertGreaterEqual(s[program][key], 0, f"{program}.{key}")
        self.assertGreaterEqual(s["fluid"]["remeshes"], 0)
        self.assertEqual(s["fluid"]["steps"], s["coupler"]["exchanges"] - s["windows"])
        self.assertEqual(s["solid"]["steps"], s["windows"])
        self.assertEqual(len(s["comparisons"]), 2)
        for comparison in s["comparisons"]:
            self.assertEqual(set(comparison), {"name", "measure", "value", "reference", "error", "tolerance", "pass"})
            self.assertTrue(comparison["pass"], comparison)

    def test_histories_say_what_they_are_and_reach_the_end(self):
        for name in ("interface", "energy", "mass", "interface_wet", "fluid_energy", "solid_energy"):
            comments, table = read_table(self.result / "history" / f"{name}.csv")
            self.assertTrue(any(line.startswith("# name: ") for line in comments), name)
            self.assertTrue(any(line.startswith("# definition: ") for line in comments), name)
            t = table["t[s]"]
            self.assertEqual(t[0], 0.0, name)
            self.assertAlmostEqual(t[-1], T_END, delta=1e-12, msg=name)
            self.assertTrue(np.all(np.diff(t) > 0.0), name)
            self.assertTrue(all(np.all(np.isfinite(column)) for column in table.values()), name)
        _, probe = read_table(self.result / "history" / "interface.csv")
        self.assertEqual(list(probe), ["t[s]", "u_x[m]", "u_y[m]", "v_x[m/s]", "v_y[m/s]"])

    def test_frames_are_readable_and_the_xdmf_names_what_is_in_the_hdf5(self):
        for program, fields in (("fluid", ("pressure", "velocity")), ("solid", ("displacement", "von_mises"))):
            with h5py.File(self.result / f"{program}.h5", "r", locking=False) as file:
                names = sorted(file["frames"])
                times = [float(file["frames"][name].attrs["time"]) for name in names]
                # every 0.02 s, at window ends; t = 0 and the end included
                self.assertEqual(len(times), 26, program)
                self.assertEqual(times[0], 0.0)
                self.assertAlmostEqual(times[-1], T_END, delta=1e-12)
                for field in fields:
                    self.assertTrue(np.all(np.isfinite(file["frames"][names[-1]]["fields"][field][:])), f"{program} {field}")
                grids = list(xml.parse(self.result / f"{program}.xdmf").getroot().iter("Grid"))
                temporal = [grid for grid in grids if grid.get("CollectionType") == "Temporal"]
                self.assertEqual(len(temporal), 1)
                self.assertEqual(len(temporal[0].findall("Grid")), 26)
                items = [item for item in temporal[0].iter("DataItem") if item.get("Format") == "HDF"]
                self.assertGreater(len(items), 26 * 3)
                for item in items:
                    name, _, path = item.text.strip().partition(":")
                    self.assertEqual(name, f"{program}.h5")
                    self.assertEqual(list(map(int, item.get("Dimensions").split())), list(file[path].shape), path)

    def test_logs_and_plots_are_there(self):
        for name in ("coupler.log", "fluid.log", "solid.log"):
            self.assertIn("info", (self.result / name).read_text(), name)
        for name in ("interface_u_y.png", "frames.png"):
            self.assertEqual((self.result / "plots" / name).read_bytes()[:4], b"\x89PNG", name)
        self.assertFalse((self.result / "FAILED.toml").exists())

    def test_the_script_prints_the_mpirun_line_it_used(self):
        self.assertRegex(self.ended.text, r"(?m)^mpirun .*coupler .* : -n 1 .*fluid_pfem .* : -n 1 .*solid_fe ")
        self.assertIn("pass", self.ended.text)
        self.assertNotIn("FAIL", self.ended.text)


class Variants(programs.SystemTest):
    def relative_error(self, *options):
        ended = run_case(self, "--no-plots", "--set", "output.frames=false", *options)
        self.assertEqual(ended.code, 0, ended.text)
        summary = json.loads((self.out / "summary.json").read_text())
        error = next(c["error"] for c in summary["comparisons"] if c["measure"] == "relative_L2")
        print(f"    {' '.join(options)}: relative L2 {error:.3e}, {summary['wall_s']:.1f} s", file=sys.stderr)
        return error, summary

    def test_the_linear_law_follows_the_exact_modal_curve(self):
        # as in Column: twice the spatial phase error
        self.assertLess(self.relative_error("--set", "solid.law=linear")[0], 6e-3)

    def test_the_paper_s_reading_of_the_tait_law_gives_the_same_curve(self):
        # Its fluid is 7 times stiffer; the compressibility of either moves the interface by p H_f/K: 1e-4 of its displacement.
        error, summary = self.relative_error("--set", "fluid.tait_reading=K")
        self.assertLess(error, 6e-3)
        self.assertGreater(summary["substeps"], 1.4 * 96)  # sqrt(7) = 2.6 times as many

    def test_a_no_slip_interface_moves_as_a_slip_interface(self):
        self.assertLess(self.relative_error("--set", 'interface.0.kind="no_slip"')[0], 6e-3)

    def test_until_ends_the_run_there(self):
        ended = run_case(self, "--until", "0.01", "--no-plots")
        self.assertEqual(ended.code, 0, ended.text)
        self.assertAlmostEqual(json.loads((self.out / "summary.json").read_text())["t_end"], 0.01, delta=1e-12)


class Alone(programs.SystemTest):
    def test_a_case_with_a_solid_only_runs_without_mpirun(self):
        text = programs.COLUMN.read_text()
        text = text[:text.index("[fluid]")] + text[text.index("[solid]"):text.index("[[interface]]")] + "[output]\nevery = 0.02\n"
        case = self.folder / "case.toml"
        case.write_text(text.replace("resolution = 40", "resolution = 10"))
        result = subprocess.run([programs.program("solid"), str(case), "--out", str(self.out)], capture_output=True, text=True,
                                env=programs.ENVIRONMENT, check=False, timeout=60)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertTrue((self.out / "solid.h5").is_file())

    def test_a_case_with_a_fluid_only_runs_without_mpirun(self):
        text = programs.COLUMN.read_text()
        text = text[:text.index("[solid]")] + '[[fluid.wall]]\non = "bottom"\nkind = "slip"\n[output]\nevery = 0.02\n'
        case = self.folder / "case.toml"
        case.write_text(text.replace("resolution = 40", "resolution = 10").replace("t_end = 0.5", "t_end = 0.02"))
        result = subprocess.run([programs.program("fluid"), str(case), "--out", str(self.out)], capture_output=True, text=True,
                                env=programs.ENVIRONMENT, check=False, timeout=60)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertTrue((self.out / "fluid.h5").is_file())


if __name__ == "__main__":
    programs.main(__doc__)
