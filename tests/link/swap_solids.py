#!/usr/bin/python3
"""Run the cases of other solids and compare their curves with each other, with solid_fe and with the exact solutions.

Example: swap_solids.py --build build/release plate getfem
         swap_solids.py --build build/release --picture docs/pictures/foreign_solids.png     (minutes; needs GetFEM and FEniCSx)

plate   a plate on springs in C, Fortran and Python under water: the three curves differ by no bit, because all do the same
        sums in the same order on the same machine; 1e-12 leaves room for another compiler's fused operations. The case's
        own tolerances (displacement 2 %, period 0.5 %) must hold.
force   the plate at level A: within the case's own tolerances; refused where the added mass ratio is above one (the fluid's interface
        nodes carry 16.3 kg/m2 in the worst mode, against a plate of 13), and where scheme and level do not fit.
user    the same at level A by the user subroutines of an explicit code, called by a stub of that code; the case's tolerances.
getfem  the elastic column with GetFEM and with solid_fe: with the same windows the same algorithm in another code, equal up
        to the amplified round-off of 500 steps (1e-8); with windows of their own apart by O(dt^2) (1e-3).
dolfinx the same with FEniCSx, also on two ranks.
gate    the elastic gate with GetFEM and with solid_fe, contact that opens and closes, 500 equal steps: equal up to round-off
        that contact and remeshing amplify (1e-6).
gate_peak  the same until after the peak, 0.2 s, 20000 equal steps. Water that contact and remeshes sort anew forgets: two runs of solid_fe
        alone, with E (1 ± 1e-12), show how fast. As long as these twins are apart by less than 1e-3 of the peak, so are GetFEM and
        solid_fe; afterwards they are apart by no more than twice the twins (largest difference up to then; four draws of the same
        scatter). Seen: 1.1e-4 until 0.068 s, 0.8 % at the end, the twins 3.3 %.
"""
import argparse
import functools
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "scripts"))
from lib import launch  # noqa: E402
from lib.compare import read_csv  # noqa: E402

bad = []


def expect(value, limit, claim):
    print(f"{'ok  ' if value <= limit else 'FAIL'} {value:.3e} <= {limit:.0e}: {claim}", flush=True)
    if not value <= limit:
        bad.append(claim)


def start(build, case, out, *options):
    """The finished process of one run."""
    return launch.start(case, out, "--build", build, *options)


def run(build, case, out, *options):
    """History of the interface and the summary of one run."""
    summary = launch.run(case, out, "--build", build, *options)
    return read_csv(out / "history" / "interface.csv"), summary


def distance(a, b, what="u_y[m]"):
    """Largest difference of two displacement histories over the largest value, at the times of the first."""
    other = np.interp(a["t[s]"], b["t[s]"], b[what])
    return float(np.max(np.abs(a[what] - other)) / np.max(np.abs(other)))


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
    for ranks in (2, 3):  # each rank talks of its own nodes; the same sums in the same order
        curve, _ = run(build, "swap_plate", folder / f"ranks_{ranks}", "--until", "0.005", "--ranks", f"solid={ranks}",
                       "--set", 'solid.program=["python3","plate_ranks.py"]')
        whole = {name: column[:len(curve["t[s]"])] for name, column in curves["Python"].items()}
        expect(float(np.max(np.abs(curve["u_y[m]"][:-1] - whole["u_y[m]"][:-1]))), 0.0,
               f"plate in Python on {ranks} ranks = on one, to the bit (the last window is cut by the end of the run)")


    # --check starts all three for one window and lets the coupler integrate the interface
    done = start(build, "swap_plate", folder / "check", "--check")
    words = "fluid side 0.1 m covered 1, solid side 0.1 m covered 1, largest gap 0 m"
    expect(done.returncode + (words not in done.stdout), 0, f"--check with a foreign solid: {words}")
    turned = folder / "turned.py"
    text = (ROOT / "cases" / "swap_plate" / "plate.py").read_text()
    expect(int("[[n, n - 1] for" not in text), 0, "the plate's faces are where this test turns them")
    turned.write_text(text.replace("[[n, n - 1] for", "[[n - 1, n] for"))
    done = start(build, "swap_plate", folder / "check", "--check", "--set", f'solid.program=["python3","{turned}"]')
    expect(abs(done.returncode - 20) + ("outward normals" not in done.stdout), 0, "--check notices a surface whose normals are turned")


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


