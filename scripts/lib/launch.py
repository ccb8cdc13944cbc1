"""Starts cases as scripts/run does, for scripts and tests that measure and compare; what an mpirun line of many programs on few cores needs."""
import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SHARE_CORES = ["--oversubscribe", "--bind-to", "none", "--mca", "mpi_yield_when_idle", "1"]
MPIRUN = ["mpirun", *SHARE_CORES]
ENVIRONMENT = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")


def settings(values):
    """--set for each of {"table.key": value}."""
    return [word for key, value in values.items() for word in ("--set", f"{key}={value}")]


def start(case, out, *options):
    """The finished process of one run, without plots; what the programs said is its stdout."""
    command = ["/usr/bin/python3", "-B", str(ROOT / "scripts" / "run_case.py"), str(case), "--out", str(out), "--no-plots", *options]
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def run(case, out, *options):
    """The summary of one run. Ends this program if the run ended with an error."""
    done = start(case, out, *options)
    if done.returncode:
        sys.exit(f"{done.stdout}\nerror: {case} {' '.join(options)} ended with {done.returncode}")
    return json.loads((Path(out) / "summary.json").read_text())
