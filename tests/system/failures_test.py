#!/usr/bin/python3
"""The real programs in a run in which one thing goes wrong: all end in seconds, with the documented code, naming the culprit.

Example: tests/system/failures_test.py --build build/release Failures.test_a_killed_solid_ends_the_run
"""
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py

sys.path.insert(0, str(Path(__file__).resolve().parent))
import programs  # noqa: E402

HELLO, STALL = 3, 2  # the deadlines [s] that the cases set
# mpirun needs about 1.5 s to start and to end; the rest is for a machine on which others compute.
MARGIN = 8

DEADLINES = ['--set', f'coupling.hello_timeout={HELLO}', '--set', f'coupling.stall_timeout={STALL}']
LONG = DEADLINES + ["--set", "run.t_end=1000", "--set", "output.every=0.01"]


# Starts a program whose files cannot grow beyond so many bytes, as on a full disk: the write that goes beyond fails.
SMALL_DISK = ["/usr/bin/python3", "-c", "import os, resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
              "resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1]))); os.execv(sys.argv[2], sys.argv[2:])"]


class FailureTest(programs.SystemTest):
    def expect(self, ended, limit, codes, says, program=None, errors=1):
        """`says`: texts of the output; `program`: who wrote FAILED.toml."""
        report = f"\n{ended.text}\nexit code {ended.code} after {ended.seconds:.1f} s"
        print(f"    {self._testMethodName}: {ended.seconds:.1f} s, exit code {ended.code}", file=sys.stderr)
        self.assertIsNotNone(ended.code, f"still running after {limit} s" + report)
        self.assertIn(ended.code, codes, report)
        self.assertEqual(ended.left, [], "processes outlive mpirun" + report)
        for text in says:
            self.assertIn(text, ended.text, report)
        if errors is not None:
            self.assertEqual(len(ended.errors()), errors, "programs that printed an error" + report)
        if program:
            failed = programs.read_failed(self.out)
            self.assertEqual(failed.get("program"), f'"{program}"', report)
            self.assertEqual(failed.get("code"), str(ended.code), report)

    def run_until_it_moves(self, line, name, number, limit):
        """Run `line`, send signal `number` to the process `name` once the history of the interface grows."""
        def act(process):
            history = self.out / "history" / "interface.csv"
            begin = time.monotonic()
            while not (history.is_file() and history.read_text().count("\n") > 20):
                self.assertLess(time.monotonic() - begin, 30.0, "the run did not start")
                self.assertIsNone(process.poll(), "the run ended by itself")
                time.sleep(0.02)
            victims = [pid for pid, command in programs.descendants(process.pid).items() if command == name]
            self.assertEqual(len(victims), 1)
            os.kill(victims[0], number)
        return programs.run(line, limit, act)

    def frames_are_whole(self):
        """Every frame of the fluid and the solid that the index names is there and can be read, by h5py and by h5dump."""
        count = 0
        for name in ("fluid", "solid"):
            index, data = self.out / f"{name}.xdmf", self.out / f"{name}.h5"
            if not index.is_file():
                continue
            with h5py.File(data) as file:
                file.visititems(lambda _, item: item[()] if isinstance(item, h5py.Dataset) else None)
                for path in re.findall(rf"{name}\.h5:(/\S+?)\s*<", index.read_text()):
                    self.assertIn(path, file)
                    count += 1
            if shutil.which("h5dump"):
                done = subprocess.run(["h5dump", str(data)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
                self.assertEqual(done.returncode, 0, done.stderr)
        self.assertGreater(count, 4, "no frame was written before the failure")


class Failures(FailureTest):
    def test_a_killed_solid_ends_the_run(self):
        # mpirun notices at once; 128 + 9 is its code for SIGKILL, and the text is its own.
        line = programs.coupled_line(programs.COLUMN, self.out, *LONG)
        ended = self.run_until_it_moves(line, "solid_fe", signal.SIGKILL, MARGIN)
        self.expect(ended, MARGIN, (137,), ["rank 2", "exited on signal 9"], errors=0)
        self.frames_are_whole()

    def test_a_blow_up_names_the_element_and_leaves_the_last_state(self):
        """A collapsing column that nobody meshes again: elements turn over and stay so."""
        case = programs.ROOT / "cases" / "dam_break" / "case.toml"
        line = [programs.program("fluid"), str(case), "--out", str(self.out), "--set", "run.resolution=10", "--set", "fluid.look_every=1000000"]
        ended = programs.run(line, MARGIN)
        self.expect(ended, MARGIN, (10,), ["element", "has the volume -", "fluid step", "the last state is the last frame of fluid.h5"], program="fluid")
        with h5py.File(self.out / "fluid.h5") as h5:
            last = h5["frames"][max(h5["frames"])]
            self.assertIn(f"t = {last.attrs['time']:.9g} s", ended.text.split("fluid.h5")[-1])
            self.assertGreater(float(last.attrs["time"]), 0.0)

    def test_a_step_that_collapses_ends_the_run_and_leaves_the_last_state(self):
        """The splash of a dam break takes steps well below three quarters of the longest one: with that as the limit the run ends."""
        case = programs.ROOT / "cases" / "dam_break" / "case.toml"
        line = [programs.program("fluid"), str(case), "--out", str(self.out), "--set", "run.resolution=10", "--set", "fluid.collapse=0.75", "--set", "run.t_end=2.0"]
        ended = programs.run(line, MARGIN)
        self.expect(ended, MARGIN, (10,), ["the stable step has collapsed to", "fluid.collapse = 0.75", "the worst of", "at (", "the last state is the last frame of fluid.h5"], program="fluid")

    def test_a_full_disk_under_the_fluid(self):
        fluid = [*SMALL_DISK, "200000", programs.program("fluid"), str(programs.COLUMN), "--out", str(self.out), *LONG]
        ended = programs.run(programs.coupled_line(programs.COLUMN, self.out, *LONG, fluid=fluid), 20 + MARGIN)
        self.expect(ended, 20 + MARGIN, (40,), ["error: 'fluid' failed (exit code 11)", "fluid.h5"], program="coupler")
        self.frames_are_whole()

    def test_a_full_disk_under_the_coupler(self):
        line = programs.coupled_line(programs.COLUMN, self.out, *LONG)
        coupler = line.index(programs.program("coupler"))
        ended = programs.run(line[:coupler] + [*SMALL_DISK, "20000"] + line[coupler:], 20 + MARGIN)
        self.expect(ended, 20 + MARGIN, (11,), ["error: ", "history/"], program="coupler")
        self.frames_are_whole()

    def test_scripts_run_names_the_killed_program(self):
        line = [sys.executable, "-B", str(programs.ROOT / "scripts" / "run_case.py"), str(programs.COLUMN), "--build", str(programs.BUILD),
                "--out", str(self.out), *LONG]
        ended = self.run_until_it_moves(line, "solid_fe", signal.SIGKILL, MARGIN)
        self.expect(ended, MARGIN, (137,), ["error: 'solid' (world rank 2) was ended by signal 9 (SIGKILL)"], program="solid")

    def test_a_stopped_solid_is_called_silent(self):
        line = programs.coupled_line(programs.COLUMN, self.out, *LONG)
        ended = self.run_until_it_moves(line, "solid_fe", signal.SIGSTOP, STALL + MARGIN)
        self.expect(ended, STALL + MARGIN, (36,), [f"error: 'solid' has sent nothing for {STALL}"], program="coupler")

    def test_an_inverted_element_ends_the_run_and_leaves_its_last_state(self):
        # A law that softens under pressure, and a weight that no bar carries.
        case = programs.ROOT / "cases" / "bar_wave" / "case.toml"
        ended = programs.run([programs.program("solid"), str(case), "--out", str(self.out), "--set", 'solid.law="svk"', "--set", "solid.gravity=[-1e11, 0.0]"], MARGIN)
        self.expect(ended, MARGIN, (10,), ["quadrilateral4 number", "near (", "at step", "is inverted"], program="solid")
        self.assertGreaterEqual((self.out / "solid.xdmf").read_text().count("<Time"), 2, "no frame of the state that broke")

    def test_a_missing_solid_is_named(self):
        ended = programs.run(programs.coupled_line(programs.COLUMN, self.out, *DEADLINES, solid=[]), MARGIN)
        self.expect(ended, MARGIN, (35,), ["error: no program with role 'solid' (found: coupler x1, fluid x1)"], program="coupler")

    def test_a_foreign_program_is_noticed_while_the_others_wait_in_mpi_init(self):
        # It never calls MPI_Init, where the others wait for it: their start timers are the only thing that still runs, and without MPI none knows
        # whether another has spoken. That of the fluid is two seconds later: it says the same where mpirun has not ended it by then, and only there.
        ended = programs.run(programs.coupled_line(programs.COLUMN, self.out, *DEADLINES, solid=["sleep", "60"]), HELLO + MARGIN)
        self.expect(ended, HELLO + MARGIN, (31,), ["error: 'coupler' still waits in MPI_Init after 3 s", "never called MPI_Init"], errors=None)
        self.assertTrue(all("still waits in MPI_Init" in error for error in ended.errors()), ended.text)
        self.assertEqual(len(ended.errors()), 1 if ended.seconds < HELLO + 2 else len(set(ended.errors())), ended.text)
        self.assertLessEqual(len(ended.errors()), 2, ended.text)

    def test_a_foreign_mpi_program_is_named_by_its_rank(self):
        foreign = [str(programs.ACTOR), "--behave=foreign"]
        ended = programs.run(programs.coupled_line(programs.COLUMN, self.out, *DEADLINES, solid=foreign), HELLO + MARGIN)
        self.expect(ended, HELLO + MARGIN, (32,), ["error: no hello from world rank(s) 2 within 3 s"], program="coupler")

    def test_another_case_file_is_noticed_before_the_run(self):
        other = self.variant(("resolution = 40", "resolution = 41"), name="other.toml")
        solid = [programs.program("solid"), str(other), "--out", str(self.out), *DEADLINES]
        ended = programs.run(programs.coupled_line(programs.COLUMN, self.out, *DEADLINES, solid=solid), MARGIN)
        self.expect(ended, MARGIN, (34,), ["error: 'solid'", "read another case than 'coupler'"], program="coupler")

    def test_other_overrides_are_another_case(self):
        solid = [programs.program("solid"), str(programs.COLUMN), "--out", str(self.out), *DEADLINES, "--set", "solid.density=1501.0"]
        ended = programs.run(programs.coupled_line(programs.COLUMN, self.out, *DEADLINES, solid=solid), MARGIN)
        self.expect(ended, MARGIN, (34,), ["read another case than 'coupler'"], program="coupler")

    def test_another_version_of_the_protocol_is_named(self):
        future = [str(programs.ACTOR), "--role=solid", "--behave=future"]
        ended = programs.run(programs.coupled_line(programs.COLUMN, self.out, *DEADLINES, solid=future), MARGIN)
        self.expect(ended, MARGIN, (33,), ["error: 'solid' (future 2.0, rank 2", "speaks protocol 2.0, 'coupler'", "speaks 1.0"], program="coupler")


class ParaView(FailureTest):
    """What a run left that was killed, or whose disk was full, opens in ParaView (label validation)."""

    SCRIPT = """
import sys
from paraview.simple import *
for path in sys.argv[1:]:
    reader = XDMFReader(FileNames=[path])
    times = list(reader.TimestepValues)
    UpdatePipeline(time=times[-1], proxy=reader)
    data = reader.GetDataInformation()
    assert len(times) >= 2 and data.GetNumberOfPoints() > 10 and data.GetNumberOfCells() > 10, path
    print("opened", path, len(times), data.GetNumberOfPoints())
"""

    def opens(self):
        if shutil.which("pvbatch") is None:
            self.skipTest("ParaView is not installed")
        script = self.folder / "open.py"
        script.write_text(self.SCRIPT)
        files = [str(self.out / f"{name}.xdmf") for name in ("fluid", "solid")]
        done = subprocess.run(["pvbatch", str(script), *files], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=120)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertEqual(done.stdout.count("opened"), 2, done.stdout)
        print("    " + "; ".join(line.split("/")[-1] for line in done.stdout.split("\n") if line.startswith("opened")), file=sys.stderr)

    def test_after_a_kill(self):
        options = [*DEADLINES, "--set", "run.t_end=1000", "--set", "output.every=0.001"]  # several frames before the kill
        ended = self.run_until_it_moves(programs.coupled_line(programs.COLUMN, self.out, *options), "solid_fe", signal.SIGKILL, MARGIN)
        self.expect(ended, MARGIN, (137,), ["exited on signal 9"], errors=0)
        self.opens()

    def test_after_a_full_disk(self):
        fluid = [*SMALL_DISK, "200000", programs.program("fluid"), str(programs.COLUMN), "--out", str(self.out), *LONG]
        programs.run(programs.coupled_line(programs.COLUMN, self.out, *LONG, fluid=fluid), 20 + MARGIN)
        self.opens()


if __name__ == "__main__":
    programs.main(__doc__)
