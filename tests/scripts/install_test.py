#!/usr/bin/python3
"""Undine installed, and unpacked from its Debian package, runs a case, plots and watches from outside the source tree.

Example: tests/scripts/install_test.py --build build/release
"""
import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

BUILD = Path(__file__).resolve().parents[2] / "build" / "release"
# Nothing of the source tree: another working folder, no PYTHONPATH, and only the system's commands.
ENVIRONMENT = {"PATH": "/usr/bin:/bin", "HOME": os.environ.get("HOME", "/root"), "LANG": "C.UTF-8"}


class Installed(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory(prefix="undine_install_")
        self.addCleanup(self._folder.cleanup)
        self.folder = Path(self._folder.name)
        (self.folder / "work").mkdir()

    def call(self, *command, code=0):
        done = subprocess.run([str(c) for c in command], capture_output=True, text=True, env=ENVIRONMENT, cwd=self.folder / "work", timeout=200)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        return done.stdout + done.stderr

    def use(self, prefix):
        """Run, plot and watch with what is under `prefix`."""
        said = self.call(prefix / "bin" / "undine", "elastic_column", "--set", "run.resolution=10", "--until", "0.05")
        self.assertIn(str(prefix.resolve() / "libexec" / "undine" / "coupler"), said)
        out = self.folder / "work" / "runs" / "elastic_column"
        summary = json.loads((out / "summary.json").read_text())
        self.assertEqual(summary["status"], "completed")
        self.assertTrue(summary["comparisons"][0]["pass"])
        for name in ("plots/interface_u_y.png", "plots/frames.png", "plots/animation.gif", "report.html", "view.py"):
            self.assertTrue((out / name).is_file(), name)
        self.assertIn("are kept", self.call(prefix / "bin" / "undine", "elastic_column", "--set", "solid.densty=1", code=2))
        self.assertEqual(json.loads((out / "summary.json").read_text()), summary)
        self.call(prefix / "bin" / "undine-plot", out, "--field", "velocity")
        self.assertIn("completed", self.call(prefix / "bin" / "undine-watch", out, "--once"))
        self.assertIn("no case 'nowhere'", self.call(prefix / "bin" / "undine", "nowhere", code=4))
        self.assertTrue((prefix / "share" / "doc" / "undine" / "case-file.md").is_file())
        self.manual_pages(prefix)

    def manual_pages(self, prefix):
        """A page per command and program, that `man` shows without a warning and that has every option of --help."""
        pages = prefix / "share" / "man" / "man1"
        commands = {name: prefix / "bin" / name for name in ("undine", "undine-plot", "undine-watch", "undine-conform")}
        commands |= {name: prefix / "libexec" / "undine" / name for name in ("coupler", "fluid_pfem", "solid_fe")}
        self.assertEqual({page.stem for page in pages.glob("*.1")}, set(commands))
        for name, command in commands.items():
            source = (pages / f"{name}.1").read_text()
            for option in set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", self.call(command, "--help"))):
                self.assertIn(option.replace("-", r"\-"), source, name)
            self.assertNotIn("scripts/", source)
            if shutil.which("man"):
                shown = subprocess.run(["man", "--warnings", "-l", pages / f"{name}.1"], capture_output=True, text=True, env={**ENVIRONMENT, "MANWIDTH": "200"})
                self.assertEqual((shown.returncode, shown.stderr), (0, ""))
                for section in ("NAME", "SYNOPSIS", "DESCRIPTION", "OPTIONS"):
                    self.assertIn(f"\n{section}\n", re.sub(".\b", "", shown.stdout))

    def test_the_installed_tree_runs_and_may_be_moved(self):
        subprocess.run(["cmake", "--install", BUILD, "--prefix", self.folder / "first"], check=True, stdout=subprocess.DEVNULL)
        shutil.move(self.folder / "first", self.folder / "moved")
        self.use(self.folder / "moved")

    def test_the_debian_package_runs_and_names_what_it_needs(self):
        subprocess.run(["cpack", "-G", "DEB", "--config", BUILD / "CPackConfig.cmake", "-B", self.folder / "package"], check=True, stdout=subprocess.DEVNULL)
        package = next((self.folder / "package").glob("undine_*.deb"))
        needs = self.call("dpkg-deb", "-f", package, "Depends")
        for name in ("libopenmpi3", "libhdf5-openmpi", "libmuparser2v5", "openmpi-bin", "python3-matplotlib"):
            self.assertIn(name, needs)
        self.call("dpkg-deb", "-x", package, self.folder / "root")
        self.use(self.folder / "root" / "usr")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, default=BUILD)
    arguments, rest = parser.parse_known_args()
    BUILD = arguments.build.resolve()
    unittest.main(argv=[sys.argv[0], "-v", *rest])
