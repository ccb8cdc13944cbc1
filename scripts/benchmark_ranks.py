#!/usr/bin/python3
"""The fluid on one and on two ranks, act by act, and a model of more ranks made of it; the solid on one and on two.

    scripts/benchmark ranks [--nodes 1e5] [--steps 84] [--pairs 3] [--large 1e6] [--solid]

Writes docs/benchmarks/scaling.md. Runs with one and two ranks alternate; medians. Acts are processor time of the slowest rank
without its waiting, so that they can be measured on a machine on which others compute; the clock on the wall cannot.
"""
import argparse
import ctypes
import json
import math
import os
import statistics
import subprocess
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from lib import launch  # noqa: E402
from lib.launch import MPIRUN, ROOT  # noqa: E402

ENVIRONMENT = dict(launch.ENVIRONMENT, OMP_WAIT_POLICY="passive")
# The network of the model, per rank, and how often a splashing dam break remeshes (docs/benchmarks/fluid_speed.md).
LATENCY, BANDWIDTH, STEPS_PER_REMESH = 2e-6, 5e9, 33
GATHERED = {2: 12 / 25, 3: 40 / 25}  # bytes of a node that a remesh gathers: one in 25 does
FOR_ALL = {2: 0.03e-6, 3: 0.05e-6}  # seconds a node that every rank spends on all nodes in a remesh (estimates: bytes that move; a flat profile of eight ranks)
PAGE = ROOT / "docs" / "benchmarks" / "scaling.md"
SOLID = "# The solid on several ranks"
# Words of solid_ranks_speed, and what they are.
SOLIDS = [("square of Q4", "plane neo_hookean_ln 1e5 200"), ("the same, flowing (J2)", "plane j2 1e5 60"), ("cube of Hex8", "space neo_hookean_ln 2e4 60"),
          ("square of Q4, one wet side", "plane neo_hookean_ln 1e5 200 1"), ("square of Q4, all sides wet", "plane neo_hookean_ln 1e5 200 4")]

SPLIT = ("Every distributed run says it in its summary: `rank_time_s` of `fluid` and `solid` in `summary.json`, a list with a number for each rank, in seconds "
         "on the wall. *compute* is all that is none of the others (files included), *halo* is copying rows of ghosts to and from messages, *remesh* new meshes,"
         " all three without waiting; *imbalance* is what the busiest rank had more of these three than this one, *wait* the rest of what a rank waited: for "
         "messages, for ranks that are late now and early another time, for the coupler, for a core. The five add up to the time of the run, so 1 - (imbalance +"
         " wait)/sum is the part in which a rank worked. The clock is read four times for each exchange of ghosts and twice for each remesh, never per node.")


def measure(ranks, resolution, steps, dim):
    line = [*MPIRUN, "-n", str(ranks), str(ROOT / "build/release/bin/ranks_speed"), str(resolution), str(steps), str(dim)]
    return json.loads(subprocess.run(line, env=ENVIRONMENT, capture_output=True, text=True, check=True).stdout)


def pairs(count, resolution, steps, dim):
    """Medians of alternating runs: {ranks: acts}, with seconds per remesh and of all ranks together."""
    rows = {1: [], 2: [], 8: []}
    for _ in range(count):
        for ranks in rows:
            row = measure(ranks, resolution, steps, dim)
            row["per_remesh_s"] = row["remesh_s"] * steps / max(1, row["remeshes"])
            row["remesh_of_all_s"] = row["all_remesh_s"] * steps / max(1, row["remeshes"])
            rows[ranks].append(row)
    return {r: {k: statistics.median(row[k] for row in rows[r]) for k in rows[r][0]} for r in rows}


