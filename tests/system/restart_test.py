#!/usr/bin/python3
"""Continue runs from their checkpoints: the same bytes as without interruption. The real programs.

Example: tests/system/restart_test.py --build build/release Restart.test_the_elastic_column
         tests/system/restart_test.py --build build/release EveryScene       (all cases, coarse; label validation)
         tests/system/restart_test.py --build build/release RandomKills      (50 times kill -9; label validation)

Truth: a run from 0 to 2T that writes a checkpoint at T, against the same folder continued from that checkpoint. Histories and
the index of frames must be the same bytes, and so must be every data set of every frame. Nothing is rounded: tolerance zero.
"""
import os
import random
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import h5py

sys.path.insert(0, str(Path(__file__).resolve().parent))
import programs  # noqa: E402

LIMIT = 240  # [s]

# What makes a case coarse and short: overrides, and the end time [s]. Two checkpoints lie in it. Times are long enough for several
# remeshes, contact and plastic flow.
SCENES = {
    "elastic_column": (["run.resolution=10"], 0.05),
    "dam_break": (["run.resolution=8"], 0.25),
    "taylor_bar": ([], 8e-6),
    "elastic_gate": (["run.resolution=5"], 0.03),
    "dam_break_obstacle": (["run.resolution=6"], 0.05),
    "hydrostatic_tank": (["run.resolution=10"], 0.05),
    "standing_wave": (["run.resolution=16"], 0.2),
    "oscillating_drop": (["run.resolution=8"], 0.05),
    "bar_wave": ([], None),
    "cook_membrane": ([], 0.02),
    "elastica": ([], 0.02),
}


def contents(out):
    """{name: bytes} of the histories, the indices, and every data set of every frame."""
    found = {str(path.relative_to(out)): path.read_bytes() for path in [*out.glob("history/*.csv"), *out.glob("*.xdmf")]}
    for path in out.glob("*.h5"):
        with h5py.File(path) as file:
            def visit(name, item, path=path):
                if isinstance(item, h5py.Dataset):
                    found[f"{path.name}:{name}"] = item[()].tobytes()
            file.visititems(visit)
    return found


def line_of(case, out, *options):
    """Programs that the case needs, on one mpirun line, or the only one alone."""
    settings = tomllib.loads(Path(case).read_text())
    if isinstance(settings.get("solid"), list):  # several solids: each a program of its own name
        line = programs.coupled_line(case, out, *options, solid=[])
        for solid in settings["solid"]:
            line += [":", "-n", "1", programs.program("solid"), str(case), "--out", str(out), *options, "--name", solid["name"]]
        return line
    if "coupling" in settings or "interface" in settings:
        return programs.coupled_line(case, out, *options)
    return [programs.program("fluid" if "fluid" in settings else "solid"), str(case), "--out", str(out), *options]


def sets(*settings):
    return [word for setting in settings for word in ("--set", setting)]


class Scene(programs.SystemTest):
    def compare(self, a, b):
        return self.compare_contents(contents(a), contents(b))

    def compare_contents(self, first, second):
        self.assertEqual(sorted(first), sorted(second))
        different = [name for name in first if first[name] != second[name]]
        self.assertEqual(different, [], "not the same bytes")
        return sum(len(data) for data in first.values())

    def complete(self, line, code=0):
        ended = programs.run(line, LIMIT)
        self.assertEqual(ended.code, code, ended.text)
        return ended

    def restart_is_exact(self, name):
        settings, t_end = SCENES[name]
        case = programs.ROOT / "cases" / name / "case.toml"
        if t_end is None:
            t_end = float(tomllib.loads(case.read_text())["run"]["t_end"])
        options = [*sets(*settings, f"checkpoint.every={t_end / 2}", "checkpoint.keep=0", f"run.t_end={t_end}",
                         f"output.every={t_end / 8}")]
        whole, again = self.folder / "whole", self.folder / "again"
        self.complete(line_of(case, whole, *options))
        ids = sorted(path.name for path in (whole / "checkpoints").iterdir())
        times = {k: tomllib.loads((whole / "checkpoints" / k / "manifest.toml").read_text())["t"] for k in ids}
        middle = [k for k in ids if 0.0 < times[k] < 0.9 * t_end]
        self.assertTrue(middle, f"a checkpoint in the middle: {times}")
        shutil.copytree(whole, again)
        self.complete(line_of(case, again, *options, "--restart", middle[0]))
        compared = self.compare(whole, again)
        print(f"    {name}: from t = {times[middle[0]]:.6g} of {t_end:g} s, {compared} bytes are the same", file=sys.stderr)


