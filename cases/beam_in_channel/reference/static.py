#!/usr/bin/python3
"""Cantilever of Euler and Bernoulli between two waters at rest, levels and deflection together: writes static.csv beside this file."""
from pathlib import Path

import numpy as np

RHO, G, E, THICKNESS, LENGTH, HALF = 1000.0, 9.81, 2.0e9, 0.01, 0.4, 0.3
LEFT, RIGHT = 0.3 * 0.295, 0.2 * 0.295  # m^2 of water
y = np.linspace(0.0, LENGTH, 4001)
step = y[1] - y[0]


def integral(f):
    return np.concatenate(([0.0], np.cumsum(0.5 * (f[1:] + f[:-1]) * step)))


w = np.zeros_like(y)
for _ in range(100):
    def level(area, sign):
        depth = area / (HALF - 0.5 * THICKNESS)
        for _ in range(50):
            depth = (area - sign * np.interp(depth, y, integral(w))) / (HALF - 0.5 * THICKNESS)
        return depth
    left, right = level(LEFT, 1.0), level(RIGHT, -1.0)
    load = RHO * G * (np.maximum(left - y, 0.0) - np.maximum(right - y, 0.0))
    shear = integral(load)[-1] - integral(load)
    moment = integral(shear)[-1] - integral(shear)
    w = integral(integral(12.0 * moment / (E * THICKNESS**3)))
print(f"levels {left:.5f}, {right:.5f} m, top {1e3 * w[-1]:.4f} mm, force {integral(load)[-1]:.2f} N/m")
text = "# Top of a cantilever of Euler and Bernoulli at rest between two waters (static.py)\nt_s,u_m\n"
(Path(__file__).parent / "static.csv").write_text(text + "".join(f"{t},{w[-1]:.6e}\n" for t in (0.0, 1.0, 2.0)))