OURS = ["--set", "solid.program=[]"]


def is_here(module):
    found = subprocess.run(["/usr/bin/python3", "-c", f"import {module}"], stderr=subprocess.DEVNULL).returncode == 0
    if not found:
        print(f"skip: there is no {module} here")
    return found


def column(build, folder, case, name, ranks=()):
    """The elastic column with another finite element code and with solid_fe on the same mesh."""
    equal_windows = ["--set", "coupling.dt_max=4e-4", "--until", "0.2"]
    b, _ = run(build, case, folder / "ours_equal", *equal_windows, *OURS)
    for options in ([], *ranks):
        a, _ = run(build, case, folder / "theirs_equal", *equal_windows, *options)
        same = b["t[s]"][:len(a["t[s]"])]  # on several ranks it takes long on few cores, and ends earlier
        expect(float(np.max(np.abs(a["t[s]"] - same))), 1e-12, f"{name} and solid_fe take the same windows")
        expect(distance(a, b), 1e-8, f"{name} = solid_fe with the same windows {' '.join(options)}")
    a, summary = run(build, case, folder / "theirs")
    b, _ = run(build, case, folder / "ours", *OURS)
    expect(distance(a, b), 1e-3, f"{name} = solid_fe, each with its own stable step")
    expect_comparisons(summary, name)


def getfem(build, folder):
    if is_here("getfem"):
        column(build, folder, "swap_getfem_column", "GetFEM")


def dolfinx(build, folder):
    if is_here("dolfinx"):
        column(build, folder, "swap_dolfinx_column", "FEniCSx", ranks=[["--ranks", "solid=2", "--until", "0.04"]])


def tips(build, folder, *options):
    """Histories of the gate's free end with GetFEM and with solid_fe."""
    for name, more in (("theirs", []), ("ours", OURS)):
        done = start(build, "swap_getfem_gate", folder / name, *options, *more)
        if done.returncode != 0:
            print(done.stdout)
            sys.exit(f"error: swap_getfem_gate {' '.join(options)} ended with {done.returncode}")
        yield read_csv(folder / name / "history" / "tip.csv")


def gate(build, folder):
    if is_here("getfem"):
        a, b = tips(build, folder, "--set", "coupling.dt_max=1e-5", "--until", "0.005")
        expect(float(np.max(np.abs(a["t[s]"] - b["t[s]"]))), 1e-8, "GetFEM and solid_fe take the same steps")
        expect(distance(a, b, "u_x[m]"), 1e-6, "gate in contact: GetFEM = solid_fe with the same steps")


@functools.cache
def equal_gates(build, folder):
    """Gate until after its peak, all with the same steps: GetFEM, solid_fe, and twins of solid_fe whose E differs by 1e-12 of it."""
    equal = ["--set", "coupling.dt_max=1e-5"]
    theirs, ours = tips(build, folder, *equal)
    twins = []
    for k, factor in enumerate((1 + 1e-12, 1 - 1e-12)):
        done = start(build, "swap_getfem_gate", folder / f"twin_{k}", *equal, *OURS, "--set", f"solid.youngs_modulus={1.2e7 * factor!r}")
        if done.returncode != 0:
            sys.exit(f"error: the twin of swap_getfem_gate ended with {done.returncode}\n{done.stdout}")
        twins.append(read_csv(folder / f"twin_{k}" / "history" / "tip.csv"))
    return theirs, ours, twins


def apart(a, b, what="u_x[m]"):
    """Difference of two histories over the largest value of the second, at its times, and the largest until then."""
    difference = np.abs(np.interp(b["t[s]"], a["t[s]"], a[what]) - b[what]) / np.max(np.abs(b[what]))
    return difference, np.maximum.accumulate(difference)


