#!/usr/bin/env python3
"""What the coupling costs: the elastic column with three processes, and its fluid alone for the same number of steps.

    scripts/benchmark coupling --resolution 40 160 --pairs 3

Writes docs/benchmarks/coupling_cost.md. Medians of paired runs; quote the ratios, not the seconds.
"""
import argparse
import json
import re
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def fluid_alone(case):
    """The case without solid and coupling; the wet surface becomes a wall."""
    text = case.read_text()
    tables = re.split(r"(?m)^(?=\[)", text)
    kept = [t for t in tables if re.match(r"\[+(run|fluid|output)", t) or not t.startswith("[")]
    return "".join(kept) + '\n[[fluid.wall]]\non = "bottom"\nkind = "slip"\n'


def run(case, out, *options):
    command = ["/usr/bin/python3", str(ROOT / "scripts" / "run_case.py"), str(case), "--out", str(out), "--no-plots", "--set", "output.frames=false",
               "--set", "output.history_every=1"]
    for option in options:
        command += ["--set", option]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stdout + done.stderr)
    return json.loads((out / "summary.json").read_text())


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--resolution", type=int, nargs="+", default=[40, 160])
    p.add_argument("--pairs", type=int, default=3)
    args = p.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        alone_case = Path(folder) / "case.toml"
        alone_case.write_text(fluid_alone(ROOT / "cases" / "elastic_column" / "case.toml"))
        for resolution in args.resolution:
            t_end = 0.02 * 40 / resolution
            samples = []
            for _ in range(args.pairs):
                common = (f"run.resolution={resolution}", f"run.t_end={t_end}")
                coupled = run(ROOT / "cases" / "elastic_column", Path(folder) / "coupled", *common)
                alone = run(alone_case, Path(folder) / "alone", *common)
                f, c = coupled["fluid"], coupled["coupler"]
                samples.append({"nodes": f["nodes"], "steps": f["steps"], "windows": coupled["windows"],
                                "compute": (f["wall_s"] - f["wait_s"]) / f["steps"], "wait": f["wait_s"] / f["steps"],
                                "window": c["wall_s"] / coupled["windows"], "share": f["wait_s"] / f["wall_s"],
                                "ratio": f["ns_per_node_step"] / alone["fluid"]["ns_per_node_step"]})
            rows.append({key: statistics.median(s[key] for s in samples) for key in samples[0]})
    lines = ["# What the coupling costs", "",
             "The elastic column, three processes; medians of paired runs. *slow-down*: computing time of the fluid per step while the coupler and the "
             "solid wait beside it, over the same fluid alone (which looks at its mesh every 4 and at its stable step every 8 steps; coupled it does so once "
             "a window, hence ratios below 1: waiting does not slow the computing process). *wait*: what the fluid waits per exchange (coupler's solve and two messages).", "",
             "| fluid nodes | steps | windows | fluid step [us] | wait per exchange [us] | window [us] | share of waiting | slow-down |",
             "| --- | --- | --- | --- | --- | --- | --- | --- |"]
    for r in rows:
        lines.append(f"| {r['nodes']:.0f} | {r['steps']:.0f} | {r['windows']:.0f} | {1e6 * r['compute']:.2f} | {1e6 * r['wait']:.2f} | {1e6 * r['window']:.0f} | "
                     f"{100 * r['share']:.0f} % | {r['ratio']:.3f} |")
    text = "\n".join(lines) + "\n\nMade by `scripts/benchmark coupling`.\n"
    (ROOT / "docs" / "benchmarks").mkdir(parents=True, exist_ok=True)
    (ROOT / "docs" / "benchmarks" / "coupling_cost.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
