#!/usr/bin/python3
"""Run a case: build the mpirun line, run it, compare with the references, draw plots, write summary.json.

    scripts/run cases/elastic_column --set run.resolution=20 --out runs/coarse
"""
import argparse
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from lib import advise  # noqa: E402
from lib import case as case_file  # noqa: E402
from lib import compare, launch  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent  # of the source tree, or share/undine of an installed one
INSTALLED = not (ROOT / "CMakeLists.txt").exists()


def places(build):
    """Folders of the programs, and of the protocol library for solvers in Python."""
    prefix = ROOT.parent.parent
    if not INSTALLED:  # a folder, or the name of a preset
        folder = Path(build).resolve() if (Path(build) / "bin").is_dir() else ROOT / "build" / build
        return folder / "bin", folder / "lib"
    return prefix / "libexec" / "undine", next(iter(prefix.glob("lib*/**/undine_link.py")), prefix / "lib").parent


def parse_arguments():
    p = argparse.ArgumentParser(prog=os.environ.get("UNDINE_COMMAND", "scripts/run"), description="Run a case of Undine, draw its plots, print a summary.",
                                epilog="example: scripts/run cases/elastic_column --set run.resolution=20")
    p.add_argument("case", help="folder under cases/, or a case.toml")
    p.add_argument("--out", help="output folder (default: runs/<case>)")
    p.add_argument("--ranks", default="", metavar="fluid=N,solid=M,coupler=K", help="MPI ranks of each program (default 1)")
    p.add_argument("--set", action="append", default=[], metavar="table.key=value", help="override a key of the case (repeatable)")
    p.add_argument("--until", metavar="T", help="end time in seconds instead of run.t_end")
    p.add_argument("--restart", metavar="latest|ID", help="continue from a checkpoint of the output folder")
    p.add_argument("--check", action="store_true", help="read and validate everything, estimate, do not run")
    p.add_argument("--no-plots", action="store_true", help="no PNG files")
    p.add_argument("--verbose", action="store_true", help="programs say more in their logs")
    p.add_argument("--build", default="release", help=argparse.SUPPRESS)
    return p.parse_args()


def stop(code, text):
    """End with a mistake of the user."""
    print(f"error: {text}", file=sys.stderr)
    sys.exit(code)


def find_case(name):
    path = Path(name)
    for candidate in (path, path / "case.toml", ROOT / "cases" / name / "case.toml", ROOT / name / "case.toml"):
        if candidate.is_file():
            return candidate
    known = sorted(p.parent.name for p in (ROOT / "cases").glob("*/case.toml"))
    stop(4, f"no case '{name}': neither a case.toml, nor a folder with one. Cases here: {' '.join(known)}")


def ranks_of(text, programs):
    ranks = {p: 1 for p in programs}
    for part in filter(None, text.split(",")):
        name, _, number = part.partition("=")
        if name not in ranks or not number.isdigit() or int(number) < 1:
            stop(2, f"--ranks {part}: write program=number with a program of this case ({', '.join(programs)})")
        ranks[name] = int(number)
    return ranks


def foreign_command(words, case, binaries):
    """Command of a program that a case names itself, such as ["python3", "my_solid.py"]: the words that are files beside the
    case, and a first word that is one of our binaries, become paths; the rest is looked up as usual."""
    if not (isinstance(words, list) and all(isinstance(w, str) for w in words)):
        stop(2, f"{case}: solid.program = {words}: write a list of words, such as [\"python3\", \"my_solid.py\"]")
    folder = case.resolve().parent
    command = [str(folder / word) if (folder / word).is_file() else word for word in words]
    if command[0] == "python3":
        command[0] = "/usr/bin/python3"  # Debian's, which has mpi4py
    elif (binaries / command[0]).is_file():
        command[0] = str(binaries / command[0])
    elif shutil.which(command[0]) is None:
        stop(2, f"{case}: solid.program = {words}: '{words[0]}' is neither beside the case, nor in {binaries}, nor in PATH")
    return command


