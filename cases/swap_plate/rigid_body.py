#!/usr/bin/python3
"""A rigid body on springs and dampers at level A of the protocol; it can be stopped and continued.

Started by scripts/run as: rigid_body.py [--damper C] case.toml --out DIR. It heaves and pitches on a spring and a damper under
each end; both are oscillators under a constant force and moment, integrated exactly over a window.
"""
import argparse
import json
import os

import numpy as np
import undine_link

undine_link.arm("solid")
N, WIDTH, M = 9, 0.1, 1000.0  # nodes along the body, [m], mass per area [kg/m2]
K, G = 1e9, -10.0             # springs per area [N/m3], half under each end; gravity [m/s2]

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--damper", type=float, default=0.0, help="dampers per area, half under each end [N s/m3]")
parser.add_argument("case")
parser.add_argument("--out", default=".")
arguments = parser.parse_known_args()[0]


def oscillate(m, k, c, f, u, v, dt):
    """Displacement and velocity of m u'' + c u' + k u = f after dt (less than critically damped)."""
    decay, rest = c / (2 * m), f / k
    omega = np.sqrt(k / m - decay**2)
    d, e, cos, sin = u - rest, np.exp(-decay * dt), np.cos(omega * dt), np.sin(omega * dt)
    rate = (v + decay * d) / omega
    return rest + e * (d * cos + rate * sin), e * (v * cos - (decay * rate + omega * d) * sin)


with undine_link.Link("solid", "rigid body in Python, forces in", out_dir=arguments.out, force_in=True) as link:
    state = {"u": 0.0, "v": 0.0, "angle": 0.0, "spin": 0.0, "steps": 0, "history": 0}
    path = f"{arguments.out}/history/interface.csv"

    def save(folder):
        state["history"] = history.tell()
        with open(f"{folder}/solid.json", "w") as file:
            json.dump(state, file)  # Python writes every double so that it comes back with all its bits
        return "solid.json"

    link.offer_checkpoints(save)
    setup = link.receive_setup()
    if link.restart_folder():
        with open(f"{link.restart_folder()}/solid.json") as file:
            state = json.load(file)
        history = open(path, "r+")
        history.truncate(state["history"])
        history.seek(0, os.SEEK_END)
    else:
        history = open(path, "w")
        history.write(f"t[s],u_y[m],v_y[m/s],angle[rad]\n{setup.t_begin:.9g},0,0,0\n")

    mass, inertia = M * WIDTH, M * WIDTH**3 / 12
    k, c = K * WIDTH, arguments.damper * WIDTH
    k_turn, c_turn = (WIDTH / 2)**2 * k, (WIDTH / 2)**2 * c
    arm = WIDTH * (np.arange(N) / (N - 1) - 0.5)
    length = np.full(N, WIDTH / (N - 1))
    length[[0, -1]] *= 0.5

    def place():
        """Positions and velocities of the nodes."""
        cos, sin = np.cos(state["angle"]), np.sin(state["angle"])
        x = np.stack([WIDTH / 2 + arm * cos, state["u"] + arm * sin], axis=1)
        return x, np.stack([-state["spin"] * arm * sin, state["v"] + state["spin"] * arm * cos], axis=1)

    x, v = place()
    link.set_nodes(x, M * length)
    link.add_faces("wet", [[n, n - 1] for n in range(1, N)])  # the body lies to the left, below
    link.send_surface()
    stable_dt = 0.1 / np.sqrt(K / M)
    link.send_motion(x, v)
    link.send_report(stable_dt, steps=state["steps"], mass=mass)
    for window in link.windows():
        f = link.receive_link_force()
        x, _ = place()
        moment = float(np.sum((x[:, 0] - WIDTH / 2) * f[:, 1] - (x[:, 1] - state["u"]) * f[:, 0]))
        state["u"], state["v"] = map(float, oscillate(mass, k, c, mass * G + float(f[:, 1].sum()), state["u"], state["v"], window.dt))
        state["angle"], state["spin"] = map(float, oscillate(inertia, k_turn, c_turn, moment, state["angle"], state["spin"], window.dt))
        state["steps"] += window.steps
        history.write(f"{window.t_end:.9g},{state['u']:.17g},{state['v']:.17g},{state['angle']:.17g}\n")
        history.flush()
        link.send_motion(*place())
        link.send_report(stable_dt, steps=state["steps"], mass=mass,
                         kinetic_energy=0.5 * (mass * state["v"]**2 + inertia * state["spin"]**2),
                         internal_energy=0.5 * (k * state["u"]**2 + k_turn * state["angle"]**2), external_work=G * mass * state["u"])
    history.close()