def cut_planes(ranks, dim):
    """Cuts of a cube's whole section, and ranks that a rank has beside it: strips in the plane, bisection in space."""
    if dim == 2:
        return ranks - 1, min(ranks - 1, 2)
    parts = [2 ** ((round(math.log2(ranks)) + i) // 3) for i in range(3)]
    return sum(p - 1 for p in parts), math.prod(min(p, 3) for p in parts) - 1


def model(rows, n, dim, ranks):
    """(share, halo, reductions, remesh) seconds per step at n nodes on so many ranks; means over the ranks."""
    one, two, eight = (rows[r] for r in (1, 2, 8))
    measured = one["nodes"]
    layer = n ** ((dim - 1) / dim) / measured ** ((dim - 1) / dim)  # nodes of a cut, over those that were measured
    planes, beside = cut_planes(ranks, dim)
    work = one["all_steps_s"] / measured
    twice = max(0.0, eight["all_steps_s"] - one["all_steps_s"]) / cut_planes(8, dim)[0] * planes * layer  # computed beside cuts
    halo = beside * two["messages"] * LATENCY + two["bytes"] * layer * 2 * planes / ranks / BANDWIDTH
    reductions = (1 / 4 + 1 / 8) * 2 * math.ceil(math.log2(ranks)) * LATENCY if ranks > 1 else 0.0
    gather = n * GATHERED[dim] / BANDWIDTH if ranks > 1 else 0.0
    # A remesh of r ranks takes one's work, what all make for all nodes, and what is made beside each cut: eight ranks tell that.
    more = eight["remesh_of_all_s"] - one["remesh_of_all_s"]
    by_cut = max(0.0, more - 8 * FOR_ALL[dim] * measured) / cut_planes(8, dim)[0]
    by_all = FOR_ALL[dim] * n if ranks > 1 else 0.0
    remesh = (one["remesh_of_all_s"] * n / measured + by_cut * planes * layer) / ranks + by_all
    return (work * n + twice) / ranks, halo, reductions, (remesh + gather) / STEPS_PER_REMESH


def table(rows, n, dim):
    lines = ["| ranks | nodes each | step [ms] | of it halo | reductions | remesh | efficiency of the step alone | of all |",
             "| --- | --- | --- | --- | --- | --- | --- | --- |"]
    first = model(rows, n, dim, 1)
    for ranks in (1, 2, 4, 8, 16, 64, 256, 1024, 4096):
        if dim == 2 and math.sqrt(n) / ranks < 2.0:
            lines.append(f"| {ranks} | {n / ranks:.3g} | - | | | | not possible: less than the two layers of a row | |")
            break
        work, halo, reductions, remesh = model(rows, n, dim, ranks)
        whole = work + halo + reductions + remesh
        lines.append(f"| {ranks} | {n / ranks:.3g} | {1e3 * whole:.3g} | {100 * halo / whole:.2g} % | {100 * reductions / whole:.2g} % | "
                     f"{100 * remesh / whole:.0f} % | {first[0] / ranks / (work + halo + reductions):.2f} | {sum(first) / ranks / whole:.2f} |")
    return lines


def copies(part, edges, ranks):
    """Nodes of which some other rank holds a copy, counted once for each such rank."""
    both = np.concatenate([edges, edges[:, ::-1]])
    cut = part[both[:, 0]] != part[both[:, 1]]
    return len(np.unique(both[cut, 0].astype(np.int64) * ranks + part[both[cut, 1]]))


def solid_model(seconds, n, dim, ranks):
    """(work, halo) seconds per step of a rank inside a square or cube of ranks; `seconds` per element."""
    if ranks == 1:
        return seconds * n, 0.0
    side = (n / ranks) ** ((dim - 1) / dim)  # elements along one side of a part
    return seconds * (n / ranks + dim * side), 2 * dim * (LATENCY + 8 * dim * side / BANDWIDTH)


def solid_section(count):
    """Efficiency of two ranks of the solid, from alternating runs."""
    lines = [SOLID, "", "Each rank computes the elements of its nodes (METIS); displacements of copied nodes travel once a step ([theory](../theory.md)). Milliseconds per step of the slowest rank: processor time without "
             f"waiting, and the clock on the wall; medians of blocks of 20 steps and of {count} alternating runs; the efficiency is the median of the pairs. Load of the machine: {os.getloadavg()[1]:.1f} on "
             f"{os.cpu_count()} cores before; the clock on the wall says something where it was below 1.", "",
             "| solid | elements | wet nodes | ranks | step | imbalance | wall | one look at the bound | halo: messages, kB per step | efficiency of the step | on the wall |",
             "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"]
    per_element = {}
    for name, words in SOLIDS:
        rows = {1: [], 2: []}
        for _ in range(count):
            for ranks in rows:
                line = [*MPIRUN, "-n", str(ranks), str(ROOT / "build/release/bin/solid_ranks_speed"), *words.split()]
                rows[ranks].append(json.loads(subprocess.run(line, env=ENVIRONMENT, capture_output=True, text=True, check=True).stdout))
        for ranks, of in rows.items():
            row = {k: statistics.median(r[k] for r in of) for k in of[0]}
            if ranks == 1:
                per_element.setdefault(words[:5], row["step_s"] / row["elements"])
            gain = [statistics.median(one[k] / ranks / some[k] for one, some in zip(rows[1], of)) for k in ("step_s", "wall_s")]
            lines.append(f"| {name} | {row['elements']:.0f} | {row['wet']:.0f} | {ranks} | {1e3 * row['step_s']:.3g} | {100 * row['imbalance']:.2g} % | {1e3 * row['wall_s']:.3g} | {1e3 * row['look_s']:.3g} | "
                         f"{row['messages']:.2g}, {row['bytes'] / 1e3:.3g} | {gain[0]:.2f} | {gain[1]:.2f} |")
    lines += ["", "The efficiency is that of elements at the cut, computed on both sides, and of what ranks take from each other's memory. Interfaces cost no message more: wet nodes are rank 0's, which "
              "has fewer others; it is the limit where they are more than their share (a square of n² elements, wet all round: n/4 ranks; a thin gate: two or three).", "",
              "A model of more ranks: an inner part of a square or cube of ranks has the elements of its share and one more layer on half of its sides, and sends to as many neighbours as it has sides; work per element from "
              f"the table, {1e6 * LATENCY:g} us and {BANDWIDTH / 1e9:g} GB/s per rank. Efficiency of the step, and the part of the halo in it:", "",
              "| ranks | 1e5 Q4 | 1e6 Q4 | 1e6 Hex8 |", "| --- | --- | --- | --- |"]
    for ranks in (4, 16, 64, 256, 1024, 4096):
        cells = []
        for n, dim, kind in ((1e5, 2, "plane"), (1e6, 2, "plane"), (1e6, 3, "space")):
            work, halo = solid_model(per_element[kind], n, dim, ranks)
            cells.append(f"{per_element[kind] * n / ranks / (work + halo):.2f}, {100 * halo / (work + halo):.2g} %")
        lines.append(f"| {ranks} | " + " | ".join(cells) + " |")
    return lines + ["", "The step is not what limits: every rank makes the whole solid at the start (10 us per Q4, once) and holds the rows of all nodes (200 bytes in the plane, 300 in space), and frames and checkpoints pass "
                    "through all ranks. So 1e7 elements or some hundred ranks are the largest sensible run; beyond, a rank must be made from its part of the mesh.", "", "Made by `scripts/benchmark ranks --solid`.", ""]


def metis(n, edges, ranks):
    both = np.concatenate([edges, edges[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    first = np.concatenate([[0], np.cumsum(np.bincount(both[:, 0], minlength=n))]).astype(np.int32)
    neighbour, part = both[:, 1].astype(np.int32), np.zeros(n, np.int32)
    pointer = lambda a: a.ctypes.data_as(ctypes.c_void_p)
    number = lambda k: ctypes.byref(ctypes.c_int32(k))
    code = ctypes.CDLL("libmetis.so.5").METIS_PartGraphKway(number(n), number(1), pointer(first), pointer(neighbour), None, None, None, number(ranks),
                                                            None, None, None, number(0), pointer(part))
    assert code == 1, "METIS"
    return part


def bisection(place):
    """Numbers of the boxes of points, as fluid_pfem/remesh/bisection.cpp makes them."""
    number, levels = np.zeros(len(place), int), 0
    while len(place) >> levels > 16:
        levels += 1

    def cut(points, level):
        if level == levels or not len(points):
            return
        x = place[points]
        axis = int(np.argmax(x.max(axis=0) - x.min(axis=0)))
        second = x[:, axis] >= np.sort(x[:, axis])[len(points) // 2]
        number[points[second]] += 1 << (levels - 1 - level)
        cut(points[~second], level + 1)
        cut(points[second], level + 1)
    cut(np.arange(len(place)), 0)
    return number


def cuts():
    """Copies of nodes: ranges of the fluid's order (rows along the longest axis, in space boxes) against METIS, on lattices of simplices."""
    lines = ["| lattice | nodes | " + " | ".join(f"{r} ranks" for r in (2, 4, 8, 16, 64)) + " |", "| --- | --- |" + " --- |" * 5]
    for name, size in (("column", (240, 480)), ("tank", (640, 160)), ("cube", (46, 46, 46))):
        dim, n = len(size), int(np.prod(size))
        place = np.stack(np.unravel_index(np.arange(n), size[::-1])[::-1], 1)  # the first axis fastest
        edges = []
        for step in range(1, 2 ** dim):  # Kuhn's simplices: along the axes and the positive diagonals
            to = place + [step >> k & 1 for k in range(dim)]
            inside = (to < size).all(axis=1)
            edges.append(np.stack([np.flatnonzero(inside), np.ravel_multi_index(to[inside].T[::-1], size[::-1])], 1))
        edges = np.concatenate(edges)
        slow = int(np.argmax(place.var(axis=0)))
        keys = [place[:, (slow - k) % dim] // 2 for k in range(dim)]
        orders = [np.lexsort([np.arange(n), *keys[::-1]]), np.lexsort([np.arange(n), bisection(place)])]
        found = []
        for ranks in (2, 4, 8, 16, 64):
            parts = [np.empty(n, int) for _ in orders]
            for part, order in zip(parts, orders):
                part[order] = np.arange(n) * ranks // n
            found.append(", ".join(f"{100 * copies(part, edges, ranks) / n:.3g}" for part in (*parts, metis(n, edges, ranks))) + " %")
        lines.append(f"| {name} {' x '.join(map(str, size))} | {n} | " + " | ".join(found) + " |")
    return lines


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--nodes", type=float, default=1e5)
    p.add_argument("--large", type=float, default=1e6, help="nodes of a second, larger dam break; 0: none")
    p.add_argument("--steps", type=int, default=84)
    p.add_argument("--pairs", type=int, default=3)
    p.add_argument("--solid", action="store_true", help="measure the solid, and leave what the page says of the fluid")
    args = p.parse_args()
    fluid, _, solid = PAGE.read_text().partition(SOLID)
    if args.solid:
        PAGE.write_text(fluid + "\n".join(solid_section(args.pairs)))
        return
    out = ["# The fluid on several ranks", "",
           "Each rank steps a range of nodes; ranks exchange ghosts twice a step, in the plane those of several steps at once; in a remesh each triangulates its nodes and what they see ([theory](../theory.md)). Milliseconds of processor time per step of the slowest "
           f"rank, without waiting, medians of {args.pairs} alternating runs of {args.steps} steps after the first remesh. The mesh is made anew every 20 steps here; \"all\" is with a remesh every {STEPS_PER_REMESH} steps, as in a "
           f"splash. Waiting: for others, and for what all gather. Work is the work of one rank over that of both together, without imbalance: what is not computed twice. "
           f"Load of the machine during the measurement: {os.getloadavg()[1]:.1f} on {os.cpu_count()} cores.", "",
           "| scene | nodes | ranks | step | bound, looks | one remesh | waiting | imbalance | wall | halo: messages, kB per step | efficiency of the step | of all | work: steps | all | memory of a rank [MB] |",
           "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"]
    scenes = [(2, math.sqrt(args.nodes / 2), args.steps), (3, (args.nodes / 5) ** (1 / 3), max(21, args.steps // 4))]  # in space a remesh takes long
    if args.large > 0:
        scenes.insert(0, (2, math.sqrt(args.large / 2), max(21, args.steps // 2)))
    found = {}
    for dim, resolution, steps in scenes:
        rows = found[dim] = pairs(args.pairs, round(resolution, 1), steps, dim)
        step = {r: rows[r]["step_s"] + rows[r]["bound_s"] for r in rows}
        whole = {r: step[r] + rows[r]["per_remesh_s"] / STEPS_PER_REMESH for r in rows}
        work = {r: rows[r]["all_steps_s"] for r in rows}
        all_work = {r: work[r] + rows[r]["remesh_of_all_s"] / STEPS_PER_REMESH for r in rows}
        for r, row in rows.items():
            out.append(f"| {'dam break' if dim == 2 else 'cube in space'} | {row['nodes']:.0f} | {r} | {1e3 * row['step_s']:.3g} | {1e3 * row['bound_s']:.3g} | "
                       f"{1e3 * row['per_remesh_s']:.3g} | {1e3 * row['wait_s']:.3g} | {100 * row['imbalance']:.2g} % | {1e3 * row['wall_s']:.3g} | {row['messages']:.2g}, {row['bytes'] / 1e3:.3g} | "
                       f"{step[1] / r / step[r]:.2f} | {whole[1] / r / whole[r]:.2f} | {work[1] / work[r]:.2f} | {all_work[1] / all_work[r]:.2f} | {row['peak_MB']:.3g} |")
    out += ["", "## Where the time goes", "", SPLIT, "", "Of two ranks, milliseconds per step, mean of both, a remesh every 21 steps:", "",
            "| nodes | wall | compute | halo | remesh | imbalance | wait |", "| --- | --- | --- | --- | --- | --- | --- |"]
    for rows in found.values():
        row = rows[2]
        out.append(f"| {row['nodes']:.0f} | " + " | ".join(f"{1e3 * row[key]:.3g}" for key in ("wall_s", *(f"wall_{part}_s" for part in ("compute", "halo", "remesh", "imbalance", "wait")))) + " |")
    out += ["", "## A model of more ranks", "",
            f"Work per node and in a remesh from the table: what eight ranks compute more than one is beside seven cuts (in space three), but for what every rank makes in a remesh for all nodes ({1e6 * FOR_ALL[2]:g} us a node in the plane, {1e6 * FOR_ALL[3]:g} in space, estimated). Messages of the measured size, "
            f"to each neighbour (two in the plane, up to 26 in space) as many in a step as two ranks send each other, several steps to a message in the plane, two reductions each four and eight steps over a tree, network: {1e6 * LATENCY:g} us and {BANDWIDTH / 1e9:g} GB/s per rank. Means over the ranks. In the plane ranges of rows are strips, so a cut is as wide as the fluid, and there are no more ranks than half "
            "its layers; in space ranges of the bisection are boxes.", ""]
    for n, dim in ((1e5, 2), (1e6, 2), (1e6, 3)):
        out += [f"{n:.0e} nodes {'in the plane' if dim == 2 else 'in space'}:", "", *table(found[dim], n, dim), ""]
    out += ["## The order of the nodes, or METIS", "",
            "Copies of nodes that ranks hold, in percent of all nodes: ranges of rows across the longest axis of the fluid (the order of the nodes in the plane), ranges of recursive coordinate bisection (their order in space), METIS k-way on the same graph.", "",
            *cuts(), "", "Made by `scripts/benchmark ranks`.", ""]
    PAGE.write_text("\n".join(out) + ("\n" + SOLID + solid if solid else ""))
    print("\n".join(out))


if __name__ == "__main__":
    main()