def mpirun_line(args, case, settings, programs, ranks, out):
    """The command line, as a list. One program on one rank needs no mpirun."""
    binaries, _ = places(args.build)
    parts = case_file.parts(settings)
    executable = {"coupler": "coupler", "fluid": "fluid_pfem"}
    commands = {p: [str(binaries / executable.get(p, "solid_fe"))] for p in programs}
    foreign = [p for p in parts if parts[p].get("program")]
    for p in programs:
        if p not in foreign and not Path(commands[p][0]).is_file():
            stop(2, f"there is no {commands[p][0]}: scripts/run builds it" + (f", or name another build folder than --build {args.build}" if args.build != "release" else ""))
    for p in foreign:
        commands[p] = foreign_command(parts[p]["program"], case, binaries)
    for p in programs if isinstance(settings.get("solid"), list) else ():
        if p not in executable:
            commands[p] += ["--name", p]
    common = [str(case), "--out", str(out)]
    for override in args.set:
        common += ["--set", override]
    if args.until:
        common += ["--until", args.until]
    if args.restart:
        common += ["--restart", args.restart]
    if sys.stderr.isatty():  # mpirun hides the terminal from the programs
        common += ["--progress", "1"]
    common += ["--check"] * args.check + ["--verbose"] * args.verbose
    lines = [commands[p] + common for p in programs]
    if args.check:
        return [commands[p] + common for p in programs if p not in foreign]
    if len(programs) == 1 and ranks[programs[0]] == 1:
        return [lines[0]]
    line = ["mpirun"]
    if sum(ranks.values()) > (os.cpu_count() or 1):
        line += launch.SHARE_CORES
    for k, (p, command) in enumerate(zip(programs, lines)):
        line += ([":"] if k else []) + ["-n", str(ranks[p])] + command
    return [line]


def run_and_listen(line, environment):
    """Run `line`; pass on its stderr and keep the end of it. Returns the exit code as a shell counts, and that text."""
    process = subprocess.Popen(line, env=environment, stderr=subprocess.PIPE)
    for number in (signal.SIGUSR1, signal.SIGTERM):  # mpirun hands SIGUSR1 to the programs, which stop in order
        signal.signal(number, lambda *_: process.send_signal(signal.SIGUSR1))
    heard = b""
    try:
        while chunk := os.read(process.stderr.fileno(), 65536):
            sys.stderr.buffer.write(chunk)
            sys.stderr.buffer.flush()
            heard = (heard + chunk)[-65536:]
    except KeyboardInterrupt:  # mpirun hears it too, and ends its programs
        pass
    code = process.wait()
    return (128 - code if code < 0 else code), heard.decode(errors="replace")


def killed_program(text, ranks):
    """(role, world rank, signal) of the program that a signal ended, as mpirun reports it; None if none was."""
    found = re.search(r"process rank (\d+) .*exited on signal (\d+)", text)
    if not found:
        return None
    rank, number = int(found[1]), int(found[2])
    roles = [program for program, count in ranks.items() for _ in range(count)]
    return (roles[rank] if rank < len(roles) else "?"), rank, number


def signal_name(number):
    try:
        return signal.Signals(number).name
    except ValueError:
        return "unknown"


def report_killed(out, code, killed):
    """A killed program cannot say so itself: print it, and leave FAILED.toml."""
    role, rank, number = killed
    text = f"'{role}' (world rank {rank}) was ended by signal {number} ({signal_name(number)})"
    print(f"error: {text}", file=sys.stderr)
    if number == signal.SIGKILL:
        print("       somebody killed it, or the machine ran out of memory (see dmesg).", file=sys.stderr)
    if not (out / "FAILED.toml").exists():
        (out / "FAILED.toml").write_text(f'# Why the run ended.\ncode = {code}\nprogram = "{role}"\nrank = {rank}\ntext = "{text}"\n')


