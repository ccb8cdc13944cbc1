#!/usr/bin/python3
"""Start coupled runs of link_actor in which one thing goes wrong, and check how they end.

Example: failure_matrix.py --actor build/release/tests/link_actor
         failure_matrix.py --actor build/release/tests/link_actor --case stuck --case killed --verbose

For each case: all processes are gone in time, mpirun returns the documented code, stderr names the culprit, and
FAILED.toml says the same when one of our programs could write it. Prints a table case -> seconds -> code.
"""
import argparse
import os
import re
import signal
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
import processes  # noqa: E402

START, HELLO, STALL = 4.0, 3.0, 2.0  # the deadlines [s]; long enough for a machine that others use as well

# What a case may take beyond its deadline [s]: mpirun needs about 1.5 s to start and to kill, the rest is for a machine
# on which others compute.
MARGIN = 8.0


@dataclass
class Case:
    """One run: programs of the mpirun line, and how it must end."""
    name: str
    programs: list                                  # each: list of arguments for link_actor, or ["!", program, ...]
    codes: tuple                                    # exit codes of mpirun
    deadline: float = 0.0                           # [s]
    says: list = field(default_factory=list)        # regular expressions for stdout + stderr
    failed: dict = field(default_factory=dict)      # entries of FAILED.toml; empty: not looked at
    signal_all: bool = False                        # stop the whole job for a while
    launcher_may_hang: bool = False                 # mpirun itself, with none of the programs left
    witnesses: int = 1                              # programs whose deadlines end together: the first to speak may not be the only one
    short: bool = False                             # part of --short


COUPLER, FLUID, SOLID = ["--role=coupler"], ["--role=fluid"], ["--role=solid"]


def coupled(*solid):
    return [COUPLER, FLUID, SOLID + list(solid)]


def owners(*behaviour):
    """The rows of the solid belong to its three ranks; the last one, world rank 4, misbehaves."""
    return [COUPLER, FLUID, ["3", *SOLID, "--split=yes", *behaviour]]


SILENT_OWNER = [r"error: 'solid rank 2' has sent nothing for 2(\.\d)? s\.  Last: FREE_VELOCITY #17 \(window 3, t = 0.0032 s\); "
                r"expected FREE_VELOCITY of the participant \(window 3, exchange 2 of 5\)"]
SILENT_SOLID = [r"error: 'solid' has sent nothing for 2(\.\d)? s\.  Last: FREE_VELOCITY #22 \(window 3, t = 0.0032 s\); "
                r"expected FREE_VELOCITY of the participant \(window 3, exchange 2 of 5\)",
                r"warning: 'solid' has sent nothing for 1(\.\d)? s"]
SILENT_SOLID_FILE = {"code": "36", "program": '"coupler"', "rank": "0", "time": "0.0032"}

