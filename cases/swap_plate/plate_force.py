#!/usr/bin/python3
"""The plate on springs at level A of the protocol: it takes nodal forces and returns positions and velocities.

Started by scripts/run as: plate_force.py [--mass M] case.toml --out DIR. Any code that can do this can be the solid. This one
integrates each window exactly: an oscillator under a constant force.
"""
import argparse

import numpy as np
import undine_link

undine_link.arm("solid")
N, WIDTH = 9, 0.1   # nodes along the plate, [m]
K, G = 1e9, -10.0   # springs per area [N/m3], gravity [m/s2]

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--mass", type=float, default=1000.0, help="mass per area [kg/m2]")
parser.add_argument("case")
parser.add_argument("--out", default=".")
arguments = parser.parse_known_args()[0]
M, out = arguments.mass, arguments.out

with undine_link.Link("solid", "plate in Python, forces in", out_dir=out, force_in=True) as link:
    setup = link.receive_setup()
    length = np.full(N, WIDTH / (N - 1))
    length[[0, -1]] *= 0.5
    mass, spring, omega = M * length, K * length, np.sqrt(K / M)
    x = np.stack([WIDTH * np.arange(N) / (N - 1), np.zeros(N)], axis=1)
    link.set_nodes(x, mass, np.tile([1, 0], (N, 1)))
    link.add_faces("wet", [[n, n - 1] for n in range(1, N)])  # the plate lies to the left, below
    link.send_surface()

    u, v = np.zeros((N, 2)), np.zeros((N, 2))  # at rest, springs relaxed
    steps, stable_dt = 0, 0.1 / omega
    with open(f"{out}/history/interface.csv", "w", buffering=1) as history:
        history.write(f"t[s],u_y[m],v_y[m/s]\n{setup.t_begin:.9g},0,0\n")
        link.send_motion(x + u, v)
        link.send_report(stable_dt, mass=mass.sum())
        for window in link.windows():
            f = link.receive_link_force()
            rest = (mass * G + f[:, 1]) / spring  # position of equilibrium under this force
            c, s = np.cos(omega * window.dt), np.sin(omega * window.dt)
            d = u[:, 1] - rest
            u[:, 1], v[:, 1] = rest + c * d + s / omega * v[:, 1], c * v[:, 1] - omega * s * d
            steps += window.steps
            history.write(f"{window.t_end:.9g},{u[N // 2, 1]:.17g},{v[N // 2, 1]:.17g}\n")
            link.send_motion(x + u, v)
            link.send_report(stable_dt, steps=steps, mass=mass.sum(), kinetic_energy=0.5 * (mass @ v[:, 1]**2),
                             internal_energy=0.5 * (spring @ u[:, 1]**2), external_work=G * (mass @ u[:, 1]))
