#!/usr/bin/python3
"""The tutorials, executed block by block as a newcomer would, in a fresh folder with an installed Undine.

Example: tests/scripts/tutorials_test.py --build build/release [Tutorials.test_3_abaqus]

A block ```sh is run, ```sh fails must end with an error, ```KIND FILE is written (and may be run by a later block); other blocks are only shown.
"""
import argparse
import os
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "release"
FENCE = re.compile(r"^```(\S*)[ ]?(\S*)\n(.*?)^```$", re.M | re.S)


class Tutorials(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory(prefix="undine_tutorial_")
        self.addCleanup(self._folder.cleanup)
        self.folder = Path(self._folder.name)
        prefix = self.folder / "prefix"
        subprocess.run(["cmake", "--install", BUILD, "--prefix", prefix], check=True, stdout=subprocess.DEVNULL)
        # The names of the source tree, for what is installed.
        (self.folder / "scripts").mkdir()
        for name, command in (("run", "undine"), ("plot", "undine-plot"), ("watch", "undine-watch")):
            (self.folder / "scripts" / name).symlink_to(prefix / "bin" / command)
        (self.folder / "cases").symlink_to(prefix / "share" / "undine" / "cases")
        build = self.folder / "build" / "release"
        (build / "bin").mkdir(parents=True)
        for program in [*(prefix / "libexec" / "undine").iterdir(), prefix / "bin" / "undine-conform"]:
            (build / "bin" / program.name).symlink_to(program)
        (build / "lib").symlink_to(next(prefix.rglob("undine_link.py")).parent)

    def follow(self, page):
        environment = {"PATH": "/usr/bin:/bin", "HOME": os.environ.get("HOME", "/root"), "LANG": "C.UTF-8", "OMPI_ALLOW_RUN_AS_ROOT": "1",
                       "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
        done = 0
        for kind, name, body in FENCE.findall((ROOT / "docs" / "tutorials" / page).read_text()):
            if kind == "sh" and name in ("", "fails"):
                ended = subprocess.run(["bash", "-euo", "pipefail", "-c", body], cwd=self.folder, env=environment, capture_output=True, text=True, timeout=600)
                report = f"\n{body}\n{ended.stdout}{ended.stderr}"
                if name == "fails":
                    self.assertNotEqual(ended.returncode, 0, report)
                else:
                    self.assertEqual(ended.returncode, 0, report)
                self.assertNotIn("Traceback", report)
                done += 1
            elif name:
                (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
                (self.folder / name).write_text(body)
        self.assertGreater(done, 0)

    def test_1_column(self):
        self.follow("1-column.md")
        self.assertTrue((self.folder / "runs" / "elastic_column" / "column.gif").is_file())
        self.assertTrue((self.folder / "runs" / "linear" / "report.html").is_file())

    @unittest.skipUnless((ROOT / "docs" / "tutorials" / "2-obstacle.md").is_file(), "not written")
    def test_2_obstacle(self):
        self.follow("2-obstacle.md")

    def test_3_abaqus(self):
        self.follow("3-abaqus.md")

    def test_4_own_solid(self):
        self.follow("4-own-solid.md")

    def test_5_cluster(self):
        self.follow("5-cluster.md")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, default=BUILD)
    arguments, rest = parser.parse_known_args()
    BUILD = arguments.build.resolve()
    unittest.main(argv=[sys.argv[0], "-v", *rest])
