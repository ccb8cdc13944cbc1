#!/usr/bin/python3
"""scripts/lib/compare.py measures known curves right, and says which references apply."""
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from lib import case, compare  # noqa: E402


class Measures(unittest.TestCase):
    def setUp(self):
        self.t = np.linspace(0.0, 1.0, 4001)

    def test_the_relative_error_of_a_scaled_curve_is_the_scale(self):
        y = np.sin(30.0 * self.t)
        # At common times the interpolation returns the reference itself; the rest is round-off.
        self.assertAlmostEqual(compare.measure("relative_L2", self.t, 1.01 * y, self.t, y)[2], 0.01, delta=1e-12)

    def test_the_curves_are_compared_where_both_are_known(self):
        y = np.sin(30.0 * self.t)
        half = self.t <= 0.5
        self.assertLess(compare.measure("relative_L2", self.t[half], y[half], self.t, y)[2], 1e-12)

    def test_times_of_our_curve_may_be_uneven(self):
        uneven = self.t**2
        # cubic interpolation of the reference: 3/128 (w dt)^4 = 1.9e-6 with w = 30 and dt = 1/100, 8 times that in the end intervals
        coarse = np.linspace(0.0, 1.0, 101)
        self.assertLess(compare.measure("relative_L2", uneven, np.sin(30.0 * uneven), coarse, np.sin(30.0 * coarse))[2], 3e-4)

    def test_the_period_of_minima_is_that_of_the_cosine(self):
        # The fitted parabola is as symmetric as the samples: wrong by a sample (1/4000) times the share that one of about
        # 80 samples has, over 6 periods: 1e-6.
        self.assertAlmostEqual(compare.period(self.t, np.cos(2.0 * np.pi * 7.3 * self.t)), 1.0 / 7.3, delta=1e-6)

    def test_ripples_of_one_minimum_count_once(self):
        ripple = np.cos(2.0 * np.pi * 5.0 * self.t) + 0.02 * np.cos(2.0 * np.pi * 200.0 * self.t)
        # A ripple may move a minimum by half its own period, 1/400, at both ends of 3 to 4 periods.
        self.assertAlmostEqual(compare.period(self.t, ripple), 0.2, delta=2.0 / 400.0 / 3.0)

    def test_a_run_that_ends_before_its_reference_begins_is_not_measured(self):
        t, later = np.linspace(0.0, 0.02, 5), np.linspace(0.1, 0.2, 5)
        for kind in ("relative_L2", "peak", "peak_time"):
            value, target, error = compare.measure(kind, t, t, later, later, band=(0.1, 0.2))
            self.assertTrue(np.isnan(error), kind)

    def test_an_unknown_measure_is_named(self):
        with self.assertRaisesRegex(ValueError, "no_such"):
            compare.measure("no_such", self.t, self.t, self.t, self.t)


class References(unittest.TestCase):
    def test_a_reference_applies_to_its_variant_only(self):
        settings = {"solid": {"law": "linear"}}
        self.assertTrue(compare.applies({}, settings))
        self.assertTrue(compare.applies({"when": "solid.law = linear"}, settings))
        self.assertFalse(compare.applies({"when": "solid.law = svk"}, settings))

    def test_all_conditions_must_hold(self):
        settings = {"solid": {"law": "linear"}, "fluid": {"tait_reading": "K"}}
        self.assertTrue(compare.applies({"when": ["solid.law = linear", "fluid.tait_reading = K"]}, settings))
        self.assertFalse(compare.applies({"when": ["solid.law = linear", "fluid.tait_reading = K_over_gamma"]}, settings))

    def test_terms_are_added_with_their_factors(self):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "a.csv").write_text("# a\nt,y\n0,1\n1,2\n2,3\n")
            (Path(folder) / "b.csv").write_text("t,u,v\n0,10,1\n2,30,1\n")
            reference = {"file": "a.csv", "time": "t", "value": "y",
                         "add": [{"file": "b.csv", "time": "t", "value": "u"}, {"file": "b.csv", "time": "t", "value": "v", "factor": -1.0},
                                 {"file": "b.csv", "time": "t", "value": "v", "when": "solid.law = svk"}]}
            t, y = compare.reference_curve(Path(folder) / "case.toml", reference, {"solid": {"law": "linear"}})
            self.assertEqual(list(y), [10.0, 21.0, 32.0])
            self.assertEqual(list(t), [0.0, 1.0, 2.0])


class Overrides(unittest.TestCase):
    def test_an_override_sets_a_value_of_its_type(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "case.toml"
            path.write_text("[run]\nresolution = 40\n[[probe]]\nname = 'a'\n")
            settings = case.load(path, ["run.resolution=10", "solid.law=linear", "probe.0.name=b"])
            self.assertEqual(settings["run"]["resolution"], 10)
            self.assertEqual(settings["solid"]["law"], "linear")
            self.assertEqual(settings["probe"][0]["name"], "b")


if __name__ == "__main__":
    unittest.main()
