#!/usr/bin/python3
"""What a run leaves opens in the viewers of Debian 12: report.html in Chromium, view.py and the frames in ParaView, both without a display.

Example: tests/scripts/viewers_test.py --build build/release [--keep FOLDER]     (skipped where a viewer is not installed)
"""
import argparse
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "release"
KEEP = None


def colours(path):
    """Number of different colours of a picture (reduced to 5 bits per channel)."""
    return len(np.unique(np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3) >> 3, axis=0))


def pvbatch(*arguments):
    """Output of pvbatch on a virtual display; once more if the display, which has three seconds to start, was not there yet."""
    for _ in range(4):
        done = subprocess.run(["xvfb-run", "-a", "pvbatch", *arguments], capture_output=True, text=True, timeout=180)
        text = done.stdout + done.stderr
        if "bad X server connection" not in text:
            break
    return text


class Viewers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls._folder = tempfile.TemporaryDirectory()
        cls.out = Path(KEEP or cls._folder.name) / "run"
        done = subprocess.run([sys.executable, "-B", ROOT / "scripts" / "run_case.py", ROOT / "cases" / "elastic_column", "--build", BUILD, "--out", cls.out,
                               "--set", "run.resolution=10", "--until", "0.07"], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr

    @classmethod
    def tearDownClass(cls):
        cls._folder.cleanup()

    def test_the_report_opens_in_chromium(self):
        if not shutil.which("chromium"):
            self.skipTest("chromium is not installed (apt-get install chromium)")
        picture = self.out / "report.png"
        done = subprocess.run(["chromium", "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={self.out / 'chromium'}", f"--screenshot={picture}", "--window-size=1200,3600",
                               "--hide-scrollbars", (self.out / "report.html").resolve().as_uri()], capture_output=True, text=True, timeout=120)
        self.assertTrue(picture.is_file(), done.stderr)
        self.assertGreater(colours(picture), 200)  # text alone has about 40 greys; plots and frames have colours
        dom = subprocess.run(["chromium", "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={self.out / 'chromium'}", "--dump-dom",
                              (self.out / "report.html").resolve().as_uri()], capture_output=True, text=True, timeout=120).stdout
        for heading in ("Pictures", "Ledgers", "Time", "Parameters"):
            self.assertIn(f"<h2>{heading}</h2>", dom)

    def opens_in_paraview(self, out, parts):
        """view.py shows the run and leaves a state that a second ParaView reads; `parts` are the sources in it."""
        if not (shutil.which("pvbatch") and shutil.which("xvfb-run")):
            self.skipTest("ParaView or a virtual display is not installed (apt-get install paraview python3-paraview xvfb xauth)")
        picture = out / "paraview.png"
        self.assertIn("frames, t = 0 to ", pvbatch(out / "view.py", picture))
        self.assertGreater(colours(picture), 50)
        script = out / "again.py"
        script.write_text(f"from paraview.simple import *\nLoadState({str(picture.with_suffix('.pvsm'))!r})\nprint(sorted(k[0] for k in GetSources()))\n")
        self.assertIn(str(parts), pvbatch(script))

    def test_the_run_opens_in_paraview(self):
        self.opens_in_paraview(self.out, ["fluid.xdmf", "solid.xdmf"])

    def test_other_kinds_of_cases_open_in_paraview(self):
        kinds = {"dam_break": (["--set", "run.resolution=8", "--until", "0.2"], ["fluid.xdmf"]),
                 "bar_wave": (["--set", "run.resolution=20"], ["solid.xdmf"]),
                 "dam_break_3d": (["--set", "run.resolution=5", "--until", "0.1"], ["fluid.xdmf"]),
                 "taylor_bar": (["--set", "run.resolution=4"], ["solid.xdmf"]),
                 "elastic_gate": (["--set", "run.resolution=10", "--until", "0.02"], ["fluid.xdmf", "solid.xdmf"])}
        for case, (options, parts) in kinds.items():
            with self.subTest(case):
                out = self.out.parent / case
                done = subprocess.run([sys.executable, "-B", ROOT / "scripts" / "run_case.py", ROOT / "cases" / case, "--build", BUILD, "--out", out, *options],
                                      capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stderr)
                self.opens_in_paraview(out, parts)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, default=BUILD)
    parser.add_argument("--keep", type=Path)
    arguments, rest = parser.parse_known_args()
    BUILD, KEEP = arguments.build.resolve(), arguments.keep
    unittest.main(argv=[sys.argv[0], "-v", *rest])