def gate_peak(build, folder):
    if is_here("getfem"):
        theirs, ours, twins = equal_gates(build, folder)
        _, of_getfem = apart(theirs, ours)
        spread = np.max([*(apart(twin, ours)[1] for twin in twins), apart(*twins)[1]], axis=0)
        knows = int(np.argmax(spread > 1e-3)) or len(spread) - 1  # rows that the twins agree on
        expect(of_getfem[knows - 1], 1e-3, f"gate in contact: GetFEM = solid_fe until the problem forgets, t = {ours['t[s]'][knows]:.3f} s (twins apart by 1e-3)")
        expect(of_getfem[-1] / spread[-1], 2.0, f"... and apart by no more than twice the twins afterwards, {of_getfem[-1]:.2e} and {spread[-1]:.2e} of the peak")
        peaks = [float(np.max(history["u_x[m]"])) for history in (theirs, ours, *twins)]
        print(f"     peaks: GetFEM {peaks[0]:.5f}, solid_fe {peaks[1]:.5f}, twins {peaks[2]:.5f}, {peaks[3]:.5f} m", flush=True)


def user(build, folder):
    if not (Path(build) / "bin" / "product_stub").is_file():
        print("skip: product_stub was not built, there is no Fortran compiler")
        return
    _, summary = run(build, "swap_plate", folder / "user", "--set", "coupling.scheme=staggered", "--set", 'solid.program=["product_stub"]')
    expect_comparisons(summary, "user subroutines under a stub")


def picture(build, folder, path):
    """The curves of GetFEM and FEniCSx over those of solid_fe, and their differences, each solid with its own step."""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    ours, _ = run(build, "swap_getfem_column", folder / "ours", *OURS)
    column = {"GetFEM": run(build, "swap_getfem_column", folder / "getfem")[0], "FEniCSx": run(build, "swap_dolfinx_column", folder / "dolfinx")[0]}
    theirs, tip, twins = equal_gates(build, folder / "gate")
    figure, axes = plt.subplots(2, 2, figsize=(10, 5), dpi=90, sharex="col", height_ratios=(2, 1), constrained_layout=True)
    for axis, title, what, base, others in ((axes[:, 0], "elastic column: displacement of the interface", "u_y[m]", ours, column),
                                            (axes[:, 1], "elastic gate in contact: displacement of its free end", "u_x[m]", tip, {"GetFEM": theirs})):
        axis[0].plot(base["t[s]"], 1e3 * base[what], color="0.7", linewidth=4, label="solid_fe")
        for style, (name, curve) in zip(("-", "--"), others.items()):
            axis[0].plot(curve["t[s]"], 1e3 * curve[what], style, linewidth=1.2, label=name)
        axis[0].set(title=title, ylabel="mm")
    for style, (name, curve) in zip(("-", "--"), column.items()):
        axes[1, 0].plot(curve["t[s]"], 1e6 * (curve["u_y[m]"] - np.interp(curve["t[s]"], ours["t[s]"], ours["u_y[m]"])), style, linewidth=1.0, label=name)
    axes[1, 0].set(xlabel="t [s]", ylabel="less solid_fe [µm]")
    for k, twin in enumerate(twins):
        axes[1, 1].semilogy(tip["t[s]"], np.maximum(apart(twin, tip)[0], 1e-16), color="0.7", linewidth=1.2, label=None if k else "solid_fe, E(1 ± 10⁻¹²)")
    axes[1, 1].semilogy(tip["t[s]"], np.maximum(apart(theirs, tip)[0], 1e-16), color="C0", linewidth=1.0, label="GetFEM")
    axes[1, 1].set(xlabel="t [s]", ylabel="apart, of the peak", ylim=(1e-16, 1))
    for axis in (axes[0, 0], axes[0, 1], axes[1, 1]):
        axis.legend(frameon=False, fontsize=8)
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    figure.savefig(path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default="build/release", help="build folder")
    parser.add_argument("--picture", metavar="FILE", help="draw the curves of GetFEM and FEniCSx over ours")
    checks = ["plate", "force", "user", "getfem", "dolfinx", "gate", "gate_peak"]
    parser.add_argument("what", nargs="*", metavar="what", help=" ".join(checks))
    arguments = parser.parse_args()
    if unknown := set(arguments.what) - set(checks):
        parser.error(f"no such comparison: {' '.join(unknown)}; choose from {' '.join(checks)}")
    build = str(Path(arguments.build).resolve())
    with tempfile.TemporaryDirectory(prefix="undine_swap_") as folder:
        for what in arguments.what:
            globals()[what](build, Path(folder))
        if arguments.picture:
            picture(build, Path(folder), arguments.picture)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
