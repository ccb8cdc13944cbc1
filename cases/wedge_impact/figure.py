#!/usr/bin/python3
"""Our curves over those of Scolan, Oger and others, one panel each: deflection at B, pressures at A, B and C; and the numbers of the README.

    for h in 60 120 240; do scripts/run cases/wedge_impact --no-plots --out runs/wedge_$h --set run.resolution=$h --set output.frames=false; done
    cases/wedge_impact/figure.py runs/wedge_60 runs/wedge_120 runs/wedge_240 --printed runs/wedge_240_K      writes wedge_impact.png here
"""
import argparse
import json
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "scripts"))
from lib import compare  # noqa: E402

PANELS = (  # title, history, column, factor, [(label, file, column, marker)]
    ("deflection at B [mm]", "B", "u_y[m]", 1e3, [
        ("Scolan 2004", "w_analytical.csv", "value", "o"), ("SPH-FEM, Fourey 2010", "w_fourey_2010_sph_fem.csv", "value", "s"),
        ("SPH-FEM, Li 2015", "w_li_2015_sph_fem.csv", "value", "^"), ("nonlinear loads (MLM)", "wedge_mlm_history.csv", "wB_m", ":")]),
    ("pressure at A [MPa]", "p_A", "p[Pa]", 1e-6, [
        ("Scolan 2004", "pA_analytical.csv", "value", "o"), ("SPH, Oger 2010", "pA_oger_2010_sph.csv", "value", "s"),
        ("SPH, Khayyer 2018", "pA_khayyer_2018_sph.csv", "value", "^")]),
    ("pressure at B [MPa]", "p_B", "p[Pa]", 1e-6, [("linear Wagner loads", "wedge_wagner_history.csv", "pB_x0.30_Pa", ":")]),
    ("pressure at C [MPa]", "p_C", "p[Pa]", 1e-6, [
        ("Scolan 2004", "pC_analytical.csv", "value", "o"), ("SPH, Oger 2010", "pC_oger_2010_sph.csv", "value", "s"),
        ("SPH, Khayyer 2018", "pC_khayyer_2018_sph.csv", "value", "^")]))


def curve(out, history, column):
    table = compare.read_csv(out / "history" / f"{history}.csv")
    return table["t[s]"], table[column]


def smooth(t, p, window):
    """Mean over a window: single landings ring."""
    return np.array([p[np.abs(t - s) <= 0.5 * window + 1e-12].mean() for s in t])


def numbers(out):
    """Deflections [mm]; arrival at C [ms]; p_C 0.2 ms later; level, dip and rise of p_A with their times [MPa, ms]."""
    t, w = curve(out, "B", "u_y[m]")
    w = 1e3 * np.interp([1.0e-3, 1.4e-3, 1.8e-3, 2.2e-3], t, w)
    t, p = curve(out, "p_C", "p[Pa]")
    k = np.argmax(p > 0.5 * p.max())  # half of the peak: the front is in the middle of the patch
    arrival = np.interp(0.5 * p.max(), p[k - 1:k + 1], t[k - 1:k + 1])
    later = p[(t > arrival + 1.5e-4) & (t < arrival + 2.5e-4)].mean()
    t, p = curve(out, "p_A", "p[Pa]")
    p = smooth(t, p, 1e-4)
    level = p[(t > 3e-4) & (t < 7e-4)].mean()
    between = (t > 9e-4) & (t < 1.6e-3)
    dip = np.argmin(np.where(between, p, np.inf))
    rise = np.argmax(np.where((t > t[dip]) & (t < 2.15e-3), p, -np.inf))
    summary = json.loads((out / "summary.json").read_text()) if (out / "summary.json").exists() else {}
    steps = json.loads((out / "coupler.json").read_text()).get("windows", summary.get("windows"))
    return [f"{v:.2f}" for v in w] + [f"{1e3 * arrival:.2f}", f"{later / 1e6:.1f}", f"{level / 1e6:.2f}", f"{p[dip] / 1e6:.2f} at {1e3 * t[dip]:.2f}",
                                      f"{p[rise] / 1e6:.2f} at {1e3 * t[rise]:.2f}", str(steps)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", type=Path, help="output folders, coarse to fine")
    parser.add_argument("--printed", type=Path, nargs="*", default=[], help="runs with fluid.tait_reading = K")
    arguments = parser.parse_args()
    print("| run | w_B at 1.0 | 1.4 | 1.8 | 2.2 ms [mm] | at C [ms] | p_C 0.2 ms later [MPa] | p_A 0.3 to 0.7 ms | dip [MPa, ms] | rise | steps |")
    print("| --- " * 11 + "|")
    for out in [*arguments.runs, *arguments.printed]:
        print(f"| {out.name} | " + " | ".join(numbers(out)) + " |")
    figure, axes = plt.subplots(2, 2, figsize=(10, 7), constrained_layout=True)
    for ax, (title, history, column, factor, references) in zip(axes.flat, PANELS):
        for k, out in enumerate(arguments.runs):
            t, y = curve(out, history, column)
            ax.plot(1e3 * t, factor * y, color=("lightsteelblue", "cornflowerblue", "mediumblue")[k - len(arguments.runs)], linewidth=0.8 + 0.3 * k,
                    label=f"Undine, {out.name.split('_')[-1]} nodes")
        for out in arguments.printed[-1:]:
            t, y = curve(out, history, column)
            ax.plot(1e3 * t, factor * y, color="tab:red", linewidth=1.0, label="Undine, c = 3924 m/s")
        for label, file, value, marker in references:
            table = compare.read_csv(HERE / "reference" / file)
            style = {"linestyle": marker, "color": "black"} if marker == ":" else {"linestyle": "", "marker": marker, "markersize": 4, "markerfacecolor": "none", "color": "black"}
            ax.plot(1e3 * table["t_s"], factor * table[value], label=label, **style)
        ax.set_xlim(0.0, 2.3)
        ax.set_ylim(0.0, {"p_C": 35.0, "p_B": 30.0, "p_A": 12.0}.get(history))
        ax.set_xlabel("t [ms]")
        ax.set_ylabel(title)
        ax.grid(alpha=0.3)
        ax.legend(frameon=False, fontsize=7)
    figure.savefig(HERE / "wedge_impact.png", dpi=70)


if __name__ == "__main__":
    main()
