#!/usr/bin/python3
"""Fluid and solid on several ranks: the same bytes as on one, and no hang when a rank fails. The real programs.

Example: tests/system/ranks_test.py --build build/release Same.test_a_dam_break
         tests/system/ranks_test.py --build build/release Longer             (1000 steps and more; label validation)

Truth: the run on one rank. Histories, indices, every data set of every frame and the files of every checkpoint must be the same bytes.
"""
import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import programs  # noqa: E402
from restart_test import contents, sets  # noqa: E402

LIMIT = 240  # [s]
STALL = 2    # [s]
MARGIN = 8   # for a machine on which others compute


def line_of(case, out, ranks, *options, solid=1):
    """mpirun line with the fluid on so many ranks, coupled where the case is, then the coupler on as many as the solid; of a
    solid alone it is its number."""
    common = [str(case), "--out", str(out), *options]
    fluid = ["-n", str(ranks), programs.program("fluid"), *common]
    text = case.read_text()
    if "[fluid]" not in text:
        return [*programs.MPIRUN, "-n", str(ranks), programs.program("solid"), *common]
    if "[coupling]" not in text and "[[interface]]" not in text:
        return [*programs.MPIRUN, *fluid]
    return [*programs.MPIRUN, "-n", str(solid), programs.program("coupler"), *common, ":", *fluid, ":", "-n", str(solid), programs.program("solid"), *common]


def checkpoints(out):
    """{name: bytes} of the files of fluid and solid of every checkpoint."""
    return {str(path.relative_to(out)): path.read_bytes() for path in [*out.glob("checkpoints/*/fluid.h5"), *out.glob("checkpoints/*/solid.h5")]}


def part_of(out, program):
    """What a program said of its run; nothing if it did not run."""
    path = out / f"{program}.json"
    part = json.loads(path.read_text()) if path.is_file() else {}
    return part.get(program, part)


class RanksTest(programs.SystemTest):
    def complete(self, line):
        ended = programs.run(line, LIMIT)
        self.assertEqual(ended.code, 0, ended.text)

    def check_time_split(self, out):
        """Every rank says where its time went: the parts of the fluid's are its time on the wall (which ends microseconds before)."""
        for program, parts in (("fluid", {"compute", "halo", "remesh", "imbalance", "wait"}), ("solid", {"compute", "halo", "imbalance", "wait"})):
            said = part_of(out, program)
            if said.get("ranks", 1) == 1:
                self.assertNotIn("rank_time_s", said)
                continue
            times = said["rank_time_s"]
            self.assertLessEqual(set(times), parts)
            self.assertLessEqual({"compute", "wait"}, set(times))
            for seconds in times.values():
                self.assertEqual(len(seconds), said["ranks"])
                self.assertGreaterEqual(min(seconds), 0.0)
            if program == "fluid":
                self.assertAlmostEqual(sum(seconds[0] for seconds in times.values()), said["wall_s"], delta=0.01 * MARGIN)

    def same(self, name, ranks, t_end, *settings, solid=lambda n: 1, case=None):
        """Run the case on each number of ranks, and from a checkpoint of the last one on one rank. solid: its ranks beside n of the fluid"""
        case = case or programs.ROOT / "cases" / name / "case.toml"
        options = sets(*settings, f"run.t_end={t_end}", f"output.every={t_end / 4}", f"checkpoint.every={t_end / 2}", "checkpoint.keep=0")
        first = self.folder / "1"
        self.complete(line_of(case, first, 1, *options))
        truth = {**contents(first), **checkpoints(first)}
        self.assertTrue(any("checkpoints" in k for k in truth))
        for n in ranks:
            out = self.folder / str(n)
            self.complete(line_of(case, out, n, *options, solid=solid(n)))
            found = {**contents(out), **checkpoints(out)}
            self.assertEqual(sorted(found), sorted(truth))
            self.assertEqual([k for k in truth if truth[k] != found[k]], [], f"{n} ranks: not the same bytes")
            self.check_time_split(out)
        self.check_time_split(first)
        said = part_of(first, "fluid") or part_of(first, "solid")
        steps, remeshes = said["steps"], said.get("remeshes")
        print(f"    {name}: 1 and {ranks} ranks, {steps} steps, {remeshes} remeshes, {sum(map(len, truth.values()))} bytes are the same",
              file=sys.stderr)
        # Written by several ranks, continued by one, and the other way round.
        several = self.folder / str(ranks[-1])
        for source, n in ((several, 1), (first, ranks[0])):
            out = self.folder / f"again_{n}"
            shutil.copytree(source, out)
            begin = sorted(p.name for p in (out / "checkpoints").iterdir())[0]
            self.complete(line_of(case, out, n, *options, "--restart", begin, solid=solid(n)))
            found = contents(out)
            self.assertEqual([k for k in contents(first) if truth[k] != found[k]], [], f"continued on {n} ranks: not the same bytes")


