#!/usr/bin/python3
"""The solid program alone: natural frequencies of an Abaqus mesh, mass scaling and measured steps as a user sees them.

Example: tests/system/solid_test.py --build build/release
"""
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import programs  # noqa: E402

CASE = """
schema = 1
[run]
name = "solid"
dimension = 2
t_end = 0.02
resolution = 1
characteristic_length = 1.0
[solid]
density = 8000.0
youngs_modulus = 200e9
poisson_ratio = 0.3
law = "svk"
plane = "stress"
mesh = "tapered.inp"
initial_velocity = [0.0, 1.0]
[[solid.fix]]
on = "root"
[output]
every = 0.02
history_every = 2e-4
[[probe]]
name = "tip"
on = "solid"
point = [10.0, 0.0]
quantity = "u"
"""


def tapered(nx, ny):
    """The membrane of NAFEMS FV32, 10 m long, 5 to 1 m high, as an Abaqus file of two element sets."""
    lines = ["*NODE"]
    lines += [f"{1 + i + (nx + 1) * j}, {10 * i / nx:.12g}, {(2.5 - 2 * i / nx) * (2 * j / ny - 1):.12g}" for j in range(ny + 1) for i in range(nx + 1)]
    for name, columns in (("inner", range(nx // 2)), ("outer", range(nx // 2, nx))):
        lines.append(f"*ELEMENT, TYPE=CPS4, ELSET={name}")
        for j in range(ny):
            for i in columns:
                a = 1 + i + (nx + 1) * j
                lines.append(f"{1 + i + nx * j}, {a}, {a + 1}, {a + nx + 2}, {a + nx + 1}")
    lines += ["*NSET, NSET=root"] + [f"{1 + (nx + 1) * j}," for j in range(ny + 1)]
    return "\n".join(lines) + "\n"


class Solid(programs.SystemTest):
    def start(self, *options, limit=60):
        self.out.mkdir(parents=True, exist_ok=True)
        (self.out / "tapered.inp").write_text(tapered(32, 16))
        (self.out / "case.toml").write_text(CASE)
        ended = programs.run([programs.program("solid"), str(self.out / "case.toml"), "--out", str(self.out), *options], limit)
        self.assertEqual(ended.code, 0, ended.text)
        return ended.text

    def tip(self, *options):
        """Last displacement of the tip, the summary."""
        self.start(*options)
        last = (self.out / "history" / "tip.csv").read_text().strip().splitlines()[-1]
        return float(last.split(",")[2]), json.loads((self.out / "solid.json").read_text())

    def test_modes_of_the_tapered_membrane(self):
        """NAFEMS FV32: 1 % with lumped mass."""
        text = self.start("--modes", "6", limit=120)
        found = [float(line.split()[1]) for line in text.splitlines() if line.split() and line.split()[0].isdigit()]
        self.assertEqual(len(found), 6, text)
        print("    FV32:", *found, file=sys.stderr)
        for f, expected in zip(found, (44.623, 130.03, 162.70, 246.05, 379.90, 391.44)):
            self.assertAlmostEqual(f / expected, 1.0, delta=0.01)

    def test_mass_scaling_tells_what_each_set_got(self):
        _, plain = self.tip()
        wanted = 1.15 * plain["smallest_step"]
        text = self.start("--check", "--set", f"solid.mass_scaling_step={wanted}")
        self.assertIn('of "inner"', text)
        self.assertIn('of "outer"', text)
        _, scaled = self.tip("--set", f"solid.mass_scaling_step={wanted}")
        added = scaled["added_mass"]
        self.assertEqual(set(added), {"inner", "outer"})
        self.assertGreater(added["outer"], added["inner"])  # the flat elements are at the tip
        self.assertAlmostEqual(scaled["mass"] - plain["mass"], sum(added.values()), delta=1e-9 * plain["mass"])
        self.assertLess(scaled["steps"], plain["steps"] / 1.1)

    def test_measured_steps_are_longer_and_give_the_same_answer(self):
        """Both step sizes are converged in time: the difference is O(dt^2) of the fast modes, below 1e-3."""
        tip, plain = self.tip()
        same, measured = self.tip("--set", 'solid.step_limit="measured"')
        print(f"    steps {plain['steps']} -> {measured['steps']}, tip {tip} -> {same}", file=sys.stderr)
        self.assertLess(measured["steps"], 0.95 * plain["steps"])
        self.assertAlmostEqual(same / tip, 1.0, delta=1e-3)


if __name__ == "__main__":
    programs.main(__doc__)
