#!/usr/bin/python3
"""Heave of the box in the fluid's own discretisation, linear and without remeshes, stabilisers and contact: what the mesh alone makes of the period.

Linear triangles on a lattice, lumped mass, one pressure per node from its volume (docs/theory.md), sound speed 16 m/s, hydrostatic rest with its geometric stiffness;
half the tank. Nodes on the box go with it normal to its faces; `corner`: the node there is held, or slides along the bottom, or along the side. Needs python3-scipy.
Prints spacing, corner, period; linear potential flow has 0.670 s.
"""
import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import eigsh

G, RHO, C = 9.81, 1000.0, 16.0
TANK, BOX, LEVEL, BOTTOM = 0.25, 0.1, 0.254, 0.204  # m, half widths
MASS = 0.5 * RHO * BOX * 0.1                        # kg/m, half the box


def lattice(h):
    x = np.linspace(0.0, TANK, round(TANK / h) + 1)
    below = round(BOTTOM / h)
    y = np.concatenate([np.linspace(0.0, BOTTOM, below + 1), np.linspace(BOTTOM, LEVEL, max(1, round((LEVEL - BOTTOM) / h)) + 1)[1:]])
    half = round(BOX / h)
    number, points, triangles = {}, [], []
    for j in range(len(y)):
        for i in range(len(x)):
            if j <= below or i >= half:
                number[i, j] = len(points)
                points.append((x[i], y[j]))
    for j in range(len(y) - 1):
        for i in range(len(x) - 1):
            if j >= below and i < half:
                continue
            a, b, c, d = (number[k] for k in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)))
            triangles += [(a, b, c), (a, c, d)] if (i + j) % 2 == 0 else [(a, b, d), (b, c, d)]
    return np.array(points), np.array(triangles), number, half, below, len(x) - 1


def period(h, corner):
    x, triangles, number, half, below, last = lattice(h)
    n = len(x)
    p = RHO * G * (LEVEL - x[:, 1])
    first, second = x[triangles[:, 1]] - x[triangles[:, 0]], x[triangles[:, 2]] - x[triangles[:, 0]]
    area = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    V = np.zeros(n)
    np.add.at(V, triangles, (area / 3.0)[:, None])

    def matrix(entries, shape):
        row, column, value = (np.concatenate([e[k] for e in entries]) for k in range(3))
        return sparse.csr_matrix((value, (row, column)), shape=shape)

    change, turning = [], []  # dV/du; -p d2V/du2
    for k in range(3):
        side = x[triangles[:, (k + 2) % 3]] - x[triangles[:, (k + 1) % 3]]
        for a in range(3):
            change += [(triangles[:, a], 2 * triangles[:, k], -side[:, 1] / 6.0), (triangles[:, a], 2 * triangles[:, k] + 1, side[:, 0] / 6.0)]
        a, b, pressed = triangles[:, k], triangles[:, (k + 1) % 3], 0.5 * p[triangles].mean(axis=1)
        for i, j, value in ((2 * a, 2 * b + 1, -pressed), (2 * b, 2 * a + 1, pressed)):
            turning += [(i, j, value), (j, i, value)]
    D = matrix(change, (n, 2 * n))
    K = D.T @ sparse.diags(RHO * C * C / V) @ D + matrix(turning, (2 * n, 2 * n))
    entries, free = [], 1  # unknown 0 is the box
    for (i, j), node in number.items():
        fixed = [i in (0, last), j == 0]
        with_box = j == below and i <= half
        if i == half and j == below:
            with_box = corner != "side"
            fixed[0] = corner != "bottom"
        elif i == half and j > below:
            fixed[0] = True
        for k in range(2):
            if k == 1 and with_box:
                entries.append((2 * node + 1, 0))
            elif not fixed[k]:
                entries.append((2 * node + k, free))
                free += 1
    Q = sparse.csr_matrix((np.ones(len(entries)), tuple(zip(*entries))), shape=(2 * n, free))
    M = (Q.T @ sparse.diags(np.repeat(RHO * V, 2)) @ Q).tolil()
    M[0, 0] += MASS
    w2, modes = eigsh((Q.T @ K @ Q).tocsc(), k=12, M=M.tocsc(), sigma=0.9 * (2.0 * np.pi / 0.67) ** 2)
    return 2.0 * np.pi / np.sqrt(abs(w2[np.argmax(modes[0] ** 2)]))


if __name__ == "__main__":
    for spacing in (0.02, 0.01, 0.005):
        print(spacing, " ".join(f"{corner} {period(spacing, corner):.3f} s" for corner in ("held", "bottom", "side")), flush=True)
