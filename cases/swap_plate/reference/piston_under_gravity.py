#!/usr/bin/python3
"""Exact motion of a plate on springs under a column of water when gravity is switched on; writes the CSV beside it.

Example: piston_under_gravity.py > piston_under_gravity.csv

Acoustic column of height L and sound speed c, free at the top, on a plate of mass m and springs k (per area). Modes
phi = cos(w (L - y) / c) with  m w^2 = k - Z w tan(w L / c),  Z = rho c; under a uniform load -g from rest
u(0, t) = sum of -g Phi_n phi_n(0) / (M_n w_n^2) (1 - cos w_n t),  Phi_n = rho int phi + m phi(0),  M_n = rho int phi^2 + m phi(0)^2.
"""
import argparse

import numpy as np

RHO, K, L, M, SPRING, G = 1000.0, 2.2e9, 1.0, 1000.0, 1e9, 10.0
C = np.sqrt(K / RHO)


def bisect(f, low, high):
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if f(low) * f(middle) > 0 else (low, middle)
    return 0.5 * (low + high)


def frequencies(count):
    """Angular frequencies: one zero in each interval where cos(w L / c) keeps its sign."""
    def f(w):  # multiplied by the cosine: no poles
        return (M * w**2 - SPRING) * np.cos(w * L / C) + RHO * C * w * np.sin(w * L / C)
    edges = (np.arange(count + 1) - 0.5) * np.pi * C / L
    edges[0] = 1e-6
    return np.array([bisect(f, a * (1 + 1e-12), b * (1 - 1e-12)) for a, b in zip(edges[:-1], edges[1:])])


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    w = frequencies(400)
    a = w * L / C
    phi0 = np.cos(a)
    load = RHO * L * np.sin(a) / a + M * phi0
    modal_mass = RHO * L * (0.5 + np.sin(2 * a) / (4 * a)) + M * phi0**2
    amplitude = -G * load * phi0 / (modal_mass * w**2)
    t = np.linspace(0.0, 0.05, 1001)
    u = amplitude @ (1 - np.cos(np.outer(w, t)))
    u1 = amplitude[0] * (1 - np.cos(w[0] * t))
    print("# plate of 1000 kg/m2 on springs of 1e9 N/m3 under 1 m of water (rho 1000, K 2.2e9, free top), g = 10 m/s2 from t = 0")
    print(f"# exact modal solution, 400 modes: piston_under_gravity.py; f1, f2 = {w[0] / 2 / np.pi:.6f}, {w[1] / 2 / np.pi:.6f} Hz")
    print(f"# u1_m: first mode alone; static displacement {amplitude.sum():.9e} m = -(m + rho L) g / k")
    print("t_s,u_m,u1_m")
    for row in zip(t, u, u1):
        print("%.9g,%.12e,%.12e" % row)


if __name__ == "__main__":
    main()
