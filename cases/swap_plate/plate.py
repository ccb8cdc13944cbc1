#!/usr/bin/python3
"""A plate on springs as a solid of its own, in Python: the smallest program behind the coupling protocol.

Started by scripts/run as: plate.py case.toml --out DIR
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

with undine_link.Link("solid", "plate in Python", out_dir=out) as link:
    setup = link.receive_setup()
    length = np.full(N, WIDTH / (N - 1))
    length[[0, -1]] *= 0.5
    mass, spring = M * length, K * length
    x = np.stack([WIDTH * np.arange(N) / (N - 1), np.zeros(N)], axis=1)
    fixed = np.tile([1, 0], (N, 1))
    link.set_nodes(x, mass, fixed)
    link.add_faces("wet", [[n, n - 1] for n in range(1, N)])  # the plate lies to the left, below
    link.send_surface()

    u, v = np.zeros((N, 2)), np.zeros((N, 2))
    a = np.tile([0.0, G], (N, 1))  # at rest, springs relaxed
    steps, stable_dt = 0, 0.9 * 2.0 / np.sqrt(K / M)
    with open(f"{out}/history/interface.csv", "w", buffering=1) as history:
        history.write(f"t[s],u_y[m],v_y[m/s]\n{setup.t_begin:.9g},0,0\n")
        link.send_report(stable_dt, mass=mass.sum())
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
            history.write(f"{window.t_end:.9g},{u[N // 2, 1]:.17g},{v[N // 2, 1]:.17g}\n")
            link.send_report(stable_dt, steps=steps, mass=mass.sum(), kinetic_energy=0.5 * (mass @ v[:, 1]**2),
                             internal_energy=0.5 * (spring @ u[:, 1]**2), external_work=G * (mass @ u[:, 1]))
