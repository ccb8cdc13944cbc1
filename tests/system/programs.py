"""Starts the three programs as a user does, watches their processes, and reads what they leave behind."""
import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COLUMN = ROOT / "cases" / "elastic_column" / "case.toml"
MPIRUN = ["mpirun", "--oversubscribe", "--bind-to", "none", "--mca", "mpi_yield_when_idle", "1"]
ENVIRONMENT = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")

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


def descendants(root):
    """{process id: command name} of all living descendants of `root`; zombies do not count."""
    children, names = {}, {}
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                with open(f"/proc/{entry}/stat") as stat:
                    head, _, tail = stat.read().rpartition(")")
            except OSError:
                continue
            state, parent = tail.split()[:2]
            if state not in "ZX":
                children.setdefault(int(parent), []).append(int(entry))
                names[int(entry)] = head.partition("(")[2]
    found, front = {}, [root]
    while front:
        front = [child for pid in front for child in children.get(pid, [])]
        found.update({pid: names[pid] for pid in front})
    return found


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as stat:
            return stat.read().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


class Ended:
    """How a run ended: exit code as a shell counts, text of stdout and stderr, seconds, and processes it left behind."""

    def __init__(self, code, text, seconds, left):
        self.code, self.text, self.seconds, self.left = code, text, seconds, left

    def errors(self):
        """What our programs had to say, without mpirun's own notices."""
        return [line for line in self.text.split("\n") if line.startswith("error: ")]


def code_of(status, text):
    """Exit code as a shell counts, None while it runs. Where `mpirun` itself crashes when all its programs are gone (docs/protocol.md,
    section 6: a fault of Open MPI 4.1.4), the code that it was told to end with."""
    told = re.search(r"^with errorcode (\d+)\.$", text, re.MULTILINE)
    if status in (-11, 139) and told and "(orte_finalize+" in text:
        return int(told[1])
    return 128 - status if status is not None and status < 0 else status


def run(line, limit, act=None):
    """Run `line` for at most `limit` seconds; `act(process)` may interfere while it runs."""
    with tempfile.TemporaryFile("w+") as log:
        begin = time.monotonic()
        process = subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, env=ENVIRONMENT,
                                   start_new_session=True, cwd=ROOT)
        pids = set()
        try:
            if act:
                act(process)
                begin = time.monotonic()  # the time that counts begins when something goes wrong
            while process.poll() is None and time.monotonic() - begin < limit:
                pids.update(descendants(process.pid))
                time.sleep(0.02)
        finally:
            seconds = time.monotonic() - begin
            code = process.poll()
            if code is None:
                pids.update(descendants(process.pid))
                process.kill()
                process.wait()
            else:
                time.sleep(0.2)
            left = [pid for pid in pids if alive(pid)]
            for pid in left:
                os.kill(pid, 9)
        log.seek(0)
        text = log.read()
        return Ended(code_of(code, text), text, seconds, left)


def read_failed(out):
    """FAILED.toml as {key: text}, {} if there is none."""
    try:
        lines = (Path(out) / "FAILED.toml").read_text().split("\n")
    except FileNotFoundError:
        return {}
    return dict(line.split(" = ", 1) for line in lines if " = " in line)


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