class Restart(Scene):
    def test_the_elastic_column(self):
        self.restart_is_exact("elastic_column")

    def test_a_dam_break(self):
        self.restart_is_exact("dam_break")

    def test_a_plastic_solid_in_contact(self):
        self.restart_is_exact("taylor_bar")

    def test_a_foreign_solid_that_can(self):
        script = str(programs.ROOT / "scripts" / "run_case.py")
        options = sets("coupling.scheme=staggered", 'solid.program=["python3","rigid_body.py"]', "run.t_end=0.004", "checkpoint.every=0.002",
                       "checkpoint.keep=0", "output.every=0.001")
        whole, again = self.folder / "whole", self.folder / "again"

        def line(out, *more):
            return [sys.executable, "-B", script, "swap_plate", "--out", str(out), "--no-plots", "--build", str(programs.BUILD), *options, *more]
        self.complete(line(whole))
        shutil.copytree(whole, again)
        self.complete(line(again, "--restart", "000001"))
        self.assertGreater(self.compare(whole, again), 10000)

    def test_a_foreign_solid_that_cannot_is_told_at_the_start(self):
        script = str(programs.ROOT / "scripts" / "run_case.py")
        ended = self.complete([sys.executable, "-B", script, "swap_plate", "--out", str(self.out), "--no-plots", "--build", str(programs.BUILD),
                               *sets("run.t_end=0.002", "checkpoint.every=0.001")])
        self.assertEqual(ended.text.count("a restart is not possible: 'solid' says: this solver writes no checkpoints"), 1, ended.text)
        self.assertEqual(list((self.out / "checkpoints").iterdir()), [])


class Stop(Scene):
    """Orderly ends before t_end: code 3, and the run that continues is the one that was not stopped."""

    OPTIONS = sets("run.resolution=10", "run.t_end=0.6", "output.every=0.05")
    WHOLE = {}  # contents of the run without interruption, made once

    def whole(self):
        if not self.WHOLE:
            out = self.folder / "whole"
            self.complete(programs.coupled_line(programs.COLUMN, out, *self.OPTIONS))
            self.WHOLE.update(contents(out))
        return self.WHOLE

    def stopped_and_continued(self, line_out, act, code=3, options=()):
        def when_it_moves(process):
            history = line_out / "history" / "interface.csv"
            while not (history.is_file() and history.read_text().count("\n") > 20):
                self.assertIsNone(process.poll(), "the run ended by itself")
                time.sleep(0.005)
            act(process)
        ended = programs.run(programs.coupled_line(programs.COLUMN, line_out, *self.OPTIONS, *options), LIMIT, when_it_moves)
        self.assertEqual(ended.code, code, ended.text)
        self.assertEqual(ended.left, [])
        print(f"    {self._testMethodName}: {ended.seconds:.1f} s, exit code {ended.code}", file=sys.stderr)
        self.complete(programs.coupled_line(programs.COLUMN, line_out, *self.OPTIONS, "--restart", "latest"))
        self.compare_contents(self.whole(), contents(line_out))
        return ended

    def victim(self, process, name):
        return next(pid for pid, command in programs.descendants(process.pid).items() if command == name)

    def test_sigusr1_to_mpirun(self):
        self.stopped_and_continued(self.out, lambda process: os.kill(process.pid, signal.SIGUSR1))

    def test_sigterm_to_the_coupler(self):
        ended = self.stopped_and_continued(self.out, lambda process: os.kill(self.victim(process, "coupler"), signal.SIGTERM))
        self.assertIn("received SIGTERM", ended.text)

    def test_sigterm_to_the_solid(self):
        ended = self.stopped_and_continued(self.out, lambda process: os.kill(self.victim(process, "solid_fe"), signal.SIGTERM))
        self.assertIn("the solid received SIGTERM", ended.text)

    def test_sigterm_to_mpirun(self):
        # mpirun passes SIGTERM on and kills what is left a second later; the code is its own. The state is written if that second is
        # enough, which on a busy machine it need not be: what counts is that everything ends and the last checkpoint is good.
        every = ["--set", "checkpoint.every=0.01"]
        self.stopped_and_continued(self.out, lambda process: os.kill(process.pid, signal.SIGTERM), code=1, options=every)

    def test_a_wall_clock_limit(self):
        line = programs.coupled_line(programs.COLUMN, self.out, *sets("run.resolution=20", "run.t_end=100.0", "checkpoint.wall_limit=1.0"))
        ended = self.complete(line, code=3)
        self.assertIn("checkpoint.wall_limit = 1 s is over", ended.text)
        self.assertTrue(list((self.out / "checkpoints").glob("*/manifest.toml")))

    def test_a_fluid_alone(self):
        case = programs.ROOT / "cases" / "dam_break" / "case.toml"

        def act(process):
            while not (self.out / "history" / "mass.csv").is_file():
                time.sleep(0.01)
            os.kill(process.pid, signal.SIGUSR1)
        ended = programs.run(line_of(case, self.out, *sets("run.resolution=8")), LIMIT, act)
        self.assertEqual(ended.code, 3, ended.text)
        self.complete(line_of(case, self.out, *sets("run.resolution=8", "run.t_end=0.3"), "--restart", "latest"))


