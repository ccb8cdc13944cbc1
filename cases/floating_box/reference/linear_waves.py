#!/usr/bin/python3
"""Heave of the box by linear potential flow: writes linear_waves.csv beside this file.

Incompressible, inviscid, small motion about the floating position: level 0.254 m, bottom 0.204 m, draught 0.05 m. Unknowns are the elevation
eta of the free surface and the heave y of the box. The potential solves Laplace's equation with the flux of both; its kinetic energy and
the potential energy 1/2 rho g (int eta^2 dx + B y^2) give an eigenvalue problem. Bilinear elements on the right half of the tank.
"""
from pathlib import Path

import numpy as np

G, RHO = 9.81, 1000.0
TANK, BOX, LEVEL, BOTTOM = 0.25, 0.1, 0.254, 0.204  # m, half widths
MASS = 0.5 * RHO * BOX * 0.1                        # kg/m, half the box
START = {"level": -0.004, "box": 0.006}             # m above rest


def modes(n):
    """Angular frequencies, amplitudes of the heave: y(t) = sum a cos(w t). n elements over half the box."""
    x = np.linspace(0.0, TANK, round(TANK / BOX * n) + 1)
    below = round(BOTTOM / BOX * n)
    z = np.concatenate([np.linspace(0.0, BOTTOM, below + 1), np.linspace(BOTTOM, LEVEL, n // 2 + 1)[1:]])
    water = lambda i, j: j <= below or i >= n
    number = {}
    for j in range(len(z)):
        for i in range(len(x)):
            if water(i, j):
                number[i, j] = len(number)
    K = np.zeros((len(number), len(number)))
    for j in range(len(z) - 1):
        for i in range(len(x) - 1):
            if j >= below and i < n:
                continue
            corners = [number[c] for c in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))]
            a, b = x[i + 1] - x[i], z[j + 1] - z[j]
            K[np.ix_(corners, corners)] += (b / a / 6 * np.array([[2, -2, -1, 1], [-2, 2, 1, -1], [-1, 1, 2, -2], [1, -1, -2, 2]])
                                            + a / b / 6 * np.array([[2, 1, -1, -2], [1, 2, -2, -1], [-1, -2, 2, 1], [-2, -1, 1, 2]]))
    m = len(x) - n  # nodes of the free surface
    B = np.zeros((m, m))
    for k in range(m - 1):
        B[k:k + 2, k:k + 2] += (x[1] - x[0]) / 6 * np.array([[2, 1], [1, 2]])
    flux = np.zeros((len(number), m + 1))
    for k in range(m):
        flux[number[n + k, len(z) - 1], :m] = B[k]
    for i in range(n):
        flux[number[i, below], m] += 0.5 * (x[1] - x[0])
        flux[number[i + 1, below], m] += 0.5 * (x[1] - x[0])
    keeps_volume = np.linalg.svd(flux.sum(axis=0)[None, :])[2][1:].T
    K[0] = 0.0  # the potential is known up to a constant
    K[0, 0] = 1.0
    f = flux @ keeps_volume
    right = f.copy()
    right[0] = 0.0
    M = RHO * f.T @ np.linalg.solve(K, right) + MASS * np.outer(keeps_volume[m], keeps_volume[m])
    S = np.zeros((m + 1, m + 1))
    S[:m, :m] = B
    S[m, m] = BOX
    S = RHO * G * keeps_volume.T @ S @ keeps_volume
    L = np.linalg.inv(np.linalg.cholesky(0.5 * (M + M.T)))
    w2, X = np.linalg.eigh(L @ S @ L.T)
    X = L.T @ X
    start = keeps_volume.T @ np.append(np.full(m, START["level"]), START["box"])
    return np.sqrt(w2), (keeps_volume @ X)[m] * (X.T @ M @ start)


def main():
    for n in (10, 20):
        w, a = modes(n)
        k = np.argmax(np.abs(a))
        print(f"{n} elements: period {2 * np.pi / w[k]:.4f} s, amplitude {1e3 * a[k]:.3f} mm")
    t = np.arange(0.0, 3.0001, 0.01)
    y = np.cos(np.outer(t, w)) @ a - START["box"]
    with open(Path(__file__).with_name("linear_waves.csv"), "w") as out:
        out.write(f"# Displacement of the bottom of the box by linear potential flow, made by linear_waves.py. Heave mode: period {2 * np.pi / w[k]:.4f} s,\n"
                  f"# amplitude {1e3 * a[k]:.2f} mm about -6 mm; nothing damps it.\nt_s,u_m\n")
        out.writelines(f"{a_:.2f},{b_:.6g}\n" for a_, b_ in zip(t, y))


if __name__ == "__main__":
    main()