CASES = [
    Case("well", coupled(), (0,), 2, [r"200 windows with 6 exchanges each"]),
    Case("well, 2 + 2 ranks", [COUPLER, ["2", "--role=fluid"], ["2", "--role=solid"]], (0,), 3,
         [r"200 windows with 6 exchanges each"], short=True),
    Case("well, coupler on 3 ranks", [["3", *COUPLER], FLUID, SOLID], (0,), 2, [r"200 windows with 6 exchanges each"]),
    Case("rows of 3 ranks", owners(), (0,), 2, [r"200 windows with 6 exchanges each"], short=True),
    Case("an owner slow but alive", owners("--behave=slow"), (0,), 2 * STALL, [r"200 windows"]),
    Case("an owner killed", owners("--behave=killed"), (137,), 0, [r"rank 4 .*exited on signal 9"]),
    Case("an owner stuck in a loop", owners("--behave=loop"), (36,), STALL, SILENT_OWNER, {"code": "36", "program": '"coupler"', "time": "0.0032"}, short=True),
    Case("an owner with SIGSTOP", owners("--behave=stopped"), (36,), STALL, SILENT_OWNER, {"code": "36"}),
    Case("an owner leaves early", owners("--behave=return"), (40,), 0,
         [r"error: 'solid rank 2' failed \(exit code 1\): it left in the middle of the conversation; next was LINK_FORCE"], {"code": "40"}),
    Case("an owner reports failure", owners("--behave=fail"), (40,), 0, [r"error: 'solid rank 2' failed \(exit code 10\): element 17 is inverted"],
         {"code": "40", "program": '"coupler"', "step": "120"}),
    Case("NaN of an owner", owners("--behave=nan"), (37,), 0,
         [r"error: FREE_VELOCITY #17 from 'solid rank 2': component 1 of node 2 of its own in the MESH is nan, expected a finite number"], {"code": "37"}),
    Case("a lost message of an owner", owners("--behave=lost"), (37,), 0, [r"error: .*'solid rank 2'"], {"code": "37", "program": '"coupler"'}),
    Case("coupler stuck, 3 owners", [COUPLER + ["--behave=loop"], FLUID, ["3", *SOLID, "--split=yes"]], (36,), STALL,
         [r"error: 'coupler' has sent nothing for 2(\.\d)? s"], {"code": "36"}, witnesses=4),
    Case("well, coupler last", [SOLID, FLUID, COUPLER], (0,), 2, [r"200 windows with 6 exchanges each"]),
    Case("alone", [["2", "--role=fluid", "--alone=yes"]], (0,), 0, [r"fluid runs alone"]),
    Case("slow but alive", coupled("--behave=slow"), (0,), 2 * STALL, [r"200 windows"]),
    Case("whole job suspended", coupled("--behave=work"), (0,), 4, [r"200 windows"], signal_all=True),

    # mpirun itself notices and kills the others; its own codes
    Case("killed", coupled("--behave=killed"), (137,), 0, [r"rank 2 .*exited on signal 9"], short=True),
    Case("segfault", coupled("--behave=segfault"), (139,), 0, [r"rank 2 .*exited on signal 11"]),
    Case("uncaught exception", coupled("--behave=throw"), (134,), 0, [r"rank 2 .*exited on signal 6"]),
    Case("exit(0) without Finalize", coupled("--behave=exit0"), (1,), 0, [r"exiting improperly"], short=True),
    Case("exit(3) without Finalize", coupled("--behave=exit3"), (3,), 0, [r"Exit code: +3|exiting improperly"]),
    Case("no such program", [COUPLER, FLUID, ["!", "/no/such/solid"]], (132, 134), 0, [r"/no/such/solid"]),

    Case("early MPI_Finalize", coupled("--behave=finalize"), (40,), 0,
         [r"error: 'solid' failed \(exit code 1\): it called MPI_Finalize before the coupled run had ended"],
         {"code": "40", "program": '"coupler"'}, short=True),
    Case("early return from the solver", coupled("--behave=return"), (40,), 0,
         [r"error: 'solid' failed \(exit code 1\): it left in the middle of the conversation; next was LINK_FORCE"],
         {"code": "40", "program": '"coupler"'}),
    Case("stuck in a loop", coupled("--behave=loop"), (36,), STALL, SILENT_SOLID, SILENT_SOLID_FILE, short=True),
    Case("SIGSTOP", coupled("--behave=stopped"), (36,), STALL, SILENT_SOLID, SILENT_SOLID_FILE),
    Case("coupler stuck", [COUPLER + ["--behave=loop"], FLUID, SOLID], (36,), STALL,
         [r"error: 'coupler' has sent nothing for 2(\.\d)? s"], {"code": "36"}, witnesses=2, short=True),

    Case("not an MPI program (sleep)", [COUPLER, FLUID, ["!", "sleep", "60"]], (31,), START,
         [r"error: 'coupler' still waits in MPI_Init .*\n?.*at least one program on the mpirun line never called MPI_Init"]),
    # 1: it ended after the others had called MPI_Init, which mpirun notices by itself
    Case("not an MPI program (true)", [COUPLER, FLUID, ["!", "true"]], (31, 1), START,
         [r"at least one program on the mpirun line never called MPI_Init|this process did not call \"init\""]),
    Case("not an MPI program, first", [["!", "sleep", "60"], COUPLER, FLUID], (31,), START,
         [r"at least one program on the mpirun line never called MPI_Init"]),
    Case("foreign MPI program", coupled("--behave=foreign"), (32,), HELLO,
         [r"error: no hello from world rank\(s\) 2 within 3 s"], {"code": "32", "program": '"coupler"'}),
    Case("foreign MPI program, first", [["--behave=foreign"], COUPLER, FLUID], (32,), HELLO + 1,
         [r"error: world rank 0 has not answered the hello"], {"code": "32"}),
    # A program that sits in MPI_Finalize when another one ends the job: mpirun of Open MPI 4.1.4 itself crashes (139) or
    # hangs in about every eighth run, without children. What is ours must be right all the same.
    Case("foreign MPI program, Finalize", coupled("--behave=foreign_finalize"), (32, 139), HELLO,
         [r"error: no hello from world rank\(s\) 2 within 3 s"], {"code": "32", "program": '"coupler"'},
         launcher_may_hang=True),
    Case("two foreign ranks", [COUPLER, FLUID, ["2", "--behave=foreign"]], (32,), HELLO,
         [r"error: no hello from world rank\(s\) 2, 3 within 3 s"], {"code": "32"}),
    Case("late for the hello", coupled("--behave=late"), (32,), HELLO, [r"no hello from world rank\(s\) 2"],
         {"code": "32"}),
    Case("protocol 2.0", coupled("--behave=future"), (33,), 0,
         [r"error: 'solid' \(future 2.0, rank 2 on node7\) speaks protocol 2.0, 'coupler' \(actor 1, rank 0 on .*\) speaks 1.0"],
         {"code": "33", "program": '"coupler"'}),
    Case("protocol 2.0, first", [["--role=solid", "--behave=future"], COUPLER, FLUID], (32,), HELLO + 1,
         [r"world rank 0 has not answered"], {"code": "32"}),
    Case("another case", coupled("--hash=8"), (34,), 0, [r"error: 'solid' .* read another case than 'coupler'"],
         {"code": "34", "program": '"coupler"'}),
    Case("another case, judge is solid", [SOLID + ["--hash=8"], FLUID, COUPLER], (34,), 0,
         [r"error: '.*' \(.*\) read another case than '.*'"], {"code": "34", "program": '"solid"'}),
    Case("no solid", [COUPLER, FLUID], (35,), 0, [r"error: no program with role 'solid' \(found: coupler x1, fluid x1\)"],
         {"code": "35", "program": '"coupler"'}),
    Case("no coupler", [FLUID, SOLID], (35,), 0, [r"no program with role 'coupler' \(found: fluid x1, solid x1\)"],
         {"code": "35", "program": '"fluid"'}),
    Case("two couplers", [COUPLER, FLUID, SOLID, COUPLER + ["--solver=another 2"]], (35,), 0, [r"role 'coupler' is doubled"],
         {"code": "35"}, short=True),
    Case("two solids", [COUPLER, FLUID, SOLID, SOLID + ["--solver=another 2"]], (35,), 0, [r"role 'solid' is"], {"code": "35"}),
    Case("started alone", [SOLID], (35,), 0, [r"no program with role 'coupler' \(found: solid x1\)", r"started alone"],
         {"code": "35"}),

    Case("solid reports failure", coupled("--behave=fail"), (40,), 0,
         [r"error: 'solid' failed \(exit code 10\): element 17 is inverted"],
         {"code": "40", "program": '"coupler"', "step": "120", "time": "0.012"}, short=True),
    Case("NaN", coupled("--behave=nan"), (37,), 0,
         [r"error: FREE_VELOCITY #22 from 'solid': component 1 of node 2 of the MESH is nan, expected a finite number"],
         {"code": "37", "program": '"coupler"'}, short=True),
    Case("out of turn", coupled("--behave=early_report"), (37,), 0,
         [r"error: READY cannot be sent to 'coupler' now, expected FREE_VELOCITY"], {"code": "37", "program": '"solid"'}, short=True),
    Case("truncated message", coupled("--behave=cut"), (37,), 0, [r"error: .*'solid'"], {"code": "37", "program": '"coupler"'}),
    Case("lost message", coupled("--behave=lost"), (37,), 0, [r"error: .*'solid'"], {"code": "37", "program": '"coupler"'}),
    Case("oversized count", coupled("--behave=oversized"), (37,), 0, [r"error: .*'solid'"], {"code": "37", "program": '"coupler"'}),
    Case("bad case before MPI_Init", coupled("--behave=bad_case"), (2,), 0, [r"error: case.toml:3:1: .*must be positive"],
         {"code": "2", "program": '"solid"'}, short=True),
]