class Same(RanksTest):
    def test_a_dam_break(self):
        self.same("dam_break", (2, 8), 0.25, "run.resolution=12")

    def test_an_elastic_gate_in_contact(self):
        self.same("elastic_gate", (2, 3), 0.004, "run.resolution=24", solid=lambda n: n)

    def test_a_box_that_is_filled(self):
        self.same("filling_box", (2, 3), 0.4)

    def test_a_tank_with_a_hole(self):
        self.same("tank_with_hole", (3,), 0.1)

    def test_a_wedge_whose_waves_leave_the_water(self):
        self.same("wedge_impact", (2, 3), 4e-4, "run.resolution=60")

    def test_a_column_that_is_subcycled(self):
        self.same("elastic_column", (2,), 0.02, "run.resolution=24", solid=lambda n: n)

    def test_a_column_by_gradients(self):
        """The coupler's ranks share the solutions for the multipliers."""
        self.same("elastic_column", (2, 3), 0.02, "run.resolution=24", "coupling.solver=gradients", solid=lambda n: n)

    def test_a_bed_under_water_in_space_by_gradients(self):
        """441 multipliers: two blocks of sums, so that a third rank of the coupler has none."""
        self.same("elastic_bed", (2, 3), 4e-4, "coupling.solver=gradients", solid=lambda n: n)

    def test_a_solid_alone(self):
        """Plastic flow, a wall, probes of everything."""
        probe = '\n[[probe]]\nname = "{}"\non = "solid"\n{}\nquantity = [{}]\n'
        text = (programs.ROOT / "cases" / "taylor_bar" / "case.toml").read_text().split("[[reference]]")[0]
        text += probe.format("stress", "point = [1e-3, 2e-3]", '"p", "von_mises", "plastic_strain", "v", "a"')
        text += probe.format("cut", "point = [1e-3, 5e-3]\nnormal = [0.0, 1.0]", '"S"') + probe.format("axis", 'surface = "left"', '"F", "u"')
        case = self.folder / "rod.toml"
        case.write_text(text)
        self.same("taylor_bar", (2, 3), 4e-6, case=case)


class Restarts(RanksTest):
    """A run on one rank is continued on three, that one on two, and that one on one again."""

    def chain(self, name, t_end, *settings, solid=lambda n: 1):
        case = programs.ROOT / "cases" / name / "case.toml"
        options = sets(*settings, f"run.t_end={t_end}", f"output.every={t_end / 8}", f"checkpoint.every={t_end / 4}", "checkpoint.keep=0")
        source = self.folder / "whole"
        self.complete(line_of(case, source, 1, *options))
        truth = {**contents(source), **checkpoints(source)}
        ids = sorted(p.name for p in (source / "checkpoints").iterdir())
        ids = ids[1 if len(ids) > 4 else 0:]  # coupled: one at the start
        for begin, n in zip(ids, (3, 2, 1)):
            out = self.folder / f"from_{begin}"
            shutil.copytree(source, out)
            for later in out.glob("checkpoints/*"):
                if later.name > begin:
                    shutil.rmtree(later)
            self.complete(line_of(case, out, n, *options, "--restart", begin, solid=solid(n)))
            found = {**contents(out), **checkpoints(out)}
            self.assertEqual(sorted(found), sorted(truth))
            self.assertEqual([k for k in truth if truth[k] != found[k]], [], f"continued on {n} ranks: not the same bytes")
            source = out
        files = [k for k in truth if k.startswith("checkpoints/")]
        print(f"    {name}: 1, 3, 2, 1 ranks, {len(files)} files of {sum(len(truth[k]) for k in files)} bytes in checkpoints "
              f"and {sum(map(len, truth.values()))} bytes in all are the same", file=sys.stderr)

    def test_a_fluid(self):
        self.chain("dam_break", 0.3, "run.resolution=12")

    def test_a_fluid_in_boxes(self):
        self.chain("dam_break", 0.3, "run.resolution=12", 'fluid.order="boxes"')

    def test_a_solid(self):
        self.chain("taylor_bar", 6e-6)

    def test_both(self):
        self.chain("elastic_gate", 0.006, "run.resolution=20", solid=lambda n: n)


