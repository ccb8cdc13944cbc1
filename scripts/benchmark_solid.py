#!/usr/bin/env python3
"""What the solid costs: time per element and step, error over computing time for each element, and CalculiX on the same mesh.

    scripts/benchmark solid [--parts speed stability error calculix] [--repeats 3]

speed     build/release/tests/solid_speed, with STREAM's triad in the same run  -> docs/benchmarks/solid_speed.md
stability build/release/tests/solid_stability, how sharp the step bound is      -> docs/benchmarks/solid_stability.md
error     a wave in a bar and the elastica on three meshes per element          -> docs/benchmarks/solid_error.md, .png
calculix  a bar of C3D8 under a sudden pull, *DYNAMIC, EXPLICIT of ccx          -> docs/benchmarks/solid_calculix.md

Times are the program's own computing time (calculix: user time of the process), the least of the repeats. Quote ratios.
"""
import argparse
import json
import math
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
BIN = ROOT / "build" / "release"
DOCS = ROOT / "docs" / "benchmarks"
sys.path.insert(0, str(ROOT / "scripts"))
from lib.compare import read_csv  # noqa: E402

# name: element, formulation, hourglass stiffness (that of the bending of a square or cube), colour and marker
KINDS = {
    "T3": ("T3", "full", None), "Q4": ("Q4", "full", None), "Q4 B-bar": ("Q4", "locking_free", None), "Q4 one point": ("Q4", "one_point", 2 / 3),
    "beam": ("Q4", "beam", None), "Tet4": ("Tet4", "full", None), "Hex8": ("Hex8", "full", None), "Hex8 one point": ("Hex8", "one_point", 8 / 9),
}


def vector(values):
    return "[" + ", ".join(f"{v:.12g}" for v in values) + "]"


def case_text(name, kind, counts, size, material, traction, ramp, t_end, every):
    element, formulation, hourglass = KINDS[kind]
    dim = len(size)
    lines = ["schema = 1", "[run]", f'name = "{name}"', f"dimension = {dim}", f"t_end = {t_end}", "resolution = 1", "characteristic_length = 1.0", "[solid]"]
    lines += [f"{key} = {value}" for key, value in material.items()]
    lines += [f"{key} = {value:.12g}" for key, value in zip(("width", "height", "depth"), size)]
    lines += [f'element = "{element}"', f'formulation = "{formulation}"', f"elements = {vector(counts)}"]
    if hourglass:
        lines.append(f"hourglass_stiffness = {hourglass}")
    lines += ["[[solid.fix]]", 'on = "left"', "[[solid.traction]]", 'on = "right"', f"value = {vector(traction + [0.0] * (dim - 2))}", f"ramp = {ramp}",
              "[output]", "frames = false", f"every = {t_end}", f"history_every = {every}",
              "[[probe]]", 'name = "tip"', 'on = "solid"', 'surface = "right"', 'quantity = ["u"]']
    return "\n".join(lines) + "\n"