class Damage(Scene):
    """What must not be continued from."""

    def test_no_checkpoint_at_all(self):
        ended = self.complete(programs.coupled_line(programs.COLUMN, self.out, "--restart", "latest"), code=4)
        self.assertIn("holds no complete checkpoint", ended.text)

    def test_a_damaged_checkpoint_is_passed_over(self):
        options = sets("run.resolution=10", "run.t_end=0.02", "checkpoint.every=0.005", "checkpoint.keep=0")
        self.complete(programs.coupled_line(programs.COLUMN, self.out, *options))
        folders = sorted((self.out / "checkpoints").iterdir())
        with open(folders[-1] / "solid.h5", "r+b") as file:
            file.seek(1000)
            file.write(b"damage")
        (folders[-2] / "manifest.toml").unlink()
        ended = self.complete(programs.coupled_line(programs.COLUMN, self.out, *options, "--restart", "latest"))
        self.assertIn(f"continues from {folders[-3]}", (self.out / "coupler.log").read_text(), ended.text)
        for folder, words in ((folders[-1], "another size or checksum"), (folders[-2], "never completed")):
            if folder.is_dir():
                ended = self.complete(programs.coupled_line(programs.COLUMN, self.out, *options, "--restart", str(folder)), code=4)
                self.assertIn(words, ended.text)


class EveryScene(Scene):
    """All shipped cases; a new one needs no entry in SCENES as long as a fiftieth of its time is not too long. UNDINE_SCENES: only these."""

    def test_every_scene(self):
        for case in sorted((programs.ROOT / "cases").glob("*/case.toml")):
            name = case.parent.name
            if name.startswith("swap_") or name not in os.environ.get("UNDINE_SCENES", name).split(","):
                continue  # foreign solids write no checkpoints
            settings = tomllib.loads(case.read_text())
            SCENES.setdefault(name, ([], float(settings["run"]["t_end"]) / 50))
            with self.subTest(name):
                shutil.rmtree(self.folder, ignore_errors=True)
                self.folder.mkdir()
                self.restart_is_exact(name)


class RandomKills(Scene):
    """kill -9 of a random program at random times, 50 times; the run that comes out is the one that was never killed."""

    KILLS = int(os.environ.get("UNDINE_KILLS", "50"))

    def test_random_kills(self):
        options = sets("run.resolution=20", "run.t_end=0.5", "checkpoint.every=0.005", "output.every=0.05")
        whole = self.folder / "whole"
        begin = time.monotonic()
        self.complete(programs.coupled_line(programs.COLUMN, whole, *options))
        alone = time.monotonic() - begin
        chance = random.Random(7)
        kills, lost = 0, 0.0
        while True:
            restart = ["--restart", "latest"] if list(self.out.glob("checkpoints/*/manifest.toml")) else []
            line = programs.coupled_line(programs.COLUMN, self.out, *options, *restart)
            delay = chance.uniform(0.2, 1.5) if kills < self.KILLS else LIMIT
            process = subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                                       env=programs.ENVIRONMENT, cwd=programs.ROOT)
            try:
                _, errors = process.communicate(timeout=delay)
                if process.returncode == 0:
                    if kills >= self.KILLS:
                        break
                    shutil.rmtree(self.out)  # it was faster than the kills: once more from the start
                    continue
                self.fail(errors)
            except subprocess.TimeoutExpired:
                names = {name: pid for pid, name in programs.descendants(process.pid).items()}
                victims = [names[name] for name in ("coupler", "fluid_pfem", "solid_fe") if name in names]
                if not victims:
                    process.kill()
                    process.wait()
                    continue
                os.kill(chance.choice(victims), signal.SIGKILL)
                process.communicate(timeout=20)
                kills += 1
                rows = self.out / "history" / "interface.csv"
                manifests = [tomllib.loads(path.read_text())["t"] for path in self.out.glob("checkpoints/*/manifest.toml")]
                if manifests and rows.is_file():
                    last = [line for line in rows.read_text().split("\n")[:-1] if line[:1].isdigit()]
                    lost = max(lost, float(last[-1].split(",")[0]) - max(manifests)) if last else lost
        compared = self.compare(whole, self.out)
        print(f"    {kills} kills, {compared} bytes are the same; at most {lost:.4g} s lost at a kill, interval 0.005 s; "
              f"run without kills {alone:.1f} s", file=sys.stderr)
        self.assertLess(lost, 2 * 0.005)


if __name__ == "__main__":
    programs.main(__doc__)