class Longer(RanksTest):
    def test_a_dam_break(self):
        self.same("dam_break", (2, 3, 4, 8), 0.6, "run.resolution=24")

    def test_an_elastic_gate_in_contact(self):
        self.same("elastic_gate", (2, 3, 4, 8), 0.06, "run.resolution=20", solid=lambda n: min(n, 4))

    def test_windows_on_trial(self):
        """Both go back to the begin of a window on all their ranks."""
        self.same("elastic_column", (2, 3), 0.01, "run.resolution=24", "coupling.form=macro_continuity", "coupling.substeps=10", solid=lambda n: n)

    def test_a_beam_in_water(self):
        self.same("beam_in_channel", (2,), 0.05, solid=lambda n: n)

    def test_an_interface_of_ten_thousand_multipliers(self):
        """Integrals and solutions shared by the coupler's ranks."""
        self.same("elastic_bed", (2,), 7e-5, "run.resolution=80", solid=lambda n: n)

    def test_waves_and_drops(self):
        self.same("standing_wave", (2, 4), 0.5, "run.resolution=40")

    def test_a_helper_of_the_coupler_that_is_stopped_while_the_run_starts(self):
        """Whoever waits for it says so, and nobody else: rank 0 of the coupler, in MPI_Init, for its hello, while they connect, or for its first task. From
        there on its partners wait twice as long as the coupler does."""
        says = {31: "'coupler' still waits in MPI_Init after 3 s", 32: "no hello from world rank(s) 1 within 3 s|'coupler': the hand-shake hangs",
                36: "rank 1 of this program has kept the others waiting for 2"}
        seen = {}
        for delay in (0.0, 0.3, 0.45, 0.5, 0.6):  # on a quiet machine in MPI_Init, there, at the hello, in the first task, in the solutions
            out = self.folder / str(delay)
            line = line_of(programs.COLUMN, out, 1, *sets("coupling.hello_timeout=3", f"coupling.stall_timeout={2 * STALL}", "run.t_end=1000", "run.resolution=24", "coupling.solver=gradients"), solid=2)

            def act(process):
                while process.poll() is None:
                    for pid, name in programs.descendants(process.pid).items():
                        if name == "coupler" and "OMPI_COMM_WORLD_RANK=1\0" in Path(f"/proc/{pid}/environ").read_text():
                            time.sleep(delay)
                            os.kill(pid, signal.SIGSTOP)
                            return
                    time.sleep(0.005)
            ended = programs.run(line, 3 * STALL + 2 * MARGIN, act)
            text = f"stopped {delay} s after its start, {ended.seconds:.1f} s, exit code {ended.code}\n{ended.text}"
            self.assertIn(ended.code, says, text)
            self.assertRegex(ended.text, says[ended.code].replace("(", r"\(").replace(")", r"\)"), text)
            self.assertTrue(len(ended.errors()) == 1 or ended.code == 31 and ended.seconds > 5 - delay, text)
            self.assertEqual(ended.left, [], text)
            seen.setdefault(ended.code, []).append(delay)
        print(f"    {self._testMethodName}: exit code and delays {seen}", file=sys.stderr)


