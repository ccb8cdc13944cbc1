#!/usr/bin/python3
"""Play the fake coupler to one of our clients; the actor without physics must be caught.

Example: conform_test.py --build build/release plate_python
"""
import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent


def command(client, build, out):
    """(options of undine-conform, command of the client, rules that it must break)."""
    column, getfem = ROOT / "cases" / "elastic_column" / "case.toml", ROOT / "cases" / "swap_getfem_column"
    dolfinx = ROOT / "cases" / "swap_dolfinx_column"
    coarse = ["--set", "run.resolution=10"]
    return {
        "plate_c": ([], [build / "bin" / "plate_c", "case.toml", "--out", out], 0),
        "plate_fortran": ([], [build / "bin" / "plate_fortran", "case.toml", "--out", out], 0),
        "plate_python": ([], ["/usr/bin/python3", ROOT / "cases" / "swap_plate" / "plate.py", "case.toml", "--out", out], 0),
        "plate_ranks": (["--ranks", "3"],
                        ["/usr/bin/python3", ROOT / "cases" / "swap_plate" / "plate_ranks.py", "case.toml", "--out", out], 0),
        "plate_force": ([], ["/usr/bin/python3", ROOT / "cases" / "swap_plate" / "plate_force.py", "case.toml", "--out", out], 0),
        # its nodes do not move alone: the two rules that compare the answer to a nodal force with the node's mass
        "rigid_body": ([], ["/usr/bin/python3", ROOT / "cases" / "swap_plate" / "rigid_body.py", "case.toml", "--out", out], 2),
        "getfem": ([], ["/usr/bin/python3", getfem / "getfem_solid.py", getfem / "case.toml", "--out", out], 0),
        "dolfinx": ([], ["/usr/bin/python3", dolfinx / "dolfinx_solid.py", dolfinx / "case.toml", "--out", out], 0),
        "solid_fe": (["--stall", "3"],
                     [build / "bin" / "solid_fe", column, "--out", out, *coarse, "--set", "coupling.stall_timeout=3"], 0),
        "fluid_pfem": (["--role", "fluid", "--stall", "3"],
                       [build / "bin" / "fluid_pfem", column, "--out", out, *coarse, "--set", "coupling.stall_timeout=3"], 0),
        "solid_fe_ranks": (["--ranks", "2", "--stall", "3"],
                           [build / "bin" / "solid_fe", column, "--out", out, *coarse, "--set", "coupling.stall_timeout=3"], 0),
        # fine enough for wet nodes on rank 0: it is its messages that are wrong ones
        "fluid_pfem_ranks": (["--role", "fluid", "--ranks", "2", "--stall", "3"],
                             [build / "bin" / "fluid_pfem", column, "--out", out, "--set", "run.resolution=32", "--set", "coupling.stall_timeout=3"], 0),
        # answers to no force: the three rules of physics
        "actor": (["--interface", "line"], [build / "tests" / "link_actor", "--role=solid"], 3),
    }[client]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", required=True)
    parser.add_argument("client")
    arguments = parser.parse_args()
    build = Path(arguments.build).resolve()
    with tempfile.TemporaryDirectory(prefix="undine_conform_test_") as out:
        (Path(out) / "history").mkdir()
        options, words, must_break = command(arguments.client, build, out)
        if arguments.client == "plate_fortran" and not words[0].is_file():
            print("skip: there is no Fortran compiler")
            return 77
        if arguments.client in ("getfem", "dolfinx") and subprocess.run(
                ["/usr/bin/python3", "-c", f"import {arguments.client}"], stderr=subprocess.DEVNULL).returncode != 0:
            print(f"skip: there is no {arguments.client} here")
            return 77
        # The limit catches a program that hangs; on a full machine MPI alone has taken more than 15 s to start one.
        line = [str(w) for w in [build / "bin" / "undine-conform", "--limit", "60", *options, "--", *words]]
        print(" ".join(line), flush=True)
        done = subprocess.run(line, env=dict(os.environ, PYTHONPATH=str(build / "lib")), stdout=subprocess.PIPE, text=True)
    print(done.stdout)
    broken = re.search(r"(\d+) rules kept, (\d+) broken", done.stdout)
    if not broken or int(broken[2]) != must_break or int(broken[1]) < 35 or done.returncode != (1 if must_break else 0):
        print(f"error: expected {must_break} broken rules and at least 35 kept ones")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