def check_all(lines, settings, environment):
    """Run each program with --check, all at once. What several of them say is printed once; the descriptions only if all is well. Returns the exit code."""
    started = [subprocess.Popen(line, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for line in lines]
    results = [(process, *process.communicate()) for process in started]
    code = next((process.returncode for process, _, _ in results if process.returncode), 0)
    said = dict.fromkeys(error for _, _, error in results if error)
    sys.stderr.write("".join(said))
    if code:
        return code if code in (2, 4) else 20
    def role(line):
        return {"fluid_pfem": "fluid", "solid_fe": line[line.index("--name") + 1] if "--name" in line else "solid"}.get(Path(line[0]).name)

    errors, advice, estimate = advise.review(settings, {role(line): out for line, (_, out, _) in zip(lines, results) if role(line)})
    for text in errors:
        print(f"error: {text}", file=sys.stderr)
    if errors:
        return 20
    print("".join(out for _, out, _ in results) + "\n".join(estimate))
    for text in advice:
        print(f"advice: {text}")
    return 0


def check_meeting(args, case, settings, programs, ranks, environment):
    """Start all programs for one window of next to no time, in a folder of its own: they must find each other, and the coupler integrates
    the interfaces at t = 0; what it says about their overlap and gap is printed (not where contact opens and closes). Returns the exit code."""
    if "coupler" not in programs:
        return 0
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="undine_meet_") as out:
        (Path(out) / "history").mkdir()
        start = argparse.Namespace(**{**vars(args), "check": False, "restart": None, "until": f"{1e-12 * float(settings['run']['t_end']):.3g}"})
        line = mpirun_line(start, case, settings, programs, ranks, out)[0]
        result = subprocess.run(line, env=environment, capture_output=True, text=True)
        log = Path(out) / "coupler.log"
        contact = {interface["name"] for interface in settings.get("interface", []) if interface.get("separation")}
        said = [text for text, name in re.findall(r"info: (interface '(.*?)': .*)", log.read_text()) if name not in contact] if log.is_file() else []
    if result.returncode != 0:
        errors = [text for text in result.stderr.split("\n") if text.startswith(("error: ", "       "))]
        print("\n".join(errors) or result.stderr, file=sys.stderr)
        return 20
    print("\n".join([f"met: {len(programs)} programs, one window, in {time.monotonic() - begin:.1f} s", *said]))
    return 0


def check_foreign(args, case, settings, programs, environment):
    """HELLO, MESH and an orderly run of each foreign program, by undine-conform. Returns the exit code."""
    binaries, _ = places(args.build)
    code = 0
    parts = case_file.parts(settings)
    for program in (p for p in programs if p != "coupler" and parts[p].get("program")):
        command = foreign_command(parts[program]["program"], case, binaries)
        with tempfile.TemporaryDirectory(prefix="undine_check_") as out:
            (Path(out) / "history").mkdir()
            line = [str(binaries / "undine-conform"), "--role", program, "--dim", str(settings["run"].get("dimension", 2)), "--only", "rest"]
            for interface in settings.get("interface", []):
                if program in ("fluid", interface.get("body", program)):
                    line += ["--interface", interface["name"]]
            line += ["--", *command, str(case), "--out", out, *(word for override in args.set for word in ("--set", override))]
            result = subprocess.run(line, env=environment, capture_output=True, text=True)
        rules = re.findall(r"^  (pass|FAIL)\s+\S+\s+(.*)$", result.stdout, re.MULTILINE)
        broken = [rule for verdict, rule in rules if verdict == "FAIL"]
        print(f"{program}: {' '.join(parts[program]['program'])}, a program of its own: hand-shake, surface and an orderly run keep "
              f"{len(rules) - len(broken)} of {len(rules)} rules of docs/protocol.md")
        for rule in broken:
            print(f"error: {program}: {rule}; see undine-conform", file=sys.stderr)
        if result.returncode != 0 or not rules:
            code = 20
            if not broken:
                sys.stderr.write(result.stdout + result.stderr)
    return code


def link_earlier(out):
    """Links to what an earlier run left in `out`, until this one is known to be a run at all."""
    earlier = out / ".earlier"
    shutil.rmtree(earlier, ignore_errors=True)
    earlier.mkdir()
    for path in out.iterdir():
        if path.suffix == ".json" or path.name in ("report.html", "view.py"):
            os.link(path, earlier / path.name)
        elif path.name in ("history", "plots", "checkpoints"):
            shutil.copytree(path, earlier / path.name, copy_function=os.link)
    return earlier


def bring_back(out, earlier):
    """After a mistake in the case: the folder as it was."""
    for path in earlier.iterdir():
        place = out / path.name
        shutil.rmtree(place) if place.is_dir() else place.unlink(missing_ok=True)
        path.rename(place)
    earlier.rmdir()


