#!/usr/bin/python3
"""Coupled cases on coarse meshes through the three programs: their own comparisons pass, mass and momentum are kept.

Example: tests/system/cases_test.py --build build/release
"""
import json
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import programs  # noqa: E402


class Cases(programs.SystemTest):
    def run_case(self, name, *options, limit=240):
        line = [sys.executable, "-B", str(programs.ROOT / "scripts" / "run_case.py"), str(programs.ROOT / "cases" / name), "--build",
                str(programs.BUILD), "--out", str(self.out), "--no-plots", *options]
        ended = programs.run(line, limit)
        self.assertEqual(ended.code, 0, ended.text)
        return json.loads((self.out / "summary.json").read_text())

    def expect_kept(self, summary):
        kept = summary["conservation"]
        # Particle mass moves between nodes in sums and differences, impulses are formed once and used with both signs: round-off
        # of some 1e4 steps.
        self.assertLess(abs(kept["mass_drift"]), 1e-11, kept)
        self.assertLess(kept["momentum_drift"], 1e-11, kept)
        # Landing is inelastic and steps are equal: the interface makes nothing but what varying steps let through.
        self.assertLess(kept["interface_energy"], 0.01, kept)

    def test_the_gate_opens(self):
        """Half the published mesh: the peak within the band of the case, 0.039 to 0.053 m at 0.11 to 0.17 s."""
        summary = self.run_case("elastic_gate", "--set", "run.resolution=20", "--until", "0.13")
        self.expect_kept(summary)
        self.assertEqual({c["name"]: c["pass"] for c in summary["comparisons"]}, {"peak deflection": True, "time of the peak": True})

    def test_the_wedge_bends(self):
        """Between 1.0 and 2.2 ms inside [0.85 nonlinear loads, 1.03 Wagner] already at 10 mm."""
        summary = self.run_case("wedge_impact", "--set", "run.resolution=60")
        self.expect_kept(summary)
        self.assertEqual(len(summary["comparisons"]), 2)
        self.assertTrue(all(c["pass"] for c in summary["comparisons"]), summary["comparisons"])

    def test_sound_passes_into_metal(self):
        """Reflection and transmission within 1 % of d'Alembert at 20 elements over the pulse."""
        summary = self.run_case("acoustic_interface")
        self.assertTrue(all(c["pass"] for c in summary["comparisons"]), summary["comparisons"])
        self.assertGreaterEqual(summary["substeps"], 2)  # each side with a step of its own


if __name__ == "__main__":
    programs.main(__doc__)
