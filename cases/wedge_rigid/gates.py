#!/usr/bin/python3
"""What the rigid wedge must show between 0.5 and 1 ms, from the frames and histories of runs of this case.

    cases/wedge_rigid/gates.py DIR...      with frames every 20 us: scripts/run cases/wedge_rigid --out DIR --set output.every=2e-5

force      F/(107 rho V^3 t), contact impulse over time; and the standard deviation of its means over 20 us
apex       mean pressure of the nodes on the wedge with x < 30 mm [MPa]
jet root   place of the largest pressure on the wedge over that of the incompressible similarity solution, 1.5556 V t / tan 10 deg
p(1.2)     pressure on the wedge at x = 1.2 V t / tan 10 deg over 0.5 rho V^2
noise      rms of a node's pressure minus the mean of its neighbours, inside the water 10 to 50 mm below the face, x < V t / tan 10 deg [MPa]
momentum   downward momentum of the water over the contact impulse, at 0.75 ms
energy     kinetic and internal energy of the water over the work of the wedge, at 1 ms
"""
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from lib import compare, frames  # noqa: E402

RHO, V, TAN = 1000.0, 30.0, np.tan(np.radians(10.0))
BEGIN, END = 0.5e-3, 1e-3


def neighbour_means(points, cells, values):
    total, count = np.zeros(len(points)), np.zeros(len(points))
    for a, b in ((0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)):
        np.add.at(total, cells[:, a], values[cells[:, b]])
        np.add.at(count, cells[:, a], 1.0)
    return total / np.maximum(count, 1.0)


def measure(out):
    force = compare.read_csv(out / "history" / "force.csv")
    inside = (force["t[s]"] > BEGIN) & (force["t[s]"] <= END + 1e-9)
    middle = force["t[s]"] - 0.5 * np.gradient(force["t[s]"])
    ratio = (force["F_y[N]"] / (107.0 * RHO * V**3 * middle))[inside]
    found = frames.Frames(out / "fluid.h5")
    apex, root, at_12, noise, momentum = [], [], [], [], None
    for index, t in enumerate(found.times):
        if t < BEGIN - 1e-9 or t > END + 1e-9:
            continue
        frame = found.read(index)
        x, y = frame.points[:, 0], frame.points[:, 1]
        p = frame.scalar("pressure")
        cells = frame.triangles()
        ahead = (x * TAN - V * t - y) * np.cos(np.radians(10.0))  # distance from the face
        on = (ahead < 5e-5) & (x <= 0.6)
        order = np.argsort(x[on])
        xs, ps = x[on][order], p[on][order]
        apex.append(ps[xs < 0.03].mean())
        root.append(xs[np.argmax(ps)] / (1.5556 * V * t / TAN))
        at_12.append(np.interp(1.2 * V * t / TAN, xs, ps) / (0.5 * RHO * V * V))
        boundary = np.zeros(len(p), bool)
        boundary[frame.outline()] = True
        below = ~boundary & (ahead < 0.05) & (ahead > 0.01) & (x < V * t / TAN)
        noise.append(np.sqrt(np.mean((p - neighbour_means(frame.points, cells, p))[below] ** 2)))
        if abs(t - 0.75e-3) < 1.1e-5 and momentum is None:
            a, b, c = (frame.points[cells[:, k]] for k in range(3))
            area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
            v, rho = frame.fields["velocity"][:, 1], frame.scalar("density")
            down = -np.sum(area * rho[cells].mean(axis=1) * v[cells].mean(axis=1))
            steps = np.diff(np.concatenate(([0.0], force["t[s]"])))
            upto = force["t[s]"] <= t + 1e-9
            momentum = down / np.sum((force["F_y[N]"] * steps)[upto])
    energy = compare.read_csv(out / "history" / "fluid_energy.csv")
    share = (energy["kinetic[J]"] + energy["internal[J]"])[-1] / energy["wall_work[J]"][-1]
    return ratio.mean(), ratio.std(), np.mean(apex) / 1e6, np.mean(root), np.mean(at_12), np.mean(noise) / 1e6, momentum, share


print("| run | force | +- | apex [MPa] | jet root | p(1.2) | noise [MPa] | momentum | energy |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
for name in sys.argv[1:]:
    print(f"| {Path(name).name} | " + " | ".join(f"{value:.3f}" for value in measure(Path(name))) + " |")
