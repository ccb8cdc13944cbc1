#!/usr/bin/python3
"""What each part of the coupling buys: equal steps against sub-cycled, exact against lumped multipliers, forms of the window, conventional staggering.

    scripts/benchmark coupling_ablation [--repeat 3]

The runs of a table take turns; costs are medians. Writes docs/benchmarks/coupling_ablation.md and .png.
"""
import argparse
import re
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from benchmark_coupled_error import ROOT, error_of, plt, run  # noqa: E402
from lib import compare  # noqa: E402

STAGGERED = "conventional staggering diverges once the fluid's interface mass exceeds the solid's; GC does not"


def ledger(out):
    """Largest displacement gap [m] and velocity jump [m/s] of the run, and what the interface lost of the largest work done through it."""
    h = compare.read_csv(next((out / "history").glob("interface_*.csv")))
    fluid, solid = h["work_on_fluid[J]"], h["work_on_solid[J]"]
    return max(h["displacement_gap[m]"]), max(h["velocity_jump[m/s]"]), -(fluid[-1] + solid[-1]) / max(max(abs(fluid)), max(abs(solid)))


def table(case, comparison, options, variants, repeat, folder):
    """Rows (name, error, cost, windows, m, gap, jump, loss) of the variants, whose runs take turns."""
    results = {}
    for _ in range(repeat):
        for name, more in variants.items():
            out = folder / name.replace(" ", "_")
            summary, cost = run(case, out, *options, *(w for o in more for w in ("--set", o)))
            results.setdefault(name, []).append((error_of(summary, comparison), cost, summary["windows"], summary["substeps"], *ledger(out)))
    return [(name, r[0][0], statistics.median(x[1] for x in r), *r[0][2:]) for name, r in results.items()]


def staggered(build):
    """(mass ratio, largest velocity of the interface within 200 steps (stopped beyond 1e6 m/s) after a disturbance of 1 mm/s) from the unit test of it."""
    text = subprocess.run([build / "tests" / "test_coupler", STAGGERED, "-s"], capture_output=True, text=True).stdout
    return list(dict.fromkeys(re.findall(r"q := ([\d.e+-]+)\s+largest := ([\d.e+-]+)", text)))


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--repeat", type=int, default=3, help="runs of each variant, for the median of their cost")
    p.add_argument("--build", type=Path, default=ROOT / "build" / "release", help="build folder")
    arguments = p.parse_args()

    def grid(steps):
        return {(f"m = {m}" if m else "m as the stable steps ask") + f", {operator}":
                [f"coupling.operator={operator}"] + ([f"coupling.substeps={m}"] if m else []) for m in steps for operator in ("exact", "lumped")} | \
               {"m = 1, half steps": ["coupling.form=half_step"]} | \
               {(f"m = {m}" if m else "m as the stable steps ask") + ", continuity at the windows' ends":
                ["coupling.form=macro_continuity"] + ([f"coupling.substeps={m}"] if m else []) for m in steps if m != 1}
    with tempfile.TemporaryDirectory() as name:
        tables = {
            "elastic column, 10 elements, linear: L2 of the interface displacement against the exact modal solution":
                table("elastic_column", "interface displacement", ("--set", "run.resolution=10", "--set", "solid.law=linear"), grid((1, 10, 30, None)),
                      arguments.repeat, Path(name)),
            "pulse on aluminium, 200 nodes: L2 of the pressure against d'Alembert":
                table("acoustic_interface", "incident and reflected pulse", ("--set", "run.resolution=200"), grid((1, 2, None)), arguments.repeat, Path(name))}

    lines = ["# What each part of the coupling buys", "",
             f"`scripts/benchmark coupling_ablation`. Computing: seconds of fluid and solid without waiting, medians of {arguments.repeat} runs that took turns.",
             "m: fine steps per window, 1: equal steps. Lumped: `coupling.operator = \"lumped\"`; half steps and continuity at the windows' ends: `coupling.form`. Loss: work of the link on both sides over the largest on one.", ""]
    figure, axes = plt.subplots(figsize=(7, 4.5), constrained_layout=True)
    for (text, rows), marker in zip(tables.items(), "os"):
        lines += [f"**{text}**", "", "| coupling | relative error | computing [s] | windows | m | largest gap [m] | largest velocity jump [m/s] | loss |",
                  "| --- | --- | --- | --- | --- | --- | --- | --- |"]
        lines += [f"| {n} | {e:.3e} | {c:.2g} | {w} | {m} | {gap:.1e} | {jump:.1e} | {loss:.1e} |" for n, e, c, w, m, gap, jump, loss in rows] + [""]
        for operator, style in (("exact", "-"), ("lumped", ":"), ("ends", "--")):
            chosen = [r for r in rows if r[0].endswith(operator)]
            axes.loglog([r[2] for r in chosen], [r[1] for r in chosen], marker + style, label=f"{text.split(',')[0]}, {operator}")
    lines += ["**Conventional staggering**, two glued bars, equal steps: largest velocity of the interface within 200 steps (stopped beyond 1e6 m/s) after a disturbance of 1e-3 m/s "
              "(`tests/coupler/gravouil_combescure_test.cpp`; with the scheme above the energy of the same bars stays below 1.5 times its start for 2000 steps). "
              "A run of the programs is refused above a mass ratio of 1.", "",
              "| mass of fluid over solid at the interface | largest velocity [m/s] |", "| --- | --- |"]
    lines += [f"| {float(q):g} | {float(v):.2g} |" for q, v in staggered(arguments.build)] + [""]
    axes.set_xlabel("computing [s]")
    axes.set_ylabel("relative error")
    axes.grid(alpha=0.3)
    axes.legend()
    target = ROOT / "docs" / "benchmarks"
    figure.savefig(target / "coupling_ablation.png", dpi=90)
    lines += ["![error against run time](coupling_ablation.png)", ""]
    (target / "coupling_ablation.md").write_text("\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
