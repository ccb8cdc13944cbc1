#!/usr/bin/env python3
"""What the coupling costs: the elastic column with three processes, and its fluid alone doing the same work.

    scripts/benchmark coupling --resolution 40 160 --pairs 5

The same work: the fluid alone has the same mesh with a wall in place of the solid, takes the same number of steps, and looks at its mesh and
at its stable step as often as the coupled one does, once in the steps of a window. Pairs run one after the other; of each column the median is
written to docs/benchmarks/coupling_cost.md. Quote the ratios, not the seconds.
"""
import argparse
import os
import re
import statistics
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from lib import launch  # noqa: E402
from lib.launch import ROOT  # noqa: E402

COLUMN = ROOT / "cases" / "elastic_column"


def fluid_alone(case):
    """The case without solid and coupling; the wet surface becomes a wall."""
    tables = re.split(r"(?m)^(?=\[)", case.read_text())
    kept = [t for t in tables if re.match(r"\[+(run|fluid|output)", t) or not t.startswith("[")]
    return "".join(kept) + '\n[[fluid.wall]]\non = "bottom"\nkind = "slip"\n'


def run(case, out, **values):
    values = {"output.frames": "false", "output.history_every": 1, **{key.replace("__", "."): value for key, value in values.items()}}
    return launch.run(case, out, *launch.settings(values))


def pair(folder, alone_case, resolution, t_end):
    """One coupled run and one of the fluid alone, with as many steps and looks."""
    coupled = run(COLUMN, folder / "coupled", run__resolution=resolution, run__t_end=t_end)
    f, c, windows = coupled["fluid"], coupled["coupler"], coupled["windows"]
    alone = run(alone_case, folder / "alone", run__resolution=resolution, run__t_end=t_end, fluid__look_every=round(f["steps"] / windows))["fluid"]
    compute = (f["wall_s"] - f["wait_s"]) / f["steps"]
    return {"nodes": f["nodes"], "steps": f["steps"], "steps alone": alone["steps"], "windows": windows, "remeshes": f["remeshes"], "alone": alone["wall_s"] / alone["steps"],
            "compute": compute, "wait": f["wait_s"] / f["steps"], "window": c["wall_s"] / windows, "share": f["wait_s"] / f["wall_s"],
            "ratio": compute / (alone["wall_s"] / alone["steps"]), "whole": f["wall_s"] / f["steps"] / (alone["wall_s"] / alone["steps"])}


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--resolution", type=int, nargs="+", default=[40, 160])
    p.add_argument("--pairs", type=int, default=5)
    args = p.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        alone_case = folder / "case.toml"
        alone_case.write_text(fluid_alone(COLUMN / "case.toml"))
        for resolution in args.resolution:
            samples = [pair(folder, alone_case, resolution, 0.02 * 40 / resolution) for _ in range(args.pairs)]
            row = {key: statistics.median(s[key] for s in samples) for key in samples[0]}
            row["fastest"] = min(s["compute"] for s in samples) / min(s["alone"] for s in samples)  # the least disturbed by others
            rows.append(row)
    lines = ["# What the coupling costs", "",
             f"The elastic column, three processes on {os.cpu_count()} cores; medians of {args.pairs} pairs of runs. *alone*: the same fluid by itself, doing the same work: the "
             "same mesh with a wall in place of the solid, the same number of steps, looking at its mesh and its stable step as often (`fluid.look_every`, once in the "
             "steps of a window). *slow-down*: computing time of the fluid per step while the coupler and the solid wait beside it, over that alone; the requirement is "
             "at most 1.10. *all*: the whole time per step, waiting for the coupler's solve and two messages included, over that alone.", "",
             "| fluid nodes | steps (alone) | windows | remeshes | alone [us/step] | coupled, computing [us/step] | waiting [us/step] | share of waiting | slow-down | of the fastest runs | all |",
             "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"]
    for r in rows:
        lines.append(f"| {r['nodes']:.0f} | {r['steps']:.0f} ({r['steps alone']:.0f}) | {r['windows']:.0f} | {r['remeshes']:.0f} | {1e6 * r['alone']:.2f} | {1e6 * r['compute']:.2f} | {1e6 * r['wait']:.2f} | "
                     f"{100 * r['share']:.0f} % | {r['ratio']:.3f} | {r['fastest']:.3f} | {r['whole']:.3f} |")
    text = "\n".join(lines) + "\n\nMade by `scripts/benchmark coupling`.\n"
    (ROOT / "docs" / "benchmarks").mkdir(parents=True, exist_ok=True)
    (ROOT / "docs" / "benchmarks" / "coupling_cost.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