def mpirun_line(case, actor, out):
    """One application context per program."""
    line = list(processes.MPIRUN)
    for i, program in enumerate(case.programs):
        count = "1"
        if program[0].isdigit():
            count, program = program[0], program[1:]
        line += ([":"] if i else []) + ["-n", count]
        if program[0] == "!":
            line += program[1:]
        else:
            line += [actor, *program, f"--out={out}", f"--start={START}", f"--hello={HELLO}", f"--stall={STALL}"]
    return line


def leave_stale_file(folder):
    """FAILED.toml of a run of an hour ago: a new failure must replace it."""
    path = os.path.join(folder, "FAILED.toml")
    with open(path, "w") as file:
        file.write("code = 99\n")
    an_hour_ago = time.time() - 3600
    os.utime(path, (an_hour_ago, an_hour_ago))


def suspend(job):
    """Stop all processes of the job for longer than the stall limit, then let them go on."""
    time.sleep(2.0)
    pids = processes.descendants(job.pid)
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    time.sleep(STALL + 2.0)
    for pid in pids:
        os.kill(pid, signal.SIGCONT)


def complaints_about(case, ended, out):
    """What is not as the case says."""
    if ended.code is None:
        if ended.left or not case.launcher_may_hang:
            yield f"still running after {ended.seconds:.1f} s"
    else:
        if ended.code not in case.codes:
            yield f"exit code {ended.code}, expected {' or '.join(map(str, case.codes))}"
        if ended.left:
            yield f"processes {ended.left} outlive mpirun"
    for pattern in case.says:
        if not re.search(pattern, ended.text):
            yield f"the output does not say /{pattern}/"
    errors = len(ended.errors())
    if case.failed and not 1 <= errors <= case.witnesses:
        yield f"{errors} programs printed an error, expected {'1' if case.witnesses == 1 else f'1 to {case.witnesses}'}"
    failed = processes.read_failed(out)
    for key, value in case.failed.items():
        if failed.get(key) != value:
            yield f"FAILED.toml has {key} = {failed.get(key)}, expected {value}"
    leftovers = [name for name in os.listdir(out) if name != "FAILED.toml"]
    if leftovers:
        yield f"left behind: {leftovers}"


