#!/usr/bin/python3
"""Run the cases of other solids and compare their curves with each other, with solid_fe and with the exact solutions.

Example: swap_solids.py --build build/release plate getfem

plate   a plate on springs in C, Fortran and Python under water: the three curves differ by no bit, because all do the same
        sums in the same order on the same machine; 1e-12 leaves room for another compiler's fused operations. The case's
        own tolerances (displacement 2 %, period 0.5 %) must hold.
force   the plate at level A: within the case's own tolerances; refused where the added mass ratio is above one (the fluid's interface
        nodes carry 16.3 kg/m2 in the worst mode, against a plate of 13), and where scheme and level do not fit.
getfem  the elastic column with GetFEM and with solid_fe: with the same windows the same algorithm in another code, equal up
        to the amplified round-off of 500 steps (1e-8); with windows of their own apart by O(dt^2) (1e-3).
"""
import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "scripts"))
from lib.compare import read_csv  # noqa: E402

bad = []


def expect(value, limit, claim):
    print(f"{'ok  ' if value <= limit else 'FAIL'} {value:.3e} <= {limit:.0e}: {claim}", flush=True)
    if not value <= limit:
        bad.append(claim)


def start(build, case, out, *options):
    """The finished process of one run."""
    command = [sys.executable, str(ROOT / "scripts" / "run_case.py"), case, "--out", str(out), "--no-plots", "--build", build, *options]
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def run(build, case, out, *options):
    """History of the interface and the summary of one run."""
    done = start(build, case, out, *options)
    if done.returncode != 0:
        print(done.stdout)
        sys.exit(f"error: {case} {' '.join(options)} ended with {done.returncode}")
    return read_csv(out / "history" / "interface.csv"), json.loads((out / "summary.json").read_text())


def distance(a, b):
    """Largest difference of two displacement histories over the largest value, at the times of the first."""
    other = np.interp(a["t[s]"], b["t[s]"], b["u_y[m]"])
    return float(np.max(np.abs(a["u_y[m]"] - other)) / np.max(np.abs(other)))


def expect_comparisons(summary, who):
    for c in summary["comparisons"]:
        expect(c["error"], c["tolerance"], f"{who}: {c['name']} against the exact solution ({c['measure']})")


def plate(build, folder):
    curves = {}
    for language, program in {"C": '["plate_c"]', "Fortran": '["plate_fortran"]', "Python": '["python3", "plate.py"]'}.items():
        if language == "Fortran" and not (Path(build) / "bin" / "plate_fortran").is_file():
            print("skip: plate_fortran was not built, there is no Fortran compiler")
            continue
        curves[language], summary = run(build, "swap_plate", folder / language, "--set", f"solid.program={program}")
        expect_comparisons(summary, f"plate in {language}")
    for language, curve in curves.items():
        expect(distance(curve, curves["C"]), 1e-12, f"plate in {language} = plate in C")


def force(build, folder):
    staggered = ["--set", "coupling.scheme=staggered"]

    def program(mass):
        return ["--set", f'solid.program=["python3","plate_force.py","--mass","{mass}"]']
    _, summary = run(build, "swap_plate", folder / "force", *staggered, *program(1000))
    expect_comparisons(summary, "plate that takes forces")
    heavy, _ = run(build, "swap_plate", folder / "light", *staggered, *program(20), "--until", "0.01")
    expect(float(np.max(np.abs(heavy["u_y[m]"]))), 3e-5, "added mass ratio 0.81: bounded by twice the static displacement")
    rigid, summary = run(build, "swap_plate", folder / "rigid", *staggered, "--set", 'solid.program=["python3","rigid_body.py"]')
    expect_comparisons(summary, "rigid body that takes forces")
    # Symmetric but for the fluid's mesh: what it pitches moves its ends by less than the error of the displacement allowed above.
    ends = 0.05 * float(np.max(np.abs(rigid["angle[rad]"]))) / float(np.max(np.abs(rigid["u_y[m]"])))
    expect(ends, 0.02, "rigid body: pitch of the symmetric problem, at its ends over its heave")
    for options, code, words in ((staggered + program(13), 2, "1.25 times the solid's"),
                                 (program(1000), 2, 'write coupling.scheme = "staggered"'),
                                 (staggered, 2, 'write coupling.scheme = "gc"')):
        done = start(build, "swap_plate", folder / "refused", *options)
        expect(abs(done.returncode - code) + (words not in done.stdout), 0, f"refused with code {code} and the words: {words}")


def getfem(build, folder):
    if subprocess.run(["/usr/bin/python3", "-c", "import getfem"], stderr=subprocess.DEVNULL).returncode != 0:
        print("skip: python3-getfem is not installed")
        return
    ours = ["--set", "solid.program=[]"]
    equal_windows = ["--set", "coupling.dt_max=4e-4", "--until", "0.2"]
    a, _ = run(build, "swap_getfem_column", folder / "getfem_equal", *equal_windows)
    b, _ = run(build, "swap_getfem_column", folder / "ours_equal", *equal_windows, *ours)
    expect(float(np.max(np.abs(a["t[s]"] - b["t[s]"]))), 1e-12, "GetFEM and solid_fe take the same windows")
    expect(distance(a, b), 1e-8, "GetFEM = solid_fe with the same windows")
    a, summary = run(build, "swap_getfem_column", folder / "getfem")
    b, _ = run(build, "swap_getfem_column", folder / "ours", *ours)
    expect(distance(a, b), 1e-3, "GetFEM = solid_fe, each with its own stable step")
    expect_comparisons(summary, "GetFEM")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default="build/release", help="build folder")
    parser.add_argument("what", nargs="+", choices=["plate", "force", "getfem"])
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="undine_swap_") as folder:
        for what in arguments.what:
            globals()[what](str(Path(arguments.build).resolve()), Path(folder))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
