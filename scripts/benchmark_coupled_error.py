#!/usr/bin/python3
"""Error against run time of coupled cases: four cases on four meshes each, column and pulse with other step ratios, gate and wedge with shorter steps.

    scripts/benchmark coupled_error

Truths: the converged curve of the column, d'Alembert for the pulse, and where no truth exists the value that the own meshes converge to
(Richardson extrapolation of the last three). Run time is the time both solvers compute, without waiting for each other, so that it does not
depend on who else uses the machine's cores. Writes docs/benchmarks/coupled_error.md and .png.
"""
import argparse
import sys
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parent))
from lib import compare, launch  # noqa: E402
from lib.launch import ROOT  # noqa: E402


def run(case, out, *options):
    """Summary of a run, and the seconds that both solvers computed."""
    summary = launch.run(ROOT / "cases" / case, out, "--set", "output.frames=false", *options)
    return summary, summary["coupler"]["fluid_compute_s"] + summary["coupler"]["solid_compute_s"]


def error_of(summary, name):
    return next(c["error"] for c in summary["comparisons"] if c["name"] == name)


def largest(out, history, column):
    return float(np.max(compare.read_csv(out / "history" / f"{history}.csv")[column]))


def extrapolated(values):
    """Limit of the last three of a sequence on meshes halved each time."""
    a, b, c = values[-3:]
    ratio = (a - b) / (b - c)
    return c + (c - b) / (ratio - 1.0) if ratio > 1.0 else c


def write(tables):
    """docs/benchmarks/coupled_error.md and .png from {title: [(resolution, error, seconds, windows, fine steps)]}."""
    lines = ["# Error against run time, coupled", "",
             "`scripts/benchmark coupled_error`. Run time: seconds in which fluid and solid compute, waiting left out; one run each. Contact (gate, wedge) takes equal steps on both sides",
             "([why](../theory.md#5-interface-the-window): with sub-steps a set frozen for a window lets nodes through, or every landing costs energy), so only the length of all of them can vary; the errors of",
             "gate and wedge are dominated by the mesh.", ""]
    figure, axes = plt.subplots(figsize=(7, 5), constrained_layout=True)
    for (text, rows), marker in zip(tables.items(), "os^<vdDp"):
        lines += [f"**{text}**", "", "| resolution | relative error | computing [s] | windows | fine steps per window | computing per window [ms] |", "| --- " * 6 + "|"]
        lines += [f"| {n} | {e:.2e} | {c:.2g} | {w} | {m} | {1e3 * c / w:.2g} |" for n, e, c, w, m in rows] + [""]
        axes.loglog([r[2] for r in rows], [r[1] for r in rows], marker + "-", label=text.split(":")[0].split(",")[0])
    axes.set_xlabel("computing [s]")
    axes.set_ylabel("relative error")
    axes.grid(alpha=0.3)
    axes.legend()
    target = ROOT / "docs" / "benchmarks"
    figure.savefig(target / "coupled_error.png", dpi=90)
    lines += ["![error against run time](coupled_error.png)", ""]
    (target / "coupled_error.md").write_text("\n".join(lines))
    print("\n".join(lines))


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--keep", type=Path, help="folder for the runs of gate and wedge (default: they are deleted)")
    arguments = p.parse_args()
    tables = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kept = arguments.keep or folder
        rows = []
        for resolution in (10, 20, 40, 80):
            summary, cost = run("elastic_column", folder / "c", "--set", f"run.resolution={resolution}", "--set", "solid.law=linear")
            rows.append((str(resolution), error_of(summary, "interface displacement"), cost, summary["windows"], summary["substeps"]))
        tables["elastic column: L2 of the interface displacement, linear solid, exact modal solution"] = rows
        rows = []
        for substeps in (30, 60, 95, 150, 300):
            summary, cost = run("elastic_column", folder / "c", "--set", "run.resolution=20", "--set", "solid.law=linear", "--set",
                                f"coupling.substeps={substeps}")
            rows.append((f"20, m = {substeps}", error_of(summary, "interface displacement"), cost, summary["windows"], summary["substeps"]))
        tables["elastic column on one mesh, other step ratios m"] = rows
        rows = []
        for resolution in (50, 100, 200, 400):
            summary, cost = run("acoustic_interface", folder / "a", "--set", f"run.resolution={resolution}")
            rows.append((str(resolution), error_of(summary, "incident and reflected pulse"), cost, summary["windows"], summary["substeps"]))
        tables["pulse on aluminium: L2 of the pressure, d'Alembert"] = rows
        rows = []
        for substeps in (1, 2, 3, 6, 12):
            summary, cost = run("acoustic_interface", folder / "a", "--set", f"coupling.substeps={substeps}")
            rows.append((f"200, m = {substeps}", error_of(summary, "incident and reflected pulse"), cost, summary["windows"], summary["substeps"]))
        tables["pulse on one mesh, other step ratios m"] = rows
        for case, history, column, resolutions, options, text, steps in (
                ("elastic_gate", "tip", "u_x[m]", (10, 20, 40, 80), ("--until", "0.13"), "elastic gate: peak of u_x against its own limit", (1e-5, 5e-6)),
                ("wedge_impact", "B", "u_y[m]", (30, 60, 120, 240), ("--set", "probe.2.radius=0.03"), "wedge: w_B(2.2 ms) against its own limit", (1e-6, 5e-7))):
            runs = []
            for resolution in resolutions:
                out = kept / f"{case}_{resolution}"
                summary, cost = run(case, out, "--set", f"run.resolution={resolution}", *options)
                runs.append((str(resolution), largest(out, history, column), cost, summary["windows"], summary["substeps"]))
            limit = extrapolated([r[1] for r in runs])
            tables[f"{text}, {limit:.5g} m"] = [(r[0], abs(r[1] / limit - 1.0), *r[2:]) for r in runs]
            at = runs[1 if case == "wedge_impact" else 0]
            rows = [(at[0], abs(at[1] / limit - 1.0), *at[2:])]
            for step in steps:  # contact takes equal steps: only their length can vary
                summary, cost = run(case, folder / "v", "--set", f"run.resolution={at[0]}", "--set", f"coupling.dt_max={step}", *options)
                rows.append((f"{at[0]}, steps at most {step:g} s", abs(largest(folder / "v", history, column) / limit - 1.0), cost, summary["windows"], summary["substeps"]))
            tables[f"{text.split(':')[0]} on one mesh, shorter steps"] = rows
    write(tables)


if __name__ == "__main__":
    main()