def run(folder, text, repeats):
    """Histories, summary, and the least computing time."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "case.toml").write_text(text)
    seconds = []
    for _ in range(repeats):
        done = subprocess.run([str(BIN / "bin" / "solid_fe"), str(folder / "case.toml"), "--out", str(folder)], capture_output=True, text=True)
        if done.returncode:
            sys.exit(text + done.stdout + done.stderr)
        summary = json.loads((folder / "solid.json").read_text())
        seconds.append(summary["compute_s"])
    return read_csv(folder / "history" / "tip.csv"), summary, min(seconds)


def wave(folder, kind, n, repeats):
    dim = 3 if KINDS[kind][0] in ("Tet4", "Hex8") else 2
    material = {"density": 7800.0, "youngs_modulus": 210e9, "poisson_ratio": 0.0, "law": '"linear"'}
    t_end = 1.54179852e-3
    table, summary, seconds = run(folder, case_text("wave", kind, [n] + [1] * (dim - 1), [1.0] + [1.0 / n] * (dim - 1), material, [1e6, 0.0], 0.0, t_end,
                                                    t_end / 400), repeats)
    exact = read_csv(ROOT / "cases" / "bar_wave" / "reference" / "s1_bar_step_load.csv")
    truth = np.interp(table["t[s]"], exact["t_s"], exact["u_tip_m"])
    return math.sqrt(np.sum((table["u_x[m]"] - truth) ** 2) / np.sum(truth ** 2)), summary, seconds


def elastica(folder, kind, n, repeats):
    dim = 3 if KINDS[kind][0] in ("Tet4", "Hex8") else 2
    h, across = 0.02, 1 if kind == "beam" else max(1, n // 50)
    material = {"density": 1000.0, "youngs_modulus": 1e6, "poisson_ratio": 0.0, "law": '"svk"', "mass_damping": 1.3}
    counts = [n, across] + [1] * (dim - 2)
    table, summary, seconds = run(folder, case_text("elastica", kind, counts, [1.0, h] + [h / across] * (dim - 2), material, [0.0, -200 / 3], 4.0, 24.0, 1.0),
                                  repeats)
    truth = (-0.1606417208, -0.4934574717)
    error = math.hypot(table["u_x[m]"][-1] - truth[0], table["u_y[m]"][-1] - truth[1]) / math.hypot(*truth)
    return error, summary, seconds


def errors(repeats):
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    problems = {
        "wave in a bar": (wave, {kind: (25, 50, 100) for kind in KINDS if kind != "beam"}),
        "elastica": (elastica, {kind: (5, 10, 20) if kind == "beam" else (25, 50, 100) if KINDS[kind][0] in ("Tet4", "Hex8") else (50, 100, 200) for kind in KINDS}),
    }
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.8), dpi=80)
    lines = ["# The solid: error over computing time", "",
             f"`scripts/benchmark solid --parts error`; one core, least of {repeats} runs, two threads of other work beside it: compare, do not quote. *error*: "
             "of the wave the relative L2 error of the tip's displacement over two periods (a step: order 1); of the elastica the distance of the tip from the exact one over its way, at "
             "P L²/EI = 2 (stretch and shear of the strip themselves are 2·10⁻⁴ of it). Meshes of the elastica are squares or cubes, 1, 2 and 4 across (25 along: half as high as long); beams 5, 10, 20.", "",
             "![error over time](solid_error.png)", ""]
    with tempfile.TemporaryDirectory() as name:
        for axis, (problem, (measure, meshes)) in zip(axes, problems.items()):
            lines += [f"## {problem[0].upper()}{problem[1:]}", "", "| element | along | elements | steps | error | order | computing [s] | ns per element and step |",
                      "| --- | --- | --- | --- | --- | --- | --- | --- |"]
            for kind, sizes in meshes.items():
                x, y = [], []
                for n in sizes:
                    error, summary, seconds = measure(Path(name) / f"{measure.__name__}_{kind}_{n}".replace(" ", "_"), kind, n, repeats)
                    order = f"{math.log2(y[-1] / error):.1f}" if y else ""
                    lines.append(f"| {kind if not y else ''} | {n} | {summary['elements']} | {summary['steps']} | {error:.2e} | {order} | {seconds:.3g} | "
                                 f"{1e9 * seconds / summary['steps'] / summary['elements']:.0f} |")
                    print(lines[-1], flush=True)
                    x.append(seconds)
                    y.append(error)
                axis.loglog(x, y, marker="osv^D<>P"[list(KINDS).index(kind)], color=f"C{list(KINDS).index(kind)}", label=kind, linewidth=1.2, markersize=5)
            lines.append("")
            axis.set(title=problem, xlabel="computing time [s]", ylabel="relative error")
            axis.grid(True, which="both", alpha=0.25)
    axes[1].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(DOCS / "solid_error.png")
    (DOCS / "solid_error.md").write_text("\n".join(lines))


def program(name, *arguments):
    done = subprocess.run([str(BIN / "tests" / name), *map(str, arguments)], capture_output=True, text=True, check=True)
    print(done.stdout, flush=True)
    return done.stdout


def speed(sizes):
    load = os.getloadavg()[0]
    lines = ["# The solid: time per element and step", "",
             "`scripts/benchmark solid --parts speed`: `build/release/tests/solid_speed`, whole steps (predict, forces, solve), one core, best of five times 20 steps; STREAM's triad in the same run. *bytes*: what a "
             "step has to read and write at least per element (geometry, node numbers, history twice, ten passes over the nodes' vectors), and *of the triad* that over the time, in bandwidths "
             "of the triad: near 1 means that memory is the limit. Aims: 20 ns for Q4 and 60 ns for Hex8, one point, `neo_hookean_ln`.", ""]
    for size in sizes:
        triad, *table = program("solid_speed", int(size)).strip().splitlines()
        lines += [f"## {size:.0e} elements".replace("e+0", "e"), "", f"{triad[0].upper()}{triad[1:]}.", "", *table, ""]
    lines += ["## Work that is left out", "", "ns per element and step of the whole solid, 1e5 elements, one point, two solids in turn, medians of nine. The answers are the same: `tests/solid_fe/skips_test.cpp`, "
              "`plasticity_test.cpp`.", "", *program("solid_speed", "--skips", 100000).strip().splitlines(), "",
              "## Broad phase of contact", "", "Looking for the facets near each node anew, on two flat surfaces that face each other: the grid of `solid_fe/contact.cpp` beside CGAL's AABB tree "
              "(build and box queries) on the same facets, `build/release/tests/solid_contact_search`, medians of eleven in turn, CPU time. It happens when a node of either side has moved by a quarter of a facet.", "",
              *program("solid_contact_search").strip().splitlines(), ""]
    lines.insert(3, f"Load average of the machine ({os.cpu_count()} cores) when this began and ended: {load:.1f}, {os.getloadavg()[0]:.1f}; above 1 per core times are too long, ratios and fractions of the triad less so.")
    lines.insert(4, "")
    (DOCS / "solid_speed.md").write_text("\n".join(lines))


def stability(samples):
    table = program("solid_stability", samples).strip().splitlines()
    lines = ["# The solid: how sharp the stable step is", "",
             f"`scripts/benchmark solid --parts stability`: `build/release/tests/solid_stability`. {samples} random small solids per element: jittered, flattened and sheared meshes, `neo_hookean_ln` or `svk`, ν from 0 to "
             "0.48, free or held at the bottom; small random motion, 3000 steps at a multiple of the claimed step (without `step_safety`), bisected to 0.5 %. An excess δ over the true limit makes the worst mode "
             "grow by 2 √(2δ) per step. At 1.0 of the claim nothing may grow; the smallest multiple that grows says how sharp the bound is, the mean how much is given away. (Random fractions from 0.5 to 1.0, all laws, large "
             "motion, damping, walls: `tests/solid_fe/stress_test.cpp`, 300 solids of 2000 steps.) `solid.step_limit = \"measured\"` gets most of it back.", "", *table, ""]
    (DOCS / "solid_stability.md").write_text("\n".join(lines))


def calculix_input(folder, nx, ny, t_end):
    """The bar as an Abaqus file that solid_fe reads too, and the step of CalculiX."""
    number = lambda i, j, k: 1 + i + (nx + 1) * (j + (ny + 1) * k)
    side = 0.1
    lines = ["*NODE"]
    lines += [f"{number(i, j, k)}, {i / nx:.10g}, {side * j / ny:.10g}, {side * k / ny:.10g}" for k in range(ny + 1) for j in range(ny + 1) for i in range(nx + 1)]
    lines.append("*ELEMENT, TYPE=C3D8, ELSET=bar")
    e = 0
    for k in range(ny):
        for j in range(ny):
            for i in range(nx):
                e += 1
                corners = [number(i + a, j + b, k + c) for c in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
                lines.append(f"{e}, " + ", ".join(map(str, corners)))
    ends = {"base": 0, "loaded": nx}
    for name, i in ends.items():
        lines += [f"*NSET, NSET={name}"] + [f"{number(i, j, k)}," for k in range(ny + 1) for j in range(ny + 1)]
    last = [1 + (nx - 1) + nx * (j + ny * k) for k in range(ny) for j in range(ny)]
    lines += ["*ELSET, ELSET=last"] + [f"{n}," for n in last] + ["*SURFACE, NAME=pulled, TYPE=ELEMENT", "last, S4"]
    (folder / "bar.inp").write_text("\n".join(lines) + "\n")
    share = lambda j: 0.5 if j in (0, ny) else 1.0
    step = ["*INCLUDE, INPUT=bar.inp", "*MATERIAL, NAME=steel", "*ELASTIC", "210e9, 0.3", "*DENSITY", "7800", "*SOLID SECTION, ELSET=bar, MATERIAL=steel",
            "*BOUNDARY", "base, 1, 3", "*AMPLITUDE, NAME=sudden", "0, 1, 1, 1", "*STEP, INC=10000000", "*DYNAMIC, EXPLICIT", f"1e-6, {t_end}",
            "*CLOAD, AMPLITUDE=sudden"]
    step += [f"{number(nx, j, k)}, 1, {1e6 * side * side * share(j) * share(k) / ny ** 2:.12g}" for k in range(ny + 1) for j in range(ny + 1)]
    step += ["*NODE PRINT, NSET=loaded, FREQUENCY=1", "U", "*END STEP"]
    (folder / "step.inp").write_text("\n".join(step) + "\n")


def calculix(repeats):
    if not shutil.which("ccx"):
        sys.exit("calculix: ccx is not there; apt install calculix-ccx")
    t_end, rows = 7.7e-4, []  # a period of the bar
    with tempfile.TemporaryDirectory() as name:
        for nx, ny in ((40, 4), (80, 8)):
            folder = Path(name) / str(nx)
            folder.mkdir()
            calculix_input(folder, nx, ny, t_end)
            theirs, ours = [], []
            for _ in range(repeats):
                before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
                subprocess.run(["ccx", "-i", "step"], cwd=folder, capture_output=True, env={**os.environ, "OMP_NUM_THREADS": "1"}, check=True)
                theirs.append(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before)
            times, tips, at = [], [], None
            for line in (folder / "step.dat").read_text().splitlines():
                if "time" in line:
                    times.append(float(line.split()[-1]))
                    tips.append([])
                elif line.strip():
                    tips[-1].append(float(line.split()[1]))
            share = np.ones(ny + 1)
            share[[0, -1]] = 0.5
            tip = np.array([np.average(t, weights=np.outer(share, share).ravel()) for t in tips])
            case = case_text("calculix", "Hex8", [1], [1.0, 1.0, 1.0], {"density": 7800.0, "youngs_modulus": 210e9, "poisson_ratio": 0.3, "law": '"linear"',
                                                                  "mesh": '"bar.inp"'}, [1e6, 0.0], 0.0, t_end, t_end / 400)
            keep = [line for line in case.splitlines() if line.split(" = ")[0] not in ("width", "height", "depth", "element", "elements")]
            case = "\n".join(keep).replace('on = "left"', 'on = "base"').replace('on = "right"', 'on = "pulled"').replace('surface = "right"', 'surface = "pulled"')
            for _ in range(repeats):
                before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
                table, summary, _ = run(folder, case + "\n", 1)
                ours.append(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before)
            mean = np.interp(table["t[s]"], [0.0] + times, [0.0] + list(tip))
            difference = math.sqrt(np.sum((table["u_x[m]"] - mean) ** 2) / np.sum(mean ** 2))
            rows.append((summary["elements"], len(times), min(theirs), summary["steps"], min(ours), difference))
            print(rows[-1], flush=True)
    lines = ["# The solid beside CalculiX", "",
             "`scripts/benchmark solid --parts calculix`: a steel bar, 1 m × 0.1 m × 0.1 m, of C3D8 (full integration), pulled suddenly at one end, one period of its axial vibration; the same Abaqus "
             "mesh for both, linear elastic, ν = 0.3. CalculiX 2.20, `*DYNAMIC, EXPLICIT`, one thread. *difference*: relative L2, over the whole time, of the mean axial displacement of the loaded "
             f"end. User time of the whole process, least of {repeats}.", "",
             "| elements | steps of ccx | user time of ccx [s] | steps of solid_fe | user time of solid_fe [s] | difference | ratio of times |", "| --- | --- | --- | --- | --- | --- | --- |"]
    lines += [f"| {n} | {a} | {t:.2f} | {b} | {s:.2f} | {100 * d:.2f} % | {t / s:.0f} |" for n, a, t, b, s, d in rows]
    (DOCS / "solid_calculix.md").write_text("\n".join(lines) + "\n")


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--parts", nargs="+", choices=("speed", "stability", "error", "calculix"), default=("speed", "stability", "error", "calculix"))
    p.add_argument("--sizes", nargs="+", type=float, default=(1e5, 1e6), help="elements of the speed tables")
    p.add_argument("--samples", type=int, default=30, help="random solids per element of the stability table")
    p.add_argument("--repeats", type=int, default=3)
    args = p.parse_args()
    if "speed" in args.parts:
        speed(args.sizes)
    if "stability" in args.parts:
        stability(args.samples)
    if "error" in args.parts:
        errors(args.repeats)
    if "calculix" in args.parts:
        calculix(args.repeats)


if __name__ == "__main__":
    main()
