#!/usr/bin/python3
"""The plate of plate.py on several ranks: each has a stretch of nodes and talks to the coupler of these itself.

Started by scripts/run as: plate_ranks.py case.toml --out DIR          (scripts/run ... --ranks solid=3)
"""
import argparse

import numpy as np
import undine_link

undine_link.arm("solid")
N, WIDTH = 9, 0.1          # nodes along the plate, [m]
M, K, G = 1000.0, 1e9, -10.0  # mass and springs per area [kg/m2, N/m3], gravity [m/s2]

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("case")
parser.add_argument("--out", default=".")
out = parser.parse_known_args()[0].out

with undine_link.Link("solid", "plate in Python on several ranks", out_dir=out, distributed=True) as link:
    rank, size = link.comm.Get_rank(), link.comm.Get_size()
    setup = link.receive_setup()
    length = np.full(N, WIDTH / (N - 1))
    length[[0, -1]] *= 0.5
    mine = np.array_split(np.arange(N), size)[rank]  # more ranks than nodes: the last ones have none
    n = len(mine)
    mass, spring = M * length[mine], K * length[mine]
    x = np.stack([WIDTH * mine / (N - 1), np.zeros(n)], axis=1)
    link.set_nodes(x, mass, np.tile([1, 0], (n, 1)), node_id=mine)
    edges = [[k, k - 1] for k in mine if k > 0]  # node k - 1 may be another rank's
    link.add_faces_by_id("wet", np.array(edges, dtype=np.int64).reshape(-1, 2))
    link.send_surface()

    u, v = np.zeros((n, 2)), np.zeros((n, 2))
    a = np.tile([0.0, G], (n, 1))  # at rest, springs relaxed
    steps, stable_dt = 0, 0.9 * 2.0 / np.sqrt(K / M)
    middle = np.flatnonzero(mine == N // 2)
    history = open(f"{out}/history/interface.csv", "w", buffering=1) if len(middle) else None
    if history:
        history.write(f"t[s],u_y[m],v_y[m/s]\n{setup.t_begin:.9g},0,0\n")

    def report():
        """All ranks call it with the sums over all; only rank 0 needs them."""
        parts = [mass.sum(), 0.5 * (mass @ v[:, 1]**2), 0.5 * (spring @ u[:, 1]**2), G * (mass @ u[:, 1])]
        total = np.sum(link.comm.allgather(parts), axis=0)
        link.send_report(stable_dt, steps=steps, mass=total[0], kinetic_energy=total[1], internal_energy=total[2],
                         external_work=total[3])

    report()
    for window in link.windows():
        dt = window.dt
        if window.activate:
            impulse, f = link.activate(v, a)
            v[:, 1] += impulse[:, 1] / mass
            a[:, 1] += f[:, 1] / mass
        for j in range(1, window.steps + 1):
            v += 0.5 * dt * a
            u += dt * v
            a[:, 1] = G - spring * u[:, 1] / mass
            v += 0.5 * dt * a
            if window.fine or j == window.steps:
                f = link.exchange(v)
                a[:, 1] += f[:, 1] / mass
                v[:, 1] += 0.5 * dt * f[:, 1] / mass
        steps += window.steps
        if history:
            k = middle[0]
            history.write(f"{window.t_end:.9g},{u[k, 1]:.17g},{v[k, 1]:.17g}\n")
        report()