class Failures(RanksTest):
    def run_and_hit(self, case, ranks, victim, number, *options, solid=1, program="fluid_pfem", history="mass"):
        """Start the case, send the signal to world rank `victim` of `program` when its history grows. @returns how it ended"""
        line = line_of(case, self.out, ranks, *sets(f"coupling.stall_timeout={STALL}" if case == self.gate else f"run.rank_timeout={STALL}", "run.t_end=1000", *options), solid=solid)

        def act(process):
            rows = self.out / "history" / f"{history}.csv"
            begin = time.monotonic()
            while not (rows.is_file() and rows.read_text().count("\n") > 6):
                self.assertLess(time.monotonic() - begin, 60.0, "the run did not start")
                self.assertIsNone(process.poll(), "the run ended by itself")
                time.sleep(0.02)
            for pid, name in programs.descendants(process.pid).items():
                if name == program and f"OMPI_COMM_WORLD_RANK={victim}\0" in Path(f"/proc/{pid}/environ").read_text():
                    os.kill(pid, number)
                    return
            self.fail("no such rank")
        ended = programs.run(line, STALL * 3 + MARGIN, act)
        self.assertIsNotNone(ended.code, "still running\n" + ended.text)
        self.assertEqual(ended.left, [], "processes outlive mpirun")
        print(f"    {self._testMethodName}: {ended.seconds:.1f} s, exit code {ended.code}", file=sys.stderr)
        return ended

    dam = programs.ROOT / "cases" / "dam_break" / "case.toml"
    gate = programs.ROOT / "cases" / "elastic_gate" / "case.toml"
    cook = programs.ROOT / "cases" / "cook_membrane" / "case.toml"
    rod = programs.ROOT / "cases" / "taylor_bar" / "case.toml"

    def test_a_killed_rank_ends_the_run(self):
        self.assertEqual(self.run_and_hit(self.dam, 3, 2, signal.SIGKILL, "run.resolution=12").code, 137)

    def test_a_silent_rank_is_named(self):
        ended = self.run_and_hit(self.dam, 3, 1, signal.SIGSTOP, "run.resolution=12")
        self.assertEqual(ended.code, 36, ended.text)
        self.assertIn("of this program kept another waiting for 2 s", ended.text)

    def test_a_silent_rank_ends_a_coupled_run(self):
        ended = self.run_and_hit(self.gate, 2, 2, signal.SIGSTOP, "run.resolution=12", "output.history_every=0.0001")
        self.assertEqual(ended.code, 36, ended.text)
        self.assertIn("fluid", "\n".join(ended.errors()))

    def test_a_silent_rank_of_the_solid_ends_a_coupled_run(self):
        ended = self.run_and_hit(self.gate, 1, 4, signal.SIGSTOP, "run.resolution=12", "output.history_every=0.0001", solid=2, program="solid_fe")
        self.assertEqual(ended.code, 36, ended.text)
        self.assertIn("solid", "\n".join(ended.errors()))

    def test_a_stopped_helper_of_the_coupler_is_named(self):
        """At the latest where the run ends: a helper that sleeps is not missed before."""
        case = programs.ROOT / "cases" / "elastic_column" / "case.toml"
        line = line_of(case, self.out, 1, *sets(f"coupling.stall_timeout={2 * STALL}", "run.t_end=0.02", "run.resolution=24"), solid=2)

        def act(process):
            history = self.out / "history" / "interface.csv"
            while process.poll() is None and not (history.is_file() and history.read_text().count("\n") > 3):  # before the first window its partners miss the coupler
                time.sleep(0.02)
            for pid, name in programs.descendants(process.pid).items():
                if name == "coupler" and "OMPI_COMM_WORLD_RANK=1\0" in Path(f"/proc/{pid}/environ").read_text():
                    os.kill(pid, signal.SIGSTOP)
        ended = programs.run(line, STALL * 3 + MARGIN, act)
        self.assertEqual(ended.code, 36, ended.text)
        self.assertIn("rank 1 of this program has kept the others waiting for 2", ended.text)
        self.assertEqual(ended.left, [], "processes outlive mpirun")

    def test_a_helper_of_the_coupler_that_fails_between_solutions(self):
        """Conjugate gradients need it in every step: it is missed at once. Its partners wait for the coupler twice as long."""
        for number, code in ((signal.SIGKILL, 137), (signal.SIGSTOP, 36)):
            self.out = self.folder / str(code)
            ended = self.run_and_hit(programs.COLUMN, 1, 1, number, "run.resolution=24", "coupling.solver=gradients", f"coupling.stall_timeout={2 * STALL}",
                                     solid=3, program="coupler", history="interface")
            self.assertEqual(ended.code, code, ended.text)
            if number == signal.SIGSTOP:
                self.assertIn("rank 1 of this program has kept the others waiting for 2", ended.text)

    def test_a_killed_or_silent_rank_of_a_solid_alone(self):
        for number, code in ((signal.SIGKILL, 137), (signal.SIGSTOP, 36)):
            self.out = self.folder / str(code)
            ended = self.run_and_hit(self.cook, 3, 2, number, "output.history_every=1", program="solid_fe", history="solid_energy")
            self.assertEqual(ended.code, code, ended.text)

    def test_an_element_that_is_inverted_anywhere_ends_all_ranks(self):
        ended = programs.run(line_of(self.rod, self.out, 3, *sets("solid.initial_velocity=[0.0,-9000.0]")), MARGIN)
        self.assertEqual(ended.code, 10, ended.text)
        self.assertIn("is not positive", ended.text)

    def test_a_rank_that_is_told_to_stop_stops_all(self):
        ended = self.run_and_hit(self.dam, 3, 2, signal.SIGUSR1, "run.resolution=12")
        self.assertEqual(ended.code, 3, ended.text)
        self.assertTrue(list(self.out.glob("checkpoints/*/manifest.toml")))


if __name__ == "__main__":
    programs.main(__doc__)