def collect_summary(out, programs, code, wall):
    """summary.json out of what each program left behind."""
    status = {0: "completed", 3: "stopped"}.get(code, "failed")
    summary = {"status": status, "exit_code": code, "t_end": None, "wall_s": wall, "windows": 0, "substeps": 1, "conservation": {}}
    mass_drifts = []
    for program in programs:
        path = out / f"{program}.json"
        part = json.loads(path.read_text()) if path.is_file() else {}
        own = part.pop(program, None)
        if own is None:  # a program that writes its own keys at the top
            own, part = part, {key: part[key] for key in ("status", "t_end") if key in part and len(programs) == 1}
        if program == "coupler" or len(programs) == 1:
            summary["conservation"].update(part.pop("conservation", own.pop("conservation", {})))
            summary.update({key: value for key, value in part.items() if key not in ("exit_code", "wall_s", "status")})
            if code == 0 and part.get("status") == "stopped":
                summary["status"] = "stopped"
            if len(programs) == 1:
                for key in ("energy_drift", "energy_drift_definition"):
                    if key in own:
                        summary["conservation"][key] = own[key]
                summary["t_end"] = summary["t_end"] if summary["t_end"] is not None else own.get("t_end")
        if "compute_s" in own and "wait_s" in own:
            own.setdefault("wall_s", own["compute_s"] + own["wait_s"])
        summary[program] = {key: value for key, value in own.items() if key not in ("status", "exit_code")}
        if "mass_drift" in own:
            mass_drifts.append(own["mass_drift"])
    if mass_drifts:
        summary["conservation"]["mass_drift"] = max(mass_drifts, key=abs)
        summary["conservation"]["mass_drift_definition"] = "change of the mass of the fluid or the solid over its mass at the start, the larger one"
    return summary


def main():
    args = parse_arguments()
    case = find_case(args.case)
    out = Path(args.out) if args.out else (Path() if INSTALLED else ROOT) / "runs" / case.resolve().parent.name
    settings = case_file.load(case, args.set + ([f"run.t_end={args.until}"] if args.until else []))
    programs = ["coupler"] * ("coupling" in settings or "interface" in settings) + list(case_file.parts(settings))
    if not programs:
        stop(2, f"{case}: the case has neither [fluid] nor [solid]: write at least one of these tables (docs/case-file.md)")
    if "schema" in settings and "fluid" in settings and "solid" in settings and "coupler" not in programs:
        stop(2, f"{case}: the case has [fluid] and [solid], but no [[interface]] between them: write one with name, fluid and solid")
    compare.check_references(case, settings)
    ranks = ranks_of(args.ranks, programs)
    environment = dict(launch.ENVIRONMENT)
    # where Python solvers find undine_link.py and the library
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [str(places(args.build)[1]), os.environ.get("PYTHONPATH")]))
    lines = mpirun_line(args, case, settings, programs, ranks, out)

    if args.check:
        code = check_all(lines, settings, environment) or check_foreign(args, case, settings, programs, environment) \
            or check_meeting(args, case, settings, programs, ranks, environment)
        if code == 0:
            would = argparse.Namespace(**{**vars(args), "check": False})
            print("would run: " + " ".join(mpirun_line(would, case, settings, programs, ranks, out)[0]))
        return code

    out.mkdir(parents=True, exist_ok=True)
    earlier = link_earlier(out)
    for old in list(out.glob("*.json")) + [out / "FAILED.toml", out / "report.html", out / "view.py"]:
        old.unlink(missing_ok=True)
    for old in ("plots",) if args.restart else ("history", "plots", "checkpoints"):
        shutil.rmtree(out / old, ignore_errors=True)
    (out / "history").mkdir(exist_ok=True)

    print(shlex.join(lines[0]), flush=True)
    begin = time.monotonic()
    code, heard = run_and_listen(lines[0], environment)
    if code in (2, 4) and any(earlier.iterdir()):
        bring_back(out, earlier)
        print(f"the results of the earlier run in {out} are kept", file=sys.stderr)
        return code
    shutil.rmtree(earlier)
    summary = collect_summary(out, programs, code, time.monotonic() - begin)
    summary["case"], summary["set"] = str(case.resolve()), args.set
    summary["comparisons"] = compare.compare_all(case, settings, out) if code == 0 else []
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    if code == 3:
        print(f"stopped on request; continue with --restart latest --out {out}", file=sys.stderr)
        return code
    if code != 0:
        if killed := killed_program(heard, ranks):
            report_killed(out, code, killed)
        elif code > 128:
            print(f"error: a program was ended by signal {code - 128} ({signal_name(code - 128)})", file=sys.stderr)
        failed = f" and {out}/FAILED.toml" if (out / "FAILED.toml").exists() else ""
        print(f"the run failed with exit code {code}; see {out}/*.log{failed}", file=sys.stderr)
        return code
    if not args.no_plots:
        from lib import plots, report
        plots.draw_all(case, settings, out)
        report.write(case, settings, out, summary, shlex.join(lines[0]))
    compare.print_table(summary, out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
