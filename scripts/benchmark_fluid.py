#!/usr/bin/env python3
"""What a step of the fluid costs: a dam break with a clock around every act, STREAM triad of the same process beside it.

    scripts/benchmark fluid --repeats 3

Writes the tables of docs/benchmarks/fluid_speed.md and keeps what is said below them. CPU time of one core, medians.
"""
import argparse
import json
import os
import statistics
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Memory traffic of a single step in the plane, bytes per node, every array once per sweep: predict 80; volumes, density, pressure and records 180;
# element forces, accelerations and kick 216; mass exchange 57. Of several steps in one sweep it is less.
BYTES_PER_NODE_STEP = 533
PAGE = ROOT / "docs" / "benchmarks" / "fluid_speed.md"
BELOW = "## What the scheme needs at least"


def measure(nodes_over_width, t_end, repeats, threads=1):
    samples = []
    for _ in range(repeats):
        done = subprocess.run([ROOT / "build" / "release" / "bin" / "fluid_speed", str(nodes_over_width), str(t_end), str(threads)], capture_output=True, text=True, check=True)
        samples.append(json.loads(done.stdout))
    return {key: statistics.median(s[key] for s in samples) for key in samples[0]}


def parts(nodes_over_width, *what):
    done = subprocess.run([ROOT / "build" / "release" / "bin" / "fluid_parts", str(nodes_over_width), *what], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def table_of_parts(widths):
    """Every part called alone, on one state: ns of CPU time per node and call, and per step where it is not called in every one."""
    rows = [parts(n) for n in widths]
    names = {"volumes": ("volumes of nodes", 1), "state": ("density and pressure", 1), "records": ("records of nodes", 1), "forces": ("element forces, all terms", 1),
             "pressure_forces": ("(pressure alone)", 0), "accelerations": ("accelerations", 1), "exchange": ("exchange of mass", 0.8),
             "exchange_booked": ("the same with its energy", 0.2), "bound": ("largest stable step", 1 / 8), "worse": ("shape of elements", 1 / 4)}
    counts = parts(33, "instructions")
    lines = ["| part | per step | " + " | ".join(f"{r['nodes']} nodes [ns]" for r in rows) + f" | instructions, {counts['nodes']} nodes | of these on eight numbers |", "| --- | --- |" + " --- |" * (len(rows) + 2)]
    for key, (name, often) in names.items():
        lines.append(f"| {name} | {often:.3g} | " + " | ".join(f"{r[key]:.1f}" for r in rows) + f" | {counts[key][0]:.0f} | {counts[key][1]:.0f} |")
    def total(value):
        return sum(value(key) * often for key, (_, often) in names.items())
    lines.append("| sum | | " + " | ".join(f"**{total(r.get):.1f}**" for r in rows) + f" | **{total(lambda key: counts[key][0]):.0f}** | **{total(lambda key: counts[key][1]):.0f}** |")
    return lines


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--repeats", type=int, default=3)
    p.add_argument("--scenes", nargs="+", default=["20:4", "66:2.5", "207:0.3", "650:0.02"], help="nodes over the width : end of the run t sqrt(2g/a)")
    p.add_argument("--threads", default="207:0.1", help="scene that is run with one and with two threads")
    p.add_argument("--parts", nargs="+", type=int, default=[66, 207], help="nodes over the width of the table by part")
    args = p.parse_args()
    rows = [measure(*(float(x) if "." in x else int(x) for x in scene.split(":")), args.repeats) for scene in args.scenes]
    lines = ["# What a step of the fluid costs", "",
             "A dam break (column a x 2a, sliding walls, all stabilisers every step), ns of CPU time per node and step on one core, everything included; medians. "
             "*step*: motion, wall contact, volumes, pressure, forces, mass exchange, four steps in one sweep; *bound*: largest stable step, every 8 steps; *look*: "
             "is the mesh good, every 4 steps; *remesh*: all of it, spread over the steps; *ledgers*: a row every 0.04 T. STREAM triad runs in the same process right after, over "
             "arrays as large as the state and over 480 MB. *volume*: largest error of the volume during the run; *energy*: what remeshing gave and took, over the initial potential energy.", "",
             f"| nodes | to T | steps | remeshes (rebuilds) | all | step | bound | look | remesh | ledgers | remesh [us/node] | triad same size / memory [GB/s] | step / triad time of {BYTES_PER_NODE_STEP} B | peak B/node | volume | energy |",
             "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"]
    for r in rows:
        roof = BYTES_PER_NODE_STEP / r["triad_same_size"]
        lines.append(f"| {r['nodes']:.0f} | {r['T']:.2f} | {r['steps']:.0f} | {r['remeshes']:.0f} ({r['rebuilds']:.0f}) | **{r['all']:.1f}** | {r['solve']:.1f} | {r['bound']:.1f} | "
                     f"{r['look']:.1f} | {r['remesh']:.1f} | {r['output']:.2f} | {r['remesh_us_per_node']:.2f} | {r['triad_same_size']:.0f} / {r['triad_memory']:.0f} | "
                     f"{r['solve'] / roof:.1f} | {r['peak_bytes_per_node']:.0f} | {r['volume_error']:.1e} | {r['remesh_gain'] / r['energy_scale']:+.1e} {r['remesh_loss'] / r['energy_scale']:+.1e} |")
    model = next((line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")), "unknown")
    lines += ["", f"{os.cpu_count()} cores of \"{model}\"; load of the machine meanwhile {os.getloadavg()[1]:.1f}."]
    n, t_end = args.threads.split(":")
    one, two = (measure(int(n), float(t_end), args.repeats, threads) for threads in (1, 2))
    lines += ["", f"Threads, {one['nodes']:.0f} nodes to T = {t_end}, ns of the clock on the wall: **{one['wall']:.1f}** with one, **{two['wall']:.1f}** with two "
              f"(step {one['solve']:.1f} ns of CPU time with one, {two['solve']:.1f} with two). The bits of the results are the same (`fluid_test.cpp`)."]
    lines += ["", "## Part by part", "", "Every part called alone, again and again on one state of the dam break: the least ns of CPU time per node and call (`fluid_parts`), and what a call "
              "executes per node, counted instruction by instruction (`fluid_parts 33 instructions`).", ""]
    lines += table_of_parts(args.parts)
    page = PAGE.read_text()
    PAGE.write_text("\n".join([*lines, "", page[page.index(BELOW):]]))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