def run(case, actor, verbose):
    """Run one case; returns (seconds, exit code, list of complaints)."""
    with tempfile.TemporaryDirectory() as out:
        if case.failed:
            leave_stale_file(out)
        ended = processes.run(mpirun_line(case, actor, out), case.deadline + MARGIN, suspend if case.signal_all else None)
        complaints = list(complaints_about(case, ended, out))
        if verbose or complaints:
            print(ended.text)
    return ended.seconds, ended.code, complaints


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--actor", required=True, help="the program link_actor")
    parser.add_argument("--case", action="append", default=[], help="only cases whose name contains this (repeatable)")
    parser.add_argument("--short", action="store_true", help="one case of each kind (those that the real programs do not play in tests/system)")
    parser.add_argument("--verbose", action="store_true", help="print what the programs print")
    arguments = parser.parse_args()

    chosen = [case for case in CASES
              if (case.short or not arguments.short) and (not arguments.case or any(part in case.name for part in arguments.case))]
    rows, bad = [], 0
    for case in chosen:
        seconds, code, complaints = run(case, arguments.actor, arguments.verbose)
        verdict = "ok" if not complaints else "; ".join(complaints)
        rows.append(f"{case.name:32} {seconds:7.1f} {str(code):>5}  {verdict}")
        print(rows[-1], flush=True)
        bad += bool(complaints)
    if bad:
        print(f"{bad} of {len(chosen)} cases ended in another way than documented")
    return 1 if bad or not chosen else 0


if __name__ == "__main__":
    sys.exit(main())
