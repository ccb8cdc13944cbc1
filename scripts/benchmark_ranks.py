#!/usr/bin/env python3
"""The fluid on one and on two ranks, act by act, and a model of more ranks made of it.

    scripts/benchmark ranks [--nodes 1e5] [--steps 120] [--pairs 5]

Writes docs/benchmarks/scaling.md. Runs with one and two ranks alternate; medians. Acts are processor time of the slowest rank
without its waiting, so that they can be measured on a machine on which others compute; the clock on the wall cannot.
"""
import argparse
import json
import math
import os
import statistics
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MPIRUN = ["mpirun", "--oversubscribe", "--bind-to", "none", "--mca", "mpi_yield_when_idle", "1"]
ENVIRONMENT = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1", OMP_WAIT_POLICY="passive")
# The network of the model, per rank, and how often a splashing dam break remeshes (docs/benchmarks/fluid_speed.md).
LATENCY, BANDWIDTH, STEPS_PER_REMESH = 2e-6, 5e9, 33
GATHERED = {2: 104, 3: 128}  # bytes of a node that a remesh gathers


def measure(ranks, resolution, steps, dim):
    line = [*MPIRUN, "-n", str(ranks), str(ROOT / "build/release/bin/ranks_speed"), str(resolution), str(steps), str(dim)]
    return json.loads(subprocess.run(line, env=ENVIRONMENT, capture_output=True, text=True, check=True).stdout)


def pairs(count, resolution, steps, dim):
    """Medians of alternating runs: {1: acts, 2: acts}, with seconds per remesh and the efficiency of each pair."""
    rows = {1: [], 2: []}
    for _ in range(count):
        for ranks in (1, 2):
            row = measure(ranks, resolution, steps, dim)
            row["per_remesh_s"] = row["remesh_s"] * steps / max(1, row["remeshes"])
            row["per_gather_s"] = row["gather_s"] * steps / max(1, row["remeshes"])
            rows[ranks].append(row)
    return {r: {k: statistics.median(row[k] for row in rows[r]) for k in rows[r][0]} for r in rows}


def model(one, two, n, dim, ranks):
    """(share, halo, reductions, remesh) seconds per step at n nodes on so many ranks."""
    measured = one["nodes"]
    layer = n ** ((dim - 1) / dim) / measured ** ((dim - 1) / dim)  # nodes of a cut, over those that were measured
    work = (one["step_s"] + one["bound_s"]) / measured
    beside = max(0.0, 2 * (two["step_s"] + two["bound_s"]) - (one["step_s"] + one["bound_s"]))  # of one cut, both sides
    cuts = 0 if ranks == 1 else 1 if ranks == 2 else 2
    halo = cuts * (2 * LATENCY + two["bytes"] * layer / BANDWIDTH)
    reductions = (1 / 4 + 1 / 8) * 2 * math.ceil(math.log2(ranks)) * LATENCY if ranks > 1 else 0.0
    gather = n * GATHERED[dim] / BANDWIDTH if ranks > 1 else 0.0
    return (work * n / ranks + cuts * 0.5 * beside * layer, halo, reductions,
            (one["per_remesh_s"] * n / measured + gather) / STEPS_PER_REMESH)


def table(one, two, n, dim):
    lines = ["| ranks | layers of nodes each | step [ms] | of it halo | reductions | remesh | efficiency of the step alone | of all |",
             "| --- | --- | --- | --- | --- | --- | --- | --- |"]
    first = model(one, two, n, dim, 1)
    for ranks in (1, 2, 4, 8, 16, 64, 256, 1024, 4096):
        layers = n ** (1 / dim) / ranks
        if layers < 2.0:
            lines.append(f"| {ranks} | {layers:.1f} | - | | | | not possible: less than the two layers of a row | |")
            break
        work, halo, reductions, remesh = model(one, two, n, dim, ranks)
        whole = work + halo + reductions + remesh
        lines.append(f"| {ranks} | {layers:.0f} | {1e3 * whole:.3g} | {100 * halo / whole:.2g} % | {100 * reductions / whole:.2g} % | "
                     f"{100 * remesh / whole:.0f} % | {first[0] / ranks / (work + halo + reductions):.2f} | {sum(first) / ranks / whole:.2f} |")
    return lines


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--nodes", type=float, default=1e5)
    p.add_argument("--steps", type=int, default=120)
    p.add_argument("--pairs", type=int, default=5)
    args = p.parse_args()
    out = ["# The fluid on several ranks", "",
           "Each rank steps a range of nodes; ranks exchange ghosts twice a step; every rank makes the whole remesh ([theory](../theory.md)). Milliseconds of processor time per step of the slowest "
           f"rank, without waiting, medians of {args.pairs} alternating runs of {args.steps} steps. The mesh is made anew every 20 steps here; \"all\" is with a remesh every {STEPS_PER_REMESH} steps, as in a "
           f"splash. Load of the machine during the measurement: {os.getloadavg()[1]:.1f} on {os.cpu_count()} cores.", "",
           "| scene | nodes | ranks | step | bound, looks | one gather | one remesh | waiting | wall | halo: messages, kB per step | efficiency of the step | of all |",
           "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"]
    found = {}
    for dim, resolution in ((2, math.sqrt(args.nodes / 2)), (3, (args.nodes / 5) ** (1 / 3))):  # in space a remesh takes long
        rows = found[dim] = pairs(args.pairs, round(resolution, 1), args.steps if dim == 2 else max(21, args.steps // 4), dim)
        one = rows[1]
        step = {r: rows[r]["step_s"] + rows[r]["bound_s"] for r in rows}
        whole = {r: step[r] + (rows[r]["per_remesh_s"] + rows[r]["per_gather_s"]) / STEPS_PER_REMESH for r in rows}
        for r, row in rows.items():
            out.append(f"| {'dam break' if dim == 2 else 'cube in space'} | {row['nodes']:.0f} | {r} | {1e3 * row['step_s']:.3g} | {1e3 * row['bound_s']:.3g} | {1e3 * row['per_gather_s']:.3g} | "
                       f"{1e3 * row['per_remesh_s']:.3g} | {1e3 * row['wait_s']:.3g} | {1e3 * row['wall_s']:.3g} | {row['messages']:.2g}, {row['bytes'] / 1e3:.3g} | "
                       f"{step[1] / r / step[r]:.2f} | {whole[1] / r / whole[r]:.2f} |")
    out += ["", "## A model of more ranks", "",
            f"Work per node and the work beside a cut from the table, two messages per cut and step of the measured size, two reductions each four and eight steps over a tree, network: {1e6 * LATENCY:g} us and "
            f"{BANDWIDTH / 1e9:g} GB/s per rank. Balance is taken as perfect. What two ranks take more than half of one counts as work beside the cut, also where they only took caches and memory from each other and from whoever else used the machine: the efficiency of the step is pessimistic. Ranges of rows are strips, so a cut is as wide as the fluid, and there are no more ranks than half its layers.", ""]
    for n, dim in ((1e5, 2), (1e6, 2), (1e6, 3)):
        out += [f"{n:.0e} nodes {'in the plane' if dim == 2 else 'in space'}:", "", *table(found[dim][1], found[dim][2], n, dim), ""]
    out += ["The remesh, which all ranks make, is the limit from the first ranks on: Amdahl's law. Halo and reductions are not.", "", "Made by `scripts/benchmark ranks`.", ""]
    (ROOT / "docs" / "benchmarks" / "scaling.md").write_text("\n".join(out))
    print("\n".join(out))


if __name__ == "__main__":
    main()
