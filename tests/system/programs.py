"""The three programs of a coupled case for the system tests: their command lines and variants of the column's case."""
import argparse
import sys
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))
from processes import ENVIRONMENT, MPIRUN, Ended, descendants, read_failed, run  # noqa: E402, F401
COLUMN = ROOT / "cases" / "elastic_column" / "case.toml"

BUILD = ROOT / "build" / "release"  # set by main()
ACTOR = BUILD / "tests" / "link_actor"


def program(role):
    """Path of the executable that plays `role`."""
    return str(BUILD / "bin" / {"coupler": "coupler", "fluid": "fluid_pfem", "solid": "solid_fe"}[role])


def coupled_line(case, out, *options, fluid=None, solid=None):
    """mpirun line of the coupled case; `fluid` and `solid` replace a program by another command ([] leaves it out)."""
    common = [str(case), "--out", str(out), *options]
    parts = [[program("coupler"), *common],
             [program("fluid"), *common] if fluid is None else fluid,
             [program("solid"), *common] if solid is None else solid]
    line = list(MPIRUN)
    for k, part in enumerate(p for p in parts if p):
        line += ([":"] if k else []) + ["-n", "1", *part]
    return line


class SystemTest(unittest.TestCase):
    """A test with a folder of its own, and variants of the column's case in it."""

    def setUp(self):
        self._folder = tempfile.TemporaryDirectory()
        self.addCleanup(self._folder.cleanup)
        self.folder = Path(self._folder.name)
        self.out = self.folder / "out"

    def variant(self, *changes, name="case.toml"):
        """A copy of the column's case with texts replaced: ("from", "to"), each must be there."""
        text = COLUMN.read_text()
        for old, new in changes:
            self.assertIn(old, text, "the column's case no longer has the text that this test changes")
            text = text.replace(old, new, 1)
        path = self.folder / name
        path.write_text(text)
        if not (self.folder / "reference").exists():
            (self.folder / "reference").symlink_to(COLUMN.parent / "reference")
        return path


def main(description):
    """Read --build and --actor, then run the tests of the calling module."""
    global BUILD, ACTOR
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, default=BUILD, help="build folder (default: build/release)")
    parser.add_argument("tests", nargs="*", help="only these, e.g. Failures.test_killed_solid")
    arguments = parser.parse_args()
    BUILD = arguments.build.resolve()
    ACTOR = BUILD / "tests" / "link_actor"
    unittest.main(argv=[sys.argv[0], "-v", *arguments.tests])
