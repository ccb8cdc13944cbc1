#!/usr/bin/python3
"""scripts/watch and the completion of scripts/run: only finished rows are read, the page renews itself until the run has ended."""
import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))
from lib import compare  # noqa: E402


class Watch(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory()
        self.addCleanup(self._folder.cleanup)
        self.out = Path(self._folder.name)
        (self.out / "history").mkdir()
        self.tip = self.out / "history" / "tip.csv"
        self.tip.write_text("# name: tip\nt[s],u_x[m],u_y[m]\n0,0,0\n0.5,1,-2\n1.0,2,-12")  # the last number is not finished: -1234

    def watch(self, *options):
        done = subprocess.run([ROOT / "scripts" / "watch", self.out, "--once", *options], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def test_a_row_that_is_being_written_is_not_read(self):
        self.assertEqual(list(compare.read_csv(self.tip)["u_y[m]"]), [0.0, -2.0])
        self.assertIn("u_y[m]   now -2 at t = 0.5 s", self.watch())

    def test_a_header_alone_is_no_row(self):
        self.tip.write_text("# name: tip\nt[s],u_x")
        self.assertEqual(compare.read_csv(self.tip), {})
        self.assertIn("no finished row yet", self.watch())

    def test_one_column_can_be_chosen(self):
        text = self.watch("--columns", "tip:u_x")
        self.assertIn("u_x[m]", text)
        self.assertNotIn("u_y[m]", text)

    def test_the_curve_goes_from_corner_to_corner(self):
        self.tip.write_text("t[s],u_x[m]\n" + "".join(f"{k},{k}\n" for k in range(100)))
        rows = [line[2:] for line in self.watch().split("\n") if line.startswith("  ")]
        self.assertNotEqual(rows[-1][0], "\u2800")   # begins low
        self.assertNotEqual(rows[0][-1], "\u2800")   # ends high
        self.assertEqual(rows[0][0], "\u2800")

    def test_the_page_renews_itself_until_the_run_has_ended(self):
        self.watch("--page")
        text = (self.out / "watch.html").read_text()
        self.assertIn('http-equiv="refresh"', text)
        self.assertIn("<polyline", text)
        (self.out / "summary.json").write_text(json.dumps({"status": "completed", "exit_code": 0, "wall_s": 1.0}))
        self.watch("--page")
        text = (self.out / "watch.html").read_text()
        self.assertNotIn('http-equiv="refresh"', text)
        self.assertIn("completed", text)

    def test_a_folder_that_is_not_there_is_named(self):
        done = subprocess.run([ROOT / "scripts" / "watch", self.out / "nowhere"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn("nowhere: there is no such folder", done.stderr)


class Completion(unittest.TestCase):
    def complete(self, *words):
        """What bash offers for the last of `words` after scripts/run."""
        line = ["scripts/run", *words]
        script = (f"source {ROOT}/scripts/completion.bash; COMP_WORDS=({' '.join(repr(w) for w in line)}); COMP_CWORD={len(line) - 1}; "
                  "_undine_run; printf '%s\\n' \"${COMPREPLY[@]}\"")
        return subprocess.run(["bash", "-c", script], capture_output=True, text=True, cwd=ROOT, check=True).stdout.split()

    def test_cases_options_and_keys_are_offered(self):
        self.assertIn("cases/elastic_column", self.complete("cases/ela"))
        self.assertIn("--restart" if "--restart" in (ROOT / "scripts" / "run_case.py").read_text() else "--until", self.complete("cases/elastic_column", "--"))
        self.assertEqual(self.complete("cases/elastic_column", "--set", "fluid.dens"), ["fluid.density="])
        self.assertEqual(self.complete("cases/elastic_column", "--set", "solid.law=", "--unt"), ["--until"])


if __name__ == "__main__":
    unittest.main(verbosity=1)
